"""The facts that the record of a run holds already when the run is resumed: clocks, notices, costs of omissions."""

from pathlib import Path

from msgspec.structs import replace

from harness.records.cells import LeftOut, RunRecord, SceneRecord, read_run
from scenes.files.errors import DamagedRecord

UNMEASURED: dict[str, object] = dict(seconds_saved=None, difference=None, interval=None, clock="", verdict="", study="")
"""The fields of `LeftOut` that `--verify-omissions` fills in, before it does."""


def earlier_run(out: Path) -> RunRecord | None:
    """Return the earlier record; None if nothing can be read, which is then treated as if nothing had been there."""
    try:
        return read_run(out)
    except DamagedRecord:
        return None


def notices_of(earlier: RunRecord | None) -> dict[str, object]:
    """Return the notices of an executor for a record, `{"notices": lines}`, or an empty dictionary."""
    notices = earlier.provenance.get("notices", []) if earlier is not None else []
    return {"notices": list(notices)} if notices else {}


def with_measured(scenes: list[SceneRecord], earlier: RunRecord | None) -> list[SceneRecord]:
    """Return `scenes` with what was measured on the same view set under the same settings."""
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
