"""What the folders of a trainer's results say: the method, the scene and the seed of each file."""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from harness.verdicts.tables.headers import share_of_scenes

RESULTS = "results.json"
STATISTICS = ("stats", "results", "eval", "test")
"""Folders between the folder of a scene and its file of results."""
DATASETS = frozenset(
    """m360 mipnerf360 360v2 360 nerfsynthetic blender synthetic llff nerfllffdata tandt tanksandtemples tnt db
    deepblending dtu nerfdata zipnerf phototourism""".split()  # noqa: SIM905
)
"""Folders of data sets between method and scene, in lower case without other characters."""
SEED = re.compile(r"(.*?)[_-]?(?:seed|run|trial)[_-]?(\d+)")
WITHOUT_NAME = re.compile(r"ours_\d+|\d{4}-?\d{2}-?\d{2}(?:[_T-]?\d+)*")
"""Folders of a number of steps, and of a time."""
GENERAL = re.compile(r"(?:results?|metrics?|stats?|eval|test|val|scores?|summary|output|train|per_view)(?:[_-].*)?")
"""The names of files that say nothing of the scene."""


@dataclass(frozen=True)
class ResultPlace:
    """What the folders of a file say; nothing for a file that is given by itself."""

    method: str = ""
    scene: str = ""
    seed: str | None = None


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
    of_scenes = {file.parent for file in every if file.name == RESULTS}
    files = [file for file in every if file.parent not in of_scenes or file.name == RESULTS]
    siblings = Counter(file.parent for file in files)
    named = {file: _named(file.relative_to(folder), siblings[file.parent] > 1) for file in files}
    depth = max((len(names) for names, _ in named.values()), default=0)
    level, datasets = _levels([names for names, _ in named.values() if len(names) == depth])
    places = {}
    for file, (names, seed) in named.items():
        at = level if len(names) == depth else len(names) - 1
        scene = names[at] if names else ""
        others = [name for place, name in enumerate(names) if place != at and place not in datasets]
        method = "/".join([*([folder.resolve().name] if is_one_of_several and names else []), *others])
        step = re.search(r"step_?(\d+)", file.stem)
        if step and siblings[file.parent] > 1:
            method = f"{method} step {step[1]}".strip()
        places[file] = ResultPlace(method, scene, seed)
    return places


def _levels(names: list[list[str]]) -> tuple[int, set[int]]:
    """Return which folder names the scene, the last one if no other names scenes that everybody knows, and which ones
    name data sets.
    """
    levels = [list(dict.fromkeys(each)) for each in zip(*names, strict=True)]
    shares = list(map(share_of_scenes, levels))
    scene = shares.index(max(shares)) if max(shares, default=0.0) > 0.5 else len(levels) - 1
    of_sets = {
        place
        for place, each in enumerate(levels)
        if place != scene
        and (len(each) == 1 or all(re.sub(r"[^a-z0-9]", "", name.lower()) in DATASETS for name in each))
    }
    return scene, of_sets if len(of_sets) < len(levels) - 1 else set()


def _named(relative: Path, has_siblings: bool) -> tuple[list[str], str | None]:
    """Return the folders of a file that name method and scene, with its own name if that is a scene's, and the seed if
    one of them tells it.
    """
    names, seed = [], None
    for part in relative.parts[:-1]:
        if part in STATISTICS or WITHOUT_NAME.fullmatch(part):
            continue
        if match := SEED.fullmatch(part.lower()):
            seed, part = match[2], part[: len(match[1])]
        if part:
            names.append(part)
    if len(names) == 1 and has_siblings and not GENERAL.fullmatch(relative.stem):
        names.append(relative.stem)
    return names, seed


def scene_folder(path: Path) -> str:
    """Return the name of the folder that holds a scene's results."""
    folder = path.resolve().parent
    return folder.parent.name if folder.name in STATISTICS else folder.name
