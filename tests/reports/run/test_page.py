"""report.html: complete, self-contained and escaped, without empty sections; the ceiling of density is named."""

import html
import re
from html.parser import HTMLParser

import pytest

from reports.data.load import Records, read_records
from reports.page.script import content_policy
from reports.page.shell import settings_rows
from reports.run.ceiling import ceilings
from reports.run.run_page import page
from tests.replacing import replace
from tests.reports.fake_run import fake_records, write_fake_run

HOSTILE = "<script>alert('$\\frac$')</script>"
"""Markup, and a formula that Matplotlib cannot parse."""


def foreign_scripts(text: str, files: bool = False) -> list[str]:
    """Return the scripts that could run and do not match the page's policy, which with `files` allows script files."""
    elements = re.findall(r"<script([^>]*)>(.*?)</script>", text, re.DOTALL | re.IGNORECASE)
    running = [body for attributes, body in elements if 'type="application/' not in attributes]
    allowed = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1])
    return [body for body in running if content_policy(body, files) != allowed]


def without_code(text: str) -> str:
    """Return the page without its script; script elements that hold data stay."""
    return re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)


class Outline(HTMLParser):
    """The ids, links and tags of a page; an unclosed or crossing tag fails."""

    VOID = frozenset({"meta", "link", "img", "input", "br", "path", "use", "rect", "wbr"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.handle_startendtag(tag, attributes)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.add(tag)
        self.links += [value for name, value in attributes if name in ("href", "src")]
        self.ids += [value for name, value in attributes if name == "id"]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_content_policy_forbids_everything_else(pictured_page):
    policy = html.unescape(pictured_page[: pictured_page.index("<style>")])
    assert "default-src 'none'" in policy
    assert not any(f"{words}'" in policy for words in ("unsafe-eval", "script-src 'unsafe-inline"))
    assert foreign_scripts(pictured_page.replace("</body>", "<script>alert(1)</script></body>")) == ["alert(1)"]


def test_diverged_cells_are_on_the_first_screen_and_in_every_section_of_scores(pictured_page):
    top = pictured_page[: pictured_page.index("<nav")]
    assert "1 of 18 cells did not finish" in top
    assert "drums · qnerf · seed 2: diverged, not finite at step 412: density_head.weight" in top
    for section in ("psnr", "convergence", "metrics", "failures"):
        body = pictured_page[pictured_page.index(f'<section id="{section}">') :]
        assert "diverged" in body[: body.index("</section>")], section


def test_text_from_data_is_escaped_everywhere(tmp_path):
    def hostile_run(run):
        scenes = [replace(scene, name=HOSTILE, title=HOSTILE, view_set=HOSTILE) for scene in run.scenes]
        methods, facts = {**run.methods, "qnerf": HOSTILE}, {HOSTILE: [HOSTILE]}
        listed = {"deviations": [HOSTILE], "not_tested": [HOSTILE], "provenance": facts, "settings": facts}
        return replace(run, scenes=scenes, methods=methods, command=HOSTILE, profile=HOSTILE, **listed)

    def hostile_cell(cell):
        reason = HOSTILE if cell.reason else None
        return replace(cell, reason=reason, warnings=[HOSTILE], properties={HOSTILE: HOSTILE}, parameters={HOSTILE: 1})

    records = read_records(write_fake_run(tmp_path / "run", ("x",), change=hostile_run, change_cell=hostile_cell))
    comparisons = [replace(row, scene=row.scene.replace("x", HOSTILE)) for row in records.comparisons]
    cells = [replace(cell, scene=HOSTILE) for cell in records.cells]
    text = page(replace(records, cells=cells, comparisons=comparisons))
    assert foreign_scripts(text) == []
    assert "&lt;script&gt;" in text
    Outline(text)


def test_sections_without_content_are_left_out(tmp_path):
    def bare_run(run):
        scenes = [replace(scene, left_out=[]) for scene in run.scenes]
        return replace(run, scenes=scenes, deviations=[], claims=[], not_tested=[], provenance={})

    def bare_cell(cell):
        curve = [replace(point, density=None, alpha=None, beta=None) for point in cell.curve]
        return replace(cell, curve=curve, trace={}, warnings=[], properties={}, parameters={})

    records = fake_records(tmp_path / "run", change=bare_run, change_cell=bare_cell)
    text = page(replace(records, comparisons=[]))
    outline = Outline(text)
    gone = {"pictures", "amplifier", "claims", "failures", "warnings", "properties", "parameters", "left_out",
            "deviations", "comparisons", "not-tested"}  # fmt: skip
    assert gone & set(outline.ids) == set()
    assert not any(f"#{name}" in outline.links for name in gone)
    assert {"psnr", "convergence", "metrics"} <= set(outline.ids)
    assert "did not finish" not in text


def test_an_unfinished_run_where_everything_failed_is_still_a_page(tmp_path):
    def failed(cell):
        return replace(cell, status="error", reason="out of memory", scores={}, curve=[], views=[], trace={})

    records = fake_records(tmp_path / "run", change_cell=failed)
    text = page(replace(records, run=replace(records.run, finished=False), cells=records.cells[1:]))
    for words in (
        "17 of 18 runs had finished",
        "qnerf diverged, failed or collapsed in every run",
        "3 of 3 failed",
        "and 11 more",
    ):
        assert words in text, words


def test_settings_are_flattened():
    assert settings_rows({"a": {"b": 1, "c": [1, True]}, "d": None}) == [("a.b", "1"), ("a.c", "1, yes"), ("d", "–")]


def with_properties(records: Records, **by_method: dict[str, list[float | None]]) -> Records:
    """Return the run with these properties of its cells, the values of a list in turn."""
    cells = []
    for place, cell in enumerate(records.cells):
        own = by_method.get(cell.method, {})
        given = {name: values[place % len(values)] for name, values in own.items()}
        cells.append(replace(cell, properties={**cell.properties, **given}))
    return replace(records, cells=cells)


UNBOUNDED = {"density_limit": [None], "opacity_of_a_pixel": [1.0], "weight_at_ceiling": [0.0]}


def bounded(limit: float, *opacities: float) -> dict[str, list[float | None]]:
    return {"density_limit": [limit], "opacity_of_a_pixel": list(opacities), "weight_at_ceiling": [0.25]}


def test_a_constant_that_limits_a_method_is_named_below_the_headline(whole: Records, whole_page: str) -> None:
    assert ceilings(whole) == [], "no record has the properties"
    assert "<dt>Ceiling</dt>" not in whole_page
    limited = with_properties(whole, nerf=UNBOUNDED, qnerf=bounded(25.0, 0.38))
    text = page(limited)
    assert text.index("<h1>") < text.index("<dt>Ceiling</dt>") < text.index("<dt>Scale</dt>")
    (line,) = ceilings(limited)
    cells = sum(cell.method == "qnerf" for cell in whole.cells)
    assert line == (
        "qnerf: at its largest density, 25 per half box, geometry one pixel thick has an opacity of 0.38; "
        f"25.0\u202f% of the weight of its pictures is at this ceiling ({cells} cells). "
        "The constant, a unit of density of 25 per half box, limits qnerf at this resolution."
    )


@pytest.mark.parametrize(("opacities", "limits"), [((0.9899, 0.9999), True), ((0.99, 0.9999), False)])
def test_the_thinnest_cell_decides_whether_it_limits(whole: Records, opacities, limits) -> None:
    (line,) = ceilings(with_properties(whole, qnerf=bounded(250.0, *opacities)))
    assert line.endswith("limits qnerf at this resolution.") == limits
    assert f"an opacity of {'0.9899' if limits else '0.9900'} to 0.9999;" in line
