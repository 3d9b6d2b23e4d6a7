"""Facts in the record of a run that a resumed run keeps: clocks, costs of omissions."""

from pathlib import Path

from msgspec.structs import replace

from harness.records.cells import LeftOut, RunRecord, SceneRecord, read_run
from scenes.files.errors import DamagedRecord

UNMEASURED: dict[str, object] = dict(seconds_saved=None, difference=None, interval=None, clock="", verdict="", study="")
"""The values of the fields of `LeftOut` that `--verify-omissions` fills in, before it does."""


def earlier_run(out: Path) -> RunRecord | None:
    """Return the earlier record; None if there is none or it cannot be read."""
    try:
        return read_run(out)
    except DamagedRecord:
        return None


def with_measured(scenes: list[SceneRecord], earlier: RunRecord | None) -> list[SceneRecord]:
    """Return `scenes` with the costs of omissions that were measured on the same view sets."""
    if earlier is None:
        return scenes
    before = {scene.name: scene for scene in earlier.scenes}
    return [
        replace(scene, left_out=[_measured(row, before[scene.name].left_out) for row in scene.left_out])
        if scene.name in before and _views_of(scene) == _views_of(before[scene.name])
        else scene
        for scene in scenes
    ]


def _measured(row: LeftOut, before: list[LeftOut]) -> LeftOut:
    measured = (other for other in before if other.verdict and not other.study)
    return next((other for other in measured if replace(other, **UNMEASURED) == row), row)


def _views_of(scene: SceneRecord) -> tuple[object, ...]:
    sizes = scene.width, scene.height, scene.views, scene.near, scene.far, scene.bounds
    return scene.view_set, scene.rendered.get("digest"), *sizes
