"""The part of a ray in the box, over rays and boxes of every kind."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.numerics.bounds import ray_box

coordinates = st.floats(-4.0, 4.0, width=32)
vectors = st.tuples(coordinates, coordinates, coordinates)


@settings(deadline=None, derandomize=True, max_examples=80, database=None)
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
