"""The first screen: the question, the answer, its certainty, its scale, and what was not tested.

It is built from the ledger, the run's comparisons and, if it lies beside, the evidence; it computes nothing.
"""

from dataclasses import dataclass

from harness.records.study import Check, Studies
from reports.claims.estimands import SENSES, between, sense_of
from reports.claims.estimands import said as difference_said
from reports.claims.headline import roles, smallest_detectable
from reports.claims.ledger import Claim, by_cause
from reports.claims.table import MARKS, TONES, in_a_sentence, measured_entry, printed_entry, printed_text
from reports.data.beside import Beside
from reports.data.load import Records
from reports.data.scale import in_a_line
from reports.data.wording import NARROW, NOTHING, UNTESTED, listed, number
from reports.page.grid import Entry

PRINCIPAL = {
    "table2-average": "PSNR gain, average",
    "abstract-psnr-range": "PSNR gain, scene by scene",
    "abstract-faster": "fewer iterations to 30 dB",
    "table4-nerf_phi_encoding-psnr": "φ encoding adds, on lego",
    "table4-nerf_phi_encoding_amplifier-psnr": "then the amplifier",
    "table4-qnerf-psnr": "then the φ skip",
    "table1-total": "weights of Table 1, counted",
}
"""The claims of the first screen, in a few words each."""

CALIBRATION = "calibration"
"""The study of the evidence that tests the comparer."""


@dataclass(frozen=True)
class Line:
    """One principal claim."""

    words: str
    source: str
    printed: Entry
    measured: Entry
    """The measurement with its interval, and the runs of this report behind it."""
    verdict: str
    mark: str
    tone: str
    note: str
    """The qualification of the verdict, and the scale if it is not the run's."""


@dataclass(frozen=True)
class FirstScreen:
    question: str
    lines: list[Line]
    sure: list[str]
    """The certainty of the answer: sentences, made from figures."""
    untested: list[str]
    """The untested claims and their needs: a sentence per cause."""
    tally: str
    """The count of the complete ledger's statements by verdict."""


def first_screen(records: Records, found: list[Claim], beside: Beside) -> FirstScreen:
    by_id = {claim.id: claim for claim in found}
    shown = {words: by_id[name] for name, words in PRINCIPAL.items() if name in by_id}
    here = in_a_line(records)
    return FirstScreen(
        question(records, by_id),
        [_line(words, claim, here) for words, claim in shown.items() if claim.verdict != UNTESTED],
        how_sure(records, beside.evidence),
        [sentence for sentence, _ in by_cause(list(shown.values()))],
        in_a_sentence(found),
    )


def question(records: Records, by_id: dict[str, Claim]) -> str:
    """Return the paper's claim as a question; without its numbers, what this run can answer."""
    gain, faster = by_id.get("abstract-psnr-range"), by_id.get("abstract-faster")
    if gain and faster and "qnerf" in records.methods:
        speed = printed_text(faster).replace(" ", NARROW)
        return f"Does Q-NeRF gain {printed_text(gain)} over NeRF and converge {speed} faster, as printed?"
    cast = roles(records)
    if not cast.contenders:
        return f"How does {cast.baseline} do?"
    return f"How {'do' if len(cast.contenders) > 1 else 'does'} {listed(cast.contenders)} compare with {cast.baseline}?"


def _line(words: str, claim: Claim, here: str) -> Line:
    # its first sentence; the other notes on a study's cells stand with the study
    elsewhere = claim.scale.split(". ")[0] if claim.scale != here else ""
    return Line(
        words,
        claim.source,
        printed_entry(claim),
        measured_entry(claim),
        claim.verdict,
        MARKS[claim.verdict],
        TONES[claim.verdict],
        "; ".join(filter(None, [claim.note, elsewhere])),
    )


def how_sure(records: Records, evidence: Studies | None) -> list[str]:
    """The interval of the answer, what could have gone unnoticed, and how often the comparer itself errs."""
    said = []
    cast = roles(records)
    one = records.comparison("all", cast.contenders[0], cast.baseline) if cast.contenders else None
    if one is not None and one.difference is not None:
        sentence, sense = difference_said(one, records.scenes, records.run.seeds), sense_of(one)
        said.append(f"{sentence}. The verdict is {sense}.")
        here = one.on_these_scenes
        if sense != SENSES["on_these_scenes"] and here is not None and here.interval is not None:
            said.append(f"On these scenes alone, the interval is {between(here.interval)} dB ({here.verdict}).")
    said += filter(None, [smallest_detectable(records)])
    return [*said, *calibration(evidence)]


def calibration(evidence: Studies | None) -> list[str]:
    """What the study of the intervals found, and each check that does not hold; or that there was no study."""
    study = evidence.study(CALIBRATION) if evidence else None
    if study is None:
        return ["The intervals' own error rate was not checked beside this run (`nox -s evidence` does)."]
    return [*study.answers[:1], *(_checked(check) for check in study.checks if not check.holds)]


def _checked(check: Check) -> str:
    digits = _enough(check)
    figure = NOTHING if check.value is None else _figure(check.value, check, digits)
    limits = [
        f"{words} {_figure(limit, check, _least(check))}"
        for words, limit in (("at least", check.low), ("at most", check.high))
        if limit is not None
    ]
    wanted = f" (wanted: {' and '.join(limits)})" if limits else ""
    failed = "" if check.holds else " – this check does not hold"
    return f"Comparer: {check.what}: {figure}{wanted}{failed}."


def _figure(value: float, check: Check, digits: int) -> str:
    """Format a share as a percentage."""
    if _is_share(check):
        return f"{number(100 * value, digits)}{NARROW}%"
    return f"{number(value, digits)}{NARROW}{check.unit}".strip()


def _is_share(check: Check) -> bool:
    return check.what.startswith("share") and not check.unit


def _least(check: Check) -> int:
    return 1 if _is_share(check) else 2


def _enough(check: Check) -> int:
    """Decimals that tell a figure that fails from its limits."""
    least, figure = _least(check), check.value
    if figure is None or check.holds:
        return least
    limits = [limit for limit in (check.low, check.high) if limit is not None]
    enough = (
        digits
        for digits in range(least, 16)
        if all(_figure(figure, check, digits) != _figure(limit, check, digits) for limit in limits)
    )
    return next(enough, 16)
