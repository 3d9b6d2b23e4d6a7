"""`nox -s speed`: the arithmetic behind its figures. Nothing is timed here, clocks are made up."""

import math
from itertools import count

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from baselines.contract import Box, NetworkSize
from baselines.numerics.encoding import PHI, fourier_features, frequency_ladder
from baselines.numerics.quadrature import midpoint
from baselines.plain import PlainField, plain_loss
from harness.studies.speed.growth import exponent
from harness.studies.speed.kernels import by_autograd, by_product, largest_error
from harness.studies.speed.memory import family_of, proportional_bytes
from harness.studies.speed.memory_worker import memory_of
from harness.studies.speed.speed_context import interleaved
from harness.studies.speed.throughput import products, step_flops
from harness.studies.speed.time_to_target import PsnrCurve, Target, reached, targets_of
from tests.harness.tiny import rays_and_colours

# products


def test_products_of_the_paper_by_hand() -> None:
    """Table 1: 63 → 256, 256 → 256 seven times, 63 once more, heads, 27 once a ray."""
    size = NetworkSize()
    a_point = 63 * 256 + 7 * 256 * 256 + 63 * 256 + 256 * 1 + 256 * 128 + 128 * 128 + 128 * 3
    without_gradient = 2 * 63 * 256
    expected = 6 * a_point * 65536 - 2 * without_gradient * 65536 + 4 * 27 * 128 * 1024
    assert step_flops(size, 65536, 1024) == expected
    assert step_flops(size, 65536, 1024, view_dependent=False) == expected - 4 * 27 * 128 * 1024


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
@pytest.mark.parametrize("view_dependent", [True, False])
def test_products_have_all_weights_of_the_field(depth: int, view_dependent: bool) -> None:
    size = NetworkSize(depth, 24, 2, 12, 5, 3)
    field = PlainField(size, Box(-torch.ones(3), torch.ones(3)), 0, view_dependent)
    weights = sum(weight.numel() for weight in field.parameters() if weight.ndim == 2)
    assert sum(row.inputs * row.outputs for row in products(size, view_dependent)) == weights


def test_flops_against_those_that_torch_counts() -> None:
    """The plain step does the same products, and those for gradients into encodings, and directions at every point."""
    size, samples = NetworkSize(5, 24, 2, 12, 4, 2), 8
    rays, colours = rays_and_colours(16)
    field = PlainField(size, Box(-torch.ones(3), torch.ones(3)), 0)
    with FlopCounterMode(display=False) as counter:
        plain_loss(field, rays, colours, samples, None).backward()
    points, position, direction = 16 * samples, 27, 15
    wasted = 2 * position * 24 * points  # gradient into the encoded position at the skip
    wasted += 6 * direction * 12 * points - 4 * direction * 12 * 16
    assert counter.get_total_flops() == step_flops(size, points, 16) + wasted


# time to a target


def curve(*points: tuple[float, float]) -> PsnrCurve:
    made = PsnrCurve()
    for seconds, psnr in points:
        made.add(seconds, psnr)
    return made


def test_a_crossing_is_interpolated_over_log_seconds() -> None:
    made = curve((1.0, 10.0), (4.0, 20.0), (8.0, 21.0))
    assert reached(made, 15.0) == pytest.approx(2.0)
    assert reached(made, 20.0) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("points", "seconds"),
    [
        ([], None),
        ([(1.0, 30.0)], None),  # nothing holds it yet
        ([(1.0, 30.0), (2.0, 30.0)], 1.0),
        ([(1.0, 10.0), (2.0, 14.9)], None),
        ([(1.0, 10.0), (2.0, 16.0)], None),
        ([(1.0, 10.0), (2.0, 16.0), (3.0, 14.0)], None),  # lost again
        ([(1.0, 10.0), (2.0, 16.0), (3.0, 14.0), (4.0, 15.0), (5.0, 15.0)], 4.0),
    ],
)
def test_a_target_is_reached_once_it_is_held(points: list[tuple[float, float]], seconds: float | None) -> None:
    found = reached(curve(*points), 15.0)
    assert found == (None if seconds is None else pytest.approx(seconds))


def test_targets_are_the_best_so_far_and_when_it_was_first_reached() -> None:
    plain = curve((10.0, 12.0), (20.0, 17.0), (30.0, 16.0), (40.0, 17.0))
    assert targets_of(plain, (1.0, 0.5, 0.25, 0.01)) == [
        Target(1.0, 17.0, 20.0),
        Target(0.5, 17.0, 20.0),
        Target(0.25, 12.0, 10.0),
        Target(0.01, 12.0, 10.0),
    ]


# figures


def test_sides_are_taken_in_turn_and_fast_ones_are_repeated() -> None:
    called: list[str] = []
    ticks = count()
    seconds = interleaved(
        {"a": lambda: called.append("a"), "b": lambda: called.append("b")}, 3, clock=lambda: float(next(ticks))
    )
    assert called == ["a", "a", "b", "b"] + ["a", "b"] * 3
    assert seconds == {"a": [1.0] * 3, "b": [1.0] * 3}
    called.clear()
    interleaved({"a": lambda: called.append("a")}, 2, least_seconds=4.0, clock=lambda: float(next(ticks)))
    assert len(called) == 2 + 2 * 4


def test_growth_is_the_slope_of_logarithms() -> None:
    slope, low, high = exponent([1.0, 2.0, 4.0], [3.0, 12.0, 24.0])
    assert (low, high) == (pytest.approx(1.0), pytest.approx(2.0))
    assert slope == pytest.approx(1.5)


def test_the_error_of_an_encoding_is_against_float64() -> None:
    x = 2.0 * torch.rand(200, 3, generator=torch.Generator().manual_seed(1)) - 1.0
    features = fourier_features(x, frequency_ladder(PHI, 10))
    assert 1e-7 < largest_error(features, x, PHI, 10) < 1.2e-5
    features[17, 40] += 0.25
    assert largest_error(features, x, PHI, 10) == pytest.approx(0.25, abs=1e-4)


def test_every_quadrature_that_is_compared_computes_the_same() -> None:
    generator = torch.Generator().manual_seed(2)
    t_edges = torch.linspace(2.0, 6.0, 17, dtype=torch.float64).expand(5, -1)
    sigma = 3.0 * torch.rand(5, 16, generator=generator, dtype=torch.float64)
    expected = midpoint(sigma, t_edges[:, 1:], t_edges)
    for rule in (by_autograd, by_product):
        for ours, theirs in zip(rule(sigma, t_edges[:, 1:], t_edges), expected, strict=True):
            torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-8)


# memory


STATUS = "Name:\tpython\nVmHWM:\t  123456 kB\nRssAnon:\t   1000 kB\nThreads:\t4\n"


def test_memory_is_read_from_what_the_system_says() -> None:
    assert memory_of(STATUS) == {"VmHWM": 123456 * 1024, "RssAnon": 1000 * 1024}
    assert memory_of("") == {}


def test_a_family_is_the_process_and_all_below_it(tmp_path: object) -> None:
    from pathlib import Path

    proc = Path(str(tmp_path))
    for process, parent in ((1, 0), (10, 1), (11, 10), (12, 11), (20, 1)):
        (proc / str(process)).mkdir()
        (proc / str(process) / "stat").write_text(f"{process} (a (b) name) S {parent} 1 1 0")
    (proc / "11" / "smaps_rollup").write_text("00-ff ---p [rollup]\nRss: 100 kB\nPss:    60 kB\nPss_Anon:  9 kB\n")
    assert sorted(family_of(10, proc)) == [10, 11, 12]
    assert proportional_bytes(11, proc) == 60 * 1024
    assert proportional_bytes(12, proc) == 0
    assert math.isfinite(proportional_bytes(10, proc))
