"""The first screen: the question, the answer, its certainty, its scale, and what was not tested.

It is built from the ledger, the run's comparisons and the evidence, if there is a record; it computes nothing.
"""

from dataclasses import dataclass
from statistics import fmean
from typing import NamedTuple

from harness.records.cells import Comparison
from harness.records.claims import STATED, Statement
from harness.records.study import Studies
from reports.claims.estimands import SENSES, between, difference_in_words
from reports.claims.ledger import Claim, by_cause
from reports.claims.table import LOOKS, in_a_sentence, link_of, measured_entry, printed_entry, printed_text
from reports.data.load import Records
from reports.data.scale import in_a_line
from reports.data.studies_load import ShelfRecords
from reports.data.wording import NARROW, UNTESTED, counted, listed, number
from reports.page.grid import Entry
from reports.studies.check_words import describe

MAX_CLAIMS = 8


@dataclass(frozen=True)
class Line:
    words: str
    printed: Entry
    measured: Entry
    """The measurement with its interval, and the runs of this report behind it."""
    verdict: str
    mark: str
    tone: str
    note: str
    """The qualification of the verdict, and the scale if it is not the run's."""


class FirstScreen(NamedTuple):
    question: str
    claimed: str
    """The verdict on the first claim that has one; empty if the heading answers a stated claim."""
    lines: list[Line]
    sure: list[str]
    guests: str
    untested: list[str]
    tally: str


def first_screen(records: Records, claims: list[Claim], shelves: ShelfRecords) -> FirstScreen:
    shown, here, lines = principal(records, claims), in_a_line(records), []
    for words, claim in shown:
        if claim.verdict != UNTESTED:
            # the first sentence; the page of the study has the rest
            elsewhere = claim.scale.split(". ")[0] if claim.scale != here else ""
            note = "; ".join(filter(None, [claim.note, elsewhere]))
            figures = printed_entry(claim), measured_entry(claim)
            lines.append(Line(words, *figures, claim.verdict, *LOOKS[claim.verdict], note))
    is_in_the_heading = any(claim.file == STATED for _, claim in shown)
    return FirstScreen(
        question(records, claims),
        _verdict_on(lines[0]) if lines and not is_in_the_heading else "",
        lines,
        how_sure(records, shelves.evidence),
        guests(records),
        [sentence for sentence, _ in by_cause([claim for _, claim in shown])],
        in_a_sentence(claims),
    )


def _verdict_on(line: Line) -> str:
    return f"{line.words}: claimed {line.printed.text}, {line.verdict}"


def principal(records: Records, claims: list[Claim]) -> list[tuple[str, Claim]]:
    """Return the claims of the first screen with their words: those that a file chooses, else its first ones."""
    chosen = []
    for file in records.run.claims or []:
        own = {claim.id: claim for claim in claims if claim.file == file.id}
        words = file.principal or {name: own[name].statement for name in list(own)[:MAX_CLAIMS]}
        chosen += [(words[name], own[name]) for name in words if name in own]
    return chosen


def question(records: Records, claims: list[Claim]) -> str:
    """Return what a file of claims asks, or whether a stated claim holds, or how the methods of this run compare."""
    for file in records.run.claims or []:
        of_file = {claim.id: claim for claim in claims if claim.file == file.id}
        own = {name: printed_text(claim).replace(" %", f"{NARROW}%") for name, claim in of_file.items()}
        if file.question and set(file.methods) & set(records.methods):
            asked = file.question
            for name, text in own.items():
                asked = asked.replace(f"{{{name}}}", text)
            return asked
        if file.id == STATED and len(file.claims) == 1:
            ((name, stated),) = of_file.items()
            return f"Does it hold that {stated.statement} {link_of(stated)} {own[name]}?"
        if file.id == STATED:
            return f"Do the {len(file.claims)} stated claims hold?"
    baseline, contenders = records.baseline, records.contenders
    if not contenders:
        return f"How does {baseline} do?"
    return f"How {'do' if len(contenders) > 1 else 'does'} {listed(contenders)} compare with {baseline}?"


def guests(records: Records) -> str:
    """State what methods of other families reach in the core seconds of the baseline, and what given Gaussians do."""
    return ". ".join(filter(None, (_guest(records, name) for name in records.run.guests)))


def _guest(records: Records, name: str) -> str:
    pairs = []
    for cell in records.guest_cells:
        for rival in records.cells_of(cell.scene, records.baseline):
            scores = cell.scores.get("psnr"), rival.scores.get("psnr"), cell.train_core_seconds
            if (cell.method, cell.seed) == (name, rival.seed) and None not in scores:
                pairs.append(scores)
    if not pairs:
        return ""
    theirs, ours, spent = (fmean(float(pair[place] or 0.0) for pair in pairs) for place in range(3))
    scenes, baseline = counted(len(pairs), "scene"), records.baseline
    if all(cell.steps == 0 for cell in records.guest_cells if cell.method == name):
        reached = f"{number(theirs)} dB as given, {baseline} {number(ours)} dB"
        return f"{name} reaches {reached} ({scenes}; trained elsewhere, not judged)"
    return (
        f"{name} reaches {number(theirs)} dB with the same core seconds as {baseline}, which reaches {number(ours)} dB "
        f"({scenes}, {spent:.0f} core seconds per cell; one seed, not judged)"
    )


def how_sure(records: Records, evidence: Studies | None) -> list[str]:
    sentences = []
    stated = next((file.claims[0] for file in records.run.claims or [] if file.id == STATED), None)
    if stated is not None:
        row = _compared(records, stated)
    else:
        row = records.comparison("all", records.contenders[0], records.baseline) if records.contenders else None
    if row is not None and row.difference is not None:
        like, here = row.scenes_like_these, row.on_these_scenes
        sense = (
            f"The {'interval' if stated else 'verdict'} is {SENSES['scenes_like_these' if like else 'on_these_scenes']}"
        )
        claim = "; the claim is judged on only these scenes" if stated and like else ""
        sentences.append(f"{difference_in_words(row, records.scenes, records.run.seeds)}. {sense}{claim}.")
        if like and here is not None and here.simultaneous is not None:
            known = f"{between(here.simultaneous)} dB ({here.verdict.phrase})"
            sentences.append(f"On only these scenes, the interval is {known}.")
    if row is not None and row.smallest_detectable is not None:
        least = number(row.smallest_detectable)
        sentences.append(f"The sign of a true difference below {least} dB could have stayed open (power 80 %).")
    return [*sentences, *calibration(evidence)]


def _compared(records: Records, claim: Statement) -> Comparison | None:
    """Return the comparison of PSNR over all scenes that a stated claim is about, if it is about that."""
    about = claim.of
    if claim.quantity != "gain" or (about["scene"], about["metric"]) != ("all", "psnr"):
        return None
    return records.comparison("all", about["method"], about["against"])


def calibration(evidence: Studies | None) -> list[str]:
    study = evidence.study("calibration") if evidence else None
    if study is None:
        return ["The intervals' own error rate was not checked in this run (`nox -s evidence` does)."]
    broken = [check for check in study.checks if not check.holds]
    return [*study.answers[:1], *(f"Comparer: {describe(check)} – this check does not hold." for check in broken)]
