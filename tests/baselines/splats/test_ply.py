"""The file of other programs' Gaussians: against their formulas typed by hand, and against a library that reads it."""

import io
import math
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from baselines.contract import Box, Rays
from baselines.splats.gaussians import Gaussians
from baselines.splats.ply import FIXED, ply_bytes, read_ply

BOX = Box(torch.tensor([-1.0, 0.0, 2.0]), torch.tensor([3.0, 2.0, 3.0]))
MIDDLE, HALF = torch.tensor([1.0, 1.0, 2.5]), 2.0


def trained(degree: int, count: int = 30) -> Gaussians:
    draw = torch.Generator().manual_seed(degree)
    values = 0.3 * torch.randn(count, 14 + 3 * ((degree + 1) ** 2 - 1), generator=draw)
    values[:, 3:6] -= 1.5
    values[:, 10] *= 6.0
    return Gaussians(BOX, degree, values, 0.02, 0.5)


def rays() -> Rays:
    axis = torch.linspace(-0.25, 0.25, 12)
    across, up = torch.meshgrid(axis, axis, indexing="ij")
    directions = torch.stack([across.flatten(), up.flatten(), torch.ones(144)], dim=-1)
    return Rays(
        torch.tensor([[1.0, 1.0, -6.0]]).repeat(144, 1), directions / directions.norm(dim=-1, keepdim=True), 0.5, 20.0
    )


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_what_is_written_shows_the_same_picture_when_it_is_read(degree: int, tmp_path: Path) -> None:
    field = trained(degree)
    (tmp_path / "a.ply").write_bytes(ply_bytes(field))
    read = read_ply(tmp_path / "a.ply", math.inf)
    assert read.degree == degree
    seen, expected = read.render(rays()), field.render(rays())
    for name in ("colour", "opacity", "depth"):
        torch.testing.assert_close(getattr(seen, name), getattr(expected, name), rtol=1e-3, atol=2e-4)
    assert float(expected.opacity.max()) > 0.3


def test_a_library_finds_what_the_reference_implementation_writes() -> None:
    field = trained(2)
    loaded = trimesh.load(io.BytesIO(ply_bytes(field)), file_type="ply", process=False)
    vertices = loaded.metadata["_ply_raw"]["vertex"]["data"]
    assert set(vertices.dtype.names) == {*FIXED, *(f"f_rest_{k}" for k in range(24))}
    places = torch.from_numpy(np.stack([vertices[axis] for axis in "xyz"], axis=1))
    torch.testing.assert_close(places, field.values[:, :3] * HALF + MIDDLE)
    torch.testing.assert_close(torch.from_numpy(vertices["opacity"].copy()), field.values[:, 10])
    wide = (torch.exp(2.0 * field.values[:, 4]) + 0.01**2).sqrt() * HALF
    torch.testing.assert_close(torch.from_numpy(np.exp(vertices["scale_1"])), wide)


def reference_colour(rest: np.ndarray, x: float, y: float, z: float) -> float:
    """Return what `eval_sh` of the reference implementation adds to the constant, coefficients in its order."""
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    terms = [
        -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
        1.0925484305920792 * xy, -1.0925484305920792 * yz, 0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * xz, 0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * xy * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]  # fmt: skip
    return float(np.dot(terms[: len(rest)], rest))


def file_of(rows: np.ndarray, names: list[str]) -> bytes:
    header = "".join(f"property float {name}\n" for name in names)
    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{header}end_header\n"
    return text.encode() + rows.astype("<f4").tobytes()


def one(rest: int, **changes: float) -> tuple[np.ndarray, list[str]]:
    """Return one grey, nearly opaque ball of radius 0.2 at the origin, in the order in which that program writes."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(rest)),
             "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]  # fmt: skip
    values = {"opacity": 3.0, "rot_0": 2.0, **{f"scale_{k}": math.log(0.2) for k in range(3)}, **changes}
    return np.array([[values.get(name, 0.0) for name in names]]), names


def along(direction: Tensor, off: float = 0.0) -> Rays:
    """Return rays that look along a direction from four units away: through the origin, and `off` beside it."""
    beside = torch.linalg.cross(direction, torch.tensor([0.3, 0.5, -0.2]))
    towards = direction + off / 4.0 * beside / beside.norm()
    both = torch.stack([direction, towards / towards.norm(), (direction + 0.05 * beside) / 1.1])
    return Rays((-4.0 * direction).repeat(3, 1), both / both.norm(dim=-1, keepdim=True), 0.1, 9.0)


@pytest.mark.parametrize("rest", [9, 24, 45])
def test_colours_are_those_of_the_reference_implementation(rest: int, tmp_path: Path) -> None:
    rows, names = one(rest)
    draw = np.random.default_rng(rest)
    rows[0, 9 : 9 + rest] = 0.15 * draw.normal(size=rest)
    (tmp_path / "a.ply").write_bytes(file_of(rows, names))
    field = read_ply(tmp_path / "a.ply", math.inf)
    opacity = 1.0 / (1.0 + math.exp(-3.0))
    for _ in range(4):
        direction = torch.from_numpy(draw.normal(size=3)).float()
        direction /= direction.norm()
        colours = field.render(along(direction)).colour[0]
        per_channel = rows[0, 9 : 9 + rest].reshape(3, -1)
        expected = [max(0.5 + reference_colour(of, *direction.tolist()), 0.0) for of in per_channel]
        assert colours.tolist() == pytest.approx([opacity * c + 1.0 - opacity for c in expected], abs=2e-5)


def test_pictures_are_blurred_by_three_tenths_of_a_square_pixel(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(file_of(*one(0, scale_0=-9.0, scale_1=-9.0, scale_2=-9.0)))
    focal = 200.0
    field = read_ply(tmp_path / "a.ply", focal)
    off = 4.0 / focal  # one pixel beside
    seen = field.render(along(torch.tensor([0.0, 0.0, 1.0]), off)).opacity
    opacity = 1.0 / (1.0 + math.exp(-3.0))
    assert seen[:2].tolist() == pytest.approx([opacity, opacity * math.exp(-0.5 / 0.3)], rel=1e-3)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"a mesh?", "not a PLY file"),
        (file_of(np.zeros((2, 3)), ["x", "y", "z"]), "has no property scale_0"),
        (file_of(*one(7)), "1 points with 7 properties f_rest"),
        (file_of(*one(0, x=math.nan)), "not finite"),
        (file_of(*one(0, rot_0=0.0)), "rotation of length 0"),
        (file_of(*one(9))[:-4], "not a PLY file"),
        (file_of(np.zeros((0, 17)), one(0)[1]), "0 points"),
    ],
)
def test_other_files_are_refused_with_the_reason(content: bytes, why: str, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(ValueError, match=why):
        read_ply(tmp_path / "a.ply", 100.0)
