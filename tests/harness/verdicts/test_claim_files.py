"""Claims in one line and in files; those of the paper agree with each other."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

from baselines.catalog import CATALOG
from harness.records.claims import STATED, Statement
from harness.verdicts.claim_files import claims_of, known_claims, read_claims, stated
from scenes.files.errors import InputError

EXAMPLE = Path("docs/examples/own_claims.toml")


def claim(line: str) -> Statement:
    (found,) = stated([line]).claims
    return found


@pytest.mark.parametrize(
    ("line", "quantity", "of", "printed", "bound", "unit"),
    [
        ("mine - nerf >= 1.5 dB", "gain", {"against": "nerf", "scene": "all", "metric": "psnr"}, 1.5, "at least", "dB"),
        ("mine − nerf <= -0.02 lpips on lego", "gain", {"against": "nerf", "scene": "lego", "metric": "lpips"}, -0.02,
         "at most", ""),
        ("mine>=30dB", "score", {"scene": "all", "metric": "psnr"}, 30, "at least", "dB"),
        ("mine = 0.961 ssim on lego", "score", {"scene": "lego", "metric": "ssim"}, 0.961, "", ""),
        ("mine - nerf >= 18 % seconds", "saving", {"against": "nerf", "axis": "seconds"}, 18, "at least", "%"),
    ],
)  # fmt: skip
def test_a_line_says_what_is_claimed(line, quantity, of, printed, bound, unit) -> None:
    found = claim(line)
    assert (found.quantity, found.printed, found.bound, found.unit) == (quantity, printed, bound, unit)
    assert found.of == {"method": "mine", **of}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("mine beats nerf", "is not of the form METHOD"),
        ("mine - nerf >= 1.5 furlongs", "'furlongs' is neither dB nor a metric"),
        ("mine >= 18 % steps", "a saving is of one method against another"),
        ("nerf - mine >= 1 dB", "mine is not part of this run; name it with --methods"),
        ("mine >= 1 dB", "mine is not part of this run; name it with --methods"),
        ("nerf >= 1 dB on legoo", "legoo is not part of this run; name it with --scenes"),
    ],
)
def test_a_line_of_another_form_or_about_what_does_not_run_is_refused(line: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        claims_of(["nerf"], ["lego"], lines=[line])


def test_decimals_are_those_of_the_claim() -> None:
    lines = ("a - b >= 1.5 dB", "a - b >= 1.55 dB", "a - b >= 2 dB", "a - b >= 0.01 ssim", "a - b >= 18 % steps")
    assert [claim(line).digits for line in lines] == [1, 2, 1, 3, 0]


def test_the_example_is_that_of_the_page() -> None:
    shown = re.findall(r"```toml\n(.*?)```", Path("docs/claims.md").read_text(encoding="utf-8"), re.DOTALL)
    assert shown == [EXAMPLE.read_text(encoding="utf-8")]
    average, lego = read_claims(EXAMPLE).claims
    assert (average.quantity, average.printed, average.unit, average.bound) == ("gain", 0.3, "dB", "")
    assert (lego.printed, lego.bound, lego.statement) == (0.005, "at least", "nerf_matched − nerf in SSIM on lego")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("title = ", "cannot be read as a file of claims"),
        ('title = "x"', "has no [[claim]]"),
        ("[[claim]]\nprinted = 1", "claim 1: 'score' needs method"),
        ('[[claim]]\nmethod = "a"\nquantity = "glory"', "quantity 'glory' is unknown"),
        ('[[claim]]\nmethod = "a"\nmetric = "glory"', "metric 'glory' is unknown"),
        ('[[claim]]\nmethod = "a"\nprinted = "a lot"', "printed 'a lot' is neither a number"),
        ('[[claim]]\nmethod = "a"\nscene = 3', "claim 1: "),
        ('[[claim]]\nmethod = "a"\n[scale]\nsteps = "many"', "steps"),
        ('[principal]\nb = "words"\n[[claim]]\nid = "a"\nmethod = "a"', "principal names 'b'"),
        ('[[claim]]\nid = "x"\nmethod = "a"\n[[claim]]\nid = "x"\nmethod = "b"', "two claims have the id 'x'"),
        ('[[claim]]\nmethod = "a"\nagainst = "b"\nquantity = "saving"\naxis = "miles"', "axis 'miles'"),
    ],
)
def test_a_file_that_is_none_names_file_and_fault(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "claims.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        read_claims(tmp_path / "claims.toml")
    assert "claims.toml" in str(refused.value)


def test_a_run_has_the_claims_of_its_methods_and_no_others() -> None:
    assert [file.id for file in claims_of(["nerf", "qnerf"], ["lego"])] == ["qnerf"]
    two = ["nerf", "nerf_matched"]
    assert claims_of(two, ["lego"]) == []
    own = claims_of([*two, "qnerf"], ["lego"], [EXAMPLE], ["nerf_matched - nerf >= 1 dB on lego"])
    assert [file.id for file in own] == [STATED, "own_claims", "qnerf"]
    with pytest.raises(InputError, match=r"own_claims\.toml: nerf_matched is not part of this run; name it with --m"):
        claims_of(["nerf", "qnerf"], ["lego"], [EXAMPLE])
    with pytest.raises(InputError, match="two files of claims have the id 'own_claims'"):
        claims_of(two, ["lego"], [EXAMPLE, EXAMPLE])


def test_the_pairs_that_claims_compare() -> None:
    (paper,) = known_claims()
    assert ("nerf_phi_encoding_amplifier", "nerf_phi_encoding") in paper.pairs
    assert read_claims(EXAMPLE).pairs == [("nerf_matched", "nerf")]


# the claims of the Q-NeRF paper


(PAPER,) = known_claims()
LEDGER = {entry.id: entry for entry in PAPER.claims}


def test_what_the_paper_prints_in_two_places_agrees() -> None:
    """`tests/reports/claims` judges the sums, means and differences within its tables."""
    printed = {name: entry.printed for name, entry in LEDGER.items()}
    columns = {"nerf": "table2-scenes-nerf", "qnerf": "table2-scenes-qnerf", "delta": "abstract-psnr-range"}
    for column, claim_id in columns.items():
        scores = [row[column] for row in PAPER.scenes.values()]
        assert printed[claim_id] == (min(scores), max(scores))
    for method in ("nerf", "qnerf"):
        assert printed[f"table2-average-{method}"] == PAPER.psnr["average"][method]
        for row in ("iterations", "hours"):
            assert printed[f"table3-{row}-{method}"] == PAPER.tables["times"][f"{row}_to_30_db"][method]
    for before, after in pairwise(PAPER.tables["ablation"]):
        for metric, score in after["scores"].items():
            added = printed[f"table4-{after['method']}-{metric}"]
            assert added == pytest.approx(score - before["scores"][metric])
    assert printed["table1-total"] == PAPER.tables["weights"]["total"]


def test_what_is_derived_lies_within_what_the_rounded_figures_leave_open() -> None:
    for entry in PAPER.claims:
        if entry.leaves_open:
            assert entry.leaves_open[0] < entry.printed < entry.leaves_open[1]


def test_methods_and_claims_that_are_named_are_there_and_no_two_entries_say_the_same() -> None:
    named = {entry.of[role] for entry in PAPER.claims for role in ("method", "against") if role in entry.of}
    assert named <= set(CATALOG)
    assert set(re.findall(r"{(.+?)}", PAPER.question)) <= set(LEDGER)
    assert len({(entry.statement, entry.quantity) for entry in PAPER.claims}) == len(PAPER.claims)
