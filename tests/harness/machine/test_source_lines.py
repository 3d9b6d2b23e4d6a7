"""The count of source lines."""

import pytest

from harness.machine.provenance import BASELINES, PARTS, core_module_lines, source_lines

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
