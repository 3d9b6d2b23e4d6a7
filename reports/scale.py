"""At what scale a run was made: the facts without which no number of it means anything."""

from dataclasses import dataclass
from statistics import median
from typing import Any

from reports.ledger import Verdict
from reports.load import Records
from reports.wording import count, counted, duration, listed

PAPER_RESOLUTION = 800
PAPER_STEPS = 200_000
PAPER_RAYS = "1\u202f024"


@dataclass(frozen=True)
class Fact:
    label: str
    value: str
    paper: str = ""
    """The paper's setting, where it states one."""


def facts(records: Records) -> list[Fact]:
    """Resolution, steps, time, seeds, network: what stands at the top of the page, beside the paper's setting."""
    settings = records.run.settings
    seconds = [cell.train_seconds for cell in records.cells if cell.status == "done"]
    found = [
        Fact("profile", records.run.profile, "full"),
        Fact("scenes", count(len(records.scenes)), "8"),
        Fact("picture", _resolutions(records), "800 × 800 px"),
        Fact("views", _views(records), "100 train, 200 test"),
        Fact("steps", _steps(records), count(PAPER_STEPS)),
        Fact("training time", f"{duration(median(seconds))} a cell (median)" if seconds else "", "4.2 h to 30 dB"),
        Fact("seeds", count(len(records.run.seeds)), "not stated"),
        Fact("network", _network(records), "8 × 256"),
        Fact("rays a step", setting(settings, "train", "rays"), "1\u202f024"),
        Fact("samples a ray", _samples(settings), "not stated"),
        Fact("learning rate", setting(settings, "train", "learning_rate"), "0.0005"),
    ]
    return [fact for fact in found if fact.value]


def in_a_line(records: Records) -> str:
    """The scale in a dozen words, as it stands beside every claim."""
    parts = [
        f"profile {records.run.profile}",
        _resolutions(records),
        f"{_steps(records)} steps",
        counted(len(records.run.seeds), "seed"),
    ]
    parts.append(f"{_layers(records)} network" if _layers(records) else "")
    return ", ".join(part for part in parts if part)


def has_paper_settings(records: Records) -> bool:
    """True where every scene was trained as the paper says, be they all of its scenes or not."""
    finished = [cell for cell in records.cells if cell.status == "done"]
    large = all(scene.width >= PAPER_RESOLUTION for scene in records.run.scenes)
    long = bool(finished) and all(cell.steps >= PAPER_STEPS for cell in finished)
    same = setting(records.run.settings, "train", "rays") == PAPER_RAYS and _layers(records) == "8 × 256"
    return large and long and same


def is_paper_scale(records: Records) -> bool:
    """True where that is so on all of its scenes; everything else says something about another scale."""
    return has_paper_settings(records) and bool(_of_table2(records)) and not _missing(records)


def on_other_pictures(records: Records) -> bool:
    """Whether a scene was rendered here, and is not a view set that was given."""
    return any(scene.rendered for scene in records.run.scenes)


def _of_table2(records: Records) -> list[str]:
    table = records.run.paper.get("table2") or {}
    return [name.lower() for name, row in table.items() if isinstance(row, dict) and name not in ("average", "all")]


def _missing(records: Records) -> list[str]:
    ran = {name.lower() for name in records.scenes}
    return [name for name in _of_table2(records) if name not in ran]


def _others(records: Records) -> list[str]:
    known = _of_table2(records)
    return [name for name in records.scenes if name.lower() not in known]


def strangers(records: Records) -> str:
    """Which of the paper's scenes a mean over this run's lacks, and which others it holds; nothing where none."""
    missing, others = ", ".join(_missing(records)), ", ".join(_others(records))
    return "; ".join(filter(None, [missing and f"without {missing}", others and f"with {others}"]))


def unless_whole(records: Records, verdict: Verdict) -> Verdict:
    """A verdict on a mean over the paper's scenes, from a mean over this run's.

    It holds on no other set of scenes than the paper's. That it does not hold can be told from some of them, as the
    interval knows how scenes differ, but not from a single one, whose interval knows of seeds alone.
    """
    if not (_missing(records) or _others(records)):
        return verdict
    if verdict == "holds" or (verdict == "does not hold" and len(records.scenes) < 2):
        return "inconclusive"
    return verdict


def _resolutions(records: Records) -> str:
    sizes = sorted({(scene.width, scene.height) for scene in records.run.scenes})
    return f"{listed([f'{width} × {height}' for width, height in sizes])} px" if sizes else ""


def _views(records: Records) -> str:
    """Number of views by split, where all scenes agree; otherwise the range."""
    words = []
    for split in ("train", "test"):
        many = sorted({scene.views.get(split, 0) for scene in records.run.scenes})
        if many and many[-1]:
            words.append(f"{many[0]}–{many[-1]} {split}" if many[0] != many[-1] else f"{many[0]} {split}")
    return ", ".join(words)


def _steps(records: Records) -> str:
    steps = [cell.steps for cell in records.cells if cell.status == "done"]
    if not steps:
        return ""
    return count(steps[0]) if min(steps) == max(steps) else f"{count(min(steps))}–{count(max(steps))}"


def _network(records: Records) -> str:
    size = _layers(records)
    weights = sorted({cell.parameters["total"] for cell in records.cells if "total" in cell.parameters})
    if not weights:
        return size
    between = count(weights[0]) if weights[0] == weights[-1] else f"{count(weights[0])}–{count(weights[-1])}"
    return f"{size}, {between} weights" if size else f"{between} weights"


def _layers(records: Records) -> str:
    """Depth × width of the density network."""
    depth, width = (setting(records.run.settings, "train", "network", name) for name in ("depth", "width"))
    return f"{depth} × {width}" if depth and width else ""


def _samples(settings: dict[str, Any]) -> str:
    coarse, fine = (setting(settings, "train", name) for name in ("bins", "fine_bins"))
    cells = setting(settings, "train", "grid", "cells")
    words = f"{coarse} coarse + {fine} fine" if fine not in ("", "0") else f"up to {coarse}" if coarse else ""
    return f"{words}, empty space skipped ({cells}³ grid)" if words and cells not in ("", "0") else words


def setting(settings: dict[str, Any], *path: str) -> str:
    """A nested setting in words; nothing where the run does not state it."""
    value = _at(settings, *path)
    if isinstance(value, bool) or value is None:
        return ""
    if isinstance(value, int):
        return count(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def number_at(settings: dict[str, Any], *path: str) -> int | float | None:
    """A nested setting that is a number; None where the run does not state it."""
    value = _at(settings, *path)
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _at(settings: dict[str, Any], *path: str) -> Any:
    value: Any = settings
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    return value
