"""A few inputs for every reader, the same each time, and all that ever showed a fault."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz import file_mutations
from tests.fuzz.__main__ import main
from tests.fuzz.campaign import Trial
from tests.fuzz.commands import called, mutate, names_its_option
from tests.fuzz.mutations import Choices, of_its_kind
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.viewer_requests import REQUEST
from tests.fuzz.watch import Guard, Outcome, bad_refusal

CORPUS = Path(__file__).parent / "corpus"
SLOW = {
    "harness_options", "reports_options", "scenes_options", "finished_run", "finished_cell", "checkpoint",
    "stability", "plan", "film", "repair_search", "evidence", "targets", "records_folder", "own_folder",
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


def tried(name: str, guard: Guard, scratch: Path, examples: int) -> None:
    trial = trial_of(name, scratch)
    if TARGETS[name].files:
        trial.warmed(guard)

    @settings(max_examples=examples, derandomize=True, database=None, deadline=None,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(st.randoms(use_true_random=False))
    def one(random: Random) -> None:
        file, data = trial.input(random)
        outcome = trial.tried(guard, file, data)
        assert outcome.kind != "fault", outcome.said

    one()


@pytest.mark.parametrize("name", names(slow=False))
@pytest.mark.filterwarnings("ignore")
def test_what_is_spoilt_is_read_or_refused_in_words(name: str, guard: Guard, scratch: Path) -> None:
    tried(name, guard, scratch, EXAMPLES)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("name", names(slow=True))
@pytest.mark.filterwarnings("ignore")
def test_so_is_what_takes_longer_to_start(name: str, guard: Guard, scratch: Path) -> None:
    tried(name, guard, scratch, EXAMPLES)


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
    assert outcome.kind != "fault", outcome.said


# --- the watch itself sees what it is for


def outcome_of(guard: Guard, read: object) -> Outcome:
    return guard.tried(read, (ValueError,), "a.json")  # type: ignore[arg-type]


def _endless() -> None:
    while True:
        pass


def test_the_watch_sees_faults(guard: Guard, scratch: Path, tmp_path_factory: pytest.TempPathFactory,
                               monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    outside = tmp_path_factory.getbasetemp().parent / "outside"
    for write in (lambda: outside.write_text("x"), outside.mkdir, lambda: outside.symlink_to("x")):
        assert "outside of its folder" in outcome_of(guard, write).said
    assert not outside.exists()
    assert outcome_of(guard, lambda: (scratch / "inside").write_text("x")).kind == "accepted"
    assert outcome_of(guard, lambda: {}["x"]).said.startswith("KeyError")
    monkeypatch.setattr("tests.fuzz.watch.MOST_SECONDS", 0.05)
    assert "took longer" in outcome_of(guard, _endless).said


@pytest.mark.parametrize(
    ("message", "good"),
    [
        ("a.json: holds a list, not an object", True),
        ("holds a list, not an object", False),
        ("a.json: 7", False),
        ("a.json: this is wrong\x1b[2J", False),
        ("a.json: this is wrong" + "x" * 5000, False),
    ],
)
def test_a_refusal_names_the_file_and_the_reason(message: str, good: bool) -> None:
    assert (bad_refusal(message, "a.json") is None) == good


def test_values_of_their_kind_stay_of_it_and_change() -> None:
    valid = {"flag": True, "whole": 3, "number": 1.5, "text": "x", "none": None, "many": list(range(1000))}
    kinds = {"flag": bool, "whole": int, "number": float | None, "text": str, "none": float | None}
    changed = set()
    for number in range(200):
        found = json.loads(of_its_kind(Random(number), json.dumps(valid).encode()))
        for key, kind in kinds.items():
            assert key not in found or isinstance(found[key], kind)
            changed |= {key} if found.get(key, valid[key]) != valid[key] else set()
    assert changed == kinds.keys()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 7}, "scene: give a name"),
        ({"width": 7}, "the request: give a whole number"),
        ({"place": {"view": -1}}, "place view and target are for somebody else"),
        ({"attention": {**REQUEST["attention"], "row": 2.0}}, "column 0.5 of the point of interest: lies outside"),
    ],
)
def test_a_refusal_that_blames_what_is_right_is_found(
    guard: Guard, scratch: Path, change: dict[str, object], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from harness.viewer import asked

    body = json.dumps({**REQUEST, **change}).encode()
    assert trial_of("viewer_request", scratch).tried(guard, "request.json", body).kind == "refused"
    ours = asked.parsed

    def blames_another(body: bytes) -> asked.ViewRequest:
        try:
            return ours(body)
        except asked.BadRequest as error:
            raise asked.BadRequest(said) from error

    monkeypatch.setattr(asked, "parsed", blames_another)
    outcome = trial_of("viewer_request", scratch).tried(guard, "request.json", body)
    assert outcome.kind == "fault"
    assert repr(said) in outcome.said


def test_faults_while_warming_are_kept(guard: Guard, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(folder: Path) -> None:
        raise KeyError(folder.name)

    mutate, place = file_mutations.of_folder, file_mutations.place_changes
    without_files = Target(TARGETS["camera_path"].make, "", careless, mutate=mutate, place=place)
    monkeypatch.setitem(TARGETS, "careless", without_files)
    trial = trial_of("careless", scratch)
    trial.warmed(guard)
    assert (trial.tally.tried, len(trial.tally.faults)) == (0, 1)


def test_without_atheris_nothing_is_guided_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="2"):
        main(["--guided-alone"])
    assert "--guided-alone: atheris is not installed" in capsys.readouterr().err


def test_a_reader_that_fails_is_found(guard: Guard, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(folder: Path) -> None:
        import json

        json.loads((folder / "path.json").read_bytes())["frames"] + 1

    monkeypatch.setitem(TARGETS, "careless", Target(TARGETS["camera_path"].make, "path.json", careless))
    trial = trial_of("careless", scratch)
    for number in range(25):
        trial.tried(guard, *trial.input(Random(number)))
    assert any(kind.startswith(("KeyError", "TypeError")) for kind in trial.tally.faults)


# --- command lines of bytes, and what a refusal of one must tell


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
