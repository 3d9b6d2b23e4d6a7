"""Views of a set that was not finished: those that are as they were written are taken, nothing else is."""

from pathlib import Path
from typing import Any

import pytest

from scenes.view_sets.manifest import note, salvaged

GOOD = {"noise_mse": 1e-6, "seconds": 0.5, "seen": True, "lit": False}


def donor(folder: Path, facts: dict[str, Any]) -> Path:
    (folder / "train").mkdir(parents=True)
    for suffix in ("png", "exr"):
        (folder / "train" / f"r_0.{suffix}").write_bytes(suffix.encode())
    note(folder, "an order", "train/r_0", facts)
    return folder


def test_what_was_noted_is_taken_with_its_files(tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    found = salvaged(tmp_path / "new", [donor(tmp_path / "old", GOOD)], "an order", ["train/r_0"])
    assert found == {"train/r_0": GOOD}
    assert (tmp_path / "new" / "train" / "r_0.exr").read_bytes() == b"exr"


@pytest.mark.parametrize(
    "change",
    [
        {"noise_mse": None},
        {"noise_mse": "0"},
        {"noise_mse": True},
        {"noise_mse": 10**400},
        {"seconds": "1"},
        {"lit": 7},
    ],
)
def test_facts_that_nobody_notes_are_a_miss_though_their_digest_is_right(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    (tmp_path / "new").mkdir()
    assert salvaged(tmp_path / "new", [donor(tmp_path / "old", GOOD | change)], "an order", ["train/r_0"]) == {}
