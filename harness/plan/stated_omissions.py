"""What leaving parts out saved and changed on the built-in scenes, from the published study of the same settings."""

import json
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.plan.profiles import Plan
from harness.records.cells import SceneRecord

STUDY = Path(__file__).parents[2] / "docs" / "left_out.json"
"""Written by `python -m harness study omissions --out docs/left_out.json`."""
APART = ("profile", "scenes", "methods", "seeds", "density_units", "score", "extras")
"""The settings that may differ: the study trains one method of the run, with three seeds."""


def with_stated(scenes: list[SceneRecord], plan: Plan, file: Path = STUDY) -> list[SceneRecord]:
    """Return `scenes` with what the study in `file` measured of each omission that this run has not measured itself.

    A study of other settings says nothing; on which processor it ran, and so how precise its matrix products were, it
    states itself.
    """
    study = json.loads(file.read_text())
    if _compared(study["settings"]) != _compared(plan.settings()):
        return scenes
    stated_in = f"{file.parent.name}/{file.name}"
    measured = {(row["scene"], row["name"]): row for row in study["omissions"]}
    kept = ("seconds_saved", "difference", "interval", "clock", "verdict")
    return [
        replace(
            scene,
            left_out=[
                replace(row, **{key: found[key] for key in kept}, study=stated_in)
                if not row.verdict and (found := measured.get((scene.name, row.name)))
                else row
                for row in scene.left_out
            ],
        )
        for scene in scenes
    ]


def _compared(settings: dict[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps({key: value for key, value in settings.items() if key not in APART}))
    plain["train"].pop("precision", None)
    return plain
