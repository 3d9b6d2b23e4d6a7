"""The scale of a run: the facts without which its numbers mean nothing."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median

from harness.records.claims import ClaimFile, Scale
from reports.data.load import Records
from reports.data.wording import count, counted, duration, listed, number


@dataclass(frozen=True)
class Fact:
    label: str
    value: str
    printed: str
    """The same fact of the source that the run is compared with; empty if the source does not state it."""


def facts(records: Records) -> list[Fact]:
    """Return resolution, steps, time, seeds, network, each with that of the source, for the top of the page."""
    settings = records.run.settings
    done = [cell for cell in records.cells if cell.status == "done"]
    seconds, cores = [cell.train_seconds for cell in done], [cell.train_core_seconds for cell in done]
    known = [each for each in cores if each is not None]
    of_cores = f", {number(median(known), 1)} core s" if known else ""
    every = {
        "profile": records.run.profile,
        "scenes": count(len(records.scenes)),
        "picture": _resolutions(records),
        "views": _views(records),
        "steps": _steps(records),
        "training time": f"{duration(median(seconds))} per cell (median){of_cores}" if seconds else "",
        "seeds": count(len(records.run.seeds)),
        "network": _network(records),
        "rays a step": setting(settings, "train", "rays"),
        "samples a ray": _samples(settings),
        "learning rate": setting(settings, "train", "learning_rate"),
    }
    source = compared_with(records)
    printed = source.facts if source else {}
    return [Fact(label, value, printed.get(label, "")) for label, value in every.items() if value]


def compared_with(records: Records) -> ClaimFile | None:
    return next((file for file in records.run.claims or [] if file.facts), None)


def in_a_line(records: Records) -> str:
    """Return the scale in a dozen words, which accompany every claim."""
    steps, seeds = f"{_steps(records)} steps", counted(len(records.run.seeds), "seed")
    network = f"{_layers(records)} network" if _layers(records) else ""
    parts = [f"profile {records.run.profile}", _resolutions(records), steps, seeds, network]
    return ", ".join(filter(None, parts))


def has_settings(records: Records, scale: Scale) -> bool:
    """Return whether every finished cell was trained as a source says: pixels, steps, rays, rate and network."""
    finished = [cell for cell in records.cells if cell.status == "done"]
    same = all(number_at(records.run.settings, *name.split(".")) == value for name, value in scale.settings.items())
    large = all((scene.width, scene.height) == (scale.width, scale.height) for scene in records.run.scenes)
    return same and large and bool(finished) and all(cell.steps == scale.steps for cell in finished)


def scenes_at_scale(records: Records, file: ClaimFile, scale: Scale) -> list[str]:
    """Return the scenes of the run that are taken to be those of a source.

    A name is not evidence, as our own scenes are analogues that share the names: a view set is accepted if it was given
    and not rendered here, and has the source's numbers of views. Its name then identifies the printed row.
    """
    return [
        scene.name
        for scene in records.run.scenes
        if not scene.rendered
        and all(scene.views.get(split) == many for split, many in scale.views.items())
        and scene.name in file.scenes
    ]


def is_at_scale(records: Records, file: ClaimFile, scene: str = "all") -> bool:
    """Return whether a result on `scene` has the settings and the pictures of a source, so that the two compare.

    A mean over `all` scenes can be if they are exactly the printed scenes. A claim without a scale is about any run.
    """
    if file.scale is None:
        return True
    accepted = scenes_at_scale(records, file, file.scale)
    if scene == "all":
        exactly = set(records.scenes) == set(accepted) == file.scenes.keys()
        return bool(accepted) and exactly and has_settings(records, file.scale)
    return has_settings(records, file.scale) and scene in accepted


def standing(records: Records, file: ClaimFile) -> str:
    if file.scale is None:
        return "Claims about any run, tested on this one"
    name, same = file.title, has_settings(records, file.scale)
    if is_at_scale(records, file):
        return (
            f"The settings of {name}, on view sets with the sizes, names and numbers of views of its data set; that "
            "they are its pictures is the word of who gave them"
        )
    if same and scenes_at_scale(records, file, file.scale):
        return f"The settings of {name}, on some of its scenes: what it prints of all of them cannot be reproduced here"
    if same:
        return f"The settings of {name}, but not its pictures: nothing that it prints of them can be reproduced here"
    return f"Not the scale of {name}: a gain can be seen here or not, but not reproduced"


def _resolutions(records: Records) -> str:
    sizes = sorted({(scene.width, scene.height) for scene in records.run.scenes})
    return f"{listed([f'{width} × {height}' for width, height in sizes])} px" if sizes else ""


def _between(values: Iterable[int]) -> str:
    ends = sorted(values)
    return "–".join(dict.fromkeys(map(count, [*ends[:1], *ends[-1:]])))


def _views(records: Records) -> str:
    many = {split: [scene.views.get(split, 0) for scene in records.run.scenes] for split in ("train", "test")}
    return ", ".join(f"{_between(values)} {split}" for split, values in many.items() if any(values))


def _steps(records: Records) -> str:
    return _between(cell.steps for cell in records.cells if cell.status == "done")


def _network(records: Records) -> str:
    weights = _between({cell.parameters["total"] for cell in records.cells if "total" in cell.parameters})
    return ", ".join(filter(None, [_layers(records), f"{weights} weights" if weights else ""]))


def _layers(records: Records) -> str:
    depth, width = (setting(records.run.settings, "train", "network", name) for name in ("depth", "width"))
    return f"{depth} × {width}" if depth and width else ""


def _samples(settings: Mapping[str, object]) -> str:
    coarse, fine = (setting(settings, "train", name) for name in ("bins", "fine_bins"))
    cells = setting(settings, "train", "grid", "cells")
    words = f"{coarse} coarse + {fine} fine" if fine not in ("", "0") else f"up to {coarse}" if coarse else ""
    return f"{words}, empty space skipped ({cells}³ grid)" if words and cells not in ("", "0") else words


def setting(settings: Mapping[str, object], *path: str) -> str:
    """Return a nested setting as text; nothing if the run does not state it."""
    value = value_at(settings, *path)
    if isinstance(value, bool) or value is None:
        return ""
    if isinstance(value, int):
        return count(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def number_at(settings: Mapping[str, object], *path: str) -> int | float | None:
    """Return a nested setting that is a number; None if the run does not state it."""
    value = value_at(settings, *path)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def value_at(settings: Mapping[str, object], *path: str) -> object:
    value: object = settings
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return value
