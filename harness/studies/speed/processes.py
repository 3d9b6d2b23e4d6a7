"""Question 10: steps per second of the reduced profile, by how the cores are shared among processes."""

import multiprocessing
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection

import torch

from harness.execution.progress import Progress
from harness.machine.device import available_cores, use_threads
from harness.machine.stopping import end_with_parent
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    STREAM,
    SpeedContext,
    batches_of,
    figure,
    no_figure,
    ratio,
    trained_reduced,
    views_of,
)
from harness.training.learner import train

WINDOW_SECONDS, QUICK_WINDOW_SECONDS = 4.0, 0.2
MODES = {
    "single": "one process, one thread",
    "threads": "one process, one thread per core",
    "each": "one process per core, one thread each",
}


def measure(context: SpeedContext) -> Iterator[Check]:
    """Measure workers that live through all repetitions; each trains a field that already skips empty space."""
    cores = available_cores()
    if context.device.type != "cpu" or cores < 2:
        why = "only one core" if context.device.type == "cpu" else "a question about CPUs"
        yield no_figure("processes.ratio", "One process per core against one process", "×", why)
        return
    window = QUICK_WINDOW_SECONDS if context.quick else WINDOW_SECONDS
    rates = rates_by_sharing(context, cores, window)
    detail = f"reduced settings, nerf on lego, {cores} cores; windows of {window:g} s"
    single, threads, each = (rates[name] for name in MODES)
    title = "One process per core, one thread each, against one process with all threads"
    yield ratio("processes", title, each, threads, detail)
    title = f"{cores} processes of one thread against one"
    yield ratio("processes.scaling", title, each, single, f"{detail}; the ideal is {cores}")
    title = f"One process with {cores} threads against one thread"
    yield ratio("processes.threads", title, threads, single, detail)
    for name, words in MODES.items():
        title = f"Training steps of all processes, {words}"
        yield figure(f"processes.{name}.rate", title, rates[name], "steps/s", detail)


def rates_by_sharing(context: SpeedContext, cores: int, window: float) -> dict[str, list[float]]:
    """Return mode → steps per second of all its processes, once per repetition, the modes in turn."""
    spawn = multiprocessing.get_context("spawn")
    connections: list[Connection] = []
    processes = []
    try:
        for index in range(cores):
            own_end, worker_end = spawn.Pipe()
            machine, scratch = replace(context.machine, threads=1), context.scratch / f"process-{index}"
            worker = replace(context, machine=machine, scratch=scratch, show=Progress())
            process = spawn.Process(target=_work, args=(worker_end, worker, window), daemon=True)
            process.start()
            worker_end.close()
            connections.append(own_end)
            processes.append(process)
        for connection in connections:
            connection.recv()  # the worker is ready
        modes = {"single": (connections[:1], 1), "threads": (connections[:1], cores), "each": (connections, 1)}
        rates: dict[str, list[float]] = {name: [] for name in MODES}
        for repetition in range(-1, context.repeats(4)):
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


def _work(connection: Connection, context: SpeedContext, window: float) -> None:
    """For each number of threads that is received, send the steps per second."""
    end_with_parent()
    use_threads(1)
    context.scratch.mkdir(parents=True)
    trainer = trained_reduced(context)
    batch_at = batches_of(views_of(context), context.device).stream(STREAM, trainer.settings.rays)
    connection.send(None)
    while True:
        torch.set_num_threads(connection.recv())
        began, first = trainer.clock.seconds, trainer.step
        train(trainer, batch_at, lambda stepped: stepped.clock.seconds - began >= window)  # noqa: B023
        connection.send((trainer.step - first) / (trainer.clock.seconds - began))
