"""Question 10: steps per second of the reduced profile, by how the cores are divided."""

import multiprocessing
from collections.abc import Iterator
from multiprocessing.connection import Connection

from harness.machine.device import available_cores
from harness.machine.stopping import end_with_parent
from harness.records.study import Check
from harness.studies.speed.speed_context import SpeedContext, measured, not_measured, quotients

WINDOW_SECONDS = 4.0


def measure(situation: SpeedContext) -> Iterator[Check]:
    """Measure workers that stay alive between repetitions; each trains a field whose empty space is skipped already."""
    cores = available_cores()
    if situation.device.type != "cpu" or cores < 2:
        why = "one core alone" if situation.device.type == "cpu" else "a question about CPUs"
        yield not_measured("processes.ratio", "One process a core against one process", "×", why)
        return
    rates = rates_by_sharing(situation, cores)
    detail = f"reduced settings, nerf on lego, {cores} cores; windows of {_window(situation):g} s"
    one, threads, each = (rates[name] for name in MODES)
    yield measured(
        "processes.ratio",
        "One process a core, a thread each, against one process with all threads",
        quotients(each, threads),
        "×",
        detail=detail,
    )
    yield measured(
        "processes.scaling.ratio",
        f"{cores} processes of one thread against one",
        quotients(each, one),
        "×",
        detail=f"{detail}; {cores} would be perfect",
    )
    yield measured(
        "processes.threads.ratio",
        f"One process with {cores} threads against one with one",
        quotients(threads, one),
        "×",
        detail=detail,
    )
    for name, title in MODES.items():
        yield measured(
            f"processes.{name}.rate", f"Training steps of all processes, {title}", rates[name], "steps/s", detail=detail
        )


MODES = {
    "single": "one process, one thread",
    "threads": "one process, a thread a core",
    "each": "one process a core, one thread each",
}


def rates_by_sharing(situation: SpeedContext, cores: int) -> dict[str, list[float]]:
    """Return mode → steps per second of all its processes together, one entry per repetition, the modes taken in
    turn.
    """
    context = multiprocessing.get_context("spawn")
    request = (
        situation.device.type, situation.quick, str(situation.view_sets), str(situation.scratch), _window(situation)
    )  # fmt: skip
    connections: list[Connection] = []
    processes = []
    try:
        for index in range(cores):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, index, *request), daemon=True)
            process.start()
            theirs.close()
            connections.append(ours)
            processes.append(process)
        for connection in connections:
            connection.recv()  # it is ready
        rates: dict[str, list[float]] = {name: [] for name in MODES}
        for repetition in range(-1, situation.repeats(4)):
            for name, workers, threads in (
                ("single", connections[:1], 1),
                ("threads", connections[:1], cores),
                ("each", connections, 1),
            ):
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


def _window(situation: SpeedContext) -> float:
    return 0.2 if situation.quick else WINDOW_SECONDS


def _work(
    connection: Connection, index: int, device: str, quick: bool, view_sets: str, scratch: str, window: float
) -> None:
    """Receive a number of threads, send steps per second."""
    end_with_parent()
    from pathlib import Path

    import torch

    from harness.execution.progress import Quiet
    from harness.machine.device import use_threads
    from harness.studies.speed.speed_context import STREAM, batches_of, trained_reduced, views_of

    use_threads(1)
    own = Path(scratch) / f"process-{index}"
    own.mkdir(parents=True)
    here = SpeedContext(torch.device(device), 1, quick, 0.0, Path(view_sets), own, Quiet())
    trainer = trained_reduced(here)
    batches = batches_of(views_of(here, "lego"), here.device)
    connection.send(None)
    while True:
        torch.set_num_threads(connection.recv())
        began, steps = trainer.clock.seconds, 0
        while trainer.clock.seconds - began < window:
            trainer.train_on(*batches.batch(STREAM, trainer.step, trainer.settings.rays))
            steps += 1
        connection.send(steps / (trainer.clock.seconds - began))
