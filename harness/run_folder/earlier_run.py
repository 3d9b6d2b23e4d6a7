"""What the record of a run holds already when the run is gone on with: clocks, notices, what omissions cost."""

from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.cells import LeftOut, RunRecord, SceneRecord, read_run
from harness.records.json_record import DamagedRecord

MEASURED = ("seconds_saved", "difference", "interval", "clock", "verdict")
"""Of `LeftOut`, what `--verify-omissions` fills in."""


def earlier_run(out: Path) -> RunRecord | None:
    """None where nothing is there that can be read: it is then as if nothing had been."""
    try:
        return read_run(out)
    except DamagedRecord:
        return None


def notices_of(earlier: RunRecord | None) -> dict[str, Any]:
    """For a record: `{"notices": lines}`, what an executor had to say, or nothing."""
    found = earlier.provenance.get("notices", []) if earlier is not None else []
    return {"notices": list(found)} if found else {}


def with_measured(scenes: list[SceneRecord], earlier: RunRecord | None) -> list[SceneRecord]:
    """`scenes` with what was measured on the same view set under the same settings."""
    if earlier is None:
        return scenes
    before = {scene.name: scene for scene in earlier.scenes}
    return [
        replace(scene, left_out=[_measured(row, before[scene.name].left_out) for row in scene.left_out])
        if scene.name in before and _views_of(scene) == _views_of(before[scene.name])
        else scene
        for scene in scenes
    ]


def costs_more(scenes: list[SceneRecord]) -> bool:
    """Whether something that was left out costs more than its bound."""
    return any(row.verdict == "costs more" for scene in scenes for row in scene.left_out)


def _measured(row: LeftOut, before: list[LeftOut]) -> LeftOut:
    found = next((one for one in before if one.verdict and _asked(one) == _asked(row)), row)
    return replace(row, **{name: getattr(found, name) for name in MEASURED})


def _asked(row: LeftOut) -> LeftOut:
    """What it is and may cost, without what it did."""
    return replace(row, seconds_saved=None, difference=None, interval=None, clock="", verdict="")


def _views_of(scene: SceneRecord) -> tuple[object, ...]:
    """What tells a view set from another, as far as a run's record holds it."""
    sizes = scene.width, scene.height, scene.views, scene.near, scene.far, scene.bounds
    return scene.view_set, scene.rendered.get("digest"), *sizes
