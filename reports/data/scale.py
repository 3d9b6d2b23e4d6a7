"""The scale of a run: the facts without which no number of it means anything."""

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median
from typing import Any

from reports.data.load import Records
from reports.data.wording import count, counted, duration, listed, number

PAPER_STEPS = 200_000
PAPER_TRAINING = {"rays": 1024, "learning_rate": 5e-4}
PAPER_NETWORK = {"depth": 8, "width": 256}
PAPER_VIEWS = {"train": 100, "test": 200}
"""The views of each scene of NeRF Synthetic, as its files are published."""


@dataclass(frozen=True)
class Fact:
    label: str
    value: str
    paper: str
    """The paper's setting."""


def facts(records: Records) -> list[Fact]:
    """Return resolution, steps, time, seeds, network: the top of the page, beside the paper's setting."""
    settings = records.run.settings
    done = [cell for cell in records.cells if cell.status == "done"]
    seconds, cores = [cell.train_seconds for cell in done], [cell.train_core_seconds for cell in done]
    counted_cores = [each for each in cores if each is not None]
    of_cores = f", {number(median(counted_cores), 1)} core s" if counted_cores else ""
    every = [
        Fact("profile", records.run.profile, "full"),
        Fact("scenes", count(len(records.scenes)), "8"),
        Fact("picture", _resolutions(records), "800 × 800 px"),
        Fact("views", _views(records), "100 train, 200 test"),
        Fact("steps", _steps(records), count(PAPER_STEPS)),
        Fact(
            "training time",
            f"{duration(median(seconds))} a cell (median){of_cores}" if seconds else "",
            "4.2 h to 30 dB",
        ),
        Fact("seeds", count(len(records.run.seeds)), "not stated"),
        Fact("network", _network(records), "8 × 256"),
        Fact("rays a step", setting(settings, "train", "rays"), "1\u202f024"),
        Fact("samples a ray", _samples(settings), "not stated"),
        Fact("learning rate", setting(settings, "train", "learning_rate"), "0.0005"),
    ]
    return [fact for fact in every if fact.value]


def in_a_line(records: Records) -> str:
    """Return the scale in a dozen words, as it stands beside every claim."""
    steps, seeds = f"{_steps(records)} steps", counted(len(records.run.seeds), "seed")
    network = f"{_layers(records)} network" if _layers(records) else ""
    parts = [f"profile {records.run.profile}", _resolutions(records), steps, seeds, network]
    return ", ".join(filter(None, parts))


def has_paper_settings(records: Records) -> bool:
    """Return whether every finished cell was trained as the paper says: pixels, steps, rays, rate and network."""
    finished = [cell for cell in records.cells if cell.status == "done"]
    settings = records.run.settings
    same = all(number_at(settings, "train", name) == value for name, value in PAPER_TRAINING.items())
    same &= all(number_at(settings, "train", "network", name) == value for name, value in PAPER_NETWORK.items())
    large = all((scene.width, scene.height) == (800, 800) for scene in records.run.scenes)
    return same and large and bool(finished) and all(cell.steps == PAPER_STEPS for cell in finished)


def papers_scenes(records: Records) -> list[str]:
    """Return the scenes of the run that are taken to be the paper's.

    A name alone is no evidence, as ours are analogues that share the names: accepted are view sets that were given and
    not rendered here, with as many views as NeRF Synthetic has. The name then says which row of Table 2 they are.
    """
    return [
        scene.name
        for scene in records.run.scenes
        if not scene.rendered
        and all(scene.views.get(split) == many for split, many in PAPER_VIEWS.items())
        and scene.name in _of_table2(records)
    ]


def is_paper_scale(records: Records, scene: str = "all") -> bool:
    """Return whether a result on `scene` is comparable with the paper's own numbers: its settings, on its pictures.

    A mean over `all` scenes is if they are just those of Table 2.
    """
    there = papers_scenes(records)
    if scene == "all":
        every = set(records.scenes) == set(there) == _of_table2(records)
        return bool(there) and every and has_paper_settings(records)
    return has_paper_settings(records) and scene in there


def standing(records: Records) -> str:
    """State the subject of verdicts on trained methods, in a sentence."""
    if is_paper_scale(records):
        return (
            "The paper’s settings, on eight view sets with the sizes, names and numbers of views of its data set; that "
            "they are its pictures is the word of who gave them"
        )
    if papers_scenes(records) and has_paper_settings(records):
        return "The paper’s settings, on some of its scenes: what it prints of all of them cannot be reproduced here"
    if has_paper_settings(records):
        return "The paper’s settings, but not its pictures: nothing that it prints of them can be reproduced here"
    return "Not the paper’s scale: a gain can be seen here or not, but not reproduced"


def _of_table2(records: Records) -> set[str]:
    table = records.run.paper.get("table2") or {}
    return {name for name, row in table.items() if isinstance(row, dict) and name != "average"}


def _resolutions(records: Records) -> str:
    sizes = sorted({(scene.width, scene.height) for scene in records.run.scenes})
    return f"{listed([f'{width} × {height}' for width, height in sizes])} px" if sizes else ""


def _between(values: Iterable[int]) -> str:
    """Return the value, or the range of several; nothing without any."""
    ends = sorted(values)
    return "–".join(dict.fromkeys(map(count, [*ends[:1], *ends[-1:]])))


def _views(records: Records) -> str:
    """Return the number of views by split, if all scenes agree; otherwise the range."""
    many = {split: [scene.views.get(split, 0) for scene in records.run.scenes] for split in ("train", "test")}
    return ", ".join(f"{_between(values)} {split}" for split, values in many.items() if any(values))


def _steps(records: Records) -> str:
    return _between(cell.steps for cell in records.cells if cell.status == "done")


def _network(records: Records) -> str:
    weights = _between({cell.parameters["total"] for cell in records.cells if "total" in cell.parameters})
    return ", ".join(filter(None, [_layers(records), f"{weights} weights" if weights else ""]))


def _layers(records: Records) -> str:
    """Return depth × width of the density network."""
    depth, width = (setting(records.run.settings, "train", "network", name) for name in ("depth", "width"))
    return f"{depth} × {width}" if depth and width else ""


def _samples(settings: dict[str, Any]) -> str:
    coarse, fine = (setting(settings, "train", name) for name in ("bins", "fine_bins"))
    cells = setting(settings, "train", "grid", "cells")
    words = f"{coarse} coarse + {fine} fine" if fine not in ("", "0") else f"up to {coarse}" if coarse else ""
    return f"{words}, empty space skipped ({cells}³ grid)" if words and cells not in ("", "0") else words


def setting(settings: dict[str, Any], *path: str) -> str:
    """Return a nested setting in words; nothing if the run does not state it."""
    value = value_at(settings, *path)
    if isinstance(value, bool) or value is None:
        return ""
    if isinstance(value, int):
        return count(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def number_at(settings: dict[str, Any], *path: str) -> int | float | None:
    """Return a nested setting that is a number; None if the run does not state it."""
    value = value_at(settings, *path)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def value_at(settings: dict[str, Any], *path: str) -> Any:
    """Return a nested setting; None if the run does not state it."""
    value: Any = settings
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    return value
