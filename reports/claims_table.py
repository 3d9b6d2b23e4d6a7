"""The paper's claims as a table: printed, measured, verdict, and at which scale."""

from reports.claims import UNTESTED, Claim, claims
from reports.grid import Column, Entry, Grid
from reports.load import Records
from reports.scale import in_a_line
from reports.wording import NOTHING, count, interval, number, signed

TONES = {"holds": "holds", "does not hold": "fails", "inconclusive": "", UNTESTED: "muted"}


def claims_grid(records: Records) -> Grid:
    """A row a claim. The scale is the run's and stands above the table, except where it is another."""
    columns = [Column("source", numeric=False), Column("claim", numeric=False), Column("printed")]
    columns += [Column("measured"), Column("verdict", numeric=False)]
    rows = []
    here = in_a_line(records)
    for claim in claims(records):
        scale = "" if claim.verdict == UNTESTED else "at this run’s scale" if claim.scale == here else claim.scale
        row = [Entry(claim.source), Entry(claim.statement, claim.note), Entry(printed_text(claim))]
        row.append(Entry(measured_text(claim), interval_text(claim)))
        row.append(Entry(claim.verdict, scale, TONES[claim.verdict]))
        rows.append(row)
    return Grid("Printed and measured", columns, rows)


def printed_text(claim: Claim) -> str:
    """+1.2 to +1.8 dB, +1.4 dB, 257 weights, 18 %."""
    if claim.printed is None:
        return NOTHING
    if isinstance(claim.printed, tuple):
        return f"{signed(claim.printed[0], claim.digits)} to {signed(claim.printed[1], claim.digits)} {claim.unit}"
    return _with_unit(claim, claim.printed, claim.digits)


def measured_text(claim: Claim) -> str:
    return NOTHING if claim.measured is None else _with_unit(claim, claim.measured, _finer(claim))


def interval_text(claim: Claim) -> str:
    if claim.interval is None:
        return ""
    if claim.unit == "%":
        return f"[{number(claim.interval[0], 0)}, {number(claim.interval[1], 0)}]"
    return interval(claim.interval, _finer(claim))


def _finer(claim: Claim) -> int:
    return {1: 2, 3: 4}.get(claim.digits, claim.digits)


def _with_unit(claim: Claim, value: int | float, digits: int) -> str:
    if claim.unit in ("weights", "lines"):
        return count(round(value))
    text = number(value, digits) if claim.unit == "%" else signed(value, digits)
    return f"{text} {claim.unit}".strip()
