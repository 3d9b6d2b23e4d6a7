"""A record of studies → a section of the report and a page of its own, both self-contained; every shelf alike.

Each kind of finding is shown in one way: answers as sentences, checks as rows and as a matrix, effects as forests,
lines as charts, tables and pictures as they are. `shelves` says the little in which shelves differ.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from harness.records.study import Check, Finding, Picture, Series, Studies, StudyRecord, Table
from reports.data.wording import counted, duration, listed, of_any_size
from reports.drawing.figure import svg
from reports.drawing.images import data_uri, read, smaller
from reports.drawing.palette import key
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import Grid, table_grid
from reports.page.shell import Layout, Section, section
from reports.studies.check_words import LOOKS, OWNERS, anchor, checks_grid, described, tone_of
from reports.studies.forest import effects_grid, forest_key, forests
from reports.studies.matrix import PENS, groups, miniature
from reports.studies.shelves import WORDS, ShelfWords, page_of
from scenes.files.atomic import write_atomically

AT_ONCE = 4
"""The number of answers in sight besides the first."""
BUDGET_BYTES = 3_000_000
"""The bytes of all pictures together, in base64."""
SIDES = (640, 480, 320, 240, 160, 96)
SMALL = 200
"""The pixels up to which a picture is shown enlarged with its pixels sharp."""


class Shown(NamedTuple):
    title: str
    caption: str
    source: str | None
    wide: bool
    sharp: bool


class ShelfShown(NamedTuple):
    """A shelf as it stands in the report, and on a page of its own."""

    shelf: str
    words: ShelfWords
    headline: str
    sentences: list[str]
    broken: list[tuple[str, str]]
    """The anchor of the study, and what of ours fails."""
    finished: bool
    quick: bool
    studies: list[StudyRecord]
    sections: list[Section]


def shelf_shown(record: Studies, out: Path) -> ShelfShown:
    """Return the section; `out` is the folder that its pictures are relative to."""
    return ShelfShown(
        record.shelf,
        WORDS[record.shelf],
        headline(record),
        sentences(record),
        [(anchor(study), broken_line(study, check)) for study, check in record.broken],
        record.finished,
        record.is_quick,
        record.studies,
        [part for part in _sections(record, out) if part.parts],
    )


def _sections(record: Studies, out: Path) -> Iterator[Section]:
    """Yield the matrix, what was aimed at and what other forms fail, the chapters, and every study."""
    words, layout = WORDS[record.shelf], Layout()
    parts, own = layout.parts, layout.study_parts
    side = side_for(out, [picture for study in record.studies for picture in study.pictures])

    def findings(name: str, some: list[Finding]) -> list[Markup]:
        shown = [picture_shown(finding, out, side) for finding in some if isinstance(finding, Picture)]
        tables = [table_grid(finding, of_any_size) for finding in some if isinstance(finding, Table)]
        drawn = charts([finding for finding in some if isinstance(finding, Series)], name)
        return [parts.charts(drawn), own.pictures(shown), *(parts.table(grid, own="own") for grid in tables)]

    def details(study: StudyRecord) -> list[Markup]:
        checks = checks_grid(f"Checks of {name_of(study, words)}", [(study, check) for check in study.checks])
        return [
            own.answers(study.answers[:1], study.answers[1 : 1 + AT_ONCE], study.answers[1 + AT_ONCE :]),
            parts.terms("about", about(study)),
            parts.table(checks, False, own="own checks"),
            _forests(study, of_interest(record), own),
            *findings(anchor(study), [] if words.chapters else study.findings),
        ]

    if cases := groups(record):
        tones = {tone_of(check) for _, check in record.checks()}
        legend = [(tone, look.mark, look.meaning) for tone, look in LOOKS.items() if tone in tones]
        keys = [(LOOKS[tone].meaning, key(PENS[tone], line=False)) for tone in LOOKS if tone in tones]
        small = [Chart(panel.title, keys, svg(panel, "matrix"), [], wide=True) for panel in miniature(record)]
        yield section("matrix", "Case by case", own.matrix(words.noun[0], legend, small, cases))
    tables = [parts.table(grid, own="own checks") for grid in _tables(record)]
    yield section(f"{record.shelf}-outcomes", words.outcomes, *tables)
    every = [
        finding
        for study in record.studies
        for finding in study.findings
        if isinstance(finding, Series | Picture | Table)
    ]
    numbers = {finding.item for finding in every} if words.chapters else set()
    for item in sorted(numbers, key=lambda item: (item not in words.chapters, item)):  # unknown ones come last
        title, name = words.chapters.get(item, f"Chapter {item}"), f"chapter-{item}"
        yield section(name, title, *findings(name, [finding for finding in every if finding.item == item]))
    if words.folded:
        folded = [_folded(study, own, name_of(study, words), details(study)) for study in record.studies]
        yield section(f"{record.shelf}-studies", f"Every {words.noun[0]} in full", *folded)
    else:
        for study in record.studies:
            yield section(anchor(study), name_of(study, words), *details(study), question=study.info.question)


def _folded(study: StudyRecord, own: Any, title: str, details: list[Markup]) -> Markup:
    """Lay out a study that is unfolded on request, or already if something fails in it."""
    tones = [tone_of(check) for check in study.checks]
    tally = [(tone, look.mark, tones.count(tone)) for tone, look in LOOKS.items() if tone in tones]
    laid_out: Markup = own.folded_study(anchor(study), title, "fails" in tones, tally, details)
    return laid_out


def about(study: StudyRecord) -> list[tuple[str, str]]:
    """Return how a study was made: pairs of a term and words."""
    pairs = [("how", study.info.method), ("scale", study.scale)]
    pairs += [("passes if" if fact == "bar" else fact, text) for fact, text in study.info.facts.items()]
    pairs += [("took", duration(study.seconds))] if study.seconds else []
    return [(term, words) for term, words in pairs if words]


def _forests(study: StudyRecord, of_interest: dict[str, float], own: Any) -> Markup:
    """Lay out the forests of the first metric over all scenes; the others are unfolded on request."""
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
    """Return whether the checks that count pass: how many, how many are inconclusive, and how many have no figure."""
    words = WORDS[record.shelf]
    own = [check for _, check in record.checks() if check.owner == words.owner]
    judged = [check for check in own if is_judged(check)]
    undecided = sum(check.status == "inconclusive" for check in own)
    tried = len(judged) + undecided
    passed = sum(check.holds for check in judged)
    if not judged:
        return words.nothing
    noun, verb = (pair[tried > 1] for pair in (words.check, words.passes))
    if passed == tried:
        return f"All {passed} {noun} {verb}" if passed > 1 else f"The one {noun} {verb}"
    lost = sum(check.value is None for check in judged if not check.holds)
    rest = f", {undecided} inconclusive" if undecided else ""
    rest += f", {lost} without a figure" if lost else ""
    return f"{passed} of {tried} {noun} {words.passes[passed != 1]}{rest}"


def is_judged(check: Check) -> bool:
    """Return whether it was put to the test; a figure of the machine without a target was not."""
    return check.status in ("pass", "fail") and (check.owner != "machine" or check.limit is not None)


def broken_line(study: StudyRecord, check: Check) -> str:
    return f"{study.info.id} {described(check)}"


def sentences(record: Studies) -> list[str]:
    """Return how much was tried and where, what is open, what was seen of forms that are not ours, what was not tried.

    What of ours fails is in the headline.
    """
    checks = [check for _, check in record.checks()]
    effects = sum(len(study.effects) for study in record.studies)
    subjects = {check.subject for check in checks if check.subject}
    parts = [
        counted(many, noun)
        for many, noun in ((len(checks), "check"), (len(subjects), "subject"), (effects, "effect"))
        if many
    ]
    seconds = sum(study.seconds for study in record.studies)
    took = f", in {duration(seconds)}" if seconds else ""
    with_parts = f" with {listed(parts)}" if parts else ""
    words = [
        f"{counted(len(record.studies), *WORDS[record.shelf].noun)}{with_parts}{took}{_machine(record.provenance)}."
    ]
    if unsettled := sum(check.status == "inconclusive" for check in checks):
        words.append(f"Inconclusive: {counted(unsettled, 'check')}; each says why.")
    forms = []
    for owner, whose in (("paper", "the paper’s forms as printed"), ("usual", "the field’s usual forms")):
        judged = [check for check in checks if check.owner == owner and is_judged(check)]
        if judged:
            forms.append(f"{whose} fail {sum(not check.holds for check in judged)} of {len(judged)} checks")
    if forms:
        text = listed(forms)
        words.append(f"{text[0].upper()}{text[1:]}; these are properties of theirs, not failures.")
    untried = [
        f"{many} {look.meaning}"
        for tone, look in LOOKS.items()
        if tone in ("absent", "spared") and (many := sum(tone_of(check) == tone for check in checks))
    ]
    return [*words, *([f"Not tried: {listed(untried)}; each says why."] if untried else [])]


def _machine(origin: dict[str, Any]) -> str:
    """Return ` on X with 2 cores and 2 threads, without units for bfloat16 matrix products`, as far as it is known."""
    processor, device, has_units = (origin.get(name) for name in ("processor", "device", "bfloat16_products"))
    parts = [
        counted(origin[name], noun)
        for name, noun in (("cores", "core"), ("threads", "thread"))
        if isinstance(origin.get(name), int)
    ]
    words = f" on {processor}" if isinstance(processor, str) else ""
    words += f" with {listed(parts)}" if words and parts else ""
    words += f", on its {device}" if isinstance(device, str) and device not in ("", "cpu") else ""
    if isinstance(has_units, bool):
        words += f", {'with' if has_units else 'without'} units for bfloat16 matrix products"
    return words


def _tables(record: Studies) -> list[Grid]:
    """Return the targets of the machine, and what fails of forms that are not ours."""
    words, tables = WORDS[record.shelf], []
    targets = [
        (study, check) for study, check in record.checks() if check.owner == "machine" and check.limit is not None
    ]
    if targets:
        tables.append(checks_grid("What was aimed at", targets, lambda study: name_of(study, words)))
    for owner in ("paper", "usual"):
        rows = [(study, check) for study, check in record.checks() if check.owner == owner and check.status == "fail"]
        if rows:
            title = f"What fails of {OWNERS[owner]}: {counted(len(rows), 'property', 'properties')}"
            tables.append(checks_grid(title, rows, lambda study: name_of(study, words)))
    return tables


def name_of(study: StudyRecord, words: ShelfWords) -> str:
    return f"{study.info.id} {study.info.title}" if words.groups else study.info.title


def of_interest(record: Studies) -> dict[str, float]:
    """Return metric → the smallest effect of interest, as far as the record knows it."""
    known: object = record.settings.get("smallest_of_interest")
    return {str(name): float(value) for name, value in known.items()} if isinstance(known, dict) else {}


def picture_shown(picture: Picture, out: Path, side: int) -> Shown:
    pixels = read(out, picture.path)
    if pixels is None:
        return Shown(picture.title, picture.caption, None, wide=False, sharp=False)
    height, width = pixels.shape[:2]
    source = data_uri(smaller(pixels, side))
    return Shown(picture.title, picture.caption, source, wide=width > 1.8 * height, sharp=max(height, width) <= SMALL)


def side_for(out: Path, pictures: list[Picture]) -> int:
    """Return the longest side at which all pictures stay within the page's budget, by the size of their files."""
    shapes = [pixels.shape[:2] for picture in pictures if (pixels := read(out, picture.path)) is not None]
    for side in SIDES:
        sizes = (height * width * min(1.0, side / max(height, width)) ** 2 for height, width in shapes)
        if 4 * sum(sizes) <= BUDGET_BYTES:
            return side
    return SIDES[-1]


def study_page(record: Studies, out: Path, beside_report: bool = False, shown: ShelfShown | None = None) -> str:
    """Return the complete page as text; `beside_report` says that report.html lies in the same folder, `shown` is the
    section if it was made already.
    """
    shown = shown or shelf_shown(record, out)
    spent = [(name_of(study, shown.words), duration(study.seconds)) for study in record.studies]
    total = [("all together", duration(sum(study.seconds for study in record.studies)))] if spent else []
    return Layout().page(
        "study_page.html",
        shown.headline,
        shown.sections,
        shell.groups_of(record.provenance, record.settings, [*total, *spent]),
        shelf=shown,
        report=shell.RUN_PAGE if beside_report else "",
    )


def write_study_page(record: Studies, out: Path, beside_report: bool = False, shown: ShelfShown | None = None) -> Path:
    """Write the page into `out`, where the pictures of the record are; returns its path."""
    path = out / page_of(record.shelf)
    write_atomically(path, study_page(record, out, beside_report, shown), fsync=False)
    return path
