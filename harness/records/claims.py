"""What a paper or a person claims of methods, as data: claims, printed tables, and the scale at which they hold.

A run's record keeps the files of claims whose methods it trained.
"""

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
"""Kind of claim → what has to be said of its subject. `reports.claims.claim_list.RULES` has the test of each."""
AXES = ("steps", "seconds")
STATED = "stated"
"""The id of the file that claims in one line make."""


class Statement(Record, frozen=True, kw_only=True):
    id: str
    printed: Number | Pair | None = None
    """The number, a range as a pair; None if it is claimed in words alone."""
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
    """The interval that a number derived from rounded ones leaves open. None if it is printed itself."""

    @property
    def digits(self) -> int:
        least = {"dB": 1, "h": 1}.get(self.unit, 3 if self.of.get("metric") == "ssim" else 0)
        numbers = self.printed if isinstance(self.printed, tuple) else (self.printed or 0,)
        return max(least, *map(_decimals, numbers)) if "metric" in self.of else least


def _decimals(value: Number) -> int:
    return 0 if float(value).is_integer() else len(repr(float(value)).partition(".")[2])


class Scale(Record, frozen=True, kw_only=True):
    """The settings and pictures at which printed scores are comparable with those of a run."""

    steps: int
    width: int
    height: int
    views: dict[str, int]
    """The views of each scene, by split."""
    settings: dict[str, Number]
    """Place in a run's settings, joined by dots → value."""


class AblationRow(TypedDict):
    configuration: str
    method: str
    scores: dict[str, float]


class Tables(TypedDict, total=False):
    """Printed tables other than of PSNR by scene, which some quantities are about."""

    weights: dict[str, int]
    """Component → number of weights, `total` of all."""
    times: dict[str, dict[str, float]]
    """Row → method → value."""
    ablation: list[AblationRow]
    original: dict[str, float]
    """Scene → PSNR of the baseline in its own publication."""


class Measured(TypedDict, total=False):
    weights: dict[str, int]
    """Component → number of weights at the printed size."""
    sloc: int
    """Our lines for the same parts."""
    sloc_files: dict[str, int]


class ClaimFile(Record, frozen=True, kw_only=True):
    """The claims of one source."""

    id: str
    title: str
    source: str = ""
    methods: tuple[str, ...]
    """The methods that it is about: a run that trains one of them shows its claims."""
    claims: tuple[Statement, ...]
    names: dict[str, str] = field(default_factory=dict)
    """Method → its name there."""
    question: str = ""
    """The question that a run answers; `{id}` stands for a claim's number."""
    scale: Scale | None = None
    """None if the claims are about any run."""
    facts: dict[str, str] = field(default_factory=dict)
    """Label of a fact of a run → the same of the source."""
    principal: dict[str, str] = field(default_factory=dict)
    """Id of a claim of the first screen → its few words there; empty for all claims, in their own words."""
    target: float | None = None
    """The PSNR in dB that its times and savings are to."""
    psnr: dict[str, dict[str, float]] = field(default_factory=dict)
    """Scene, or `average` → column, such as a method → printed PSNR in dB."""
    tables: Tables = field(default_factory=Tables)
    measured: Measured = field(default_factory=Measured)
    """Written by a run; empty in a file."""

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Return the pairs of methods that claims compare, in their order."""
        subjects = [claim.of for claim in self.claims if {"method", "against"} <= claim.of.keys()]
        return list(dict.fromkeys((of["method"], of["against"]) for of in subjects))

    @property
    def scenes(self) -> dict[str, dict[str, float]]:
        """Return the rows of `psnr` without the average."""
        return {scene: row for scene, row in self.psnr.items() if scene != "average"}
