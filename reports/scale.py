"""At what scale a run was made: the facts without which no number of it means anything."""

from dataclasses import dataclass
from statistics import median

from reports.load import Records
from reports.wording import count, counted, duration, listed, significant

PAPER_RESOLUTION = 800
PAPER_STEPS = 200_000


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
        Fact("training time", f"{duration(median(seconds))} a cell (median)" if seconds else "", "3.4–4.2 h to 30 dB"),
        Fact("seeds", count(len(records.run.seeds)), "1, as far as stated"),
        Fact("network", _network(records), "8 × 256"),
        Fact("rays a step", _setting(settings, "rays"), "1\u202f024"),
        Fact("samples a ray", _setting(settings, "samples"), "not stated"),
        Fact("learning rate", _setting(settings, "learning_rate"), "0.0005"),
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
    network = _setting(records.run.settings, "depth"), _setting(records.run.settings, "width")
    if all(network):
        parts.append(f"{network[0]} × {network[1]} network")
    return ", ".join(part for part in parts if part)


def is_paper_scale(records: Records) -> bool:
    """True where the run has the paper's setting; everything else says something about another scale."""
    return records.run.profile == "full"


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
    depth, width = _setting(records.run.settings, "depth"), _setting(records.run.settings, "width")
    weights = sorted({cell.parameters["total"] for cell in records.cells if "total" in cell.parameters})
    size = f"{depth} × {width}" if depth and width else ""
    if not weights:
        return size
    between = count(weights[0]) if weights[0] == weights[-1] else f"{count(weights[0])}–{count(weights[-1])}"
    return f"{size}, {between} weights" if size else f"{between} weights"


def _setting(settings: dict[str, object], name: str) -> str:
    value = settings.get(name)
    if isinstance(value, bool) or value is None:
        return ""
    if isinstance(value, int):
        return count(value)
    return significant(value) if isinstance(value, float) else str(value)
