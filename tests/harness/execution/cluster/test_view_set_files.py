"""View sets on nodes without the driver's disk: the same files, fetched once, and no other file of the driver."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from harness.execution.cluster import view_set_files
from harness.execution.cluster.view_set_files import listed, node_folder, on_this_node, piece
from harness.machine import provenance
from harness.machine.provenance import changed_since, differences, versions
from scenes.files.errors import InputError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small view set, and provide a node with an empty temporary folder."""
    (tmp_path / "node").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "node"))
    monkeypatch.setattr(view_set_files, "PIECE_BYTES", 1000)
    made = tmp_path / "driver" / "ball"
    (made / "train").mkdir(parents=True)
    (made / "train" / "r_0.png").write_bytes(bytes(range(256)) * 10)
    (made / "empty.json").write_bytes(b"")
    (made / ".hidden").write_text("not part of it")
    return made


def fetching(listing: view_set_files.Listing, asked: list[str]) -> Callable[[str, int], bytes]:
    def fetch(relative: str, offset: int) -> bytes:
        asked.append(f"{relative} {offset}")
        return piece(listing, relative, offset)

    return fetch


def shared(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def others(folder: Path) -> None:
    folder.mkdir()
    if os.geteuid() != 0:
        pytest.skip("only root gives a folder away")
    os.chown(folder, 65534, 65534)


def led_elsewhere(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize("made", [shared, others, led_elsewhere, Path.touch])
def test_what_others_could_change_is_not_run_from(
    made: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = node_folder()
    assert folder == node_folder(), "ours is taken again"
    folder.rmdir()
    made(folder)
    with pytest.raises(InputError, match="not a folder of this user only; remove it, or set TMPDIR"):
        node_folder()


def test_a_shared_folder_is_used_where_it_is(folder: Path) -> None:
    asked: list[str] = []
    assert on_this_node(listed(folder), fetching(listed(folder), asked)) == folder
    assert asked == []


def test_elsewhere_it_is_fetched_in_pieces_and_once(folder: Path) -> None:
    here = listed(folder)
    asked: list[str] = []
    there = replace(here, folder=Path("/not/on/this/node/ball"))
    copy = on_this_node(there, fetching(here, asked))
    assert copy.is_relative_to(node_folder())
    assert copy.name == "ball"
    assert listed(copy).digest == here.digest
    assert asked == ["train/r_0.png 0", "train/r_0.png 1000", "train/r_0.png 2000"]
    assert on_this_node(there, fetching(here, asked)) == copy
    assert len(asked) == 3
    assert not list((node_folder() / "view_sets").glob(".*")), "nothing unfinished stays"


def test_a_damaged_copy_is_fetched_again(folder: Path) -> None:
    here = listed(folder)
    there = replace(here, folder=Path("/not/on/this/node/ball"))
    copy = on_this_node(there, fetching(here, []))
    data = bytearray((copy / "train" / "r_0.png").read_bytes())
    data[7] ^= 1
    (copy / "train" / "r_0.png").write_bytes(data)
    assert listed(on_this_node(there, fetching(here, []))).digest == here.digest


def test_another_content_at_the_same_path_is_not_taken_for_it(folder: Path, tmp_path: Path) -> None:
    here = listed(folder)
    (folder / "train" / "r_0.png").write_bytes(bytes(reversed(range(256))) * 10)
    with pytest.raises(InputError, match="changed while it was copied"):
        on_this_node(here, fetching(here, []))
    assert not list((node_folder() / "view_sets").iterdir())


@pytest.mark.parametrize("path", ["../secret", "/etc/passwd", ".hidden", "train"])
def test_nothing_but_listed_files_is_given_away(folder: Path, path: str) -> None:
    (folder.parent / "secret").write_text("of the driver alone")
    with pytest.raises(KeyError):
        piece(listed(folder), path, 0)


def test_what_differs_between_two_machines_is_named() -> None:
    ours = versions()
    assert differences(ours, ours) == ""
    assert differences(ours, {**ours, "torch": "1.0"}) == f"torch 1.0 instead of {ours['torch']}"
    assert "this program unknown instead of" in differences({"this program": "ab"}, {})
    assert set(ours) >= {"Python", "torch", "numpy", "this program"}


def test_sources_are_read_again_where_that_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.py").write_text("A = 1")
    monkeypatch.setattr(provenance, "our_folders", lambda: [tmp_path])
    ours = versions.__wrapped__()  # not what this process was started with
    assert changed_since(ours) == ""
    (tmp_path / "one.py").write_text("A = 2")
    assert changed_since(ours).startswith("this program ")
