import numpy as np
import pytest

from scenes.needs import left_out, needs
from scenes.scene import Description

DIFFUSE = {"type": "diffuse", "reflectance": {"type": "bitmap", "data": np.zeros((2, 2, 3), np.float32)}}


def scene_of(bsdf: Description) -> Description:
    return {"sky": {"type": "constant"}, "thing": {"type": "sphere", "bsdf": bsdf}}


@pytest.mark.parametrize(
    "bsdf",
    [
        DIFFUSE,
        {"type": "twosided", "bsdf": DIFFUSE},
        {"type": "mask", "opacity": 0.5, "nested": {"type": "twosided", "bsdf": DIFFUSE}},
        {"type": "bumpmap", "texture": {"type": "checkerboard"}, "bsdf": DIFFUSE},
        {"type": "blendbsdf", "weight": 0.5, "a": DIFFUSE, "b": DIFFUSE},
    ],
)
def test_lambertian_scenes_need_no_view_direction(bsdf: Description) -> None:
    found = needs(scene_of(bsdf))
    assert not found.view_direction
    assert "Lambertian" in found.reasons["view_direction"]


@pytest.mark.parametrize("kind", ["plastic", "dielectric", "roughconductor", "principled", "not_invented_yet"])
def test_one_shiny_part_needs_it(kind: str) -> None:
    wrapped = {"type": "twosided", "bsdf": {"type": "blendbsdf", "a": DIFFUSE, "b": {"type": kind}}}
    found = needs(scene_of(wrapped))
    assert found.view_direction
    assert kind in found.reasons["view_direction"]


def test_a_shape_without_material_is_diffuse() -> None:
    assert not needs({"sky": {"type": "constant"}, "thing": {"type": "sphere"}}).view_direction


def test_media_need_the_volumetric_integrator() -> None:
    description = {
        "fog": {"type": "sphere", "bsdf": {"type": "null"}, "interior": {"type": "homogeneous", "albedo": 0.5}}
    }
    found = needs(description)
    assert found.participating_media
    assert found.view_direction
    assert "homogeneous" in found.reasons["participating_media"]


def test_left_out_names_what_and_why() -> None:
    bounds = np.array([[-1.0, -1, -1], [1, 1, 1]])
    rows = left_out(needs(scene_of(DIFFUSE)), bounds)
    assert {row["what"] for row in rows} == {
        "samples outside the box", "view-direction branch", "volumetric integrator", "background model",
    }  # fmt: skip
    assert all(row["reason"] for row in rows)
    shiny = left_out(needs(scene_of({"type": "conductor"})), bounds)
    assert "view-direction branch" not in {row["what"] for row in shiny}
