"""A study of whether the PSNR ceiling that a view set states agrees with independent renders."""

import json
import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from harness.execution.ground_truth import scenes_output, view_set_folders
from harness.records.study import Table, check
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found, Rows
from harness.training.scoring.metrics import psnr_from_mse
from harness.verdicts.statistics import critical
from scenes.catalog.entries import CLASSICS

TOLERANCE_DB = 0.1
TRAINING = "objections"
"""The training whose view sets are examined, with those of the other classics at the same settings."""
REPEATS = 2
"""The number of renders in addition to the stored one."""


@dataclass(frozen=True)
class Agreement:
    """Two ceilings of one scene: means over its test views, dB."""

    scene: str
    stated: float
    again: float
    """The ceiling from the stored images and new ones."""
    halves: float
    """The ceiling that the view set's formula gives for the new ones."""
    error: float
    """The standard error of stated minus again, from the spread over views."""
    views: int

    @property
    def difference(self) -> float:
        return self.stated - self.again

    @property
    def excess(self) -> float:
        """Return by how many standard errors the difference exceeds what is allowed; 0 if it does not."""
        over = abs(self.difference) - TOLERANCE_DB
        return 0.0 if over <= 0.0 else over / self.error if self.error else math.inf


def agreement(scene: str, stated: Sequence[float], again: Sequence[float], halves: Sequence[float]) -> Agreement:
    levels = [[psnr_from_mse(mse) for mse in values] for values in (stated, again, halves)]
    differences = [a - b for a, b in zip(levels[0], levels[1], strict=True)]
    error = statistics.stdev(differences) / len(differences) ** 0.5
    of_stated, of_again, of_halves = map(statistics.fmean, levels)
    return Agreement(scene, of_stated, of_again, of_halves, error, len(differences))


def ceilings(context: EvidenceContext) -> Iterator[Found]:
    plan = replace(context.plan(TRAINING), scenes=tuple(CLASSICS)[: 2 if context.quick else None])
    folders = view_set_folders(plan, context.view_sets, context.show)
    agreements, rows = [], []
    for number, name in enumerate(plan.scenes):
        context.show.line(f"rendering {name} ({number + 1} of {len(plan.scenes)})")
        rows = [json.loads(line) for line in scenes_output("noise", str(folders[name]), repeats=REPEATS).splitlines()]
        agreements.append(agreement(name, *([row[key] for row in rows] for key in ("stored", "again", "halves"))))
    sample = rows[0]
    yield from judge(agreements)
    yield (
        f"Stored and new images have {sample['spp']} samples per pixel, in two halves each, and are compared in the "
        f"float colours that scores use, not as 8-bit pictures. Each view is rendered {REPEATS} times more, by "
        f"{sample['variant']}."
    )


def judge(scenes: Sequence[Agreement]) -> Iterator[Found]:
    within = sum(abs(scene.difference) <= TOLERANCE_DB for scene in scenes)
    mean = statistics.fmean(scene.difference for scene in scenes)
    error = math.hypot(*(scene.error for scene in scenes)) / len(scenes)
    worst = max(scenes, key=lambda scene: abs(scene.difference))
    poorest = max(scenes, key=lambda scene: scene.error)
    yield (
        f"{within} of {len(scenes)} ceilings lie within {TOLERANCE_DB} dB of what new renders say; over all scenes the "
        f"stated ceiling is {_signed(mean)} dB off ± {error:.3f}, at most {_signed(worst.difference)} dB "
        f"± {worst.error:.3f} ({worst.scene})."
    )
    what, why = "ceiling stated less ceiling from new renders, mean over scenes", f"standard error {error:.3f} dB"
    yield check(what, mean, -TOLERANCE_DB, TOLERANCE_DB, "dB", why)
    limit = critical(min(scene.views for scene in scenes) - 1, len(scenes))
    what = f"largest excess of a scene's difference over {TOLERANCE_DB} dB"
    why = (
        "the scene's own standard error, from the spread of its views; larger by chance in at most 5 % of all studies. "
        f"A difference passes up to {TOLERANCE_DB} dB plus this number of standard errors: "
        f"{TOLERANCE_DB + limit * poorest.error:.2f} dB where they are largest"
    )
    yield check(what, max(scene.excess for scene in scenes), high=limit, unit="standard errors", why=why)
    what = "largest standard error of a scene's difference"
    why = (
        f"{poorest.scene}; with a larger one, {TOLERANCE_DB} dB could not be detected, and that a scene passes would "
        "mean nothing"
    )
    yield check(what, poorest.error, high=TOLERANCE_DB, unit="dB", why=why)
    columns = ["scene", "stated, dB", "new renders, dB", "difference, dB", "standard error, dB",
               "formula on new renders, dB", "views"]  # fmt: skip
    rows: Rows = [
        [scene.scene, scene.stated, scene.again, scene.difference, scene.error, scene.halves, float(scene.views)]
        for scene in scenes
    ]
    yield Table("ceilings", 0, "PSNR ceilings of the test views", columns, rows)


def _signed(value: float) -> str:
    return f"{value:+.3f}".replace("-", "−")
