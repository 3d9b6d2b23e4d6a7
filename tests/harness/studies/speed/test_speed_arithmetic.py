"""`nox -s speed`: the arithmetic behind its figures. Nothing is timed here, clocks are made up."""

from itertools import count
from pathlib import Path

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from baselines.contract import Box, NetworkSize
from baselines.numerics.quadrature import midpoint
from baselines.plain import PlainField, plain_loss
from harness.execution.progress import Quiet
from harness.machine.peak_memory import peak_bytes
from harness.plan.run_plan import Machine
from harness.studies.speed import throughput
from harness.studies.speed.growth import exponent
from harness.studies.speed.kernels import RULES
from harness.studies.speed.memory import session_bytes
from harness.studies.speed.speed_context import SpeedContext, interleaved
from harness.studies.speed.throughput import step_flops
from tests.harness.tiny import rays_and_colours


@pytest.mark.parametrize("depth", [1, 2, 4, 5, 8])
@pytest.mark.parametrize("view_dependent", [True, False])
def test_flops_against_those_that_torch_counts(depth: int, view_dependent: bool) -> None:
    """The plain step also computes gradients into encodings, and directions at every point."""
    size, samples, rays = NetworkSize(depth, 24, 2, 12, 4, 2), 8, 16
    field = PlainField(size, Box(-torch.ones(3), torch.ones(3)), 0, view_dependent)
    with FlopCounterMode(display=False) as counter:
        plain_loss(field, *rays_and_colours(rays), samples, None).backward()
    points, position, direction = rays * samples, 27, 15
    after_the_skip = 1 + 12 if field.skip == depth - 1 else 24
    wasted = 2 * position * after_the_skip * points  # gradient into the encoded position at the skip
    wasted += (6 * points - 4 * rays) * direction * 12 if view_dependent else 0
    assert counter.get_total_flops() == step_flops(size, points, rays, view_dependent) + wasted


def test_sides_are_taken_in_turn_and_fast_ones_are_repeated() -> None:
    called: list[str] = []
    ticks = map(float, count())
    sides = {"a": lambda: called.append("a"), "b": lambda: called.append("b")}
    assert interleaved(sides, 3, clock=lambda: next(ticks)) == {"a": [1.0] * 3, "b": [1.0] * 3}
    assert called == ["a", "a", "b", "b"] + ["a", "b"] * 3
    called.clear()
    interleaved({"a": sides["a"]}, 2, least_seconds=4.0, clock=lambda: next(ticks))
    assert len(called) == 2 + 2 * 4


@pytest.mark.parametrize(("seconds", "chunks"), [(0.1, [1024, 2048]), (3.0, [1024])])
def test_of_an_emulated_type_only_the_smallest_multiplication_is_timed(
    seconds: float, chunks: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(throughput, "interleaved", lambda sides, *_: {name: [seconds] for name in sides})
    context = SpeedContext(tmp_path, tmp_path, tmp_path, True, Quiet(), Machine("cpu", 1, 1), 1.0)
    assert list(throughput._matmul_rates(context, 8, torch.float32)) == chunks


def test_growth_is_the_slope_of_logarithms() -> None:
    assert exponent([1.0, 2.0, 4.0], [3.0, 12.0, 24.0]) == pytest.approx((1.5, 1.0, 2.0))


@pytest.mark.parametrize("name", ["autograd", "product"])
def test_every_quadrature_that_is_compared_computes_the_same(name: str) -> None:
    generator = torch.Generator().manual_seed(2)
    t_edges = torch.linspace(2.0, 6.0, 17, dtype=torch.float64).expand(5, -1)
    sigma = 3.0 * torch.rand(5, 16, generator=generator, dtype=torch.float64)
    _, rule = RULES[name]
    torch.testing.assert_close(
        rule(sigma, t_edges[:, 1:], t_edges), midpoint(sigma, t_edges[:, 1:], t_edges), rtol=0, atol=1e-8
    )


def test_memory_is_read_from_what_the_system_says(tmp_path: Path) -> None:
    (tmp_path / "status").write_text("Name:\tpython\nVmHWM:\t  123456 kB\nRssAnon:\t   1000 kB\nThreads:\t4\n")
    assert peak_bytes(tmp_path / "status") == 123456 * 1024
    assert peak_bytes(tmp_path / "missing") > 0


def test_a_session_is_counted_with_shared_pages_once(tmp_path: Path) -> None:
    for process, session, kibibytes in ((10, 10, 60), (11, 10, 7), (12, 12, 900), (13, 10, None)):
        (tmp_path / str(process)).mkdir()
        (tmp_path / str(process) / "stat").write_text(f"{process} (a (b) name) S 1 10 {session} 1 0")
        if kibibytes:
            pages = f"00-ff ---p [rollup]\nRss: 100 kB\nPss:    {kibibytes} kB\nPss_Anon:  9 kB\n"
            (tmp_path / str(process) / "smaps_rollup").write_text(pages)
    assert session_bytes(10, tmp_path) == 67 * 1024, "a process has ended meanwhile"
