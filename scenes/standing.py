"""How far the rendering of a view set is."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Standing:
    """Views that are there, and what is left."""

    done: int
    """Views, those that were there before included."""
    total: int
    kept: int
    """Views that were there before: they take no time."""
    share: float
    """Of the samples that had to be taken: a test view has several times those of a training view."""
    view: str
    """That is rendered next, `<split>/r_<number>`; empty once all are."""


def standings(counts: dict[str, int], spp: dict[str, int], kept: Collection[str]) -> Iterator[Standing]:
    """One before anything is rendered, and one after each view that is; `kept` names those that are not."""
    total = sum(counts.values())
    views = [(f"{split}/r_{number}", spp[split]) for split in counts for number in range(counts[split])]
    missing = [(name, samples) for name, samples in views if name not in kept]
    taken, all_samples = 0, sum(samples for _, samples in missing)
    for place, (name, samples) in enumerate([*missing, ("", 0)]):
        yield Standing(len(kept) + place, total, len(kept), taken / all_samples if all_samples else 1.0, name)
        taken += samples
