"""Invariants over many shapes and magnitudes."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from baselines.numerics.bounds import ray_box
from baselines.numerics.quadrature import midpoint

law = settings(deadline=None, derandomize=True, max_examples=80, database=None)

densities = st.one_of(st.just(0.0), st.floats(1e-12, 1e12), st.floats(0.01, 10.0))
lengths = st.one_of(st.just(0.0), st.floats(1e-9, 1e3), st.floats(0.01, 1.0))
ray_of_bins = st.lists(st.tuples(densities, lengths), min_size=1, max_size=24)
coordinates = st.floats(-4.0, 4.0, width=32)
vectors = st.tuples(coordinates, coordinates, coordinates)


def ray_from(bins: list[tuple[float, float]]) -> tuple[Tensor, Tensor, Tensor]:
    """One ray in float64 whose bins have exactly these optical depths, up to rounding of the fenceposts."""
    t_edges = torch.tensor([[0.0, *(length for _, length in bins)]], dtype=torch.float64).cumsum(-1)
    sigma = torch.tensor([[density for density, _ in bins]], dtype=torch.float64)
    return sigma, 0.5 * (t_edges[:, 1:] + t_edges[:, :-1]), t_edges


@law
@given(ray_of_bins, st.data())
def test_a_ray_in_two_parts_is_the_ray(bins: list[tuple[float, float]], data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(bins)))
    sigma, t, t_edges = ray_from(bins)
    w, T_end = midpoint(sigma, t, t_edges)
    if cut in (0, len(bins)):
        return
    front_w, front_T = midpoint(sigma[:, :cut], t[:, :cut], t_edges[:, : cut + 1])
    back_w, back_T = midpoint(sigma[:, cut:], t[:, cut:], t_edges[:, cut:])
    torch.testing.assert_close(torch.cat([front_w, front_T * back_w], dim=-1), w, rtol=0.0, atol=1e-12)
    torch.testing.assert_close(front_T * back_T, T_end, rtol=0.0, atol=1e-12)


@law
@given(ray_of_bins, st.data(), st.floats(0.0, 1.0))
def test_splitting_a_bin_of_constant_density_changes_nothing(
    bins: list[tuple[float, float]], data: st.DataObject, share: float
) -> None:
    at = data.draw(st.integers(0, len(bins) - 1))
    sigma, t, t_edges = ray_from(bins)
    w, T_end = midpoint(sigma, t, t_edges)
    post = torch.lerp(t_edges[:, at], t_edges[:, at + 1], share).unsqueeze(-1)
    finer = torch.cat([t_edges[:, : at + 1], post, t_edges[:, at + 1 :]], dim=-1)
    repeats = torch.ones(len(bins), dtype=torch.long)
    repeats[at] = 2
    fine_w, fine_T = midpoint(sigma.repeat_interleave(repeats, -1), finer[:, :-1], finer)
    merged = torch.cat([fine_w[:, :at], fine_w[:, at : at + 2].sum(-1, keepdim=True), fine_w[:, at + 2 :]], dim=-1)
    torch.testing.assert_close(merged, w, rtol=0.0, atol=1e-12)
    torch.testing.assert_close(fine_T, T_end, rtol=0.0, atol=1e-12)


@law
@given(ray_of_bins, st.integers(-20, 20))
def test_the_unit_of_length_does_not_matter(bins: list[tuple[float, float]], exponent: int) -> None:
    """Exactly: powers of two scale without rounding."""
    sigma, t, t_edges = ray_from(bins)
    scaled = midpoint(sigma / 2.0**exponent, t * 2.0**exponent, t_edges * 2.0**exponent)
    for ours, theirs in zip(scaled, midpoint(sigma, t, t_edges), strict=True):
        assert torch.equal(ours, theirs)


@law
@given(vectors, vectors.filter(lambda d: sum(c * c for c in d) > 1e-6), vectors, vectors, st.floats(0.0, 3.0))
def test_ray_box_gives_the_part_of_the_ray_in_the_box(
    o: tuple[float, ...], d: tuple[float, ...], one: tuple[float, ...], other: tuple[float, ...], near: float
) -> None:
    origin, corners = torch.tensor([o], dtype=torch.float64), torch.tensor([one, other], dtype=torch.float64)
    direction = torch.nn.functional.normalize(torch.tensor([d], dtype=torch.float64), dim=-1)
    lower, upper = corners.amin(0), corners.amax(0)
    entry, leave, hit = ray_box(origin, direction, lower, upper, near, near + 10.0)
    assert near <= float(entry) <= float(leave) <= near + 10.0
    assert bool(hit) == bool(leave > entry)
    share = torch.linspace(0.0, 1.0, 11, dtype=torch.float64)
    inside = origin + torch.lerp(entry, leave, share).unsqueeze(-1) * direction
    if hit:
        slack = 1e-9
        assert ((inside >= lower - slack) & (inside <= upper + slack)).all()
    everywhere = origin + torch.linspace(near, near + 10.0, 401, dtype=torch.float64).unsqueeze(-1) * direction
    t = torch.linspace(near, near + 10.0, 401, dtype=torch.float64)
    in_box = ((everywhere > lower + 1e-9) & (everywhere < upper - 1e-9)).all(-1)
    assert not (in_box & ((t < entry - 1e-9) | (t > leave + 1e-9))).any()
