"""Whether the PSNR ceiling that a view set states agrees with independent renders."""

import json
import math
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from harness.execution.run import view_set_folders
from harness.records.cells import read_cells
from harness.records.json_record import DamagedRecord
from harness.records.study import Series, Table, check
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import TRAININGS, EvidenceContext, Finding
from harness.training.cell_training import REFERENCE_LIMITED_DB
from harness.training.metrics import psnr_from_mse
from harness.verdicts.statistics import critical
from scenes.catalog.entries import CLASSICS
from scenes.files.errors import InputError

Rows = dict[str, list[dict[str, Any]]]
"""Folder or scene → the rows printed about it."""


def noise_rows(
    kind: Literal["folders", "scenes"],
    items: Sequence[str],
    options: Sequence[str] = (),
    say: Callable[[str], None] = lambda line: None,
    module: str = "scenes",
) -> Rows:
    """Return all rows of each of `items`, in order. `say` gets a line when an item is begun.

    If a signal ends the process, the item that it was at and those behind are rendered again with `scalar_rgb`. Raises
    `InputError` with what the renderer says of wrong input, and `RuntimeError` if it fails otherwise.
    """
    rows, code, said = _asked(kind, items, options, say, module)
    if code < 0:
        say(f"rendering was ended by signal {-code}; going on with scalar_rgb")
        whole = list(rows)[:-1]
        rest = [item for item in items if item not in whole]
        again, code, said = _asked(kind, rest, [*options, "--variant", "scalar_rgb"], say, module)
        rows = {item: rows[item] for item in whole} | again
    if code == 2:
        raise InputError(said.removeprefix("scenes: "))
    if code:
        raise RuntimeError(f"rendering ended with exit code {code}: {said[-2000:]}")
    return rows


def _asked(
    kind: str, items: Sequence[str], options: Sequence[str], say: Callable[[str], None], module: str
) -> tuple[Rows, int, str]:
    """Return the rows so far, the exit code and the error output."""
    rows: Rows = {}
    with tempfile.TemporaryFile("w+") as complaints:
        command = [sys.executable, "-m", module, "noise", f"--{kind}", *items, *options]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True)
        assert process.stdout is not None
        try:
            for line in process.stdout:
                row = json.loads(line)
                if row["item"] not in rows:
                    say(f"rendering {row['scene']} ({len(rows) + 1} of {len(items)})")
                rows.setdefault(row["item"], []).append(row)
            code = process.wait()
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            process.stdout.close()
        complaints.seek(0)
        return rows, code, complaints.read().strip()


def scores_at_hand(out: Path, width: int) -> dict[str, float]:
    """Scene → PSNR of its best method, the median over seeds, of images `width` pixels wide.

    They come from the run in `out`, else from the first training of the studies that has the scene. Nothing is trained
    for it.
    """
    found: dict[str, float] = {}
    for folder in (out, *(out / "studies" / name for name in TRAININGS)):
        with suppress(DamagedRecord):
            found = _scores(folder, width) | found
    return found


def _scores(folder: Path, width: int) -> dict[str, float]:
    values: dict[tuple[str, str], list[float]] = {}
    for cell in read_cells(folder):
        psnr = cell.scores.get("psnr")
        if psnr is not None and cell.settings.get("view_set", {}).get("width") == width:
            values.setdefault((cell.scene, cell.method), []).append(psnr)
    best: dict[str, float] = {}
    for (scene, _), scores in values.items():
        best[scene] = max(best.get(scene, float("-inf")), statistics.median(scores))
    return best


TOLERANCE_DB = 0.1
TRAINING = "repaired"
"""The training whose view sets are examined, along with those of the other classics with the same settings."""
REPEATS = 2
"""The renders beside the stored one."""


@dataclass(frozen=True)
class Agreement:
    """Two ceilings of one scene: means over its test views, dB."""

    scene: str
    stated: float
    again: float
    """The ceiling from the stored images and new ones."""
    halves: float
    """The ceiling that the view set's formula gives for the new ones."""
    error: float | None
    """The standard error of stated minus again, from the spread over views; None with one view."""
    views: int

    @property
    def difference(self) -> float:
        return self.stated - self.again

    def excess(self) -> float | None:
        """Return the standard errors by which the two differ beyond what is allowed; 0 if they do not."""
        over = abs(self.difference) - TOLERANCE_DB
        if over <= 0.0:
            return 0.0
        return over / self.error if self.error else None


def agreement(scene: str, stated: Sequence[float], again: Sequence[float], halves: Sequence[float]) -> Agreement:
    """Return the agreement computed from the mean square errors that noise causes in each view."""
    levels = [[psnr_from_mse(one) for one in values] for values in (stated, again, halves)]
    apart = [a - b for a, b in zip(levels[0], levels[1], strict=True)]
    error = statistics.stdev(apart) / len(apart) ** 0.5 if len(apart) > 1 else None
    means = [statistics.fmean(one) for one in levels]
    return Agreement(scene, means[0], means[1], means[2], error, len(apart))


def ceilings(situation: EvidenceContext) -> Iterator[Finding]:
    """Yield sentences, three checks, and a table of the scenes."""
    plan = replace(situation.plan(TRAINING), scenes=tuple(CLASSICS))
    if situation.quick:
        plan = replace(plan, scenes=plan.scenes[:2])
    folders = view_set_folders(plan, situation.view_sets, situation.show)
    items = [str(folders[name]) for name in plan.scenes]
    rows = noise_rows("folders", items, ["--repeats", str(REPEATS)], situation.show.line)
    found = []
    for name in plan.scenes:
        of_scene = rows[str(folders[name])]
        found.append(agreement(name, *([row[key] for row in of_scene] for key in ("stored", "again", "halves"))))
    sample = rows[str(folders[plan.scenes[0]])][0]
    yield from judged(found)
    yield (
        f"Stored and new images have {sample['spp']} samples a pixel, in two halves each, and are compared in the "
        "float colours that scores use: the 8-bit pictures beside them play no part. Each view is rendered "
        f"{REPEATS} times more, by {sample['variant']}."
    )
    yield from limited(found, scores_at_hand(situation.out, plan.views.resolution))
    yield Series(
        "Ceiling stated and measured again", 0, "scenes", "stated ceiling, dB", "ceiling from new renders, dB",
        [one.stated for one in found], [one.again for one in found], log_x=False, log_y=False,
    )  # fmt: skip


def judged(found: Sequence[Agreement]) -> Iterator[Finding]:
    """Yield the answer, its checks and its table."""
    within = [one for one in found if abs(one.difference) <= TOLERANCE_DB]
    mean = statistics.fmean(one.difference for one in found)
    known = [one.error for one in found if one.error is not None]
    error = sum(one**2 for one in known) ** 0.5 / len(found) if len(known) == len(found) else None
    worst = max(found, key=lambda one: abs(one.difference))
    yield (
        f"{len(within)} of {len(found)} ceilings lie within {TOLERANCE_DB} dB of what new renders say; over all "
        f"scenes the stated ceiling is {_signed(mean)} dB off{_give_or_take(error)}, at most "
        f"{_signed(worst.difference)} dB{_give_or_take(worst.error)} ({worst.scene})."
    )
    yield check(
        "ceiling stated less ceiling from new renders, mean over scenes",
        mean,
        -TOLERANCE_DB,
        TOLERANCE_DB,
        "dB",
        f"standard error {error:.3f} dB" if error is not None else "no standard error: one view a scene",
    )
    excesses = [one.excess() for one in found]
    judged_ones = [one for one in excesses if one is not None]
    yield check(
        f"largest excess of a scene's difference over {TOLERANCE_DB} dB",
        max(judged_ones) if len(judged_ones) == len(found) else None,
        high=_limit(found),
        unit="standard errors",
        why=f"of the scene itself, from the spread of its views; larger by chance in at most 5 % of all studies. A "
        f"difference passes up to {TOLERANCE_DB} dB and so many standard errors, "
        f"{_widest(found):.2f} dB where they are largest"
        if len(judged_ones) == len(found)
        else "a scene with a single view has no standard error",
    )
    poorest = max(found, key=lambda one: math.inf if one.error is None else one.error)
    yield check(
        "largest standard error of a scene's difference",
        poorest.error,
        high=TOLERANCE_DB,
        unit="dB",
        why=f"{poorest.scene}; with a larger one {TOLERANCE_DB} dB would not be told, and that a scene is not called "
        "wrong would mean nothing"
        if poorest.error is not None
        else f"{poorest.scene} has a single view and no standard error",
    )
    columns = ["scene", "stated, dB", "new renders, dB", "difference, dB", "standard error, dB",
               "formula on new renders, dB", "views"]  # fmt: skip
    yield Table(
        "ceilings", 0, "PSNR ceilings of the test views", columns,
        [[one.scene, one.stated, one.again, one.difference, one.error, one.halves, float(one.views)] for one in found],
    )  # fmt: skip


def limited(found: Sequence[Agreement], scores: dict[str, float]) -> Iterator[str]:
    """Yield how far the best available scores stay below the ceiling."""
    room = {one.scene: one.again - scores[one.scene] for one in found if one.scene in scores}
    if not room:
        yield "No trained cell is at hand in this folder to stand beside the ceilings."
        return
    near = [name for name, value in room.items() if value < REFERENCE_LIMITED_DB]
    least = min(room, key=lambda name: room[name])
    said = f"{listed(near)} are reference-limited" if near else "none is reference-limited"
    yield (
        f"The best cells of this folder stay {room[least]:.1f} dB ({least}) to {max(room.values()):.1f} dB below the "
        f"ceiling of their scene; within {REFERENCE_LIMITED_DB:g} dB of it {said}."
    )


def _limit(found: Sequence[Agreement]) -> float:
    """Return Student's limit for as many scenes as there are, with the fewest views that any of them has."""
    return critical(max(1, min(one.views for one in found) - 1), len(found))


def _widest(found: Sequence[Agreement]) -> float:
    """Return the largest difference in dB of a scene that passes."""
    return TOLERANCE_DB + _limit(found) * max(one.error or 0.0 for one in found)


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")


def _give_or_take(error: float | None) -> str:
    return "" if error is None else f" ± {error:.3f}"
