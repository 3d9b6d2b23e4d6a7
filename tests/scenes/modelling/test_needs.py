import json
from types import SimpleNamespace

import numpy as np
import pytest

from scenes.modelling.needs import as_rows, needs, needs_of
from scenes.modelling.scene import Description

DIFFUSE = {"type": "diffuse", "reflectance": {"type": "bitmap", "data": np.zeros((2, 2, 3), np.float32)}}
BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])
SKY = {"type": "constant"}
LAMP = {"type": "sphere", "emitter": {"type": "area", "radiance": 7.0}}


def scene_of(bsdf: Description) -> Description:
    return {"sky": SKY, "thing": {"type": "sphere", "bsdf": bsdf}}


def fog(sigma_t: object, shape: str = "cube", **others: object) -> Description:
    medium = {"type": "homogeneous", "albedo": 0.5, "sigma_t": sigma_t, **others}
    return {"sky": SKY, "fog": {"type": shape, "bsdf": {"type": "null"}, "interior": medium}}


SHINY = "plastic", "dielectric", "roughconductor", "principled", "not_invented_yet"


@pytest.mark.parametrize(
    ("description", "reason"),
    [
        (scene_of(DIFFUSE), "Lambertian and"),
        (scene_of({"type": "twosided", "bsdf": DIFFUSE}), "Lambertian and"),
        (scene_of({"type": "mask", "nested": {"type": "twosided", "bsdf": DIFFUSE}}), "Lambertian and"),
        (scene_of({"type": "bumpmap", "texture": {"type": "checkerboard"}, "bsdf": DIFFUSE}), "Lambertian and"),
        (scene_of({"type": "blendbsdf", "weight": 0.5, "a": DIFFUSE, "b": DIFFUSE}), "Lambertian and"),
        *((scene_of({"type": "twosided", "bsdf": {"type": "blendbsdf", "a": DIFFUSE, "b": {"type": kind}}}), kind)
          for kind in SHINY),
        (fog(1.0), "homogeneous"),
    ],
)  # fmt: skip
def test_the_view_direction_is_needed_unless_all_is_lambertian(description: Description, reason: str) -> None:
    need = needs(description)["view_direction"]
    assert need.needed == (reason != "Lambertian and")
    assert reason in need.reason


@pytest.mark.parametrize(
    ("name", "description", "needed"),
    [
        ("view_direction", {"sky": SKY, "thing": {"type": "sphere"}}, False),  # Mitsuba's usual material is diffuse
        ("participating_media", scene_of(DIFFUSE), False),
        ("participating_media", fog(1.0), True),
        ("depth_metric", scene_of(DIFFUSE), True),
        ("depth_metric", fog(1.0), False),
        ("depth_metric", fog(1.0) | scene_of(DIFFUSE), True),
        ("depth_metric", {"sky": SKY}, False),
        ("depth_metric", {"lamp": LAMP | {"bsdf": {"type": "null"}}}, True),
        ("empty_space", fog(1.0), True),  # fills the box
        ("empty_space", fog(1.0, "sphere"), False),
        ("empty_space", scene_of(DIFFUSE), False),
    ],
)
def test_what_follows_from_the_kinds_of_shapes(name: str, description: Description, needed: bool) -> None:
    assert needs(description, BOX)[name].needed == needed


@pytest.mark.parametrize(
    ("description", "bin_is_stiff", "ray_is_opaque"),
    [
        (scene_of(DIFFUSE), True, True),
        (fog(1e-3), False, False),
        (fog(5.0), False, True),  # 17 along the diagonal, 0.27 a bin
        (fog(50.0), True, True),
        (fog({"type": "rgb", "value": [0.1, 50.0, 1.0]}), True, True),
        (fog(0.5, scale=100.0), True, True),
        (fog({"type": "gridvolume", "data": np.full((2, 2, 2, 1), 50.0)}), True, True),
        ({"sky": SKY}, False, False),
    ],
)
def test_what_follows_from_the_optical_depth(description: Description, bin_is_stiff: bool, ray_is_opaque: bool) -> None:
    result = needs(description, BOX)
    assert result["fine_pass"].needed == bin_is_stiff
    assert result["linear_quadrature"].needed == bin_is_stiff
    # samples behind opaque geometry can be left out
    assert result["behind_opaque"].needed == (not ray_is_opaque)


@pytest.mark.parametrize(
    ("lights", "needed"),
    [
        ([], False),
        ([{"type": "constant", "radiance": 0.4}], False),
        ([{"type": "constant"}, {"type": "area", "radiance": {"type": "rgb", "value": [50.0, 50, 50]}}], False),
        ([{"type": "constant"}, {"type": "area", "radiance": {"type": "rgb", "value": [1e6, 1e6, 1e6]}}], True),
        ([{"type": "area", "radiance": 7.0}], False),
        ([{"type": "envmap", "data": np.array([[[1.0] * 3] * 9 + [[1e3] * 3]], np.float32)}], True),
        ([{"type": "envmap", "data": np.array([[[1.0] * 3] * 9 + [[9.0] * 3]], np.float32)}], False),
        ([{"type": "constant", "radiance": 0.0}, {"type": "area", "radiance": 1.0}], True),
        ([LAMP, {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}}], False),
        ([LAMP, {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 1e-5}}], True),
        ([LAMP, {"type": "rectangle", "bsdf": {"type": "conductor"}}], False),
    ],
)
def test_bright_over_median_light(lights: list[Description], needed: bool) -> None:
    description = {f"light{i}": light for i, light in enumerate(lights)}
    assert needs(description)["hdr_metrics"].needed == needed


def test_a_manifest_keeps_them() -> None:
    def read(rows: object) -> object:
        return needs_of(SimpleNamespace(rendered={"needs": rows}))  # type: ignore[arg-type]

    result = needs(fog(50.0), BOX, 0.02)
    assert read(json.loads(json.dumps(as_rows(result)))) == result
    assert read({"view_direction": True}) == read(None) == {}
