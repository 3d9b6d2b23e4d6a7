"""The context of the evidence studies, one literal table of what they train, and their run."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import torch

from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, multiplies_bfloat16, use_threads
from harness.machine.provenance import provenance
from harness.plan.profiles import PROFILES, Machine, Plan
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord, RunRecord, SceneRecord, cell_path, read_cells, read_run
from harness.records.json_record import DamagedRecord
from harness.records.metric_table import METRICS
from harness.records.study import Check, Effect, Series, Studies, Table
from harness.run_folder.integrity import DAMAGED, aside, mend, plan_of_cells
from harness.studies import framework
from harness.studies.evidence.evidence_studies import SHELF, STUDIES, TRAININGS_FOLDER
from scenes.catalog.entries import CLASSICS

SEARCHED = ("chair", "ship")
"""The scenes on which the repaired Q-NeRF was chosen, by their validation views; its verdict is taken from the
others.
"""
FACTORIAL_SCENES = ("lego", "ficus", "hotdog")
"""Scenes of blocks with fine studs, of thin leaves, and of smooth and soft shapes."""
READINGS = {
    "Listing 2": ("amplifier", "qnerf"),
    "Eq. 4": ("equation4", "qnerf_theorem"),
}
"""Reading of the amplifier → its name in the names of combinations, and the method with all three parts."""


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


def _factorial() -> tuple[str, ...]:
    """Return nerf, and every combination of the three parts under both readings."""
    names = ["nerf", "nerf_phi_encoding", "nerf_phi_skip", "nerf_phi_encoding_phi_skip"]
    for amplifier, whole in READINGS.values():
        names += [f"nerf_{amplifier}", f"nerf_phi_encoding_{amplifier}", f"nerf_{amplifier}_phi_skip", whole]
    return tuple(names)


DIRECTED = ("lego", "drums", "materials")
"""Scenes whose appearance depends on direction: drums and materials have metals and glass, which training finds out
late. lego's plastic hardly looks different from other sides.
"""
SCARCE = 20
"""The number of training views of which half and a quarter are taken. A hundred are more than so short a training uses
up: on these scenes half of a hundred changed the score by −0.03 dB, and a quarter by −0.04.
"""
LADDERS = ("nerf", "nerf_matched", "nerf_phi_encoding", "nerf_phi_far", "nerf_base165")
TEXTURED = ("lego", "chair")
HELD_OUT = tuple(name for name in CLASSICS if name not in SEARCHED)

TRAININGS: dict[str, Training] = {
    "no_encoding": Training(("nerf", "nerf_no_encoding"), DIRECTED, 600),
    "no_direction": Training(("nerf", "nerf_no_direction"), DIRECTED[1:], 1000, seeds=tuple(range(6))),
    "images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE),
    "half_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 2),
    "quarter_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 4),
    "factorial": Training(_factorial(), FACTORIAL_SCENES, 400),
    "bandwidth_100": Training(LADDERS, TEXTURED, 400, train_views=60, test_views=3),
    "bandwidth_200": Training(LADDERS, TEXTURED, 400, resolution=200, train_views=60, test_views=3),
    "bandwidth_300": Training(LADDERS, TEXTURED, 400, resolution=300, train_views=60, test_views=3),
    "repaired": Training(
        ("nerf", "nerf_matched", "qnerf_repaired", "nerf_phi_encoding_phi_skip"),
        HELD_OUT,
        400,
        seeds=(0, 1),
        checkpoints=4,
    ),
}


def plan_of(training: Training, precision_as_planned: bool, quick: bool) -> Plan:
    """Return the profile `reduced` with what the training changes; `quick` is far too short for any figure to mean
    anything.

    If the processor has no bfloat16 matrix multiplications, the plan is in float32.
    """
    profile = PROFILES["reduced"]
    views = replace(profile.views, resolution=training.resolution, train=training.train_views, test=training.test_views)
    plan = replace(
        profile,
        scenes=training.scenes,
        methods=training.methods,
        seeds=training.seeds,
        budget=Budget(steps=training.steps, seconds=None),
        score=replace(profile.score, checkpoints=training.checkpoints, stored_views=0),
        views=views,
        train=profile.train if precision_as_planned else replace(profile.train, precision="float32"),
        extras=(),
    )
    if not quick:
        return plan
    tiny = replace(views, resolution=12 + training.resolution // 25, train=6, val=2, test=2, spp_train=4, spp_test=4)
    return replace(plan, budget=Budget(steps=4, seconds=None), views=tiny, seeds=training.seeds[:2])


Finding = str | Check | Effect | Series | Table
"""A string is a sentence that answers the study's question; the first is its answer."""
Measure = Callable[["EvidenceContext"], Iterator[Finding]]


@dataclass(frozen=True)
class StudyRun:
    """The results of a training."""

    folder: Path
    plan: Plan
    scenes: list[SceneRecord]
    cells: list[CellRecord]


@dataclass(frozen=True)
class EvidenceContext:
    """One run of the studies."""

    out: Path
    view_sets: Path
    scratch: Path
    """A folder on a disk that is removed after the run."""
    machine: Machine
    precision_as_planned: bool
    """Whether this processor has the profile's bfloat16 matrix multiplications."""
    quick: bool
    """Whether to use sizes at which no figure means anything, to try the studies themselves."""
    show: Progress

    def plan(self, name: str) -> Plan:
        """Return the plan of the training of that name."""
        return plan_of(TRAININGS[name], self.precision_as_planned, self.quick)

    def trained(self, name: str) -> StudyRun:
        """Return the training of that name: an ordinary run in `studies/<name>`. Cells that are there are not trained
        again, except those that failed without a chance (`lacks_cells`); what is there of another plan is moved to
        OUT/damaged.

        Studies may request the same training, one after another.
        """
        from harness.execution import run as execution

        plan, folder = self.plan(name), folder_of(self.out, name)
        if _is_of_another_plan(folder, plan):
            self.show.line(f"{folder}: of another plan, moved to {self.out / DAMAGED}: trained again")
            aside(self.out, folder.relative_to(self.out).as_posix())
        if lacks_cells(folder, plan):
            folder.mkdir(parents=True, exist_ok=True)
            execution.run(plan, folder, self.view_sets, self.machine, "nox -s evidence", self.show)
        return StudyRun(folder, plan, read_run(folder).scenes, list(read_cells(folder)))

    def mended(self, name: str) -> bool:
        """Repair the folder of a training, so that it holds only valid files; returns whether the training has to be
        resumed.

        A folder that is missing or is of another plan is left as it is: its figures were taken when it was there.
        """
        plan, folder = self.plan(name), folder_of(self.out, name)
        if not folder.exists() or _is_of_another_plan(folder, plan):
            return False
        mend(folder, plan, lambda line: self.show.line(f"{name}: {line}"))
        return lacks_cells(folder, plan)

    def scale(self, *names: str) -> str:
        """Return the scale of trainings, in one line, and whether the code may have changed since they were done."""
        lines = []
        for name in names:
            plan = self.plan(name)
            lines.append(
                f"{', '.join(plan.scenes)}; {len(plan.seeds)} seeds; {plan.budget.steps} steps; {plan.views.train} "
                f"training views of {plan.views.resolution} px"
            )
        return ". ".join([" | ".join(dict.fromkeys(lines)), *self._trained_elsewhen(names)])

    def _trained_elsewhen(self, names: tuple[str, ...]) -> Iterator[str]:
        """Yield the trainings with cells of a commit other than the present one, or of a tree with changes, which no
        commit names. They are used all the same: the plan decides whether a cell is compatible.
        """
        import torch

        from harness.machine.provenance import provenance

        here = provenance(torch.device(self.machine.device))["commit"]
        told = []
        for name in names:
            made = Counter(
                cell.provenance.get("commit", "unknown")
                for cell in read_cells(folder_of(self.out, name))
                if (cell.scene, cell.method, cell.seed) in set(self.plan(name).cells())
            )
            if any(commit != here or not _names_the_code(commit) for commit in made):
                said = ", ".join(f"{count} cells at commit {commit}" for commit, count in made.items())
                told.append(f"{name}: {said}")
        if told:
            yield f"Not all was trained at commit {here}, at which it was judged ({'; '.join(told)})"


def folder_of(out: Path, training: str) -> Path:
    """Return the folder in which the run of a training lies."""
    return out / TRAININGS_FOLDER / training


def lacks_cells(folder: Path, plan: Plan) -> bool:
    """Whether only running it again completes a training: it is not finished, something is missing, or cells failed
    without having had their chance.
    """
    run = _run_of(folder)
    if run is None or not run.finished or not all(cell_path(folder, *one).exists() for one in plan.cells()):
        return True
    return any(cell.status in ("error", "not_available") for cell in read_cells(folder))


def _is_of_another_plan(folder: Path, plan: Plan) -> bool:
    """Whether the training is of another plan, by its record, or by its cells if that is lost."""
    run = _run_of(folder)
    if run is None:
        return bool(plan_of_cells(folder, plan))
    return run.settings != json.loads(json.dumps(plan.settings()))


def _names_the_code(commit: str) -> bool:
    return commit != "unknown" and not commit.endswith("-dirty")


def _run_of(folder: Path) -> RunRecord | None:
    with suppress(DamagedRecord):
        return read_run(folder)
    return None


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
    settings = {"quick": quick, "device": machine.device, "smallest_of_interest": interest}

    def context(scratch: Path, missing: tuple[str, ...]) -> EvidenceContext:
        return EvidenceContext(out, view_sets, scratch, machine, multiplies_bfloat16(device), quick, show)

    return framework.run(
        SHELF,
        studies,
        out,
        resume,
        settings,
        provenance(device),
        context,
        show,
        repaired=lambda record, found: _with_sound_trainings(record, studies, found),
        scale_of=lambda study, found: found.scale(*study.trainings),
    )


def _with_sound_trainings(record: Studies, studies: list[str], context: EvidenceContext) -> Studies:
    """Return the record without the studies, requested now or not, on a training of `studies` that has to be resumed,
    as other cells are other figures. Trainings of none of `studies` stay as they are, and so do their figures.
    """
    trainings = {name for study in studies for name in STUDIES[study].trainings}
    lost = {name for name in sorted(trainings) if context.mended(name)}
    dropped = {one.info.id: sorted(lost & set(STUDIES[one.info.id].trainings)) for one in record.studies}
    for name, ended in dropped.items():
        if ended:
            context.show.line(f"{name}: its figures are dropped, as {', '.join(ended)} has to be gone on with")
    kept = [one for one in record.studies if not dropped[one.info.id]]
    return msgspec.structs.replace(record, studies=kept)
