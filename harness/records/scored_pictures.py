"""The table of `python -m harness score`, with a row per scene, method and seed; `python -m harness judge` reads it."""

from pathlib import Path

from harness.records.cells import Scores, ViewScore
from harness.records.json_record import Record, read_record, write_record
from scenes.files.json_object import JsonObject

SCHEMA = 1
REMEDY = "delete it, or name another --to"


class ScoredPictures(Scores, frozen=True):
    """The mean scores of one method's pictures of one scene; None for a metric that was not scored."""

    scene: str
    method: str
    seed: int
    views: list[ViewScore]
    made: JsonObject
    """What was scored: folder and digest of the pictures, view set, width, and whether `--as-they-are`."""
    seconds: float | None = None
    """The training seconds that the user stated."""

    @property
    def cell(self) -> tuple[str, str, int]:
        return self.scene, self.method, self.seed


class ScoreTable(Record, frozen=True):
    """The rows, in the order in which they were first scored."""

    cells: list[ScoredPictures]
    schema: int = SCHEMA


def read_scores(path: Path) -> ScoreTable:
    """Read a table, empty if there is no file; raises `DamagedRecord` for any other file."""
    return read_record(path, ScoreTable, SCHEMA, remedy=REMEDY) if path.exists() else ScoreTable([])


def write_scores(path: Path, table: ScoreTable, row: ScoredPictures) -> None:
    """Write the table with `row`, which replaces a row of the same scene, method and seed, or is appended."""
    rows = {known.cell: known for known in table.cells} | {row.cell: row}
    write_record(path, ScoreTable(list(rows.values())))
