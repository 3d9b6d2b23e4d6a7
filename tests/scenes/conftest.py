"""A tiny scene of plain shapes, rendered once per session with `scalar_rgb`."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scenes.modelling.scene import Description, Scene
from scenes.rendering.variant import Variant
from scenes.view_sets.formats.export import export
from tests.harness.ball import write_ball

COUNTS = {"train": 3, "val": 1, "test": 2}
SPP = {"train": 4, "val": 4, "test": 8}


def tiny_description() -> Description:
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 0.9, 0.8]}},
        "ball": {
            "type": "sphere",
            "radius": 0.6,
            "center": [0.2, 0.1, 0.0],
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.7, 0.3, 0.1]}},
        },
        "floor": {
            "type": "mesh",
            "vertices": np.array([[-1, -1, -0.7], [1, -1, -0.7], [1, 1, -0.7], [-1, 1, -0.7]], dtype=np.float32),
            "faces": np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32),
            "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}},
        },
    }


@pytest.fixture
def scalar() -> Variant:
    return Variant("scalar_rgb", None, "test")


@pytest.fixture
def description() -> Description:
    return tiny_description()


@pytest.fixture(scope="session")
def tiny_scene() -> Scene:
    return Scene("tiny", "A ball on a floor", tiny_description, max_depth=4)


@pytest.fixture(scope="session")
def render_tiny(tiny_scene: Scene) -> Callable[..., Path]:
    """Return `ensure_view_set` for the tiny scene; keywords override the defaults."""
    from scenes.rendering import store

    def render(cache: Path, **changes: object) -> Path:
        options: dict[str, object] = {
            "resolution": 16, "counts": COUNTS, "spp": SPP, "cache_folder": cache, "variant": "scalar_rgb", **changes,
        }  # fmt: skip
        return store.ensure_view_set(tiny_scene, **options)  # type: ignore[arg-type]

    return render


@pytest.fixture(scope="session")
def stored_once(tmp_path_factory: pytest.TempPathFactory, render_tiny: Callable[..., Path]) -> Path:
    return render_tiny(tmp_path_factory.mktemp("view_sets"))


@pytest.fixture
def view_set(stored_once: Path, tmp_path: Path) -> Path:
    """A copy of the tiny view set, which a test may damage."""
    copy = tmp_path / stored_once.name
    shutil.copytree(stored_once, copy)
    return copy


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    """A view set of another program."""
    return write_ball(tmp_path / "ball", size=12, train=4, test=2)


@pytest.fixture
def studio(tmp_path: Path, ball: Path) -> Path:
    """The same view set with a `transforms.json`."""
    export(ball, "nerfstudio", tmp_path / "studio")
    return tmp_path / "studio"
