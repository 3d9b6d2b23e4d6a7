"""The record of `python -m harness judge`, `judgement.json`."""

from itertools import pairwise
from pathlib import Path

from msgspec import field

from harness.records.cells import Estimate
from harness.records.former.four_words import in_two_words
from harness.records.json_record import Record, read_record, write_record
from harness.records.verdict import OPEN, Verdict
from scenes.files.errors import DamagedRecord

JUDGEMENT_SCHEMA = 1
JUDGEMENT_FILE = "judgement.json"
REMEDY = "run `python -m harness judge` again"


class Pair(Record, frozen=True):
    """The difference `method` − `against` over the scenes that both have."""

    method: str
    against: str
    scenes: int
    difference: float | None
    scenes_like_these: Estimate | None
    """The estimate that the verdict comes from; None with fewer than two shared scenes."""
    on_these_scenes: Estimate | None
    """The estimate whose error comes from seeds only; None without seeds that both have."""
    scenes_to_settle: int | None = None
    """The number of scenes with this difference and spread whose sign 80 % of tables would find; None if the sign is
    known, if the difference is 0, or between methods that are not neighbours in the order."""

    @property
    def verdict(self) -> Verdict:
        return self.scenes_like_these.verdict if self.scenes_like_these else OPEN

    @property
    def distinguished(self) -> bool:
        return self.verdict.sign != "open"


class Place(Record, frozen=True):
    """A method in the order of its mean."""

    method: str
    mean: float
    """The mean over scenes of the means over seeds, adjusted for missing scenes."""
    scenes: int
    seconds: float | None
    steps: float | None
    groups: list[int]
    """The numbers of its letters, from 1: two methods share one if and only if they are not distinguished. Empty
    against a baseline; in older records runs of neighbours, which need not be so."""
    core_seconds: float | None = None
    rank: tuple[int, int] | None = None
    """Its first and last possible place: in 95 % of tables the places of all methods lie in theirs."""
    best: float | None = None
    """The probability that its mean over scenes like these is the best, by the Bayesian bootstrap over scenes."""
    origin: str = ""
    """Where its scores come from: file, source, protocol."""


class Ranking(Record, frozen=True):
    """The methods from best to worst, and all judged pairs, the better-placed method first."""

    places: list[Place]
    pairs: list[Pair]
    family: int

    @property
    def neighbours(self) -> list[Pair]:
        """Return the pairs of methods that are next to each other in the order."""
        neighbours = {frozenset(names) for names in pairwise(place.method for place in self.places)}
        return [pair for pair in self.pairs if frozenset((pair.method, pair.against)) in neighbours]


class Suspect(Record, frozen=True):
    """A result far from what its method and its scene suggest."""

    method: str
    scene: str
    seed: str
    value: float
    expected: float
    deviation: float
    """The largest residual of a fit by medians, in robust standard deviations of its method, scene or table."""


class JudgementRecord(Record, frozen=True):
    source: str
    metric: str
    unit: str
    higher_is_better: bool
    margin: float
    baseline: str | None
    scenes: list[str]
    seeds: int
    """The number of seeds; 1 if the table has none."""
    results: int
    missing: list[str]
    """The `method, scene` of cells without any result."""
    notes: list[str]
    suspects: list[Suspect]
    given: Ranking
    without_suspects: Ranking | None
    """The verdicts without the suspect results; None without a suspect."""
    digests: dict[str, str]
    """The SHA-256 of each file of the table."""
    read_as: str = ""
    """The table in one sentence, as it was understood."""
    other_metrics: list["JudgementRecord"] = field(default_factory=list)
    """The judgements of further metrics of the table, each by itself."""
    schema: int = JUDGEMENT_SCHEMA


def changed_pairs(record: JudgementRecord) -> list[tuple[Pair, Verdict]]:
    """Return the pairs whose verdict differs without the suspect results, and that verdict."""
    if record.without_suspects is None:
        return []
    after: dict[tuple[str, str], Verdict] = {}
    for pair in record.without_suspects.pairs:
        after[pair.method, pair.against] = pair.verdict
        after[pair.against, pair.method] = pair.verdict.turned
    pairs = [(pair, after[pair.method, pair.against]) for pair in record.given.pairs]
    return [(pair, verdict) for pair, verdict in pairs if verdict != pair.verdict]


def write_judgement(path: Path, record: JudgementRecord) -> None:
    write_record(path, record)


def read_judgement(path: Path) -> JudgementRecord:
    """Read the record; raises `DamagedRecord` if the file is not what this version writes."""
    record = read_record(path, JudgementRecord, JUDGEMENT_SCHEMA, remedy=REMEDY, former=in_two_words)
    if not record.given.places:
        raise DamagedRecord(f"{path}: it has no method; {REMEDY}")
    return record
