"""The paper's printed numbers, each with what was measured here and a verdict. Never a silent pass.

A printed difference is judged by the interval of the measured one:
*does not hold* where the interval ends below everything that rounds to the printed value,
*holds* where it lies at or above that range, *inconclusive* where it reaches into it or across it.
The scale stands beside each: at another scale than the paper's, a verdict is about that scale.

`RunRecord.paper` holds the printed numbers; what it lacks is not judged:
    table1, parameters_measured   {component: weights}: printed, counted at the paper's size
    table2               {scene: {"nerf": dB, "qnerf": dB}}
    table3               {"iterations_to_30_db": {"nerf", "qnerf"}, "hours_to_30_db": {"nerf", "qnerf"}}
    table4               [{"method", "configuration", "psnr", "ssim"}], the baseline first
    sloc, sloc_measured  lines of the core module: printed, ours
"""

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import mean
from typing import Any, Literal

from harness.records import Comparison
from reports.headline import roles
from reports.load import Records
from reports.scale import in_a_line
from reports.table import curves_frame
from reports.time_to_target import savings as savings_of
from reports.wording import count, counted, interval, signed

Verdict = Literal["holds", "does not hold", "inconclusive", "not tested at this scale"]
UNTESTED: Verdict = "not tested at this scale"
TARGET_DB = 30.0
COMPONENTS = {
    "density_net": "density MLP",
    "density_head": "density head",
    "colour_net": "colour MLP",
    "amplifier": "amplifier",
    "total": "total",
}


@dataclass(frozen=True)
class Claim:
    id: str
    source: str
    statement: str
    printed: int | float | tuple[float, float] | None
    measured: int | float | None
    interval: tuple[float, float] | None
    scale: str
    verdict: Verdict
    unit: str = ""
    digits: int = 1
    note: str = ""


def claims(records: Records) -> list[Claim]:
    """Every printed number that this project knows of, in the paper's order."""
    scale = in_a_line(records)
    return [
        *_abstract(records, scale),
        *_table1(records, scale),
        *_table2(records, scale),
        *_table3(records, scale),
        *_table4(records, scale),
        *_lines_of_code(records, scale),
        _retrieval(scale),
    ]


def half_unit(printed: int | float) -> float:
    """Half of the last printed digit: what may have been rounded away. 1.4 → 0.05, 257 → 0.5, 67 000 → 500."""
    if isinstance(printed, int) or float(printed).is_integer():
        digits = str(abs(int(printed)))
        zeros = len(digits) - len(digits.rstrip("0")) if digits != "0" else 0
        return 0.5 * 10**zeros
    decimals = len(repr(float(printed)).split(".")[1])
    return 0.5 * 10**-decimals


def judge_comparison(printed: float, rounding: float, one: Comparison | None) -> Verdict:
    """A printed gain against a comparison; where cells were lost, their survivors settle nothing."""
    if one is None or one.difference is None:
        return UNTESTED
    return (
        "inconclusive" if one.left_aside or one.interval is None else judge_difference(printed, rounding, one.interval)
    )


def judge_difference(printed: float, rounding: float, measured: tuple[float, float] | None) -> Verdict:
    """A printed gain against the interval of the measured one."""
    if measured is None:
        return UNTESTED
    low, high = measured
    if high < printed - rounding:
        return "does not hold"
    return "holds" if low >= printed - rounding else "inconclusive"


def _difference_claim(
    ident: str, source: str, statement: str, printed: float, rounding: float, one: Comparison | None, scale: str
) -> Claim:
    pair = one.interval if one else None
    measured = one.difference if one else None
    unit, digits = ("dB", 1) if one is None or one.metric == "psnr" else ("", 3)
    verdict = judge_comparison(printed, rounding, one)
    return Claim(ident, source, statement, printed, measured, pair, scale, verdict, unit, digits)


def _matched_note(records: Records, scene: str) -> str:
    """What is left of a gain over the baseline once bandwidth is matched, and what could not be paired."""
    cast = roles(records)
    parts = []
    over_baseline = records.comparison(scene, "qnerf", "nerf")
    if over_baseline and over_baseline.left_aside:
        parts.append(f"{counted(over_baseline.left_aside, 'cell')} without a score")
    one = records.comparison(scene, "qnerf", cast.control) if cast.control else None
    if one is not None and one.difference is not None:
        shown = f"{signed(one.difference)} {interval(one.interval)}".strip()
        parts.append(f"against {cast.control}: {shown} ({one.verdict})")
    return "; ".join(parts)


def _average_note(records: Records) -> str:
    """The same for the mean over scenes, with the scenes that it lacks."""
    missing = [scene.lower() for scene in _printed_gains(records) if scene.lower() not in records.scenes]
    return "; ".join(filter(None, [f"without {', '.join(missing)}" if missing else "", _matched_note(records, "all")]))


def _abstract(records: Records, scale: str) -> Iterator[Claim]:
    printed = _printed_gains(records)
    if not printed:
        return
    low, high = min(printed.values()), max(printed.values())
    one = records.comparison("all", "qnerf", "nerf")
    verdict = judge_comparison(low, half_unit(low), one)
    yield Claim(
        "abstract-psnr-range",
        "Abstract",
        "PSNR improves over vanilla NeRF by this much on average over the scenes",
        (low, high),
        one.difference if one else None,
        one.interval if one else None,
        scale,
        verdict,
        "dB",
        note=_average_note(records),
    )


def _printed_gains(records: Records) -> dict[str, float]:
    table = records.run.paper.get("table2") or {}
    return {
        scene: round(row["qnerf"] - row["nerf"], 1)
        for scene, row in table.items()
        if isinstance(row, dict) and {"nerf", "qnerf"} <= set(row) and scene.lower() not in ("average", "all")
    }


def _table1(records: Records, scale: str) -> Iterator[Claim]:
    """Counted at the paper's own size: no training is needed, so the scale of the run does not matter."""
    printed = records.run.paper.get("table1") or {}
    measured = records.run.paper.get("parameters_measured") or {}
    for component, weights in printed.items():
        if not isinstance(weights, int | float):
            continue
        ours = measured.get(component)
        verdict: Verdict = UNTESTED
        if ours is not None:
            verdict = "holds" if abs(ours - weights) <= half_unit(weights) else "does not hold"
        note = "counted in the network as Table 1 describes it" if ours is not None else "not counted in this run"
        statement = f"Weights, {COMPONENTS.get(component, component)}"
        size = "the paper’s network" if ours is not None else scale
        yield Claim(f"table1-{component}", "Table 1", statement, weights, ours, None, size, verdict, "weights", 0, note)


def _table2(records: Records, scale: str) -> Iterator[Claim]:
    gains = _printed_gains(records)
    for scene, printed in gains.items():
        one = records.comparison(scene.lower(), "qnerf", "nerf")
        note = _matched_note(records, scene.lower())
        yield _noted(
            _difference_claim(
                f"table2-{scene.lower()}",
                "Table 2",
                f"Q-NeRF gains over NeRF on {scene.lower()}",
                printed,
                half_unit(printed),
                one,
                scale,
            ),
            note,
        )
    if gains:
        average = round(mean(gains.values()), 1)
        one = records.comparison("all", "qnerf", "nerf")
        statement = "Q-NeRF gains over NeRF on average"
        claim = _difference_claim("table2-average", "Table 2", statement, average, 0.05, one, scale)
        yield _noted(claim, _average_note(records))


def _noted(claim: Claim, note: str) -> Claim:
    return Claim(**{**claim.__dict__, "note": note})


def _table3(records: Records, scale: str) -> Iterator[Claim]:
    """Steps and time until the mean over all scenes reaches 30 dB."""
    table: dict[str, Any] = records.run.paper.get("table3") or {}
    kinds = (
        ("iterations_to_30_db", "step", "fewer iterations"),
        ("hours_to_30_db", "seconds", "less training time"),
    )
    for name, axis, words in kinds:
        row = table.get(name)
        if not isinstance(row, dict) or not {"nerf", "qnerf"} <= set(row):
            continue
        printed = float(round(100 * (1 - row["qnerf"] / row["nerf"])))
        savings = savings_of(curves_frame(records), axis, TARGET_DB)
        pair = (min(savings), max(savings)) if len(savings) > 1 else None
        verdict = judge_difference(printed, 0.5, pair) if savings else UNTESTED
        if savings and pair is None:
            verdict = "inconclusive"
        note = "range over seeds" if pair else "" if savings else f"not both methods reach {TARGET_DB:.0f} dB"
        measured = mean(savings) if savings else None
        statement = f"Q-NeRF needs this much {words} to reach {TARGET_DB:.0f} dB"
        yield Claim(
            f"table3-{name.split('_')[0]}", "Table 3", statement, printed, measured, pair, scale, verdict, "%", 0, note
        )


def _table4(records: Records, scale: str) -> Iterator[Claim]:
    """The cumulative ablation on lego, each row as its gain over the baseline."""
    rows = [row for row in records.run.paper.get("table4") or [] if isinstance(row, dict)]
    if len(rows) < 2:
        return
    base = rows[0]
    for row in rows[1:]:
        for metric, rounding, decimals in (("psnr", 0.05, 1), ("ssim", 0.0005, 3)):
            if metric not in row or metric not in base:
                continue
            printed = round(row[metric] - base[metric], decimals)
            method = row.get("method", "")
            one = records.comparison("lego", method, base.get("method", "nerf"), metric)
            statement = f"{row.get('configuration', method)} gains {metric.upper()} over the baseline on lego"
            yield _noted(
                Claim(
                    **{
                        **_difference_claim(
                            f"table4-{method or row.get('configuration')}-{metric}",
                            "Table 4",
                            statement,
                            printed,
                            rounding,
                            one,
                            scale,
                        ).__dict__,
                        "digits": decimals,
                        "unit": "dB" if metric == "psnr" else "",
                    }
                ),
                "" if one else f"{method or 'this combination'} was not compared on lego in this run",
            )


def _lines_of_code(records: Records, scale: str) -> Iterator[Claim]:
    printed = records.run.paper.get("sloc", 427)
    ours = records.run.paper.get("sloc_measured")
    note = "the authors' module is not published"
    if ours is not None:
        note += f"; the same parts here take {count(int(ours))}"
    statement = "Lines of the core module"
    yield Claim("abstract-sloc", "Abstract", statement, printed, None, None, scale, UNTESTED, "lines", 0, note)


def _retrieval(scale: str) -> Claim:
    note = "a cache keyed by the pose alone is not part of this comparison"
    statement = "Cached views are retrieved instantly"
    return Claim("section8.1-retrieval", "§8.1", statement, None, None, None, scale, UNTESTED, "", 1, note)
