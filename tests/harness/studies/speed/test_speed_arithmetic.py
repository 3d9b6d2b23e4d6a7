"""`nox -s speed`: the arithmetic behind its figures. Nothing is timed here, clocks are made up."""

import math
from itertools import count
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from baselines.contract import Box, NetworkSize, Rays
from baselines.plain import PlainField, plain_loss
from harness.execution.progress import Progress
from harness.machine.peak_memory import peak_bytes
from harness.machine.stopwatch import Stopwatch
from harness.plan.run_plan import Machine
from harness.records.study import Check
from harness.studies.speed import throughput, time_to_target
from harness.studies.speed.memory import session_bytes
from harness.studies.speed.speed_context import SpeedContext, batches_of, interleaved
from harness.studies.speed.throughput import step_flops
from harness.studies.speed.time_to_target import PsnrCurve, Target, targets_of
from harness.training.batches import Batch
from harness.training.learner import at_step, train
from harness.training.trainer import Diverged
from scenes.view_sets.view_set import ViewSet
from tests.harness.tiny import CPU, TRAIN, rays_and_colours


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
    context = SpeedContext(tmp_path, tmp_path, tmp_path, True, Progress(), Machine("cpu", 1, 1), 1.0)
    assert list(throughput._matmul_rates(context, 8, torch.float32)) == chunks


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


# question 3, the contest: learners with a made-up clock; a late one is censored and reported

EVEN = [2.0 * (place + 1) for place in range(10)]


class Scripted:
    """Each step takes two seconds and improves what it shows, until the learner fails as requested."""

    progress = 0.0

    def __init__(self, fails_after: float = float("inf"), shows_nan: bool = False) -> None:
        self.step = 0
        self.clock = Stopwatch(CPU)
        self.fails_after = fails_after
        self.shows_nan = shows_nan

    def train_on(self, rays: Rays, colours: Tensor) -> None:
        if self.clock.seconds >= self.fails_after:
            raise Diverged(7, "loss")
        self.clock.seconds += 2.0
        self.step += 1

    def colours(self, rays: Rays) -> Tensor:
        return torch.full((len(rays), 3), float("nan") if self.shows_nan else 1.0 / (1.0 + self.clock.seconds))


def followed(learner: Scripted, times: list[float], target: float = math.inf) -> PsnrCurve:
    rays, colours = rays_and_colours(8)
    black = time_to_target.PixelSubset(rays, torch.zeros_like(colours))
    return time_to_target.follow(learner, lambda step: Batch(rays, colours), learner.colours, black, times, target)


def test_a_training_is_evaluated_when_its_clock_has_passed() -> None:
    curve = followed(Scripted(), [1.0, 1.5, 5.0, 10.0])
    assert curve.before == pytest.approx(0.0)
    assert curve.seconds == [2.0, 6.0, 10.0]  # 1.5 had passed with 1.0 already
    levels = (3.0, 7.0, 11.0)
    assert curve.psnr == pytest.approx([20 * torch.tensor(level).log10().item() for level in levels], abs=1e-4)
    assert followed(Scripted(), EVEN, target=13.0).seconds == [2, 4, 6], "it ends at the target"


def test_a_diverging_training_keeps_its_curve_and_says_why() -> None:
    curve = followed(Scripted(fails_after=4.0), EVEN)
    assert curve.seconds == [2.0, 4.0]
    assert "step 7" in curve.ended
    assert followed(Scripted(shows_nan=True), [2.0]).ended != ""


@pytest.mark.parametrize(
    ("points", "seconds"),
    [
        ([], None),
        ([(1.0, 30.0)], None),  # no second evaluation holds it
        ([(1.0, 30.0), (2.0, 30.0)], 1.0),
        ([(1.0, 10.0), (2.0, 14.9)], None),
        ([(1.0, 10.0), (2.0, 16.0)], None),
        ([(1.0, 10.0), (2.0, 16.0), (3.0, 14.0)], None),  # lost again
        ([(1.0, 10.0), (2.0, 16.0), (3.0, 14.0), (4.0, 15.0), (5.0, 15.0)], 4.0),
        ([(1.0, 10.0), (4.0, 20.0), (8.0, 21.0)], 2.0),  # half way in log seconds
    ],
)
def test_a_target_is_reached_once_it_is_held(points: list[tuple[float, float]], seconds: float | None) -> None:
    curve = PsnrCurve([second for second, _ in points], [psnr for _, psnr in points])
    assert time_to_target.seconds_to(curve, 15.0) == (None if seconds is None else pytest.approx(seconds))


def test_targets_are_the_best_so_far_and_when_it_was_first_reached() -> None:
    plain = PsnrCurve([10.0, 20.0, 30.0, 40.0], [12.0, 17.0, 16.0, 17.0])
    best, first = (17.0, 20.0), (12.0, 10.0)
    expected = {1.0: best, 0.5: best, 0.25: first, 0.01: first}
    assert targets_of(plain, tuple(expected)) == [Target(share, *place) for share, place in expected.items()]


def ratio(*curves: PsnrCurve, share: float = 1.0) -> Check:
    here = SpeedContext(Path(), Path(), Path(), True, Progress(), Machine("cpu", 1, 1), 10.0)
    return time_to_target.ratio_to(here, "same", Target(share, 20.0, 60.0), list(curves), None)


def test_the_ratio_is_plain_seconds_over_seconds() -> None:
    check = ratio(*(PsnrCurve([seconds, seconds + 1.0], [20.0, 21.0]) for seconds in (2.0, 3.0, 6.0)))
    assert (check.id, check.value, check.spread) == ("target.same.ratio", 20.0, (10.0, 30.0))
    assert check.limit is not None


def test_a_late_training_has_no_ratio_and_says_its_best() -> None:
    good = PsnrCurve([1.0, 2.0], [20.0, 21.0])
    late = PsnrCurve([1.0, 2.0], [17.0, 19.5], ended="not finite at step 3: loss")
    check = ratio(good, late, share=0.5)
    assert (check.id, check.value, check.limit) == ("target.same.at50", None, None)
    for words in ("1 of 2", "19.50 dB", "not finite at step 3"):
        assert words in check.why
    assert ratio(PsnrCurve()).value is None


def test_what_is_shown_without_training_is_no_target() -> None:
    check = ratio(PsnrCurve([1.0, 2.0], [20.0, 21.0], before=20.0))
    assert check.value is None
    assert "without any training" in check.why
    assert ratio(PsnrCurve([1.0, 2.0], [20.0, 21.0], before=19.9)).value == 60.0


def test_the_plain_training_learns_on_its_own_clock(ball: ViewSet) -> None:
    batch_at = batches_of(ball, CPU).stream("speed/0", TRAIN.rays)
    plain = time_to_target.Plain(TRAIN, ball, batch_at(0), CPU)
    pixels = time_to_target.pixels_of(ball, CPU, 200)
    before = pixels.psnr(plain.colours(pixels.rays))
    assert plain.clock.seconds == 0.0, "an evaluation takes no time"
    train(plain, batch_at, at_step(30))
    assert plain.clock.seconds > 0.0
    assert pixels.psnr(plain.colours(pixels.rays)) > before + 1.0
