"""The Python API (docs/api.md), and the command `radiance-verdict`.

The command has the commands of `python -m harness`, and `report`, which is `python -m reports`. Each function does what
the command of its name does, on values in memory, and raises `InputError` for bad input.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.command.main import main as command
from harness.command.main import run_as_process
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from harness.records.judgements import JudgementRecord
    from harness.records.scored_pictures import ScoredPictures
    from scenes.view_sets.view_set import ViewSet

__all__ = ["InputError", "judge", "record", "report", "score", "view_set", "words"]

PROGRAM = "radiance-verdict"


def judge(
    table: "str | Path | Sequence[str | Path] | Sequence[Mapping[str, Any]] | pd.DataFrame",
    *,
    metric: str | Sequence[str] | None = None,
    lower: Sequence[str] = (),
    margin: float | None = None,
    baseline: str | None = None,
    methods: Sequence[str] = (),
    out: str | Path | None = None,
) -> "JudgementRecord":
    """Judge a table of results: one or several files in the forms of docs/judge.md, rows, or a data frame, with the
    columns scene, method, a metric, and optionally seed, steps, seconds.

    `metric` is one name or several, each judged by itself; by default psnr, else the first one. `methods` are judged
    together, by default all of the table. A missing value of a data frame is a missing result,
    which the judgement names. `margin` is the smallest effect of interest. The judgement is written into the folder
    `out`, if given, for `report`.
    """
    from harness.records.judgements import JUDGEMENT_FILE, write_judgement
    from harness.verdicts.judging import judgement
    from harness.verdicts.tables.files import rows_given

    if isinstance(table, str | Path):
        table = [table]
    elif not isinstance(table, Sequence):
        import pandas as pd

        is_in_columns = isinstance(table.index, pd.RangeIndex) or {*table.index.names} & {*table.columns}
        table = table.copy() if is_in_columns else table.reset_index()
        if table.columns.nlevels > 1:
            table.columns = [" ".join(map(str, names)).strip() for names in table.columns]
        table = table.astype(object).where(table.notna(), None).to_dict("records")
    rows = [each for each in table if isinstance(each, Mapping)]
    files = [Path(each) for each in table if not isinstance(each, Mapping)]
    metrics = [metric] if isinstance(metric, str) else metric or ()
    if files:
        judged = judgement.judge_files(files, metrics, lower, margin, baseline, methods)
    else:
        judged = judgement.judge_rows(rows_given(rows), metrics, lower, margin, baseline, methods)
    if out is not None:
        write_judgement(Path(out) / JUDGEMENT_FILE, judged)
    return judged


def words(judged: "JudgementRecord") -> str:
    """Return the lines that the command `judge` prints."""
    from harness.verdicts.judging.judgement import lines

    return "\n".join(lines(judged))


def view_set(path: str | Path, width: int | None = None) -> "ViewSet":
    """Read posed images at `width` pixels (default: as stored), of any format in docs/images.md.

    In its splits `train`, `val` and `test`, `camera_to_world` is [n, 4, 4] (OpenGL axes), and `rgba[i]` is an image
    [h, w, 4]: display colour from 0 to 1, straight alpha. `focal` is in pixels; `bounds` [2, 3], `near` and `far` are
    in the units of the poses.
    """
    from scenes.view_sets.view_set import read_view_set

    return read_view_set(path, width)


def score(
    pictures: "str | Path | Sequence[np.ndarray] | np.ndarray",
    view_set: str | Path,
    method: str,
    *,
    scene: str | None = None,
    seed: int = 0,
    seconds: float | None = None,
    **options: Any,
) -> "ScoredPictures":
    """Score pictures of a view set's test views: a folder, or arrays [h, w, 3 or 4] in the order of the views.

    `options` are those of `harness.training.scoring.others.score_pictures`: resolution, as_they_are, lpips.
    """
    from msgspec.structs import replace

    from harness.training.scoring.others import score_pictures

    of_folder = isinstance(pictures, str | Path)
    row = score_pictures(Path(pictures) if of_folder else list(pictures), Path(view_set), method, **options)
    return replace(row, scene=scene or row.scene, seed=seed, seconds=seconds)


def record(table: str | Path, *, scene: str, method: str, seed: int = 0, **values: float | None) -> None:
    """Put the result of your own training loop into a table for `judge`: a JSON file, which is created if missing.

    `values` are scores by metric, and optionally steps, seconds, core_seconds; None is a missing result. A row of the
    same scene, method and seed is replaced. Raises `InputError` for a value that is not finite, and for a file that
    does not hold a list of rows.
    """
    from harness.records.json_record import load_json, write_json

    path = Path(table)
    try:
        rows = load_json(path) if path.exists() else []
    except ValueError as error:
        raise InputError(f"{path}: {error}; name another file") from error
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: is not a list of rows; name another file")
    for name, value in values.items():
        if value is not None and not math.isfinite(value):
            raise InputError(f"{name} of {scene}, {method}, seed {seed}, is {value}; give None for a missing result")
    cell = {"scene": scene, "method": method, "seed": seed}
    others = [row for row in rows if any(row.get(key) != value for key, value in cell.items())]
    row = {name: value if value is None else float(value) for name, value in values.items()}
    write_json(path, [*others, cell | row])


def report(folder: str | Path) -> int:
    """Build the pages of an output folder, and print their paths; returns the exit code of the command."""
    from reports.__main__ import build

    return build(Path(folder), None, False, lambda line: None)


def called(arguments: list[str]) -> int:
    """Call the command that the arguments name; returns its exit code."""
    if arguments[:1] == ["report"]:
        from reports.__main__ import main as command_report

        return command_report(arguments[1:], f"{PROGRAM} report")
    return command(arguments, PROGRAM)


def main() -> None:
    sys.path.append(str(Path.cwd()))  # for modules of the user, after everything that is installed
    run_as_process(called, sys.argv[1:])
