"""Turns of many steps in which the host reads nothing, so that on a GPU neither waits for the other.

A step is captured once, as a graph of the device where it has graphs, and replayed on fixed memory: shapes depend on no
value, batch and random numbers are copied there first, and every check leaves a number on the device. The host reads
these numbers at the end of a turn. Until then the turn is provisional: if a number is not finite, the state before the
turn is restored and the turn is taken again step by step with the host looking, which names the step and the tensor; if
points did not fit into the capacity, it is taken again with more room. So neither changes a result silently.
"""

import gc
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from baselines.contract import Counts, Rays
from baselines.field import NetworkField
from baselines.numerics.optimisers import TorchOptimisers
from baselines.numerics.sampling import Draws, uniform
from harness.plan.seeds import generator_for
from harness.training.batches import Batch
from harness.training.learner import Learner
from harness.training.trainer import ROW, StepLoss, Trainer

LONGEST = 100
"""The maximum number of steps of a turn."""
TIMED = 10
"""The same where a clock ends the training: no more than these are taken after it has run out."""
ROOM, STEP_OF_CAPACITY = 1.25, 1 / 64
"""The room for points over those that were needed, and the multiple to which the capacity is rounded up."""
SHRINK = 0.6
"""The capacity is reduced where this share of it would do."""

Run = Callable[[], object]
Capture = Callable[[Run], Run]
"""Function without arguments, which works on fixed memory → the same work, to be repeated."""


class RecordedDraws:
    """The draws of a generator, which are kept in the order in which a step asks for them."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator, self.tensors = generator, list[Tensor]()

    def uniform(self, shape: tuple[int, ...], like: Tensor) -> Tensor:
        self.tensors.append(uniform(shape, self.generator, like))
        return self.tensors[-1]


class GivenDraws:
    """Draws that lie in these tensors."""

    def __init__(self, tensors: list[Tensor]) -> None:
        self._rest = iter(tensors)

    def uniform(self, shape: tuple[int, ...], like: Tensor) -> Tensor:
        tensor = next(self._rest)
        if tuple(tensor.shape) != shape:
            raise RuntimeError(f"numbers of shape {shape} are asked for, {tuple(tensor.shape)} were drawn")
        return tensor


@dataclass
class Memory:
    """The fixed places from which a captured step reads its batch, numbers and rate, and to which it writes."""

    origins: Tensor
    directions: Tensor
    colours: Tensor
    draws: list[Tensor]
    rate: Tensor
    place: Tensor
    """The row of `rows` that the next step writes."""
    rows: Tensor = field(default_factory=lambda: torch.zeros(0))

    def load(self, batch: Batch, generator: torch.Generator, rate: float) -> None:
        """Copy the inputs of a step, in the order of the device's work and without waiting for it."""
        for place, given in (
            (self.origins, batch.rays.origins),
            (self.directions, batch.rays.directions),
            (self.colours, batch.colours),
        ):
            place.copy_(given, non_blocking=True)
        pinned = self.rate.is_cuda
        for place in self.draws:
            # the allocator of pinned memory keeps a block until the copy from it is done
            place.copy_(torch.rand(place.shape, generator=generator, pin_memory=pinned), non_blocking=True)
        self.rate.fill_(rate)


class Turns:
    """The turns of one trainer of networks."""

    def __init__(self, trainer: Trainer, capture: Capture, compiler: str | None = None) -> None:
        """Take the function that captures a step, and a backend of `torch.compile` for the loss; None: no compiler."""
        self.trainer, self.capture, self.compiler = trainer, capture, compiler
        self.capacity = 1.0
        self.redone, self.captured = 0, 0
        self.form = "eager"
        self._key: object = None
        self._memory: Memory | None = None
        self._replay: Run = _nothing

    def properties(self) -> dict[str, float | str | None]:
        """Return facts of the run for the record."""
        return {
            "step_form": self.form,
            "steps_captured": float(self.captured),
            "turns_redone": float(self.redone),
            "sample_capacity": self.capacity,
        }

    def take(self, batch_at: Callable[[int], Batch], share: float) -> None:
        """Take a turn, which ends at the `share` of the budget, at the next refresh of the grid or after `LONGEST`
        steps. Raises `Diverged` naming the step and the tensor; the weights are then those before that step.
        """
        trainer = self.trainer
        with trainer.clock.running():
            trainer.refresh_grid()
        while not self._taken(batch_at, share):
            self.redone += 1

    def _taken(self, batch_at: Callable[[int], Batch], share: float) -> bool:
        """Take the turn; return False, with the state before it and more room, if points did not fit."""
        trainer = self.trainer
        with trainer.clock.running():
            batch = batch_at(trainer.step)
        self._prepare(batch)
        rates = [trainer.learning_rate(trainer.step + number) for number in range(self._length(share))]
        with trainer.clock.running():
            before = self._state()
            rows = self._enqueue(lambda step: batch if step == trainer.step else batch_at(step), rates)
            needed = max(row[ROW.index("needed")] for row in rows)
            fits, valid = not needed > self.capacity, all(map(_is_valid, rows))
            if not (fits and valid):
                self._restore(before)
        if not fits:
            self._resize(needed)
        elif not valid:
            self.redone += 1
            self._look(batch_at, rates)
        else:
            for row, rate in zip(rows, rates, strict=True):
                trainer.end_step(row, rate, len(batch.rays))
            if trainer.grid is not None and ROOM * needed < SHRINK * self.capacity:
                self._resize(needed)
        return fits

    def _length(self, share: float) -> int:
        """Return the number of steps of the next turn."""
        trainer, budget, grid = self.trainer, self.trainer.budget, self.trainer.settings.grid
        timed = budget.seconds is not None or budget.core_seconds is not None
        longest = TIMED if timed else LONGEST
        if budget.steps is not None:
            longest = min(longest, math.ceil(share * budget.steps) - trainer.step)
        if grid.cells > 0 and not trainer.whole_rays:
            # until the first refresh, the change of bins behind it (also without a grid), and the next refresh
            since = trainer.step - grid.first_step
            if since <= 0:
                longest = min(longest, -since or 1)
            elif trainer.grid is not None:
                longest = min(longest, grid.every - since % grid.every)
        return max(longest, 1)

    def _enqueue(self, batch_at: Callable[[int], Batch], rates: list[float]) -> list[list[float]]:
        """Hand the steps to the device; then wait, and return their rows."""
        trainer, memory = self.trainer, self._memory
        assert memory is not None
        memory.place.zero_()
        for number, rate in enumerate(rates):
            step = trainer.step + number
            memory.load(batch_at(step), generator_for(trainer.seed, step, "jitter"), rate)
            self._replay()
            if trainer.average:
                trainer.average.observe()
        rows: list[list[float]] = memory.rows[: len(rates)].tolist()
        return rows

    def _look(self, batch_at: Callable[[int], Batch], rates: list[float]) -> None:
        """Take the steps of a turn one by one, and look at each. Raises `Diverged`, unless the device alone failed."""
        trainer, memory = self.trainer, self._memory
        assert memory is not None
        for rate in rates:
            batch = batch_at(trainer.step)
            with trainer.clock.running():
                memory.load(batch, generator_for(trainer.seed, trainer.step, "jitter"), rate)
                row = trainer.looked_at_step(batch.rays, batch.colours, GivenDraws(memory.draws), memory.rate)
            trainer.end_step(row, rate, len(batch.rays))
            if trainer.progress >= 1.0:  # by a clock, in the middle of the turn
                break

    # the captured step

    def release(self) -> None:
        """Free the memory of the captured step; the next turn captures it again."""
        self._replay, self._memory, self._key = _nothing, None, None

    def _live(self) -> list[Tensor]:
        """Return the tensors that a step changes."""
        trainer = self.trainer
        means = trainer.average.means if trainer.average else []
        weights = [weight.detach() for weight in trainer.fields.parameters()]
        optimiser = list(trainer.optimiser.tensors().values())
        return [*weights, *trainer.fields.buffers(), *optimiser, *trainer.clipping.state(), *means]

    def _state(self) -> tuple[list[Tensor], int]:
        average = self.trainer.average
        return [tensor.clone() for tensor in self._live()], average.observed if average else 0

    @torch.no_grad()
    def _restore(self, state: tuple[list[Tensor], int]) -> None:
        """Restore a state in place, as the captured step knows its tensors by their places."""
        tensors, observed = state
        torch._foreach_copy_(self._live(), tensors)
        if self.trainer.average:
            self.trainer.average.observed = observed

    def _resize(self, needed: float) -> None:
        room = math.ceil(ROOM * needed / STEP_OF_CAPACITY) * STEP_OF_CAPACITY
        self.capacity = min(1.0, room)

    def _prepare(self, batch: Batch) -> None:
        """Capture a step unless the last captured one has the same shapes and places of memory; off the clock."""
        trainer, optimiser = self.trainer, self.trainer.optimiser
        assert isinstance(optimiser, TorchOptimisers)
        optimiser.prepare()
        if self._memory is None and trainer.grid is not None:
            with torch.no_grad():
                counts = trainer.loss(batch.rays, batch.colours, self._recorder()).counts
            assert counts is not None
            self._resize(float(counts.needed))
        masks = [trainer.grid.occupied, trainer.grid.density] if trainer.grid is not None else []
        places = tuple(tensor.data_ptr() for tensor in (*self._live(), *masks))
        key = trainer.sampling(training=True), len(batch.rays), places
        if key != self._key:
            self._key = key
            self._capture(batch)

    def _recorder(self) -> RecordedDraws:
        return RecordedDraws(generator_for(self.trainer.seed, "warm-up"))

    def _capture(self, batch: Batch) -> None:
        trainer, device, before = self.trainer, self.trainer.device, self._state()
        self._replay, self._memory = _nothing, None
        gc.collect()  # the graphs of cells that have ended, which hold gigabytes
        recorder, rays = self._recorder(), batch.rays
        with torch.no_grad():
            evaluations = trainer.loss(rays, batch.colours, recorder).evaluations
        self._memory = memory = Memory(
            rays.origins.clone(), rays.directions.clone(), batch.colours.clone(), recorder.tensors,
            torch.zeros((), device=device), torch.zeros((), dtype=torch.int64, device=device),
        )  # fmt: skip

        def flat(origins: Tensor, directions: Tensor, colours: Tensor, *draws: Tensor) -> tuple[Tensor, Tensor, Tensor]:
            here = Rays(origins, directions, rays.near, rays.far)
            loss, _, counts = trainer.loss(here, colours, GivenDraws(list(draws)))
            assert counts is not None
            return loss, counts.invalid, counts.needed

        def step_of(run: Callable[..., tuple[Tensor, Tensor, Tensor]]) -> Callable[[], Tensor]:
            def loss_of(rays: Rays, colours: Tensor, draws: Draws) -> StepLoss:
                del draws
                loss, *counts = run(rays.origins, rays.directions, colours, *memory.draws)
                return StepLoss(loss, evaluations, Counts(*counts))

            here = Rays(memory.origins, memory.directions, rays.near, rays.far)
            return lambda: trainer.take_step(here, memory.colours, GivenDraws([]), memory.rate, loss_of)

        step, words = step_of(flat), []
        # packed shapes change as the grid does, and compiling takes half a minute
        if self.compiler is not None and self.capacity == 1.0:
            torch.compiler.reset()  # it compiles one function a few times only, and this one for every cell
            try:
                compiled = step_of(torch.compile(flat, fullgraph=True, dynamic=False, backend=self.compiler))
                compiled()
                step, words = compiled, ["compiled"]
            except torch.OutOfMemoryError:
                raise
            except Exception as error:  # no compiler here, or an operation that it does not know
                words = [f"not compiled ({type(error).__name__})"]
                trainer.fields.zero_grad(set_to_none=True)
        row = step()  # allocates, and says how long a row is
        memory.rows = row.new_zeros((LONGEST, len(row)))

        def noted_step() -> None:
            memory.rows.index_copy_(0, memory.place.unsqueeze(0), step().unsqueeze(0))
            memory.place.add_(1)

        memory.place.zero_()
        try:
            self._replay = self.capture(noted_step)
            words.append("captured")
        except torch.OutOfMemoryError:
            raise
        except RuntimeError as error:  # this device cannot capture a step: the host launches every operation
            trainer.fields.zero_grad(set_to_none=True)
            self._replay = noted_step
            words.append(f"not captured ({type(error).__name__})")
        self.form = ", ".join(words)
        self.captured += 1
        self._restore(before)


def _nothing() -> None:
    pass


def _is_valid(row: list[float]) -> bool:
    named = dict(zip(ROW, row, strict=False))
    finite = all(math.isfinite(named[name]) for name in ("loss", "gradient_norm", "weight_norm"))
    return finite and named["invalid"] == 0.0


def graph_of_the_gpu(run: Run) -> Run:
    """Capture `run` as a CUDA or HIP graph. Raises `RuntimeError` for work that cannot be captured."""
    beside = torch.cuda.Stream()
    beside.wait_stream(torch.cuda.current_stream())
    try:
        with torch.cuda.stream(beside):
            for _ in range(3):
                run()
    finally:
        torch.cuda.current_stream().wait_stream(beside)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        run()
    return graph.replay


def in_turns(learner: Learner, capture: Capture = graph_of_the_gpu, compiler: str | None = "inductor") -> Learner:
    """Let a learner take its steps in turns, if all of a step can run on the device: networks trained by Adam."""
    if not (isinstance(learner, Trainer) and learner.settings.optimiser.name == "adam"):
        return learner
    if all(isinstance(part, NetworkField) for part in learner.fields.children()):
        learner.turns = Turns(learner, capture, compiler)
    return learner
