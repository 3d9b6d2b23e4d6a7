"""Command lines of bytes, and what a refusal of one must tell."""

import json
from pathlib import Path
from random import Random

import pytest

from tests.fuzz.choices import Choices
from tests.fuzz.command_work import called
from tests.fuzz.commands import mutate, names_its_option
from tests.fuzz.watch import bad_refusal


def test_the_same_bytes_make_the_same_command_line_and_others_another() -> None:
    make = mutate("reports")
    lines = [make(Choices(Random(number).randbytes(64)), b"") for number in range(40)]
    assert lines == [make(Choices(Random(number).randbytes(64)), b"") for number in range(40)]
    assert len(set(lines)) > 20


def test_a_byte_more_changes_what_comes_after_it_alone() -> None:
    data = Random(7).randbytes(64)
    one, other = Choices(data), Choices(data[:20] + bytes([data[20] ^ 1]) + data[21:])
    drawn = [[source.randrange(250) for _ in range(40)] for source in (one, other)]
    assert [at for at in range(40) if drawn[0][at] != drawn[1][at]] == [20]


def test_bytes_that_are_at_an_end_still_make_a_command_line() -> None:
    source = Choices(b"\x01")
    assert [source.randrange(3), source.randrange(3), source.choice("ab"), source.randrange(1000)] == [1, 2, "b", 999]
    assert all(isinstance(one, str) for one in json.loads(mutate("reports")(Choices(b""), b"")))


@pytest.mark.parametrize(
    ("text", "arguments", "named"),
    [
        ("argument --page: expected one argument", ["a", "--page"], True),
        ("--page: goes with several outputs alone", ["a", "--page", "b"], True),
        ("--pages: goes with several outputs alone", ["a", "--page", "b"], False),
        ("goes with several outputs alone; see --publish", ["a", "--page", "b"], False),
        ("a/b: no such folder", ["a/b"], True),
        ("no such folder as that one", ["a/b"], False),
    ],
)
def test_a_refusal_names_an_option_or_a_file(text: str, arguments: list[str], named: bool) -> None:
    assert names_its_option(text, arguments, "reports") == named


def test_one_of_the_words_is_enough_and_none_is_not() -> None:
    words = ("radius", "frames")
    assert bad_refusal("radius 0: must be a positive number", words) is None
    assert bad_refusal("radiuses 0: must be positive numbers", words) is not None
    assert bad_refusal("must be a positive number", words) is not None


def test_a_command_line_is_refused_by_what_checks_it(tmp_path: Path) -> None:
    code, said = called("reports", ["nothing", "--page", "x.html"], tmp_path)
    assert code == 2
    assert "--page" in said
    assert Path.cwd() != tmp_path
