"""A record of studies → a section of the report and a separate page, both self-contained, for every shelf.

Each kind of finding is shown in one way: answers as sentences, checks as rows and as a matrix, effects as forests,
lines as charts, tables as they are. `shelves` holds what differs between shelves.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from harness.records.study import Check, Finding, Series, Studies, StudyRecord, Table
from reports.data.wording import counted, duration, listed, of_any_size
from reports.drawing.figure import svg
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import Grid, table_grid
from reports.page.shell import Layout, Section, section
from reports.studies.check_words import LOOKS, OWNERS, Tone, anchor, checks_grid, describe, tone_of
from reports.studies.forest import effects_grid, forest_key, forests
from reports.studies.matrix import glance, groups, tones_of
from reports.studies.shelves import WORDS, ShelfWords, page_of
from scenes.files.atomic import write_atomically
from scenes.files.json_object import JsonObject

GROUPS = {"Cases": ("matrix", "stability-outcomes", "stability-studies"), "Figures and provenance": ()}
AT_ONCE = 4
"""The number of answers after the first that are not folded."""


class ShelfShown(NamedTuple):
    record: Studies
    words: ShelfWords
    headline: str
    sentences: list[str]
    broken: list[tuple[str, str]]
    """The anchor of the study, and the failed check of our own code."""
    sections: list[Section]


def shelf_shown(record: Studies) -> ShelfShown:
    broken = [(anchor(study), broken_line(study, check)) for study, check in record.broken]
    sections = [part for part in _sections(record) if part.parts]
    return ShelfShown(record, WORDS[record.shelf], headline(record), sentences(record), broken, sections)


def _sections(record: Studies) -> Iterator[Section]:
    words, layout = WORDS[record.shelf], Layout()
    parts, own = layout.parts, layout.study_parts

    def lay_out(name: str, findings: list[Finding]) -> list[Markup]:
        tables = [table_grid(finding, of_any_size) for finding in findings if isinstance(finding, Table)]
        drawn = charts([finding for finding in findings if isinstance(finding, Series)], name)
        return [parts.charts(drawn), *(parts.table(grid, own="own") for grid in tables)]

    def details(study: StudyRecord) -> list[Markup]:
        checks = checks_grid(f"Checks of {name_of(study, words)}", [(study, check) for check in study.checks])
        return [
            own.answers(study.answers[:1] * words.folded, study.answers[1 : 1 + AT_ONCE], study.answers[1 + AT_ONCE :]),
            *([parts.terms("about", about(study))] if words.folded else []),
            parts.table(checks, False, own="own checks"),
            _forests(study, of_interest(record), own),
            *lay_out(anchor(study), [] if words.chapters else study.findings),
            *([] if words.folded else [parts.folded("How it was measured", parts.terms("about", about(study)))]),
        ]

    if cases := groups(record):
        tones = {tone_of(check) for _, check in record.checks()}
        legend = [(tone, look.mark, look.meaning) for tone, look in LOOKS.items() if tone in tones]
        full = [own.matrix(words.noun[0], group, tally_of(tones_of(group))) for group in cases]
        yield section("matrix", "Case by case", own.glance(legend, *glance(record)), *full)
    tables = [(grid, parts.table(grid, not words.folded, own="own checks")) for grid in _tables(record)]
    outcomes = [parts.folded(grid.caption, table) if words.folded else table for grid, table in tables]
    yield section(f"{record.shelf}-outcomes", words.outcomes, *outcomes)
    every = [finding for study in record.studies for finding in study.findings if isinstance(finding, Series | Table)]
    numbers = {finding.item for finding in every} if words.chapters else set()
    for item in sorted(numbers, key=lambda item: (item not in words.chapters, item)):  # unknown chapters come last
        title, name = words.chapters.get(item, f"Chapter {item}"), f"chapter-{item}"
        yield section(name, title, *lay_out(name, [finding for finding in every if finding.item == item]), folded=True)
    if words.folded:
        folded = [_folded(study, own, name_of(study, words), details(study)) for study in record.studies]
        yield section(f"{record.shelf}-studies", f"Every {words.noun[0]} in full", *folded)
    else:
        for study in record.studies:
            answer = next(iter(study.answers), "")
            title, question = name_of(study, words), study.info.question
            yield section(anchor(study), title, *details(study), question=question, answer=answer)


def _folded(study: StudyRecord, own: Any, title: str, details: list[Markup]) -> Markup:
    """Lay out a study that is folded, unless one of its checks fails."""
    tones = [tone_of(check) for check in study.checks]
    laid_out: Markup = own.folded_study(anchor(study), title, "fails" in tones, tally_of(tones), details)
    return laid_out


def tally_of(tones: list[Tone]) -> list[tuple[Tone, str, int]]:
    return [(tone, look.mark, tones.count(tone)) for tone, look in LOOKS.items() if tone in tones]


def about(study: StudyRecord) -> list[tuple[str, str]]:
    """Return how a study was made, as pairs of a term and a text."""
    pairs = [("how", study.info.method), ("scale", _merged(study.scale))]
    pairs += [("passes if" if fact == "bar" else fact, text) for fact, text in study.info.facts.items()]
    pairs += [("took", f"{duration(study.seconds)} since its last start")] if study.seconds else []
    return [(term, text) for term, text in pairs if text]


def _merged(scale: str) -> str:
    """Say once what the scales of several runs share: `lego; 4 s | lego; 15 s` → `lego; 4 s, 15 s`."""
    scales = [each.split("; ") for each in scale.split(" | ")]
    if len({len(each) for each in scales}) > 1:
        return scale
    return "; ".join(", ".join(dict.fromkeys(facts)) for facts in zip(*scales, strict=True))


def _forests(study: StudyRecord, of_interest: dict[str, float], own: Any) -> Markup:
    """Lay out the forests of the first metric over all scenes; the others are folded."""
    if not study.effects:
        return Markup("")
    panels = forests(study.effects, of_interest)
    name, (metric, _, scene) = anchor(study), next(iter(panels))
    first: list[Chart] = []
    others: list[Chart] = []
    for place, (drawn, panel) in enumerate(panels.items()):
        shown = Chart(panel.title, [], svg(panel, f"{name}-forest-{place}"), [], wide=True)
        (first if (drawn[0], drawn[2]) == (metric, scene) else others).append(shown)
    laid_out: Markup = own.forests(first, forest_key(study.effects), others, effects_grid(study.effects))
    return laid_out


def headline(record: Studies) -> str:
    """State how many of the checks that count pass, how many are inconclusive, and how many have no figure."""
    words = WORDS[record.shelf]
    own = [check for _, check in record.checks() if check.owner == words.owner]
    judged = [check for check in own if is_judged(check)]
    undecided = sum(check.status == "inconclusive" for check in own)
    tried = len(judged) + undecided
    passed = sum(check.holds for check in judged)
    if not judged:
        return words.nothing or words.title
    noun, verb = (pair[tried > 1] for pair in (words.check, words.passes))
    if passed == tried:
        return f"All {passed} {noun} {verb}" if passed > 1 else f"The one {noun} {verb}"
    missing = sum(check.value is None for check in judged if not check.holds)
    rest = f", {undecided} inconclusive" if undecided else ""
    rest += f", {missing} without a figure" if missing else ""
    return f"{passed} of {tried} {noun} {words.passes[passed != 1]}{rest}"


def is_judged(check: Check) -> bool:
    """Return whether the check was tested; a figure of the machine without a target was not."""
    return check.status in ("pass", "fail") and (check.owner != "machine" or check.limit is not None)


def broken_line(study: StudyRecord, check: Check) -> str:
    return f"{study.info.id} {describe(check)}"


def sentences(record: Studies) -> list[str]:
    """State what was tried and where, what is open, what the paper's and the usual forms fail, and what was not tried.

    The headline counts the failures of our own code.
    """
    checks = [check for _, check in record.checks()]
    effects = sum(len(study.effects) for study in record.studies)
    subjects = {check.subject for check in checks if check.subject}
    parts = [
        counted(many, noun)
        for many, noun in ((len(checks), "check"), (len(subjects), "subject"), (effects, "effect"))
        if many
    ]
    with_parts = f" with {listed(parts)}" if parts else ""
    words = [f"{counted(len(record.studies), *WORDS[record.shelf].noun)}{with_parts}{_machine(record.provenance)}."]
    if unsettled := sum(check.status == "inconclusive" for check in checks):
        words.append(f"Inconclusive: {counted(unsettled, 'check')}; each says why.")
    forms = []
    for owner, whose in (("paper", "the paper’s forms as printed"), ("usual", "the field’s usual forms")):
        judged = [check for check in checks if check.owner == owner and is_judged(check)]
        if judged:
            forms.append(f"{whose} fail {sum(not check.holds for check in judged)} of {len(judged)} checks")
    if forms:
        text = listed(forms)
        words.append(f"{text[0].upper()}{text[1:]}; these are properties of those forms, not failures.")
    untried = [
        f"{many} {look.meaning}"
        for tone, look in LOOKS.items()
        if tone in ("absent", "spared") and (many := sum(tone_of(check) == tone for check in checks))
    ]
    return [*words, *([f"Not tried: {listed(untried)}; each says why."] if untried else [])]


def _machine(origin: JsonObject) -> str:
    """Return `, measured on X with 2 cores, without units for bfloat16 matrix multiplications`, as far as known."""
    processor, device, has_units = (origin.get(name) for name in ("processor", "device", "bfloat16_products"))
    parts = [
        counted(origin[name], noun)
        for name, noun in (("cores", "core"), ("threads", "thread"))
        if isinstance(origin.get(name), int)
    ]
    words = f", measured on {processor}" if isinstance(processor, str) else ""
    words += f" with {listed(parts)}" if words and parts else ""
    words += f", on its {device}" if isinstance(device, str) and device not in ("", "cpu") else ""
    if isinstance(has_units, bool):
        words += f", {'with' if has_units else 'without'} units for bfloat16 matrix multiplications"
    return words


def _tables(record: Studies) -> list[Grid]:
    rows = list(record.checks())
    targets = [row for row in rows if row[1].owner == "machine" and row[1].limit is not None]
    titled = [("Targets", targets)] if targets else []
    for owner in ("paper", "usual"):
        if failed := [row for row in rows if row[1].owner == owner and row[1].status == "fail"]:
            titled.append((f"What {OWNERS[owner]} fails: {counted(len(failed), 'property', 'properties')}", failed))
    return [checks_grid(title, some, lambda study: name_of(study, WORDS[record.shelf])) for title, some in titled]


def name_of(study: StudyRecord, words: ShelfWords) -> str:
    return f"{study.info.id} {study.info.title}" if words.groups else study.info.title


def of_interest(record: Studies) -> dict[str, float]:
    """Map metric → the smallest effect of interest, as far as the record states it."""
    known: object = record.settings.get("smallest_of_interest")
    return {str(name): float(value) for name, value in known.items()} if isinstance(known, dict) else {}


def study_page(shown: ShelfShown, has_report: bool = False) -> str:
    """Return the complete page; `has_report` says that report.html is in the same folder."""
    record = shown.record
    spent = [(name_of(study, shown.words), duration(study.seconds)) for study in record.studies]
    total = [("total", duration(sum(study.seconds for study in record.studies)))] if spent else []
    return Layout().page(
        "study_page.html",
        shown.headline,
        shown.sections,
        shell.groups_of(record.provenance, record.settings, [*total, *spent]),
        fold_origins=shown.words.folded,
        groups=GROUPS if shown.words.chapters else None,
        shelf=shown,
        report=shell.RUN_PAGE if has_report else "",
    )


def write_study_page(shown: ShelfShown, out: Path, has_report: bool = False) -> Path:
    path = out / page_of(shown.record.shelf)
    write_atomically(path, study_page(shown, has_report), fsync=False)
    return path
