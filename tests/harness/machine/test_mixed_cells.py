"""Runs whose cells were made by different code or packages are told; source lines are counted."""

from pathlib import Path
from typing import Any

import pytest

from harness.machine.mixed_cells import mixed_sources, stale_cells
from harness.machine.provenance import BASELINES, PARTS, core_module_lines, source_lines
from harness.records.cells import CellRecord
from tests.harness import cells

HERE: dict[str, Any] = {"commit": "new", "sources": "22", "python": "3.11", "packages": {"torch": "2", "mitsuba": "3"}}


def made(scene: str, method: str, **changes: Any) -> CellRecord:
    origin = {name: value for name, value in {**HERE, **changes}.items() if value is not None}
    return cells.cell(scene, method, 0, [cells.checkpoint(4, 1.0, 20.0)], provenance=origin)


def plugin(sources: str) -> dict[str, Any]:
    return {"mine": {"package": "pack", "version": "1.0", "entry_point": "pack:METHOD", "sources": sources}}


ALIKE = [made("a", "nerf"), made("a", "qnerf"), made("b", "nerf")]


def test_cells_of_the_same_code_have_no_sentence() -> None:
    others = [made("b", "qnerf", commit="docs changed"), made("c", "nerf", packages={"torch": "2", "mitsuba": "4"})]
    assert mixed_sources([]) == mixed_sources([*ALIKE, *others]) == []
    assert stale_cells([*ALIKE, *others], HERE, Path("out")) is None
    # old records have no digest
    assert mixed_sources([*ALIKE, made("b", "qnerf", sources=None)]) == []
    assert stale_cells([made("b", "qnerf", sources=None)], HERE, Path("out")) is None
    # a cell that never began
    failed = cells.cell("a", "nerf", 0, [], status="error", provenance={})
    assert mixed_sources([*ALIKE, failed]) == []
    assert stale_cells([failed], HERE, Path("out")) is None


def test_groups_that_mix_code_are_counted() -> None:
    (sentence,) = mixed_sources([*ALIKE, made("b", "qnerf", sources="11", commit="old")])
    assert sentence.startswith(
        "One code and one set of packages for all cells: they differ in sources 22 (3 cells), 11 (1"
    )
    assert "commit new (3 cells), old (1 cells)" in sentence
    assert "In 1 of 2 groups of one scene and seed" in sentence


def test_records_without_the_digest_are_distinguished_by_their_commit() -> None:
    (sentence,) = mixed_sources([*ALIKE, made("b", "qnerf", sources=None, commit="old")])
    assert "differ in commit new (3 cells), old (1 cells). In 1 of 2" in sentence


def test_a_package_of_the_user_matters_only_to_its_own_method() -> None:
    first, second = (made(scene, "mine", plugins=plugin(digest)) for scene, digest in (("a", "aa"), ("b", "bb")))
    (sentence,) = mixed_sources([*ALIKE, first, second])
    assert "differ in package of mine pack 1.0 (aa) (1 cells), pack 1.0 (bb) (1 cells)" in sentence
    sentence = stale_cells([first, second], {**HERE, "plugins": plugin("bb")}, Path("out")) or ""
    assert sentence.startswith("1 of 2 finished cells")
    assert "a.mine.0: package of mine pack 1.0 (aa) instead of pack 1.0 (bb)" in sentence


def test_cells_of_other_code_are_named_with_the_remedy() -> None:
    old = [made(scene, "nerf", commit="old", sources="11") for scene in "cdefgh"]
    sentence = stale_cells([*ALIKE, *old, made("i", "nerf", packages={"torch": "1"})], HERE, Path("out"))
    assert sentence == (
        "7 of 10 finished cells were made by other code or packages (c.nerf.0, d.nerf.0, e.nerf.0, f.nerf.0 and 2 "
        "more: sources 11 instead of 22, commit old instead of new; i.nerf.0: torch 1 instead of 2) and are compared "
        "with the others all the same; to train them again, remove their records in out/records/cells and use "
        "--resume, or name a fresh --out"
    )


# source lines


MODULE = '''"""A docstring
over two lines."""

# a comment
import math  # with a comment behind


def f(x):
    """Told."""
    y = """not
    told"""

    return (
        x,
        # in between
        y,
    )
'''


@pytest.mark.parametrize(
    ("text", "count"),
    [
        (MODULE, 8),  # import, def, y over two lines, return ( x, y, )
        ("", 0),
        ("\n\n# only\n", 0),
        ("x = 1; y = 2\n", 1),
        ('x = 1\n"""told of x"""\n', 1),
    ],
)
def test_blank_lines_comments_and_docstrings_do_not_count(text: str, count: int) -> None:
    assert source_lines(text) == count


def test_the_core_module_is_counted_by_part_and_no_file_twice():
    lines = core_module_lines()
    assert set(lines) == set(PARTS)
    names = [name for names in PARTS.values() for name in names]
    assert len(set(names)) == len(names)
    longest = {part: sum(len((BASELINES / name).read_text().splitlines()) for name in PARTS[part]) for part in PARTS}
    assert all(0 < lines[part] < longest[part] for part in PARTS)
