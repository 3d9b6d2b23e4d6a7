"""The view cache (§8.1, Listing 5) on a finished run: latency, bytes, camera paths, and what a lesser key confuses."""

from harness.finished import TrainedCell
from harness.serving.cache_confusions import confusions, in_other_calls, variants
from harness.serving.cache_latency import bytes_a_view, latencies
from harness.serving.cache_paths import followed, routes
from harness.serving.situation import Situation
from harness.serving_record import CacheRecord

SCENE = "lego"
METHODS = ("nerf", "qnerf")
"""Looked at where the run has them."""


def measured(situation: Situation) -> CacheRecord | None:
    """None where no method of the run can be rendered here."""
    cells = cells_of(situation)
    if not cells:
        return None
    found = []
    for cell in cells:
        if situation.is_over(f"latencies of {cell.learner.method}"):
            break
        situation.show.line(f"  latencies of {cell.learner.method} on {cell.scene.name}")
        found += latencies(situation, cell)
    first = cells[0]
    memory, disk = bytes_a_view(situation, first)
    paths = []
    for number, route in enumerate(routes(situation, first, memory)):
        situation.show.line(f"  {route.path}")
        if (path := followed(situation, first, route, number)) is not None:
            paths.append(path)
    if len(cells) > 1:
        situation.leave_out(f"camera paths were followed with {first.learner.method} alone: hits are any method's")
    situation.show.line("  what a key of the pose alone would return")
    mixed = confusions(situation, first, variants(situation, first))
    for cell in cells[1:]:
        mixed += confusions(situation, cell, in_other_calls(cell))
    camera = situation.camera(first, situation.orbit(first.scene, 1)[0])
    return CacheRecord(camera.width, camera.height, found, paths, mixed, memory, disk)


def cells_of(situation: Situation) -> list[TrainedCell]:
    """Of one scene: two methods if there is a scene that has them, ours first."""
    names = {scene.name: scene for scene in situation.scenes}
    preferred = ([names.pop(SCENE)] if SCENE in names else []) + list(names.values())
    methods = [name for name in METHODS if name in situation.methods]
    methods += [name for name in situation.methods if name not in methods]
    best: list[TrainedCell] = []
    for scene in preferred:
        cells: list[TrainedCell] = []
        for method in methods:
            if len(cells) < len(METHODS) and (cell := situation.trained(scene, method)) is not None:
                cells.append(cell)
        if len(cells) > len(best):
            best = cells
        if len(best) == min(len(METHODS), len(methods)):
            break
    return best
