"""The paper's four tables as printed, and the ledger: every number that it prints, once, with all its places.

An entry's `rule` names the kind of statement, and so its judge (`reports.claims.claim_list.RULES`); `of` names its
subject. Entries that repeat the shape of a table are made from that table, in the paper's order.
"""

from typing import Any

from msgspec import field

from harness.records.json_record import Record, plain

TABLE1: dict[str, int] = {"density_net": 1_300_000, "density_head": 257, "colour_net": 67_000, "total": 1_370_000}
TABLE2: dict[str, dict[str, float]] = {
    "chair": {"nerf": 33.0, "qnerf": 34.4, "delta": 1.4},
    "drums": {"nerf": 25.0, "qnerf": 26.2, "delta": 1.2},
    "ficus": {"nerf": 30.1, "qnerf": 31.6, "delta": 1.5},
    "hotdog": {"nerf": 36.2, "qnerf": 38.0, "delta": 1.8},
    "lego": {"nerf": 32.5, "qnerf": 34.0, "delta": 1.5},
    "materials": {"nerf": 29.6, "qnerf": 31.0, "delta": 1.4},
    "mic": {"nerf": 32.9, "qnerf": 34.4, "delta": 1.5},
    "ship": {"nerf": 28.7, "qnerf": 30.2, "delta": 1.5},
    "average": {"nerf": 31.0, "qnerf": 32.5, "delta": 1.5},
}
TABLE3: dict[str, Any] = {
    "iterations_to_30_db": {"nerf": 150_000, "qnerf": 123_000},
    "hours_to_30_db": {"nerf": 4.2, "qnerf": 3.4},
    "final_psnr": {"nerf": 31.0, "qnerf": 32.5},
    "speedup_percent": 18,
}
TABLE4: list[dict[str, Any]] = [
    {"configuration": "Baseline NeRF", "method": "nerf", "psnr": 32.5, "ssim": 0.961},
    {"configuration": "+ φ-Encoding", "method": "nerf_phi_encoding", "psnr": 33.2, "ssim": 0.967},
    {"configuration": "+ Quantum Amplifier", "method": "nerf_phi_encoding_amplifier", "psnr": 33.8, "ssim": 0.972},
    {"configuration": "+ φ-Skip (Full Q-NeRF)", "method": "qnerf", "psnr": 34.0, "ssim": 0.974},
]
"""Table 4; `method` is ours with that row's parts, the amplifier as in Listing 2."""

SETTINGS: tuple[tuple[str, str, float | None, str, str], ...] = (
    ("table1-position-bands", "Table 1", 10, "Frequency bands of a position, L", "train.network.position_bands"),
    ("table1-direction-bands", "Table 1", 4, "Frequency bands of a direction, L", "train.network.direction_bands"),
    ("table1-depth", "Table 1", 8, "Layers of the density MLP", "train.network.depth"),
    ("table1-width", "Table 1", 256, "Width of the density MLP", "train.network.width"),
    ("table1-colour-layers", "Table 1", 2, "Layers of the colour MLP", "train.network.colour_layers"),
    ("table1-colour-width", "Table 1", 128, "Width of the colour MLP", "train.network.colour_width"),
    ("setup-iterations", "§7.1", 200_000, "Iterations of a training", "budget.steps"),
    ("setup-learning-rate", "§7.1", 0.0005, "Learning rate", "train.learning_rate"),
    ("setup-rays", "§7.1", 1024, "Rays of an iteration", "train.rays"),
    ("section5.2-skip", "§5.2", 4, "The standard skip follows this layer", ""),
    ("theorem1-alpha", "§4.1", None, "α of the amplifier begins at 1/φ", ""),
    ("listing2-threshold", "Listing 2", 0.5, "Threshold of the boost", ""),
    ("listing2-beta", "Listing 2", 1, "β of the amplifier begins here", ""),
    ("listing4-last", "Listing 4", 1e10, "Length of the last interval of a ray", ""),
    ("listing4-offset", "Listing 4", 1e-10, "What is added to the transmittance of an interval", ""),
)
"""The stated settings: id, place, printed value, quantity, and the place of a run's own value, empty if it has none."""

SERVING: tuple[tuple[str, tuple[str, ...], str, str, str], ...] = (
    ("section8.1-retrieval", ("§8.1",), "Cached views are retrieved instantly", "retrieval", "×"),
    ("listing5-key", ("Listing 5",), "The hash of its pose tells which picture a view is", "pose key", "kinds"),
    ("section8.2-priority", ("§8.2", "Eq. 7"), "Rendering is prioritised by attention", "attended first", "×"),
    ("eq7-phi", ("Eq. 7",), "Factor φ changes what is rendered first or how finely", "factor of priorities", "maps"),
)
"""The statements of §8 in words, and our reading of Listing 5's key and of Eq. 7's φ, which it does not explain: id,
places, statement, rule, unit of the measured value.
"""

ORIGINAL_NERF: dict[str, float] = {
    "chair": 33.00, "drums": 25.01, "ficus": 30.13, "hotdog": 36.18,
    "lego": 32.54, "materials": 29.62, "mic": 32.91, "ship": 28.65,
}  # fmt: skip
"""The PSNR by scene of the original NeRF (Mildenhall et al. 2020, Realistic Synthetic 360°): trained with 4096 rays per
step for 100 000 to 300 000 steps, where the paper states 1024 rays and 200 000. Its SSIM on lego is 0.961 as well.
"""


Number = int | float
Pair = tuple[Number, Number]


class Printed(Record, frozen=True):
    """A printed number."""

    id: str
    where: tuple[str, ...]
    """The places of the paper that state it."""
    printed: Number | Pair | None
    """The number, a range as a pair; None if the paper says it in words alone."""
    statement: str
    """The paper's statement, in a sentence without the number."""
    rule: str
    """The rule of its test, a key of `reports.claims.claim_list.RULES`."""
    unit: str = ""
    of: dict[str, str] = field(default_factory=dict)
    """The subject: scene, method, against, metric, axis, table, column."""
    leaves_open: tuple[float, float] | None = None
    """The interval that a number derived from rounded ones leaves open. None if the paper prints it."""

    @property
    def digits(self) -> int:
        """Return the decimals as printed."""
        return {"dB": 1, "h": 1}.get(self.unit, 3 if self.of.get("metric") == "ssim" else 0)


NAMES = {"nerf": "NeRF", "qnerf": "Q-NeRF"}
LABELS = {"psnr": "PSNR", "ssim": "SSIM"}
UNITS = {"psnr": "dB", "ssim": ""}
NOTE = "Epistemological Note"


def _ends(values: list[float]) -> Pair:
    return (min(values), max(values))


ABSTRACT = (
    Printed("table2-average", ("Table 2", "§10"), 1.5, "Q-NeRF gains over NeRF on average", "gain", "dB",
            {"scene": "all", "method": "qnerf", "against": "nerf", "metric": "psnr"}),
    Printed("abstract-psnr-range", ("Abstract", NOTE, "Table 2"), (1.2, 1.8),
            "Q-NeRF gains what Table 2 prints on each of its scenes", "each gain", "dB",
            {"table": "table2", "column": "delta", "metric": "psnr"}),
    Printed("abstract-faster", ("Abstract", NOTE, "Table 3", "§10"), 18,
            "Q-NeRF needs this much fewer iterations to reach 30 dB (“faster convergence”)", "saving", "%",
            {"axis": "steps"}),
    Printed("abstract-sloc", ("Abstract", NOTE, "§10"), 427, "Source lines of the core Q-NeRF module", "lines",
            "lines"),
)  # fmt: skip

ARCHITECTURE = (
    Printed("eq3-last-band", ("Eq. 3",), 10, "Exponent of φ in the last cosine, for L = 10", "listing 1"),
    Printed("table1-skip", ("Table 1", "Eq. 5", "§5.2"), 6, "The φ skip follows layer ⌊φ·8/2⌋", "skip layer"),
    Printed("table1-total", ("Table 1",), TABLE1["total"], "The network has this many weights", "weights", "weights"),
    Printed("table1-sum", ("Table 1",), TABLE1["total"], "The total is the sum of the printed parts", "sum of weights",
            "weights"),
)  # fmt: skip

SCORES = (
    *(Printed(f"table2-average-{method}", ("Table 2", "Table 3"), TABLE2["average"][method],
              f"{name} reaches this PSNR on average", "score", "dB",
              {"scene": "all", "method": method, "metric": "psnr"})
      for method, name in NAMES.items()),
    *(Printed(f"table2-scenes-{method}", ("Table 2",),
              _ends([row[method] for scene, row in TABLE2.items() if scene != "average"]),
              f"{name} reaches what Table 2 prints on each of its scenes", "each level", "dB",
              {"table": "table2", "column": method, "metric": "psnr"})
      for method, name in NAMES.items()),
    Printed("table2-differences", ("Table 2",), 9, "Rows whose Δ is Q-NeRF less NeRF", "differences of rows", "rows"),
    Printed("table2-means", ("Table 2",), 3, "Columns whose average is the mean of their rows", "means of rows"),
    Printed("table2-range", ("Abstract", "Table 2"), (1.2, 1.8), "The range of the gains is that of column Δ",
            "range of rows", "dB"),
    Printed("setup-scenes", ("§7.1",), 8, "Scenes of the data set, as many as Table 2 has rows", "scenes of rows",
            "scenes"),
    Printed("table2-source", ("Table 2", "§7.1"), None,
            "The NeRF column was trained as §7.1 says: 1024 rays, 200 000 iterations", "source of the baseline",
            "scenes"),
)  # fmt: skip

EFFICIENCY = (
    *(Printed(f"table3-{name}-{method}", ("Table 3",), TABLE3[key][method],
              f"{NAMES[method]} needs this {words} to reach 30 dB", "time to target", unit)
      for name, key, words, unit in (("iterations", "iterations_to_30_db", "many iterations", "steps"),
                                     ("hours", "hours_to_30_db", "long", "h"))
      for method in NAMES),
    Printed("table3-hours", ("Table 3",), 19,
            "Q-NeRF needs this much less training time to reach 30 dB: what the printed hours come to",
            "derived saving", "%", {"axis": "seconds"}, (100 * (1 - 3.45 / 4.15), 100 * (1 - 3.35 / 4.25))),
    *(Printed(f"table3-speedup-{name}", ("Table 3",), TABLE3["speedup_percent"],
              f"The speedup is what the printed {name} save", "ratio of times", "%", {"row": row})
      for name, row in (("iterations", "iterations_to_30_db"), ("hours", "hours_to_30_db"))),
    Printed("table3-final", ("Table 3",), 2, "Final scores that are Table 2’s averages", "final is average"),
)  # fmt: skip


def _added(metric: str, place: int) -> Printed:
    """Return what row `place` of Table 4 adds to the row above it.

    Half a digit of either row is open; footnote 1 prints the first step of PSNR itself.
    """
    row, above = TABLE4[place], TABLE4[place - 1]
    digits = {"psnr": 1, "ssim": 3}[metric]
    step, noted = round(row[metric] - above[metric], digits), (metric, place) == ("psnr", 1)
    return Printed(
        f"table4-{row['method']}-{metric}",
        ("Table 4", "§10 footnote 1") if noted else ("Table 4",),
        step,
        f"{row['configuration'].removeprefix('+ ')} adds {LABELS[metric]} to the row above it on lego",
        "added part",
        UNITS[metric],
        {"scene": "lego", "method": row["method"], "against": above["method"], "metric": metric},
        None if noted else (round(step - 0.1**digits, 3), round(step + 0.1**digits, 3)),
    )


ABLATION = (
    *(Printed(f"table4-{metric}", ("Table 4",), _ends([row[metric] for row in TABLE4]),
              f"The four rows of Table 4 reach this {label} on lego", "each level", UNITS[metric],
              {"table": "table4", "column": metric, "metric": metric})
      for metric, label in LABELS.items()),
    *(_added(metric, place) for metric in LABELS for place in (1, 2, 3)),
    Printed("table4-lego", ("Table 2", "Table 4"), 2, "Scores on lego that are those of Table 2", "row of table 2"),
    Printed("footnote1-table", ("§10 footnote 1",), 7, "Number of the table that holds the ablation",
            "number of a table"),
)  # fmt: skip

ELSEWHERE = (
    Printed("section10-integration", ("§10",), None, "Seamless integration via HUAM and consciousness bridge",
            "their code"),
    Printed("footnote2-files", ("§10 footnote 2",), 189, "Source files of their vision subsystem", "their code",
            "files"),
    Printed("footnote2-lines", ("§10 footnote 2",), 44_000, "Lines of their vision subsystem", "their code", "lines"),
    Printed("footnote2-tests", ("§10 footnote 2",), 30, "Test files of their vision subsystem", "their code", "files"),
)  # fmt: skip

STATED = tuple(
    Printed(name, (where,), value, words, "setting", "", {"at": path}) for name, where, value, words, path in SETTINGS
)
SERVED = tuple(Printed(name, where, None, words, rule, unit) for name, where, words, rule, unit in SERVING)
LEDGER = (*ABSTRACT, *ARCHITECTURE, *STATED, *SCORES, *EFFICIENCY, *SERVED, *ABLATION, *ELSEWHERE)
"""All entries in the paper's order. `tests/harness/verdicts/test_paper.py` compares them with the paper's text."""


def printed() -> dict[str, Any]:
    """Return all tables and the ledger as plain data, as a run record keeps them."""
    return {
        "table1": TABLE1,
        "table2": TABLE2,
        "table3": TABLE3,
        "table4": TABLE4,
        "sloc": 427,
        "original_nerf": ORIGINAL_NERF,
        "ledger": plain(LEDGER),
    }
