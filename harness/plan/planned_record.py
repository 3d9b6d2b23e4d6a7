"""The part of a run's record that follows from its plan: what is trained, departures from the paper, omitted tests."""

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG as METHODS
from baselines.composition import Parts
from baselines.methods.chosen import chosen
from baselines.numerics.optimisers import OPTIMISER_TITLES
from harness.plan.plugins import origins, title_of
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget, Decay
from harness.plan.settings import TrainSettings, ViewSettings
from harness.records.cells import RunRecord
from scenes.modelling.needs import PARTS

ALWAYS = [
    "Eq. 3 prints its last cosine with φ^L, Listing 1 uses φ^(L−1) and keeps the raw coordinates: Listing 1 is used.",
    "Eq. 4 and Listing 2 are different operators: qnerf has Listing 2 as printed, qnerf_theorem has Eq. 4 on density.",
    "Listing 4 indexes a 2-D tensor with three indices and cannot run; every method is rendered with the sound "
    "quadrature over a white background instead (exclusive sums, expm1, no interval of 1e10). qnerf_listing4 is "
    "Q-NeRF with Listing 4 repaired only so far that it runs.",
    "Positions are normalised by the scene's box (longest half-extent 1) and multiplied by π before they are encoded, "
    "as Listing 1 prints it: 1.4 to 1.7 octaves beyond the released NeRF, whose coordinates are scene units without π "
    "(nerf_released). The paper does not say what its coordinates are.",
    "Each ray of a batch goes through a random pixel of a random image. The paper does not say from how many images a "
    "batch is drawn; the released NeRF takes one image per step for these scenes.",
    "Rays are cut to the scene's box, outside of which a rendered scene is empty: this changes samples, not the "
    "integral. A view set in the Blender format from elsewhere is taken to lie within ±1.5 unless --bounds says where.",
    "Sampling is not stated in the paper; the full profile takes the original NeRF's 64 coarse + 128 fine.",
    "The paper names no unit of length, and density is per length (Alpha Invariance, arXiv 2404.02155): what an "
    "amplifier calls 1 is a density per half of the longest side of the scene's box. For Listing 2 this unit is the "
    "largest density as well. `python -m harness study constants` tries units and starts of each method alike, on "
    "validation views. qnerf has no shift before its sigmoid, as Listing 2 prints it; qnerf_printed has a density of "
    "at most 1 per scene unit.",
    "Vanilla NeRF's density is a softplus instead of ReLU, which can die for good; Eq. 4 acts on the same density.",
    "Adam's gradient is clipped, for all networks, grids and voxels, at norm 1 and at four times the running mean of "
    "the norms before it, against single spikes: norm 1 alone may be a hundred times the usual one.",
    "Weights start Glorot-uniform with zero biases as in the original NeRF, equal for all methods wherever names and "
    "shapes match.",
    "Listing 2 takes its mean over whatever points share a call. Where empty space is skipped these are the points of "
    "occupied cells; in scoring they are those of one chunk of rays, drawn from all over the view. The occupancy grid "
    "and the density histograms ask about other points and take the mean that training rendered with last.",
    "The view cache (§8.1) knows a view by all that its picture depends on: weights, method, pose, lens, size, "
    "sampling and how rays are put into calls. Listing 5's hash of the pose alone would return another one's picture. "
    "HUAMMemory is not published: the store has what Listing 5 asks of it.",
    "Eq. 7 is taken as a priority, as its values sum to φ and not to 1: it orders the regions of a picture and shares "
    "out samples. φ scales all alike, so that nothing depends on it. What is attended to, the paper does not say.",
]


Notes = Mapping[str, tuple[str, ...]]
"""Map scene → what the reader of its images noted."""
SHAPES: dict[Decay, str] = {"exponential": "exponentially", "linear": "linearly"}


def planned_record(plan: Plan, command: str, notes: Notes) -> RunRecord:
    """Return the record of a run of `command` that has not begun; its provenance holds only the methods' packages."""
    methods = (*plan.all_methods(), *plan.guests)
    claimed = dict.fromkeys(pair for file in plan.claims for pair in file.pairs)
    return RunRecord(
        profile=plan.profile,
        command=command,
        scenes=[],
        methods={name: title_of(name) for name in methods},
        seeds=list(plan.seeds),
        settings=plan.settings(),
        provenance=origins(methods),
        phases={},
        finished=False,
        not_tested=not_tested(plan),
        deviations=deviations(plan, notes),
        guests=list(plan.guests),
        claims=list(plan.claims),
        roles=replace(plan.roles.among(plan.methods), claimed=tuple(claimed)),
    )


def deviations(plan: Plan, notes: Notes) -> list[str]:
    """Return the departures of this plan from the paper's text, with the reasons."""
    own = plan.own_settings(plan.methods)
    parts = {method: settings for method, settings in own.items() if isinstance(settings, Parts)}
    known = [name for name in plan.methods if name in METHODS]
    return [
        *ALWAYS,
        *_of_training(plan, parts),
        *_of_sampling(plan.train, parts),
        *_of_scoring(plan),
        *(f"{name}: {text}" for name in known for text in METHODS[name].deviations_with(own.get(name))),
        *_of_images(plan.views, notes),
    ]


SEARCHED_AT = {
    "reduced": "the profile reduced (100 px, 1000 steps)",
    "converged": "the profile converged (100 px, 4000 steps)",
    "full": "400 px and 1500 steps, with the network of the profile converged",
}
"""Profile with constants of its own → the scale at which they were searched."""


def _of_training(plan: Plan, parts: Mapping[str, Parts]) -> Iterator[str]:
    train, paper = plan.train, TrainSettings()
    if parts:
        each = (
            f"{method} {of.density_scale:g} and {'as printed' if of.start is None else f'{of.start:g}'}"
            for method, of in parts.items()
        )
        elsewhere = [method for method in parts if method not in chosen(plan.profile)]
        here = SEARCHED_AT[plan.profile if len(elsewhere) < len(parts) else "reduced"]
        others = f", those of {', '.join(elsewhere)} at that of {SEARCHED_AT['reduced']}"
        yield (
            f"Unit of density and density of a fresh field, per half of the box: {'; '.join(each)}. They were chosen "
            f"on validation views at the scale of {here}{others if 0 < len(elsewhere) < len(parts) else ''}."
        )
    if (train.learning_rate, train.rays) != (paper.learning_rate, paper.rays):
        yield (
            f"The learning rate falls {SHAPES[train.decay]} from {train.learning_rate:g} to "
            f"{train.last_learning_rate:g} after {train.warm_up_steps} steps of warm-up, with {train.rays} rays a step "
            f"(paper: {paper.learning_rate:g}, {paper.rays} rays): a short run would hardly begin otherwise. All "
            "networks train with it unless this list says otherwise; `python -m harness study sweep` tries optimisers "
            "and rates on validation views."
        )
    elif train.last_learning_rate != paper.learning_rate:
        yield (
            f"The learning rate falls from {train.learning_rate:g} to {train.last_learning_rate:g}, as the original "
            "NeRF's does; the paper prints one rate."
        )
    if train.optimiser != paper.optimiser:
        yield (
            f"The optimiser is {OPTIMISER_TITLES[train.optimiser.name]} with β {train.optimiser.betas[0]:g} and "
            f"{train.optimiser.betas[1]:g}, the same for all methods; the paper trains with Adam, β 0.9 and 0.999."
        )
    if train.average:
        yield (
            f"Scores are of the running mean of the weights (arXiv 2312.02696, power {train.average:g}), the same for "
            "all methods of a network; the paper has none."
        )
    if train.precision != "float32":
        yield (
            f"Matrix multiplications run in {train.precision} on float32 weights; encoding, amplifier and quadrature "
            "run in float32."
        )


def _of_sampling(train: TrainSettings, parts: Mapping[str, Parts]) -> Iterator[str]:
    if train.grid.cells and train.accelerations.grid:
        per_pixel = train.grid.per_pixel
        fineness = f"{train.grid.cells}³ cells" if per_pixel is None else f"{per_pixel:g} cells per pixel of the box"
        yield (
            "Cells of the box that the silhouettes of the training images show to be empty are never evaluated. Other "
            f"empty space is skipped by an occupancy grid of {fineness} from step {train.grid.first_step} on: one grid "
            "for each method, of its own density, all with the same rules. A "
            f"cell is left out where a ray loses less than {train.grid.opacity_threshold:.0%} of what it loses in the "
            "densest one; for Listing 2 this also changes the points that its mean runs over."
        )
        bound = [method for method, of in parts.items() if not AMPLIFIERS[of.amplifier](None).pointwise]
        if train.accelerations.hidden and bound:
            yield (
                "Points behind matter that the grid measured to be opaque are left out of training where a point's "
                f"density is its own. In {', '.join(bound)} it depends on the other points of the call: all are "
                "evaluated, which takes more core seconds and counts against the method at equal time."
            )
    if train.covered_share:
        yield (
            f"{train.covered_share:.0%} of the rays of a batch go through covered pixels of the training images, or "
            "near them, the same for all methods; the others go anywhere. The loss is the mean over the batch as it "
            "is, so that the object weighs more in it than in the scores. "
            + (
                "Of covered pixels those at edges are drawn more often: in proportion to 1 + "
                f"{train.contrast_weight:g} times their contrast with their neighbours, relative to its mean. "
                if train.contrast_weight
                else ""
            )
            + "The paper does not say how its rays are chosen."
        )


def _of_scoring(plan: Plan) -> Iterator[str]:
    if plan.score.on_curve(plan.views.test) < plan.views.test:
        yield (
            f"Curves, and scores at equal time, are means over {plan.score.curve_views} evenly spread test views; "
            "scores at the end, and so those at equal steps, are means over all."
        )


def _of_images(views: ViewSettings, notes: Notes) -> Iterator[str]:
    scenes_of: dict[str, list[str]] = {}
    for scene, note in ((scene, note) for scene, of_scene in notes.items() for note in of_scene):
        scenes_of.setdefault(note, []).append(scene)
    yield from (f"Of the view set of {', '.join(scenes)}: {note}" for note, scenes in scenes_of.items())
    if views.region is not None:
        yield ("Where the view set has what is seen (bounds, near or far) was given by hand.")
    for names, option, words in ((views.need, "--need", "kept"), (views.no_need, "--no-need", "left out")):
        if names:
            forced = ", ".join(PARTS[name].what for name in names)
            yield (f"Forced by {option}, whatever the scene needs: {words} are {forced}.")


def not_tested(plan: Plan) -> list[str]:
    """Return what a reader of the paper might expect and this plan does not test."""
    full, controls = Budget(steps=200_000, seconds=None), plan.roles.among(plan.methods).controls
    missing = []
    if plan.view_set is None and plan.scene_file is None:
        missing.append(
            "The original NeRF synthetic images: the scenes are procedural analogues of them, so absolute scores "
            "are not comparable with the paper's."
        )
    if plan.views.resolution != 800 or plan.budget != full:
        missing.append(
            f"The paper's scale: 800 × 800 views and 200 000 steps (here {plan.views.resolution} px, "
            f"{plan.budget.in_words}). "
            "Low resolution and short training reward low bandwidth"
            + (f", which is why {' and '.join(controls)} is shown for comparison." if controls else ".")
        )
    if plan.train.network.width != 256 or plan.train.network.depth != 8:
        missing.append(f"The paper's network (8 × 256): here {plan.train.network.depth} × {plan.train.network.width}.")
    if plan.train.fine_bins == 0:
        missing.append("Hierarchical (coarse and fine) sampling: an occupancy grid takes its place, for all methods.")
    if plan.budget.seconds is None and plan.budget.core_seconds is None:
        missing.append(
            "Training for equal time: scores at equal time are taken from the middle of the slower method's run, "
            "before its learning rate has fallen all the way. --budget-seconds gives every method its own."
        )
    if plan.lpips is None:
        missing.append("LPIPS: its weights are not part of this program; --lpips FILE scores with them.")
    return missing
