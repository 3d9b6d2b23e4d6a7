"""The views that the methods are scored on, as far as they are still there."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.finished import FinishedRun
from harness.records import SceneRecord
from scenes.errors import InputError
from scenes.pixels import over_white
from scenes.view_set import Split


@dataclass(frozen=True)
class Truth:
    """The test views of one scene at one size; without any, `missing` says why."""

    names: tuple[str, ...]
    poses: np.ndarray
    """float64 [views, 4, 4], OpenGL axes."""
    split: Split | None
    missing: str = ""

    def __len__(self) -> int:
        return len(self.names)

    def colour(self, view: int) -> np.ndarray:
        """float32 [h, w, 3], display colour over white."""
        assert self.split is not None
        return over_white(self.split.rgba[view])

    def opacity(self, view: int) -> np.ndarray:
        """float32 [h, w]."""
        assert self.split is not None
        return self.split.rgba[view][..., 3]

    def depth(self, view: int) -> np.ndarray | None:
        """float32 [h, w], 0 where nothing was hit; None for a view set that has no depth."""
        assert self.split is not None
        return None if self.split.depth is None else self.split.depth[view]


def no_truth(why: str) -> Truth:
    return Truth((), np.zeros((0, 4, 4)), None, why)


def read_truth(run: FinishedRun, scene: SceneRecord, view_sets: Path, width: int, scratch: Path | None) -> Truth:
    """Of a finished run's scene, at `width` pixels or the views' own width where that is smaller; decoded images go to
    `scratch`. Never raises for what is wrong with the view set.
    """
    try:
        found = run.views(scene, view_sets, min(width, scene.width), scratch=scratch)
    except (InputError, OSError) as error:
        return no_truth(f"No ground truth: {error}")
    return Truth(found.test.names, found.test.camera_to_world, found.test)
