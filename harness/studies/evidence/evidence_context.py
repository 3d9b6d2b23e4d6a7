"""The context of the evidence studies, one literal table of what they train, and their run."""

import json
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import torch

from harness.execution import run as execution
from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, multiplies_bfloat16, use_threads
from harness.machine.provenance import provenance
from harness.plan.profiles import PROFILES, Machine, Plan
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord, SceneRecord, cell_path, read_cells, read_cells_of, read_run
from harness.records.json_record import DamagedRecord
from harness.records.metric_table import METRICS
from harness.records.study import Studies
from harness.run_folder.integrity import DAMAGED, aside, mend, plan_of_cells
from harness.studies import framework
from harness.studies.evidence.evidence_studies import SHELF, STUDIES, TRAININGS_FOLDER
from scenes.catalog.entries import CLASSICS
from scenes.view_sets.source import Region

SEARCHED = ("chair", "ship")
"""The scenes on whose validation views the repaired Q-NeRF was chosen; its verdict is taken from the others."""
HELD_OUT = tuple(name for name in CLASSICS if name not in SEARCHED)
FACTORIAL_SCENES = ("lego", "ficus", "hotdog")
"""Scenes of blocks with fine studs, of thin leaves, and of smooth and soft shapes."""
DIRECTED = ("lego", "drums", "materials")
"""Scenes whose appearance depends on direction: drums and materials have metals and glass, which training finds out
late. lego's plastic hardly looks different from other sides.
"""
TEXTURED = ("lego", "chair")
SCARCE = 20
"""The number of training views of which half and a quarter are taken. A hundred are more than so short a training uses
up: on these scenes half of a hundred changed the score by −0.03 dB, and a quarter by −0.04.
"""
READINGS = {"Listing 2": ("amplifier", "qnerf"), "Eq. 4": ("equation4", "qnerf_theorem")}
"""Reading of the amplifier → its name in the names of combinations, and the method with all three parts."""
COMBINATIONS = (
    *("nerf", "nerf_phi_encoding", "nerf_phi_skip", "nerf_phi_encoding_phi_skip"),
    *("nerf_amplifier", "nerf_phi_encoding_amplifier", "nerf_amplifier_phi_skip", "qnerf"),
    *("nerf_equation4", "nerf_phi_encoding_equation4", "nerf_equation4_phi_skip", "qnerf_theorem"),
)
"""Every combination of the three parts under both readings."""
LADDERS = ("nerf", "nerf_matched", "nerf_phi_encoding", "nerf_phi_far", "nerf_base165")
DENSITIES = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_repaired")
"""Methods with every reading of density that a user would train."""
THIN = ("ficus", "mic")
"""Scenes of thin things, which most rays miss."""
TEN = tuple(range(10))
REPAIRED = ("nerf", "nerf_matched", "qnerf_repaired", "nerf_phi_encoding_phi_skip")


@dataclass(frozen=True)
class Training:
    """The differences from the profile `reduced`."""

    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    steps: int
    seeds: tuple[int, ...] = (0, 1, 2)
    resolution: int = 100
    train_views: int = 100
    test_views: int = 15
    checkpoints: int = 3
    half_side: float | None = None
    """Half of the side of a cube about the origin in place of the scene's own box."""


TRAININGS: dict[str, Training] = {
    "no_encoding": Training(("nerf", "nerf_no_encoding"), DIRECTED, 600),
    "no_direction": Training(("nerf", "nerf_no_direction"), DIRECTED[1:], 1000, seeds=tuple(range(6))),
    "images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE),
    "half_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 2),
    "quarter_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 4),
    "factorial": Training(COMBINATIONS, FACTORIAL_SCENES, 400),
    "bandwidth_100": Training(LADDERS, TEXTURED, 400, train_views=60, test_views=3),
    "bandwidth_200": Training(LADDERS, TEXTURED, 400, resolution=200, train_views=60, test_views=3),
    "bandwidth_300": Training(LADDERS, TEXTURED, 400, resolution=300, train_views=60, test_views=3),
    "repaired": Training(REPAIRED, HELD_OUT, 400, seeds=(0, 1), checkpoints=4),
    "box_own": Training(DENSITIES, tuple(CLASSICS), 200, seeds=TEN, checkpoints=1),
    "box_1_5": Training(DENSITIES, THIN, 200, seeds=TEN, checkpoints=1, half_side=1.5),
    "box_1_8": Training(DENSITIES, THIN, 200, seeds=TEN[:5], checkpoints=1, half_side=1.8),
    "box_2_4": Training(DENSITIES, THIN, 200, seeds=TEN[:5], checkpoints=1, half_side=2.4),
}


@dataclass(frozen=True)
class StudyRun:
    """The results of a training."""

    plan: Plan
    scenes: list[SceneRecord]
    cells: list[CellRecord]


@dataclass(frozen=True)
class EvidenceContext(framework.StudyContext):
    """One run of the studies."""

    machine: Machine
    precision_as_planned: bool
    """Whether this processor has the profile's bfloat16 matrix multiplications."""

    def plan(self, name: str) -> Plan:
        """Return the profile `reduced` with what the training of that name changes; in float32 if the processor has no
        bfloat16 matrix multiplications, and far too short for any figure to mean anything with `quick`.
        """
        training, profile = TRAININGS[name], PROFILES["reduced"]
        size, seeds, steps = training.resolution, training.seeds, training.steps
        views = replace(profile.views, resolution=size, train=training.train_views, test=training.test_views)
        if (half := training.half_side) is not None:
            views = replace(views, region=Region((-half, -half, -half, half, half, half)))
        if self.quick:
            views = replace(views, resolution=12 + size // 25, train=6, val=2, test=2, spp_train=4, spp_test=4)
            seeds, steps = seeds[:2], 4
        return replace(
            profile,
            scenes=training.scenes,
            methods=training.methods,
            seeds=seeds,
            budget=Budget(steps=steps, seconds=None),
            score=replace(profile.score, checkpoints=training.checkpoints, stored_views=0),
            views=views,
            train=profile.train if self.precision_as_planned else replace(profile.train, precision="float32"),
            extras=(),
        )

    def trained(self, name: str) -> StudyRun:
        """Return the training of that name: an ordinary run in `studies/<name>`. Cells that are there are not trained
        again, except those that failed without a chance (`lacks_cells`); what is there of another plan is moved to
        OUT/damaged.

        Studies may request the same training, one after another.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if is_of_another_plan(folder, plan):
            self.show.line(f"{folder}: of another plan, moved to {self.out / DAMAGED}: trained again")
            aside(self.out, folder.relative_to(self.out).as_posix())
        if lacks_cells(folder, plan):
            folder.mkdir(parents=True, exist_ok=True)
            execution.run(plan, folder, self.view_sets, self.machine, "nox -s evidence", self.show)
        return StudyRun(plan, read_run(folder).scenes, list(read_cells(folder)))

    def repaired(self, name: str) -> bool:
        """Repair the folder of a training, so that it holds only valid files; returns whether the training has to be
        resumed.

        A folder that is missing or is of another plan is left as it is: its figures were taken when it was there.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if not folder.exists() or is_of_another_plan(folder, plan):
            return False
        mend(folder, plan, lambda line: self.show.line(f"{name}: {line}"))
        return lacks_cells(folder, plan)

    def scale(self, *names: str) -> str:
        """Return the scale of trainings, in one line, and whether the code may have changed since they were done: cells
        of another commit, or of a tree with changes, are used all the same, as the plan decides what is compatible.
        """
        lines = [
            f"{', '.join(plan.scenes)}; {len(plan.seeds)} seeds; {plan.budget.steps} steps; {plan.views.train} "
            f"training views of {plan.views.resolution} px"
            for plan in map(self.plan, names)
        ]
        scale, here = " | ".join(dict.fromkeys(lines)), provenance(torch.device(self.machine.device))["commit"]
        commits = Counter(
            cell.provenance.get("commit", "unknown")
            for name in names
            for cell in read_cells_of(folder_of(self.out, name), self.plan(name).cells())
        )
        if not any(commit != here or commit == "unknown" or commit.endswith("-dirty") for commit in commits):
            return scale
        counts = ", ".join(f"{count} cells at commit {commit}" for commit, count in commits.items())
        return f"{scale}. Not all was trained at commit {here}, at which it was judged: {counts}"


def folder_of(out: Path, training: str) -> Path:
    """Return the folder in which the run of a training lies."""
    return out / TRAININGS_FOLDER / training


def lacks_cells(folder: Path, plan: Plan) -> bool:
    """Return whether only running it again completes a training: it is not finished, something is missing, or cells
    failed without having had their chance.
    """
    finished = False
    with suppress(DamagedRecord):
        finished = read_run(folder).finished
    if not finished or not all(cell_path(folder, *key).exists() for key in plan.cells()):
        return True
    return any(cell.status in ("error", "not_available") for cell in read_cells(folder))


def is_of_another_plan(folder: Path, plan: Plan) -> bool:
    """Return whether the training is of another plan, by its record, or by its cells if that is lost."""
    with suppress(DamagedRecord):
        return bool(read_run(folder).settings != json.loads(json.dumps(plan.settings())))
    return bool(plan_of_cells(folder, plan))


def run(
    studies: list[str], out: Path, view_sets: Path, machine: Machine, quick: bool, resume: bool, show: Progress
) -> int:
    """Run `studies` into `out`; with `resume` only those that are not complete there, or whose trainings hold cells
    that failed without a chance. Returns 0, or 3 if a check fails.

    Raises `InputError` before anything is measured if `out` cannot be used.
    """
    device = torch.device(machine.device)
    use_threads(machine.threads)
    keep_freed_memory()
    interest = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
    return framework.run(
        SHELF,
        studies,
        out,
        resume,
        {"quick": quick, "device": machine.device, "smallest_of_interest": interest},
        provenance(device),
        lambda scratch, _: EvidenceContext(out, view_sets, scratch, quick, show, machine, multiplies_bfloat16(device)),
        show,
        repaired=lambda record, context: _with_valid_trainings(record, studies, context),
        scale_of=lambda study, context: context.scale(*study.trainings),
    )


def _with_valid_trainings(record: Studies, studies: list[str], context: EvidenceContext) -> Studies:
    """Return the record without the studies, requested now or not, on a training of `studies` that has to be resumed,
    as other cells are other figures. Trainings of none of `studies` stay as they are, and so do their figures.
    """
    trainings = {name for study in studies for name in STUDIES[study].trainings}
    resumed = {name for name in sorted(trainings) if context.repaired(name)}
    kept = []
    for study in record.studies:
        if lost := sorted(resumed & set(STUDIES[study.info.id].trainings)):
            context.show.line(f"{study.info.id}: its figures are dropped, as {', '.join(lost)} has to be gone on with")
        else:
            kept.append(study)
    return msgspec.structs.replace(record, studies=kept)
