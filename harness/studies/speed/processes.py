"""Question 10: steps per second of the reduced profile, by how the cores are divided."""

import multiprocessing
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection

import torch

from harness.execution.progress import Quiet
from harness.machine.device import available_cores, use_threads
from harness.machine.stopping import end_with_parent
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    STREAM,
    SpeedContext,
    batches_of,
    measured,
    not_measured,
    ratio,
    trained_reduced,
    views_of,
)
from harness.training.learner import train

WINDOW_SECONDS, QUICK_WINDOW_SECONDS = 4.0, 0.2
MODES = {
    "single": "one process, one thread",
    "threads": "one process, a thread a core",
    "each": "one process a core, one thread each",
}


def measure(context: SpeedContext) -> Iterator[Check]:
    """Measure workers that stay alive between repetitions; each trains a field whose empty space is skipped already."""
    cores = available_cores()
    if context.device.type != "cpu" or cores < 2:
        why = "one core alone" if context.device.type == "cpu" else "a question about CPUs"
        yield not_measured("processes.ratio", "One process a core against one process", "×", why)
        return
    window = QUICK_WINDOW_SECONDS if context.quick else WINDOW_SECONDS
    rates = rates_by_sharing(context, cores, window)
    detail = f"reduced settings, nerf on lego, {cores} cores; windows of {window:g} s"
    single, threads, each = (rates[name] for name in MODES)
    title = "One process a core, a thread each, against one process with all threads"
    yield ratio("processes", title, each, threads, detail)
    title = f"{cores} processes of one thread against one"
    yield ratio("processes.scaling", title, each, single, f"{detail}; {cores} would be perfect")
    title = f"One process with {cores} threads against one with one"
    yield ratio("processes.threads", title, threads, single, detail)
    for name, words in MODES.items():
        title = f"Training steps of all processes, {words}"
        yield measured(f"processes.{name}.rate", title, rates[name], "steps/s", detail)


def rates_by_sharing(here: SpeedContext, cores: int, window: float) -> dict[str, list[float]]:
    """Return mode → steps per second of all its processes, one per repetition, the modes taken in turn."""
    spawn = multiprocessing.get_context("spawn")
    connections: list[Connection] = []
    processes = []
    try:
        for index in range(cores):
            ours, theirs = spawn.Pipe()
            one_thread = replace(here.machine, threads=1)
            alone = replace(here, machine=one_thread, scratch=here.scratch / f"process-{index}", show=Quiet())
            process = spawn.Process(target=_work, args=(theirs, alone, window), daemon=True)
            process.start()
            theirs.close()
            connections.append(ours)
            processes.append(process)
        for connection in connections:
            connection.recv()  # it is ready
        modes = {"single": (connections[:1], 1), "threads": (connections[:1], cores), "each": (connections, 1)}
        rates: dict[str, list[float]] = {name: [] for name in MODES}
        for repetition in range(-1, here.repeats(4)):
            for name, (workers, threads) in modes.items():
                for connection in workers:
                    connection.send(threads)
                rate = sum(connection.recv() for connection in workers)
                if repetition >= 0:  # the first round warms up
                    rates[name].append(rate)
    finally:
        for process in processes:
            process.kill()  # they do not listen to SIGTERM
        for process in processes:
            process.join()
    return rates


def _work(connection: Connection, here: SpeedContext, window: float) -> None:
    """Receive a number of threads, send steps per second."""
    end_with_parent()
    use_threads(1)
    here.scratch.mkdir(parents=True)
    trainer = trained_reduced(here)
    batch_at = batches_of(views_of(here), here.device).stream(STREAM, trainer.settings.rays)
    connection.send(None)
    while True:
        torch.set_num_threads(connection.recv())
        began, first = trainer.clock.seconds, trainer.step
        train(trainer, batch_at, lambda stepped: stepped.clock.seconds - began >= window)  # noqa: B023
        connection.send((trainer.step - first) / (trainer.clock.seconds - began))
