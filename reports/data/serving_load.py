"""OUT/serving.json → a record with every figure checked against its type."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import get_args

from harness.records.cells import records_folder
from harness.records.serving_record import (
    SERVING_FILE,
    Allocation,
    Anytime,
    AttentionRecord,
    CacheRecord,
    Confusion,
    FirstFrame,
    Latency,
    PathUse,
    Reaching,
    ServingRecord,
    Source,
    read_serving,
)
from reports.data.load import find_record
from reports.data.wording import Verdict

MEMORY, DISK, HASHED = ("level 0", "level 1"), ("level 2", "level 2 cold"), ("level 0 hashed",)
"""The kinds of hits that each target applies to, and those that fail the one of memory by nature: hashing costs more
than everything else.
"""


MISSED: Verdict = "not seen at this scale"


def find_serving(out: Path) -> ServingRecord | None:
    """What serving was measured to do under `out`, None where it was not; raises `DamagedRecord`."""
    remedy = f"run `python -m harness study serving {out}` again"
    return find_record(out / SERVING_FILE, read_serving, partial(_contradiction, records_folder(out)), remedy)


def is_quick(record: ServingRecord) -> bool:
    """Return whether sizes were so small that no figure means anything."""
    return bool(record.settings.get("quick"))


def is_whole(record: ServingRecord) -> bool:
    """Return whether everything that was asked for was measured."""
    return bool(record.settings.get("complete", True))


def _contradiction(folder: Path, record: ServingRecord) -> str | None:
    """Return the first thing that no measurement gives, though every type is right."""
    found: list[Iterator[str]] = [_negative("seconds", record.seconds)]
    if record.cache is not None:
        found.append(_of_cache(record.cache))
    if record.attention is not None:
        found += [_of_attention(record.attention), _strays(folder, record.attention)]
    if record.first_frame is not None:
        found.append(_of_first_frame(record.first_frame))
    return next(itertools.chain(*found), None)


def _of_cache(record: CacheRecord) -> Iterator[str]:
    yield from _not_positive(
        width=record.width, height=record.height, target_memory=record.target_memory, target_disk=record.target_disk
    )
    yield from _negative("memory_bytes_per_view", record.memory_bytes_per_view)
    yield from _negative("disk_bytes_per_view", record.disk_bytes_per_view)
    yield from _twice("latency", ((one.scene, one.method, one.source) for one in record.latencies))
    for latency in record.latencies:
        yield from _of_latency(latency)
    for path in record.paths:
        yield from _of_path(path)
    for confusion in record.confusions:
        yield from _of_confusion(confusion)


def _of_latency(one: Latency) -> Iterator[str]:
    name = f"latency of {one.source!r}, {one.method} on {one.scene}"
    yield from (f"{name}: {wrong}" for wrong in _not_positive(seconds=one.seconds, low=one.spread[0], calls=one.calls))
    if not one.spread[0] <= one.seconds <= one.spread[1]:
        yield f"{name}: {one.seconds} lies outside of its spread {list(one.spread)}"
    if (one.source == "render") != (one.ratio is None) or (one.ratio is None) != (one.ratio_spread is None):
        yield f"{name}: a hit has a ratio with a spread, rendering has none"
    if one.ratio is not None and one.ratio_spread is not None:
        yield from (f"{name}: {wrong}" for wrong in _not_positive(ratio=one.ratio))
        if not 0 < one.ratio_spread[0] <= one.ratio_spread[1]:
            yield f"{name}: ratio_spread is {list(one.ratio_spread)}"


def _of_path(one: PathUse) -> Iterator[str]:
    name = f"path {one.path!r}, {one.method} on {one.scene}"
    strange = set(one.hits) - set(get_args(Source))
    if strange:
        yield f"{name}: hits from {sorted(strange)[0]!r}"
    if min(one.hits.values(), default=0) < 0 or sum(one.hits.values()) != one.views:
        yield f"{name}: {one.views} views, but {sum(one.hits.values())} that came from anywhere"
    if any(not 0 <= rate <= 1 for rate in one.other_hit_rates):
        yield f"{name}: other_hit_rates are {one.other_hit_rates}"
    for label in ("seconds", "seconds_without", "memory_bytes", "disk_bytes"):
        yield from (f"{name}: {wrong}" for wrong in _negative(label, getattr(one, label)))


def _of_confusion(one: Confusion) -> Iterator[str]:
    name = f"confusion {one.changed!r}"
    for label in ("stale", "missed"):
        if not 0 <= getattr(one, label) <= one.views:
            yield f"{name}: {label} is {getattr(one, label)} of {one.views} views"
    yield from (f"{name}: {wrong}" for wrong in _negative("rmse", one.rmse))


def _of_attention(record: AttentionRecord) -> Iterator[str]:
    yield from _not_positive(
        width=record.width, height=record.height, tile=record.tile, reference_bins=record.reference_bins
    )
    yield from _twice("curve", ((one.scene, one.method, one.attention, one.order) for one in record.curves))
    yield from _twice(
        "time",
        (
            (one.scene, one.method, one.attention, one.order, one.measure, str(one.share_of_error))
            for one in record.reaching
        ),
    )
    yield from _twice(
        "allocation",
        ((one.scene, one.method, one.attention, one.way, str(one.against)) for one in record.allocations),
    )
    for curve in record.curves:
        yield from _of_curve(curve)
    for time in record.reaching:
        yield from _of_reaching(time)
    for allocation in record.allocations:
        yield from _of_allocation(allocation)
    for plain in record.not_by_regions:
        yield from (f"{plain.method}: {wrong}" for wrong in _negative("rmse", plain.rmse))
    phi = record.phi
    if not (0 <= phi.orders_changed <= phi.maps and 0 <= phi.allocations_changed <= phi.maps):
        yield f"φ changed {phi.orders_changed} orders and {phi.allocations_changed} allocations of {phi.maps} maps"


def _of_curve(one: Anytime) -> Iterator[str]:
    name = f"curve of {one.method} on {one.scene}, {one.attention}, {one.order}"
    labels = ("seconds", "share", "rmse_whole", "rmse_hardest", "rmse_attended")
    lengths = {label: len(getattr(one, label)) for label in labels}
    if len(set(lengths.values())) > 1 or not one.seconds:
        yield f"{name} has {', '.join(f'{many} {label}' for label, many in lengths.items())}"
        return
    for label in lengths:
        yield from (f"{name}: {wrong}" for wrong in _negative(label, *getattr(one, label)))
    for label in ("seconds", "share"):
        if any(later < sooner for sooner, later in itertools.pairwise(getattr(one, label))):
            yield f"{name}: {label} run backwards"
    yield from (f"{name}: {wrong}" for wrong in _outside(one.seconds[-1], one.total_spread))
    if one.share[-1] > 1:
        yield f"{name}: share is {one.share[-1]}, more than all"


def _of_reaching(one: Reaching) -> Iterator[str]:
    name = f"time of {one.method} on {one.scene}, {one.attention}, {one.order}"
    if not 0 < one.share_of_error <= 1:
        yield f"{name}: share_of_error is {one.share_of_error}"
    yield from (f"{name}: {wrong}" for wrong in _negative("error", one.error))
    if (one.seconds is None) != (one.spread is None):
        yield f"{name}: seconds and spread are there together or not at all"
    if one.seconds is not None and one.spread is not None:
        yield from (f"{name}: {wrong}" for wrong in _outside(one.seconds, one.spread))


def _outside(seconds: float, spread: tuple[float, float]) -> Iterator[str]:
    if not 0 <= spread[0] <= seconds <= spread[1]:
        yield f"{seconds} s lies outside of its spread {list(spread)}"


def _of_allocation(one: Allocation) -> Iterator[str]:
    name = f"allocation of {one.method} on {one.scene}, {one.attention}"
    yield from (f"{name}: {wrong}" for wrong in _not_positive(bins=one.bins, evaluations=one.evaluations))
    for label in ("own", "rmse_attended", "rmse_whole", "truth_attended", "truth_whole"):
        yield from (f"{name}: {wrong}" for wrong in _negative(label, getattr(one, label) or 0.0))
    yield from (f"{name}: {wrong}" for wrong in _outside(one.seconds, one.seconds_spread))
    if one.own > one.evaluations:
        yield f"{name}: own is {one.own} of {one.evaluations} evaluations"


def _of_first_frame(one: FirstFrame) -> Iterator[str]:
    yield from (f"first frame: {wrong}" for wrong in _not_positive(calls=one.calls, target=one.target))
    if not 0 <= one.seconds_coarse <= one.seconds_whole:
        yield f"first frame: coarse after {one.seconds_coarse} s, whole after {one.seconds_whole} s"
    if not len(one.methods) == len(one.strides) == len(one.psnr_coarse):
        yield f"first frame: {len(one.methods)} methods, {len(one.strides)} strides, {len(one.psnr_coarse)} psnr_coarse"
    yield from (f"first frame: {wrong}" for stride in one.strides for wrong in _not_positive(strides=stride))


def _strays(folder: Path, record: AttentionRecord) -> Iterator[str]:
    """Yield pictures that are missing, or would bring something foreign to the run into the page."""
    for frame in record.frames:
        path = (folder / frame.image).resolve()
        if not path.is_relative_to(folder.resolve()):
            yield f"picture {frame.image!r} lies outside of {folder.name}/"
        elif not path.is_file():
            yield f"picture {frame.image!r} is missing in {folder.name}/"


def _twice(what: str, names: Iterable[tuple[str, ...]]) -> Iterator[str]:
    for name, many in Counter(names).items():
        if many > 1:
            yield f"{what} {', '.join(name)} is there twice"


def _negative(label: str, *values: float) -> Iterator[str]:
    if min(values, default=0) < 0:
        yield f"{label} is {min(values)}"


def _not_positive(**values: float) -> Iterator[str]:
    for label, value in values.items():
        if value <= 0:
            yield f"{label} is {value}"


def both(record: CacheRecord) -> Verdict:
    """Return *not seen* if the hits of a scene and method fail a target, *seen* if all of both kinds reach it."""
    found = [judge_hit(one, record) for one in record.latencies if one.source in MEMORY + DISK]
    sources = {one.source for one in record.latencies}
    if MISSED in found:
        return MISSED
    complete = sources & set(MEMORY) and sources & set(DISK)
    return "seen" if complete and all(one == "seen" for one in found) else "inconclusive"


def judge_hit(one: Latency, record: CacheRecord) -> Verdict:
    """Judge a hit by its spread, if there is one: it may lie above the target, below, or across."""
    target = record.target_disk if one.source in DISK else record.target_memory
    low, high = one.ratio_spread or (0.0, math.inf)
    return "seen" if low >= target else MISSED if high < target else "inconclusive"
