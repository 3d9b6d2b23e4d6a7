"""A few inputs for every reader, the same each time, and all that ever showed a fault."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from tests.fuzz.campaign import Trial
from tests.fuzz.commands import called, names_its_option
from tests.fuzz.mutations import of_its_kind
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.watch import Guard, Outcome, bad_refusal

CORPUS = Path(__file__).parent / "corpus"
SLOW = {
    "harness_options", "reports_options", "scenes_options", "finished_run", "finished_cell", "checkpoint",
    "stability", "plan", "film", "evidence", "targets", "records_folder", "own_folder",
    "own_view_set", "own_exr", "run", "comparisons", "speed", "cell_in_training",
}  # fmt: skip
"""Which start so much that they are tried with the slow tests."""
EXAMPLES = 3


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guard]:
    """One for all: an audit hook stays."""
    guard, before = Guard(tmp_path_factory.getbasetemp()), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # what is imported first while an input is tried is no file that the input wrote
    yield guard
    guard.watching, sys.dont_write_bytecode = False, before


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


def trial_of(name: str, scratch: Path) -> Trial:
    (scratch / name).mkdir(exist_ok=True)
    return Trial(name, scratch / name)


def is_slow(name: str) -> bool:
    return name in SLOW or name.startswith("page_")


def names(slow: bool) -> list[str]:
    return [name for name in TARGETS if is_slow(name) == slow]


def tried(name: str, guard: Guard, scratch: Path) -> None:
    trial = trial_of(name, scratch)
    if TARGETS[name].files:
        trial.warmed(guard)
    for number in range(EXAMPLES):
        outcome = trial.tried(guard, *trial.input(Random(f"{name} {number}")))
        assert outcome.kind != "fault", outcome.why


@pytest.mark.parametrize("name", names(slow=False))
@pytest.mark.filterwarnings("ignore")
def test_what_is_spoilt_is_read_or_refused_in_words(name: str, guard: Guard, scratch: Path) -> None:
    tried(name, guard, scratch)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("name", names(slow=True))
@pytest.mark.filterwarnings("ignore")
def test_so_is_what_takes_longer_to_start(name: str, guard: Guard, scratch: Path) -> None:
    tried(name, guard, scratch)


KEPT = sorted(file for file in CORPUS.glob("*/*") if file.parent.name in TARGETS)


@pytest.mark.parametrize(
    "file",
    [
        pytest.param(file, marks=[pytest.mark.slow, pytest.mark.thorough] if is_slow(file.parent.name) else [])
        for file in KEPT
    ],
    ids=[f"{file.parent.name}-{file.name}" for file in KEPT],
)
@pytest.mark.filterwarnings("ignore")
def test_what_showed_a_fault_once_shows_none(file: Path, guard: Guard, scratch: Path) -> None:
    stands_for, _, data = file.read_bytes().partition(b"\n")
    outcome = trial_of(file.parent.name, scratch).tried(guard, stands_for.decode(), data)
    assert outcome.kind != "fault", outcome.why


# --- the watch itself sees what it is for


def outcome_of(guard: Guard, read: object) -> Outcome:
    return guard.tried(read, (ValueError,), "a.json")  # type: ignore[arg-type]


def _endless() -> None:
    while True:
        pass


def test_the_watch_sees_faults(
    guard: Guard, scratch: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside = tmp_path_factory.getbasetemp().parent / "outside"
    for write in (lambda: outside.write_text("x"), outside.mkdir, lambda: outside.symlink_to("x")):
        assert "outside of its folder" in outcome_of(guard, write).why
    assert not outside.exists()
    assert outcome_of(guard, lambda: (scratch / "inside").write_text("x")).kind == "accepted"
    assert outcome_of(guard, lambda: {}["x"]).why.startswith("KeyError")
    monkeypatch.setattr("tests.fuzz.watch.MOST_SECONDS", 0.05)
    assert "took longer" in outcome_of(guard, _endless).why


@pytest.mark.parametrize(
    ("message", "names", "good"),
    [
        ("a.json: holds a list, not an object", "a.json", True),
        ("holds a list, not an object", "a.json", False),
        ("a.json: 7", "a.json", False),
        ("a.json: this is wrong\x1b[2J", "a.json", False),
        ("a.json: this is wrong" + "x" * 5000, "a.json", False),
        ("radius 0: must be a positive number", ("radius", "frames"), True),
        ("radiuses 0: must be positive numbers", ("radius", "frames"), False),
        ("must be a positive number", ("radius", "frames"), False),
    ],
)
def test_a_refusal_names_what_is_wrong_and_the_reason(message: str, names: str | tuple[str, ...], good: bool) -> None:
    assert (bad_refusal(message, names) is None) == good


def test_values_of_their_kind_stay_of_it_and_change() -> None:
    valid = {"flag": True, "whole": 3, "number": 1.5, "text": "x", "none": None, "many": list(range(1000))}
    kinds = {"flag": bool, "whole": int, "number": float | None, "text": str, "none": float | None}
    changed = set()
    for number in range(200):
        made = json.loads(of_its_kind(Random(number), json.dumps(valid).encode()))
        for key, kind in kinds.items():
            assert key not in made or isinstance(made[key], kind)
            changed |= {key} if made.get(key, valid[key]) != valid[key] else set()
    assert changed == kinds.keys()


def test_a_reader_that_fails_shows_a_fault(guard: Guard, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(folder: Path) -> None:
        json.loads((folder / "path.json").read_bytes())["frames"] + 1

    monkeypatch.setitem(TARGETS, "careless", Target(TARGETS["camera_path"].make, "path.json", careless))
    trial = trial_of("careless", scratch)
    for number in range(25):
        trial.tried(guard, *trial.input(Random(number)))
    assert any(kind.startswith(("KeyError", "TypeError")) for kind in trial.tally.faults)


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


def test_a_command_line_is_refused_by_what_checks_it(tmp_path: Path) -> None:
    code, errors = called("reports", ["nothing", "--page", "x.html"], tmp_path)
    assert code == 2
    assert "--page" in errors
    assert Path.cwd() != tmp_path
