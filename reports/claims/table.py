"""The ledger as tables: the printed number, the measurement, the verdict, and how and at which scale it was judged."""

from harness.records.claims import Bound, Number, Pair
from reports.claims.claim_list import KINDS, tally
from reports.claims.ledger import Claim, by_cause
from reports.claims.psnr_table import ends_of
from reports.data.wording import NOTHING, UNTESTED, bare, count, counted, listed, number, signed, significant
from reports.page.grid import Column, Entry, Grid

BOUNDS: dict[Bound, str] = {"": "", "at least": "≥ ", "at most": "≤ "}
LOOKS = {
    "reproduced": ("✓", "holds"),
    "seen": ("✓", "holds"),
    "not reproduced": ("✕", "fails"),
    "not seen at this scale": ("✕", "fails"),
    "inconclusive": ("?", ""),
    UNTESTED: ("–", "muted"),
}
"""Verdict → its mark and tone."""


def chapters(claims: list[Claim], here: str) -> list[tuple[str, Grid]]:
    """Return title and grid of the tested claims of each kind; `here` is the run's scale, which rows do not repeat."""
    of_kind = {kind: [claim for claim in claims if claim.kind == kind and claim.verdict != UNTESTED] for kind in KINDS}
    return [
        (f"{KINDS[kind]} ({len(some)})", claims_grid(some, here, KINDS[kind])) for kind, some in of_kind.items() if some
    ]


def folds(claims: list[Claim]) -> list[tuple[str, list[str]]]:
    """Gather untested claims by what they need, as lines `Layers of the MLP (Table 1): 8, here 6`."""

    def line(claim: Claim) -> str:
        here = f", here {measured_text(claim)}" if claim.measured is not None else ""
        return f"{claim.statement} ({claim.source}): {printed_text(claim)}{here}"

    return [(sentence, [line(claim) for claim in some]) for sentence, some in by_cause(claims)]


def in_a_sentence(claims: list[Claim]) -> str:
    """Format `Of 58 statements in the ledger: 10 reproduced, 4 not reproduced and 38 not tested.`, or nothing."""
    words = [f"{many} {verdict}" for verdict, many in tally(claims)]
    return f"Of {counted(len(claims), 'statement')} in the ledger: {listed(words)}." if claims else ""


def claims_grid(claims: list[Claim], here: str, caption: str = "Printed and measured") -> Grid:
    columns = [
        Column("claim", numeric=False),
        Column("printed", small="where"),
        Column("measured", small="interval"),
        Column("verdict", small="scale, where another", numeric=False),
        Column("how it is measured", numeric=False),
    ]
    rows = []
    for claim in claims:
        mark, tone = LOOKS[claim.verdict]
        verdict = Entry(f"{mark} {claim.verdict}", "" if claim.scale == here else claim.scale, tone)
        printed = printed_entry(claim, claim.source.replace(", ", "\n"))
        rows.append([Entry(claim.statement), printed, measured_entry(claim), verdict, Entry(claim.how, claim.note)])
    # a filter that hid verdicts would make the claims look untested
    return Grid(caption, columns, rows, filtered=False)


def printed_entry(claim: Claim, small: str = "") -> Entry:
    """Return the printed number; saved files give its unit in a separate column."""
    value, parts = _numbers(claim.printed)
    unit = claim.unit if claim.printed is not None and claim.unit else None
    return Entry(printed_text(claim), small, value=value, parts={**parts, "unit": unit})


def measured_entry(claim: Claim) -> Entry:
    value, parts = _numbers(claim.measured)
    pair = claim.interval if claim.measured is not None else None
    between = f"[{', '.join(_value(claim, end, _finer(claim)) for end in pair)}]" if pair else ""
    return Entry(measured_text(claim), between, value=value, parts={**parts, **ends_of(pair)}, runs=claim.runs)


def _numbers(value: Number | Pair | None) -> tuple[Number | None, dict[str, float | None]]:
    return (None, {"from": value[0], "to": value[1]}) if isinstance(value, tuple) else (value, {})


def link_of(claim: Claim) -> str:
    """Return the word between a statement and its number: a saving is *by* a percentage."""
    return "by" if claim.unit == "%" else "is"


def printed_text(claim: Claim) -> str:
    """Format a printed number: +1.2 to +1.8 dB, +1.4 dB, 33.0 dB, 257, 18 %, 4.2 h."""
    if claim.printed is None:
        return "no number" if claim.kind != "others" else NOTHING
    return BOUNDS[claim.bound] + _text(claim, claim.printed, claim.digits)


def measured_text(claim: Claim) -> str:
    as_printed = isinstance(claim.measured, tuple) and not _is_difference(claim)
    return _text(claim, claim.measured, claim.digits if as_printed else _finer(claim))


def _text(claim: Claim, value: Number | Pair | None, digits: int) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, tuple):
        return f"{' to '.join(_value(claim, end, digits) for end in value)} {claim.unit}".strip()
    return f"{_value(claim, value, digits)} {claim.unit if claim.unit in ('dB', '%', 'h', '×') else ''}".strip()


def _is_difference(claim: Claim) -> bool:
    return claim.kind == "gains" and claim.unit != "%"


def _finer(claim: Claim) -> int:
    """Return one decimal more than printed, if the figure has decimals at all; percentages get one."""
    return 1 if claim.unit == "%" else claim.digits + 1 if claim.digits else 0


def _value(claim: Claim, value: Number, digits: int) -> str:
    if _is_difference(claim):
        return signed(value, digits)
    if claim.kind == "others":
        return bare(value)
    if claim.unit == "×":
        return significant(value)
    return number(value, digits) if digits else count(round(value)) if abs(value) >= 1 else number(value, 0)
