"""Claims in one line and in files; those of the paper agree with its text, of which this file has a second copy."""

import json
import re
from pathlib import Path

import pytest

from baselines.catalog import CATALOG
from harness.records.claims import STATED, ClaimFile, Statement
from harness.records.json_record import as_promised, plain
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
        ("mine - nerf >= many dB", "is not of the form METHOD"),
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
        ('[[claim]]\nmethod = "a"\nprinted = [1, 2, 3]', "claim 1: "),
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
LEDGER = PAPER.claims
TEXT_TABLE2 = """
| Chair          | 33.0        | 34.4        | +1.4        |
| Drums          | 25.0        | 26.2        | +1.2        |
| Ficus          | 30.1        | 31.6        | +1.5        |
| Hotdog         | 36.2        | 38.0        | +1.8        |
| Lego           | 32.5        | 34.0        | +1.5        |
| Materials      | 29.6        | 31.0        | +1.4        |
| Mic            | 32.9        | 34.4        | +1.5        |
| Ship           | 28.7        | 30.2        | +1.5        |
| <b>Average</b> | <b>31.0</b> | <b>32.5</b> | <b>+1.5</b> |
"""
TEXT_TABLE3 = """
| Iters to PSNR 30      | 150K | 123K   |
| Time to PSNR 30 (hrs) | 4.2  | 3.4    |
| Final PSNR (200K)     | 31.0 | 32.5   |
| Speedup               | —    | 18%    |
"""
TEXT_TABLE4 = """
| Baseline NeRF                | 32.5 | 0.961 |
| + $\\phi$ -Encoding           | 33.2 | 0.967 |
| + Quantum Amplifier          | 33.8 | 0.972 |
| + $\\phi$ -Skip (Full Q-NeRF) | 34.0 | 0.974 |
"""


def rows(text: str) -> list[list[str]]:
    lines = text.replace("<b>", "").replace("</b>", "").strip().splitlines()
    return [[entry.strip() for entry in line.strip("|").split("|")] for line in lines]


def by_id():
    return {entry.id: entry for entry in LEDGER}


def test_table_2_is_the_printed_one():
    for name, nerf, qnerf, delta in rows(TEXT_TABLE2):
        assert PAPER.psnr[name.lower()] == {"nerf": float(nerf), "qnerf": float(qnerf), "delta": float(delta)}
    assert len(PAPER.psnr) == 9
    assert [by_id()[f"table2-scenes-{name}"].printed for name in ("nerf", "qnerf")] == [(25.0, 36.2), (26.2, 38.0)]
    assert by_id()["abstract-psnr-range"].printed == (1.2, 1.8)


def test_table_3_is_the_printed_one():
    iterations, hours, final, speedup = rows(TEXT_TABLE3)
    thousands = [1000 * int(text.removesuffix("K")) for text in iterations[1:]]
    assert list(PAPER.tables["times"]["iterations_to_30_db"].values()) == thousands
    assert list(PAPER.tables["times"]["hours_to_30_db"].values()) == [float(text) for text in hours[1:]]
    assert list(PAPER.tables["times"]["final_psnr"].values()) == [float(text) for text in final[1:]]
    assert f"{by_id()['table3-speedup-hours'].printed}%" == speedup[2]
    entries = [by_id()[f"table3-{row}-{name}"].printed for row in ("iterations", "hours") for name in ("nerf", "qnerf")]
    assert entries == [*thousands, 4.2, 3.4]


def test_table_4_is_the_printed_one_and_its_steps_are_differences():
    for row, (name, psnr, ssim) in zip(PAPER.tables["ablation"], rows(TEXT_TABLE4), strict=True):
        assert re.sub(r"\$\\phi\$ ", "φ", name) == row["configuration"]
        assert (row["scores"]["psnr"], row["scores"]["ssim"]) == (float(psnr), float(ssim))
    steps = {entry.id: entry.printed for entry in LEDGER if entry.quantity == "added part"}
    assert list(steps.values()) == [0.7, 0.6, 0.2, 0.006, 0.005, 0.002]


def test_every_number_of_the_text_has_an_entry():
    """The numbers of the abstract, Table 1, §8.1, the conclusion and footnotes are as printed."""
    entries = by_id()
    assert (entries["abstract-sloc"].printed, entries["abstract-sloc"].where[0]) == (427, "Abstract")
    assert entries["abstract-faster"].printed == 18
    assert entries["table1-skip"].printed == 6
    assert PAPER.tables["weights"] == {"density_net": 1.3e6, "density_head": 257, "colour_net": 67_000, "total": 1.37e6}
    assert entries["table1-total"].printed == PAPER.tables["weights"]["total"]
    assert entries["section8.1-retrieval"].printed is None
    assert [entries[f"footnote2-{name}"].printed for name in ("files", "lines", "tests")] == [189, 44_000, 30]
    assert entries["footnote1-table"].printed == 7
    stated = {entry.id: entry.printed for entry in LEDGER if "at" in entry.of}
    assert stated == {
        "table1-position-bands": 10, "table1-direction-bands": 4, "table1-depth": 8, "table1-width": 256,
        "table1-colour-layers": 2, "table1-colour-width": 128,
        "setup-iterations": 200_000, "setup-learning-rate": 5e-4, "setup-rays": 1024, "section5.2-skip": 4,
        "theorem1-alpha": None, "listing2-threshold": 0.5, "listing2-beta": 1.0,
        "listing4-last": 1e10, "listing4-offset": 1e-10,
    }  # fmt: skip


def test_what_is_derived_lies_within_what_the_rounded_figures_leave_open():
    for entry in LEDGER:
        if entry.leaves_open:
            assert entry.leaves_open[0] < entry.printed < entry.leaves_open[1]


def test_what_the_paper_says_in_several_places_is_one_entry():
    entries = by_id()
    for name in ("abstract-psnr-range", "abstract-faster", "abstract-sloc"):
        assert {"Abstract", "Epistemological Note"} <= set(entries[name].where)
    assert {"Table 3", "§10"} <= set(entries["abstract-faster"].where)
    assert entries["table4-nerf_phi_encoding-psnr"].where == ("Table 4", "§10 footnote 1")
    assert entries["table2-average"].where == ("Table 2", "§10")


def test_ids_are_unique_and_methods_are_there_to_be_run():
    assert len({entry.id for entry in LEDGER}) == len(LEDGER)
    named = {entry.of[role] for entry in LEDGER for role in ("method", "against") if role in entry.of}
    assert named <= set(CATALOG)
    assert len({(entry.statement, entry.quantity) for entry in LEDGER}) == len(LEDGER), "two entries say the same"


def test_a_record_can_keep_it():
    assert as_promised(json.loads(json.dumps(plain(PAPER), allow_nan=False)), ClaimFile) == PAPER


def test_what_a_page_shows_of_it_is_there():
    assert set(PAPER.principal) <= set(by_id())
    assert set(re.findall(r"{(.+?)}", PAPER.question)) <= set(by_id())
