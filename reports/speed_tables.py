"""A speed record → tables as plain data: the targets first, then every figure of a question."""

from dataclasses import dataclass

from harness.speed_record import QUESTIONS, Measurement, SpeedRecord
from reports.grid import EMPTY, Column, Entry, Grid
from reports.speed_wording import in_repetitions, outcome, spread, target
from reports.wording import NOTHING, counted, figure, with_unit

TONES = {True: "met", False: "missed", None: "unmeasured"}


@dataclass(frozen=True)
class Aim:
    """One target and what became of it."""

    title: str
    item: int
    question: str
    value: str
    spread: str
    target: str
    tone: str
    """`met`, `missed` or `unmeasured`."""
    outcome: str
    small: str


def question(item: int) -> str:
    return QUESTIONS.get(item, f"Question {item}")


def items(record: SpeedRecord) -> list[int]:
    """Questions that have something to show: in their own order, then those that this version does not know."""
    known = list(QUESTIONS)
    found = {one.item for one in record.measurements}
    found |= {one.item for one in record.series if one.x}
    found |= {one.item for one in record.tables if one.rows and one.columns}
    return sorted(found, key=lambda item: (known.index(item) if item in known else len(known), item))


def aims(record: SpeedRecord) -> list[Aim]:
    """Every target, by question."""
    order = items(record)
    chosen = sorted((one for one in record.measurements if one.target is not None), key=lambda m: order.index(m.item))
    return [
        Aim(
            title=one.title,
            item=one.item,
            question=question(one.item),
            value=with_unit(one.value, one.unit),
            spread=_repeated(one),
            target=target(one),
            tone=TONES[one.met],
            outcome=outcome(one),
            small=in_repetitions(one) if one.met is not None else one.detail or "no reason recorded",
        )
        for one in chosen
    ]


def _repeated(one: Measurement) -> str:
    if one.value is None:
        return ""
    return spread(one) or ("measured once" if one.repeats == 1 else counted(one.repeats, "repetition"))


def headline(found: list[Aim]) -> str:
    """How many targets are met, missed, and without a figure, which may be a miss as well."""
    if not found:
        return "Speed of training and rendering"
    met, missed, unmeasured = (sum(one.tone == tone for one in found) for tone in ("met", "missed", "unmeasured"))
    parts = [f"{met} of {counted(len(found), 'speed target')} met"]
    parts += [f"{missed} missed"] if missed else []
    parts += [f"{unmeasured} without a figure"] if unmeasured else []
    return ", ".join(parts)


def measurements_grid(record: SpeedRecord, item: int) -> Grid | None:
    """Every figure of a question; columns that would be empty are left out."""
    chosen = [one for one in record.measurements if one.item == item]
    if not chosen:
        return None
    with_spread = any(spread(one) for one in chosen)
    with_repeats = any(one.repeats > 1 for one in chosen)
    with_target = any(one.target is not None for one in chosen)
    columns = [Column("figure", numeric=False), Column("median" if with_repeats else "value")]
    columns += [Column("smallest – largest")] if with_spread else []
    columns += [Column("repetitions")] if with_repeats else []
    columns += [Column("target"), Column("outcome", numeric=False)] if with_target else []
    rows = []
    for one in chosen:
        row = [Entry(one.title, one.detail), _value(one)]
        row += [Entry(spread(one)) if spread(one) else EMPTY] if with_spread else []
        row += [Entry(figure(one.repeats)) if one.value is not None else EMPTY] if with_repeats else []
        if with_target:
            tone = TONES[one.met] if one.target is not None else "muted"
            row += [Entry(target(one)) if target(one) else EMPTY, Entry(outcome(one), in_repetitions(one), tone)]
        rows.append(row)
    return Grid(f"{question(item)}: figures", columns, rows)


def _value(one: Measurement) -> Entry:
    if one.value is None:
        return Entry(NOTHING, "no figure" if one.detail else "no figure, no reason recorded", "unmeasured")
    return Entry(with_unit(one.value, one.unit))
