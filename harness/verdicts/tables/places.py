"""What the folders of a trainer's results say: the method, the scene and the seed of each file."""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from harness.verdicts.tables.headers import share_of_scenes

PER_VIEW, RESULTS = "per_view.json", "results.json"
STATISTICS = ("stats", "results", "eval", "test")
"""Folders between the folder of a scene and its file of results."""
DATASETS = frozenset(
    """m360 mipnerf360 360v2 360 nerfsynthetic blender synthetic llff nerfllffdata tandt tanksandtemples tnt db
    deepblending dtu nerfdata zipnerf phototourism""".split()  # noqa: SIM905
)
"""Folders of data sets between method and scene, in lower case without other characters."""
SEED = re.compile(r"(?:seed|run|trial)[_-]?(\d+)")
GENERAL = re.compile(r"(?:results?|metrics?|stats?|eval|test|val|scores?|summary|output|train|per_view)(?:[_-].*)?")
"""The names of files that say nothing of the scene."""


@dataclass(frozen=True)
class ResultPlace:
    method: str = ""
    scene: str = ""
    seed: str | None = None


NOWHERE = ResultPlace()
"""The place of a file that is given by itself."""


def places_below(folder: Path, is_one_of_several: bool) -> dict[Path, ResultPlace]:
    """Return the JSON files below a folder, as METHOD/SCENE or, where the names tell, SCENE/METHOD; `is_one_of_several`
    makes the folder itself a part of the method. Of a scene's results those of all views, not also those by view.
    """
    every = [
        file
        for file in sorted(folder.rglob("*.json"))
        if not any(part.startswith(".") for part in file.relative_to(folder).parts)
        and not file.name.startswith("train_step")
    ]
    # 3D Gaussian Splatting keeps cameras.json and per_view.json next to it
    of_scenes = [file for file in every if file.name == RESULTS]
    files = of_scenes or [file for file in every if file.name != PER_VIEW] or every
    parts = {file: _parts(file.relative_to(folder)) for file in files}
    outer, inner = ([names[end] for names, _ in parts.values() if len(names) > 1] for end in (0, -1))
    is_turned = share_of_scenes(outer) > 0.5 >= share_of_scenes(inner)
    siblings = Counter(file.parent for file in files)
    places = {}
    for file, (names, seed) in parts.items():
        if names and not GENERAL.fullmatch(file.stem) and len(names) == 1:
            names = [*names, file.stem] if siblings[file.parent] > 1 else names
        scene = names[0 if is_turned else -1] if names else ""
        others = names[1:] if is_turned else names[:-1]
        method = "/".join([*([folder.resolve().name] if is_one_of_several and names else []), *others])
        step = re.search(r"step_?(\d+)", file.stem)
        if step and siblings[file.parent] > 1:
            method = f"{method} step {step[1]}".strip()
        places[file] = ResultPlace(method, scene, seed)
    return places


def _parts(relative: Path) -> tuple[list[str], str | None]:
    """Return the folders of a file that name method and scene, and the seed if one of them does."""
    names = [name for name in relative.parts[:-1] if name not in STATISTICS]
    seeds = [match[1] for name in names if (match := SEED.fullmatch(name.lower()))]
    names = [name for name in names if not SEED.fullmatch(name.lower())]
    between = [name for name in names[1:-1] if re.sub(r"[^a-z0-9]", "", name.lower()) not in DATASETS]
    names = [*names[:1], *between, *names[1:][-1:]]
    return names, seeds[0] if seeds else None


def scene_folder(path: Path) -> str:
    """Return the name of the folder that holds a scene's results."""
    folder = path.resolve().parent
    return folder.parent.name if folder.name in STATISTICS else folder.name
