"""The cache of rendered view sets: each is named by a digest of everything that it depends on.

A view set is rendered into a temporary sibling and renamed into place, so that a folder of its name is complete.
"""

import errno
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from scenes.catalog.entries import scene_named
from scenes.catalog.scene_file import mistakes_in
from scenes.files.errors import InputError
from scenes.files.partial_folders import PARTIAL, abandoned, remove, remove_stale, working_folder
from scenes.modelling.normalise import fitted, normalised
from scenes.modelling.scene import Scene
from scenes.rendering.occupancy import with_occupancy
from scenes.rendering.order import NoiseTarget, Order
from scenes.rendering.variant import VARIANTS, choose_variant, known_variant
from scenes.rendering.writer import Progress, write_view_set
from scenes.view_sets.manifest import check_all
from scenes.view_sets.viewpoints import SPLITS

LARGEST_RESOLUTION = 4096
LARGEST_SPP = 1 << 16
CEILINGS = (10.0, 100.0)
"""The valid range in dB of `NoiseTarget.ceiling_db`."""


def ensure_view_set(
    scene_name: str | Scene,
    *,
    resolution: int,
    counts: dict[str, int],
    spp: Mapping[str, int | NoiseTarget],
    cache_folder: Path | str,
    variant: str | None = None,
    progress: Progress | None = None,
    integrator: str | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Return the folder of the rendered view set, from the cache if it is complete there, else rendered now.

    A scene of the catalogue is given by name, a user's scene (`scenes.catalog.scene_file`) as a `Scene`. `counts` and
    `spp` (samples per pixel, 2 or more, or the noise that they may leave) have keys train, val and test. With `variant`
    None a cached set of any variant is used, else the fastest variant that works renders it. Several processes may
    request the same set at once. `say` receives the fault of a cached set. Raises `InputError` for a bad request or a
    folder that cannot be written.
    """
    own = None if isinstance(scene_name, str) else scene_name.file
    with mistakes_in(own):
        order = checked_order(scene_name, resolution, counts, spp, integrator)
    requested = known_variant(variant)
    cache = Path(cache_folder)
    for name in VARIANTS if requested is None else (requested,):
        with mistakes_in(own):  # a description that is not plain data has no digest
            stored = _folder(cache, order, name)
        if is_complete(stored):
            return with_occupancy(stored, order)
    chosen = choose_variant(variant)
    target = _folder(cache, order, chosen.name)
    if say and target.exists():
        say(f"{first_fault(target)}: rendered again, except intact views")
    with _disk(cache):
        cache.mkdir(parents=True, exist_ok=True)
        remove_stale(cache, but=target.name)
        with working_folder(cache, target.name) as partial:
            try:
                donors = [folder for folder in (target, *abandoned(cache, target.name)) if folder.is_dir()]
                with mistakes_in(own, but=OSError):  # these concern the cache
                    write_view_set(partial, order, chosen, progress, donors)
                # before it is in place: a process killed while writing leaves nothing in a complete set
                with_occupancy(partial, order)
                _move_into_place(partial, target)
            except (BrokenPipeError, KeyboardInterrupt):
                raise  # the caller is gone: the rendered views are kept for the next call
            except BaseException:
                remove(partial)
                raise
        for folder in (partial, *abandoned(cache, target.name)):
            remove(folder)
    return target


def check_resolution(resolution: int) -> None:
    if not 1 <= resolution <= LARGEST_RESOLUTION:
        raise InputError(f"--resolution {resolution}: choose 1 to {LARGEST_RESOLUTION} pixels")


def is_stored(
    scene_name: str, resolution: int, counts: dict[str, int], spp: Mapping[str, int | NoiseTarget], cache_folder: Path,
    integrator: str | None = None,
) -> bool:  # fmt: skip
    """Return whether the view set's folder exists, complete or not; arguments and errors as for `ensure_view_set`."""
    order = checked_order(scene_name, resolution, counts, spp, integrator)
    return any(_folder(cache_folder, order, name).is_dir() for name in VARIANTS)


def checked_order(
    scene_name: str | Scene, resolution: int, counts: dict[str, int], spp: Mapping[str, int | NoiseTarget],
    integrator: str | None = None,
) -> Order:  # fmt: skip
    """Return the order; raises `InputError` that names the value and the remedy."""
    scene = scene_named(scene_name) if isinstance(scene_name, str) else scene_name
    check_resolution(resolution)
    most = {split: value.most if isinstance(value, NoiseTarget) else value for split, value in spp.items()}
    for option, given, smallest, largest in (("--", counts, 0, None), ("--spp-", most, 2, LARGEST_SPP)):
        if set(given) != set(SPLITS):
            raise InputError(f"{option}train {option}val {option}test: {given}: give one number each")
        for split, value in given.items():
            if value < smallest or (largest is not None and value > largest):
                limit = f"to {largest}" if largest else "or more"
                raise InputError(f"{option}{split} {value}: choose {smallest} {limit}")
    for split, target in spp.items():
        if isinstance(target, NoiseTarget) and not CEILINGS[0] <= target.ceiling_db <= CEILINGS[1]:
            raise InputError(f"--ceiling-{split} {target.ceiling_db:g}: choose {CEILINGS[0]:g} to {CEILINGS[1]:g} dB")
    order = Order(
        scene,
        *(fitted(scene) if scene.file is not None and scene.load is None else normalised(scene)),
        resolution,
        {split: counts[split] for split in SPLITS},
        {split: spp[split] for split in SPLITS},
        integrator,
    )
    if not sum(counts.values()):
        raise InputError(f"no view of {scene.name} was asked for; choose at least one")
    for split in SPLITS:
        order.poses(split)
    return order


def is_complete(folder: Path) -> bool:
    """Return whether every file of the view set exists and is intact."""
    return folder.is_dir() and first_fault(folder) is None


def first_fault(folder: Path) -> str | None:
    try:
        check_all(folder)
    except InputError as error:
        return str(error).split("; ")[0]
    except (OSError, KeyError, TypeError) as error:
        return f"{folder}: {type(error).__name__}: {error}"
    return None


def _move_into_place(partial: Path, target: Path) -> None:
    """Rename into place; an existing folder is kept if it is complete (another process was faster), else replaced."""
    for _ in range(5):
        try:
            partial.rename(target)
            return
        except OSError as error:
            if error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.EACCES) or not target.exists():
                raise
        if is_complete(target):
            return
        broken = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=PARTIAL, dir=target.parent))
        try:
            target.rename(broken / "broken")
        except FileNotFoundError:
            pass  # another process moved it away first
        finally:
            shutil.rmtree(broken, ignore_errors=True)
    raise InputError(f"{target}: cannot be replaced, something keeps writing to it; remove it by hand")


REFUSALS = {
    errno.ENOSPC: "the disk is full", errno.EDQUOT: "the disk is full", errno.EFBIG: "the disk is full",
    errno.EROFS: "not writable", errno.EACCES: "not writable", errno.EPERM: "not writable",
    errno.ENOTDIR: "a file is in the way of a folder", errno.EEXIST: "a file is in the way of a folder",
}  # fmt: skip


@contextmanager
def _disk(cache: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = REFUSALS.get(error.errno or 0, f"cannot be written ({error.strerror})")
        raise InputError(f"{error.filename or cache}: {reason}; choose another --view-sets folder") from error


def _folder(cache: Path, order: Order, variant: str) -> Path:
    return cache / f"{order.scene.name}-{order.resolution}px-{order.digest(variant)[:12]}"
