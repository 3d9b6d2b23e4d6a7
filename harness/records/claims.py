"""Claims about methods as data: statements, printed tables, and the scale at which they hold."""

from typing import Literal, TypedDict

from msgspec import field

from harness.records.json_record import Record

Number = int | float
Pair = tuple[Number, Number]
Bound = Literal["", "at least", "at most"]

QUANTITIES: dict[str, tuple[str, ...]] = {
    "gain": ("method", "against", "scene", "metric"),
    "each gain": ("method", "against", "table", "column", "metric"),
    "each level": ("table", "column", "metric"),
    "saving": ("method", "against", "axis"),
    "derived saving": ("method", "against", "axis"),
    "added part": ("method", "against", "scene", "metric"),
    "score": ("method", "scene", "metric"),
    "time to target": ("method",),
    "weights": ("method",),
    "listing 1": (),
    "skip layer": (),
    "sum of weights": (),
    "differences of rows": ("method", "against"),
    "means of rows": (),
    "range of rows": (),
    "scenes of rows": (),
    "source of the baseline": ("method",),
    "ratio of times": ("method", "against", "row"),
    "final is average": (),
    "row of table 2": (),
    "number of a table": (),
    "retrieval": (),
    "pose key": (),
    "attended first": (),
    "factor of priorities": (),
    "setting": ("at",),
    "lines": (),
    "their code": (),
}
"""Kind of claim → the keys that its subject needs. `reports.claims.claim_list.RULES` tests each kind."""
AXES = ("steps", "seconds")
STATED = "stated"
"""The id of the claim file that one-line claims form."""


class Statement(Record, frozen=True, kw_only=True):
    id: str
    printed: Number | Pair | None = None
    """The number, or a range as a pair; None if the claim has no number."""
    statement: str
    """The claim in a sentence, without the number."""
    quantity: str
    """The kind of claim, a key of `QUANTITIES`."""
    where: tuple[str, ...] = ()
    bound: Bound = ""
    unit: str = ""
    of: dict[str, str] = field(default_factory=dict)
    """The subject: method, against, scene, metric, axis, table, column."""
    leaves_open: tuple[float, float] | None = None
    """The interval of a number that is derived from rounded numbers; None if the number itself is printed."""

    @property
    def digits(self) -> int:
        minimum = {"dB": 1, "h": 1}.get(self.unit, 3 if self.of.get("metric") == "ssim" else 0)
        numbers = self.printed if isinstance(self.printed, tuple) else (self.printed or 0,)
        return max(minimum, *map(_decimals, numbers)) if "metric" in self.of else minimum


def _decimals(value: Number) -> int:
    return 0 if float(value).is_integer() else len(repr(float(value)).partition(".")[2])


class Scale(Record, frozen=True, kw_only=True):
    """The settings and picture sizes at which the printed scores are comparable with those of a run."""

    steps: int
    width: int
    height: int
    views: dict[str, int]
    """The views of each scene, by split."""
    settings: dict[str, Number]
    """Dotted path in a run's settings → value."""


class AblationRow(TypedDict):
    configuration: str
    method: str
    scores: dict[str, float]


class Tables(TypedDict, total=False):
    """The printed tables other than PSNR by scene."""

    weights: dict[str, int]
    """Component → number of weights; `total` is their sum."""
    times: dict[str, dict[str, float]]
    """Row → method → value."""
    ablation: list[AblationRow]
    original: dict[str, float]
    """Scene → PSNR of the baseline in its own publication."""


class Measured(TypedDict, total=False):
    weights: dict[str, int]
    """Component → number of weights at the printed size."""
    sloc: int
    """The lines of this program for the same parts."""
    sloc_files: dict[str, int]


class ClaimFile(Record, frozen=True, kw_only=True):
    """The claims of one source."""

    id: str
    title: str
    source: str = ""
    methods: tuple[str, ...]
    """The methods of the claims; the claims are shown by each run that trains at least one."""
    claims: tuple[Statement, ...]
    names: dict[str, str] = field(default_factory=dict)
    """Method → its name in the source."""
    question: str = ""
    """The question that a run answers; `{id}` stands for a claim's number."""
    scale: Scale | None = None
    """None if the claims hold for every run."""
    facts: dict[str, str] = field(default_factory=dict)
    """Label of a fact of a run → the same fact of the source."""
    principal: dict[str, str] = field(default_factory=dict)
    """Id of a claim of the first screen → its short text there; empty to show all claims with their own statements."""
    target: float | None = None
    """The target PSNR of its times and savings, in dB."""
    psnr: dict[str, dict[str, float]] = field(default_factory=dict)
    """Scene or `average` → column, such as a method → printed PSNR in dB."""
    tables: Tables = field(default_factory=Tables)
    measured: Measured = field(default_factory=Measured)
    """Written by a run; empty in a file."""

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Return the pairs of methods that claims compare, in the order of the claims."""
        subjects = [claim.of for claim in self.claims if {"method", "against"} <= claim.of.keys()]
        return list(dict.fromkeys((of["method"], of["against"]) for of in subjects))

    @property
    def scenes(self) -> dict[str, dict[str, float]]:
        """Return the rows of `psnr` without the average."""
        return {scene: row for scene, row in self.psnr.items() if scene != "average"}
