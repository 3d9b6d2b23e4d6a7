"""The ledger: every number that the paper prints, once, with all the places where it stands.

An entry's `rule` says what kind of statement it is, and so who judges it (`reports.claims.RULES`); `of` says of what.
Entries that repeat the shape of a table are made from that table (`harness.paper_tables`), in the paper's order.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

from harness.paper_tables import ORIGINAL_NERF, SERVING, SETTINGS, TABLE1, TABLE2, TABLE3, TABLE4

Number = int | float


@dataclass(frozen=True)
class Printed:
    """One printed number."""

    id: str
    where: tuple[str, ...]
    """Every place of the paper that states it."""
    printed: Number | tuple[Number, Number] | None
    """A range as a pair; None where the paper says it in words alone."""
    statement: str
    """What the paper says, in a sentence without the number."""
    rule: str
    """How it is put to the test, a key of `reports.claims.RULES`."""
    unit: str = ""
    of: dict[str, str] = field(default_factory=dict)
    """What it is about: scene, method, against, metric, axis, table, column."""
    leaves_open: tuple[float, float] | None = None
    """Of a number that is derived from rounded ones: what these leave open. None where the paper prints it."""


NAMES = {"nerf": "NeRF", "qnerf": "Q-NeRF"}
LABELS = {"psnr": "PSNR", "ssim": "SSIM"}
NOTE = "Epistemological Note"

ABSTRACT = (
    Printed(
        "table2-average",
        ("Table 2", "§10"),
        1.5,
        "Q-NeRF gains over NeRF on average",
        "gain",
        "dB",
        {"scene": "all", "method": "qnerf", "against": "nerf", "metric": "psnr"},
    ),
    Printed(
        "abstract-psnr-range",
        ("Abstract", NOTE, "Table 2"),
        (1.2, 1.8),
        "Q-NeRF gains what Table 2 prints on each of its scenes",
        "each gain",
        "dB",
        {"table": "table2", "column": "delta", "metric": "psnr"},
    ),
    Printed(
        "abstract-faster",
        ("Abstract", NOTE, "Table 3", "§10"),
        18,
        "Q-NeRF needs this much fewer iterations to reach 30 dB (“faster convergence”)",
        "saving",
        "%",
        {"axis": "steps"},
    ),
    Printed(
        "abstract-sloc", ("Abstract", NOTE, "§10"), 427, "Source lines of the core Q-NeRF module", "lines", "lines"
    ),
)

ARCHITECTURE = (
    Printed("eq3-last-band", ("Eq. 3",), 10, "Exponent of φ in the last cosine, for L = 10", "listing 1"),
    Printed("table1-skip", ("Table 1", "Eq. 5", "§5.2"), 6, "The φ skip follows layer ⌊φ·8/2⌋", "skip layer"),
    Printed("table1-total", ("Table 1",), TABLE1["total"], "The network has this many weights", "weights", "weights"),
    Printed(
        "table1-sum",
        ("Table 1",),
        TABLE1["total"],
        "The total is the sum of the printed parts",
        "sum of weights",
        "weights",
    ),
)


def _ends(values: list[float]) -> tuple[float, float]:
    return (min(values), max(values))


SCORES = (
    *(
        Printed(
            f"table2-average-{method}",
            ("Table 2", "Table 3"),
            TABLE2["average"][method],
            f"{NAMES[method]} reaches this PSNR on average",
            "score",
            "dB",
            {"scene": "all", "method": method, "metric": "psnr"},
        )
        for method in NAMES
    ),
    *(
        Printed(
            f"table2-scenes-{method}",
            ("Table 2",),
            _ends([row[method] for name, row in TABLE2.items() if name != "average"]),
            f"{NAMES[method]} reaches what Table 2 prints on each of its scenes",
            "each level",
            "dB",
            {"table": "table2", "column": method, "metric": "psnr"},
        )
        for method in NAMES
    ),
    Printed("table2-differences", ("Table 2",), 9, "Rows whose Δ is Q-NeRF less NeRF", "differences of rows", "rows"),
    Printed("table2-means", ("Table 2",), 3, "Columns whose average is the mean of their rows", "means of rows"),
    Printed(
        "table2-range",
        ("Abstract", "Table 2"),
        (1.2, 1.8),
        "The range of the gains is that of column Δ",
        "range of rows",
        "dB",
    ),
    Printed(
        "setup-scenes", ("§7.1",), 8, "Scenes of the data set, as many as Table 2 has rows", "scenes of rows", "scenes"
    ),
    Printed(
        "table2-source",
        ("Table 2", "§7.1"),
        None,
        "The NeRF column was trained as §7.1 says: 1024 rays, 200 000 iterations",
        "source of the baseline",
        "scenes",
    ),
)

EFFICIENCY = (
    *(
        Printed(
            f"table3-{name}-{method}",
            ("Table 3",),
            TABLE3[key][method],
            f"{NAMES[method]} needs this {words} to reach 30 dB",
            "time to target",
            unit,
        )
        for name, key, words, unit in (
            ("iterations", "iterations_to_30_db", "many iterations", "steps"),
            ("hours", "hours_to_30_db", "long", "h"),
        )
        for method in NAMES
    ),
    Printed(
        "table3-hours",
        ("Table 3",),
        19,
        "Q-NeRF needs this much less training time to reach 30 dB: what the printed hours come to",
        "derived saving",
        "%",
        {"axis": "seconds"},
        (100 * (1 - 3.45 / 4.15), 100 * (1 - 3.35 / 4.25)),
    ),
    *(
        Printed(
            f"table3-speedup-{name}",
            ("Table 3",),
            TABLE3["speedup_percent"],
            f"The speedup is what the printed {name} save",
            "ratio of times",
            "%",
            {"row": row},
        )
        for name, row in (("iterations", "iterations_to_30_db"), ("hours", "hours_to_30_db"))
    ),
    Printed("table3-final", ("Table 3",), 2, "Final scores that are Table 2’s averages", "final is average"),
)


def _step(metric: str, place: int) -> Number:
    """What row `place` of Table 4 adds to the row above it."""
    return round(TABLE4[place][metric] - TABLE4[place - 1][metric], {"psnr": 1, "ssim": 3}[metric])


def _open(metric: str, place: int) -> tuple[float, float] | None:
    """Half a digit of either row; footnote 1 prints the first step of PSNR itself."""
    digit = {"psnr": 0.1, "ssim": 0.001}[metric]
    step = _step(metric, place)
    return None if (metric, place) == ("psnr", 1) else (round(step - digit, 3), round(step + digit, 3))


def _row(place: int) -> str:
    return str(TABLE4[place]["configuration"]).removeprefix("+ ")


ABLATION = (
    *(
        Printed(
            f"table4-{metric}",
            ("Table 4",),
            _ends([row[metric] for row in TABLE4]),
            f"The four rows of Table 4 reach this {LABELS[metric]} on lego",
            "each level",
            "dB" if metric == "psnr" else "",
            {"table": "table4", "column": metric, "metric": metric},
        )
        for metric in LABELS
    ),
    *(
        Printed(
            f"table4-{TABLE4[place]['method']}-{metric}",
            ("Table 4", "§10 footnote 1") if (place, metric) == (1, "psnr") else ("Table 4",),
            _step(metric, place),
            f"{_row(place)} adds {LABELS[metric]} to the row above it on lego",
            "added part",
            "dB" if metric == "psnr" else "",
            {
                "scene": "lego",
                "method": str(TABLE4[place]["method"]),
                "against": str(TABLE4[place - 1]["method"]),
                "metric": metric,
            },
            _open(metric, place),
        )
        for metric in LABELS
        for place in (1, 2, 3)
    ),
    Printed("table4-lego", ("Table 2", "Table 4"), 2, "Scores on lego that are those of Table 2", "row of table 2"),
    Printed(
        "footnote1-table", ("§10 footnote 1",), 7, "Number of the table that holds the ablation", "number of a table"
    ),
)

ELSEWHERE = (
    Printed(
        "section10-integration", ("§10",), None, "Seamless integration via HUAM and consciousness bridge", "their code"
    ),
    Printed(
        "footnote2-files", ("§10 footnote 2",), 189, "Source files of their vision subsystem", "their code", "files"
    ),
    Printed("footnote2-lines", ("§10 footnote 2",), 44_000, "Lines of their vision subsystem", "their code", "lines"),
    Printed("footnote2-tests", ("§10 footnote 2",), 30, "Test files of their vision subsystem", "their code", "files"),
)

STATED = tuple(
    Printed(name, (where,), value, words, "setting", "", {"at": path}) for name, where, value, words, path in SETTINGS
)

SERVED = tuple(Printed(name, where, None, words, rule, unit) for name, where, words, rule, unit in SERVING)

LEDGER: tuple[Printed, ...] = (
    *ABSTRACT, *ARCHITECTURE, *STATED, *SCORES, *EFFICIENCY, *SERVED, *ABLATION, *ELSEWHERE,
)  # fmt: skip
"""In the paper's order. `tests/harness/test_paper.py` holds them against the numbers of the paper's text."""


def printed() -> dict[str, Any]:
    """All tables and the ledger as plain data, as a run record keeps them."""
    return {
        "table1": TABLE1,
        "table2": TABLE2,
        "table3": TABLE3,
        "table4": TABLE4,
        "sloc": 427,
        "original_nerf": ORIGINAL_NERF,
        "ledger": [asdict(one) for one in LEDGER],
    }
