"""Rendering of the missing frames; pictures side by side and an animation of all frames."""

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.execution.progress import Progress
from harness.playback.cached import CachedMethod
from harness.viewer.film.film_folder import SIDE_BY_SIDE
from harness.viewer.film.film_plan import FilmPlan, Part, render_frame
from harness.viewer.film.frames import write_levels
from harness.viewer.film.panels import side_by_side, write_animation
from harness.viewer.film.video import ffmpeg, write_video


@dataclass
class Tally:
    """The frames of one method and their seconds, by origin: `there`, `rendered` or `cached`."""

    frames: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def line(self, method: str, use_cache: bool) -> str:
        rendered, hits = self.frames["rendered"], self.frames["cached"]
        parts = [f"{method}: {self.frames.total()} frames"]
        if self.frames["there"]:
            parts.append(f"{self.frames['there']} there already")
        if rendered:
            parts.append(f"{rendered} rendered in {1e3 * self.seconds['rendered'] / rendered:.1f} ms each")
        if hits:
            parts.append(f"{hits} from the view cache in {1e3 * self.seconds['cached'] / hits:.2f} ms each")
        if use_cache and rendered + hits:
            parts.append(f"hit rate {hits / (rendered + hits):.0%}")
        return ", ".join(parts)


def make_film(plan: FilmPlan, fps: int, show: Progress) -> Iterator[str]:
    """Film scene by scene; yields a line per animation, and one per method at the end. Raises `OSError`."""
    tallies = {part.method: Tally() for part in plan.parts}
    total, done = sum(len(part.missing) for part in plan.parts), 0
    for name in dict.fromkeys(part.take.scene.name for part in plan.parts):
        parts = [part for part in plan.parts if part.take.scene.name == name]
        for part in parts:
            for _ in _frames(plan, part, tallies[part.method]):
                done += 1
                show.part(f"{name} {part.method}", done, total)
        folder = plan.folder / name
        count = len(parts[0].keys)
        sheets = (_sheet(folder / SIDE_BY_SIDE, parts, number) for number in range(count))
        file = folder / f"{plan.spec.path}.webp"
        size = write_animation(file, sheets, count, fps)
        yield f"{file}: {count} frames, {count / fps:.1f} s, {size / 1e3:.0f} kB"
        if program := ffmpeg():
            yield write_video(program, file.with_suffix(".mp4"), folder / SIDE_BY_SIDE, fps)
    yield from (tally.line(method, plan.use_cache) for method, tally in tallies.items())
    if plan.use_cache and (failure := plan.store.failure) is not None:
        yield f"the view cache could not be written ({failure}): this film is complete, others cannot reuse its views"


def _frames(plan: FilmPlan, part: Part, tally: Tally) -> Iterator[int]:
    tally.frames["there"] += len(part.keys) - len(part.missing)
    if not part.missing:
        return
    cell = plan.run.trained(part.take.scene, part.method, plan.spec.seed, plan.device)
    cached = CachedMethod(cell.learner, plan.store, cell.chunk)
    for number in part.missing:
        camera = part.take.cameras[number]
        began = time.perf_counter()
        hit = cached.lookup(camera) if plan.use_cache else None
        view = render_frame(cell, camera) if hit is None else hit[0]
        origin = "rendered" if hit is None else "cached"
        tally.frames[origin] += 1
        tally.seconds[origin] += time.perf_counter() - began
        if hit is None and plan.use_cache:
            cached.keep(camera, view)
        part.frames.write(number, part.keys[number], view)
        yield number


def _sheet(folder: Path, parts: list[Part], number: int) -> np.ndarray:
    pictures = {part.method: part.frames.picture(number) for part in parts}
    sheet = side_by_side({**pictures, **parts[0].take.truth_levels(number)})
    folder.mkdir(parents=True, exist_ok=True)
    write_levels(folder / f"{number:04}.png", sheet)
    return sheet
