"""Table 4: what each part adds to the row above it, on lego.

The run's own comparison is judged where it has one, else the effect of the factorial study, which trains every
combination of the parts. Listing 2 is the paper's amplifier; the effect of Eq. 4 stands beside it.
"""

from dataclasses import replace

from harness.records.study import Effect, Studies
from reports.claims.ledger import LEAST_PAIRS, MARGINS, Bench, Finding, Printed, judge_gain
from reports.claims.scores import PAIRED, gain
from reports.data.wording import UNTESTED, counted, interval, signed

STUDY = "factorial"
TRUSTED_BY = (STUDY, "calibration")
"""The studies whose checks must hold before an effect may be believed."""
EQUATION_4 = {"nerf_phi_encoding_amplifier": "nerf_phi_encoding_equation4", "qnerf": "qnerf_theorem"}
"""The same row of Table 4 with the other reading of the amplifier."""
NEEDS_STUDY = "need the ablation study: `nox -s evidence -- --out out/latest`"


def added_part(bench: Bench, entry: Printed) -> Finding:
    """Return one row of Table 4 less the row above it."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    found = gain(bench, entry)
    effect = effect_of(bench.evidence, scene, method, against, metric)
    if found.verdict != UNTESTED or bench.evidence is None or effect is None:
        return replace(found, note=NEEDS_STUDY) if found.verdict == UNTESTED else found
    study, about = bench.evidence.study(STUDY), effect.on_these_scenes
    pair = (about.simultaneous or about.interval) if about and effect.pairs >= LEAST_PAIRS else None
    printed = entry.printed if isinstance(entry.printed, int | float) else float("nan")
    notes = [
        _other_reading(bench.evidence, scene, method, against, metric, entry.digits),
        f"{counted(effect.unpaired, 'pair')} could not be judged" if effect.unpaired else "",
        doubts(bench.evidence),
    ]
    return Finding(
        judge_gain(printed, MARGINS[metric], pair, False),
        PAIRED.format(metric=metric.upper(), units="seed"),
        effect.difference,
        pair,
        study.scale if study else "",
        "; ".join(filter(None, notes)),
    )


def doubts(evidence: Studies) -> str:
    """What speaks against taking the study's effects as they stand; nothing where nothing does."""
    failed = [
        f"{sum(not check.holds for check in study.checks)} of {counted(len(study.checks), 'check')} of {name}"
        for name in TRUSTED_BY
        if (study := evidence.study(name)) and not all(check.holds for check in study.checks)
    ]
    parts = [] if evidence.finished else ["the evidence was not finished"]
    parts += [f"{' and '.join(failed)} failed"] if failed else []
    return "; ".join(parts)


def effect_of(evidence: Studies | None, scene: str, method: str, against: str, metric: str) -> Effect | None:
    """At equal steps, from the factorial study; a quick one says nothing."""
    study = evidence.study(STUDY) if evidence and not evidence.is_quick else None
    wanted = (method, against, scene, metric, "steps")
    found = (one for one in (study.effects if study else []) if one.difference is not None)
    return next((one for one in found if (one.name, one.against, one.scene, one.metric, one.budget) == wanted), None)


def _other_reading(evidence: Studies, scene: str, method: str, against: str, metric: str, digits: int) -> str:
    """The same with the amplifier of Eq. 4, where the row has an amplifier."""
    if method not in EQUATION_4:
        return ""
    one = effect_of(evidence, scene, EQUATION_4[method], EQUATION_4.get(against, against), metric)
    if one is None:
        return ""
    shown = f"{signed(one.difference, digits + 1)} {interval(one.simultaneous or one.interval, digits + 1)}".strip()
    return f"with the amplifier of Eq. 4: {shown} ({one.verdict})"
