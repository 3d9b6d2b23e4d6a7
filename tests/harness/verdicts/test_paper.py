"""The claims of the Q-NeRF paper agree with the text of the paper, of which this file has a second copy."""

import json
import re

from baselines.catalog import CATALOG
from harness.records.claims import ClaimFile
from harness.records.json_record import as_promised, plain
from harness.verdicts.claim_files import known_claims

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
    entries = [
        by_id()[f"table3-{row}-{method}"].printed for row in ("iterations", "hours") for method in ("nerf", "qnerf")
    ]
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
    assert PAPER.tables["weights"] == {
        "density_net": 1_300_000,
        "density_head": 257,
        "colour_net": 67_000,
        "total": 1_370_000,
    }
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
