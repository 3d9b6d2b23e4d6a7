"""After any failure of a writer, a file is unchanged or complete."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from scenes.files.atomic import remove_leftovers, replacing, require_suffix, write_atomically
from scenes.files.errors import InputError


@pytest.mark.parametrize("killed_at", ["os.fsync", "pathlib.Path.replace"])
def test_a_killed_write_leaves_the_old_file_and_a_part_that_is_known(killed_at: str, tmp_path: Path) -> None:
    (file := tmp_path / "a.json").write_text("old")
    code = (
        "import os, pathlib, sys\n"
        "from scenes.files.atomic import write_atomically\n"
        f"{killed_at} = lambda *_: os.kill(os.getpid(), 9)\n"
        "write_atomically(pathlib.Path(sys.argv[1]), 'new')\n"
    )
    ran = subprocess.run([sys.executable, "-c", code, file], capture_output=True, text=True)
    assert ran.returncode == -signal.SIGKILL, ran.stderr
    assert file.read_text() == "old"
    assert remove_leftovers(tmp_path) == 1
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("refused", ["os.fsync", "pathlib.Path.replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), KeyboardInterrupt()])
def test_a_write_that_fails_names_the_file_and_leaves_what_was_there(
    refused: str, error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise error

    (file := tmp_path / "a.json").write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(refused, refuse)
        with pytest.raises(type(error)) as caught:
            write_atomically(file, b"new")
    if isinstance(caught.value, OSError):
        assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(file))
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_file_has_the_permissions_of_any_other_and_reaches_the_disk_where_that_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr("os.fsync", synced.append)
    write_atomically(tmp_path / "new" / "page", "½\n", fsync=False)
    assert synced == []
    write_atomically(tmp_path / "new" / "record", "½\n")
    assert len(synced) == 1
    (tmp_path / "other").write_text("")
    for file in (tmp_path / "new").iterdir():
        assert (file.read_bytes(), file.stat().st_mode) == ("½\n".encode(), (tmp_path / "other").stat().st_mode)


def test_what_bears_the_temporary_name_goes_and_no_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    part = tmp_path / f".a.json.{os.getpid()}.part"
    puts = (lambda: (part / "inner").mkdir(parents=True), part.touch, lambda: part.symlink_to(tmp_path / "precious"))
    for put in puts:
        put()
        write_atomically(tmp_path / "a.json", "new")
        assert {one.name: one.read_text() for one in tmp_path.iterdir()} == {"a.json": "new", "precious": "mine"}


def test_a_folder_gets_its_name_with_all_that_is_in_it_or_not_at_all(tmp_path: Path) -> None:
    for number in range(2):
        with replacing(tmp_path / "set", ".exr") as temporary:
            assert (temporary.parent, temporary.suffix) == (tmp_path, ".exr")
            temporary.mkdir()
            (temporary / "a").write_text("new")
            if number:
                (tmp_path / "set" / "a").unlink()
        assert [one.relative_to(tmp_path).as_posix() for one in tmp_path.rglob("*")] == ["set", "set/a"]
    with pytest.raises(OSError, match="not empty") as caught, replacing(tmp_path / "set") as temporary:
        temporary.mkdir()
    assert caught.value.filename == str(tmp_path / "set")
    assert list(tmp_path.iterdir()) == [tmp_path / "set"]


def test_an_error_about_a_file_elsewhere_keeps_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught, replacing(tmp_path / "copy"):
        (tmp_path / "source").read_bytes()
    assert caught.value.filename == str(tmp_path / "source")
    with pytest.raises(OSError, match=r"^no system said this$"), replacing(tmp_path / "copy"):
        raise OSError("no system said this")
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError) as caught:
        write_atomically(tmp_path / "file" / "inner" / "a.json", "new")
    assert caught.value.filename == str(tmp_path / "file" / "inner" / "a.json")


def test_leftovers_of_this_version_and_of_those_before_are_known(tmp_path: Path) -> None:
    left = (".a.json.12.part", ".0000.png.12.part.png", ".0000.part.exr", ".limits.json.part")
    mine = ("a.part", ".lego.1234.partial", ".parts", "b.part.png")
    for name in (*left, *mine):
        (tmp_path / name).write_text("half")
    (tmp_path / ".folder.12.part").mkdir()
    assert remove_leftovers(tmp_path) == len(left)
    assert {one.name for one in tmp_path.iterdir()} == {*mine, ".folder.12.part"}
    assert remove_leftovers(tmp_path / "nowhere") == 0


@pytest.mark.parametrize("device", ["/dev/null", "/dev/stdin"])
def test_a_device_is_not_replaced(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path(device).is_char_device():
        pytest.skip(f"{device} is not a device here")
    monkeypatch.setattr(Path, "replace", None)  # should it come so far, nothing is lost
    with pytest.raises(OSError, match="is a device, which no file replaces"):
        write_atomically(Path(device), "text")


def test_a_link_of_ours_to_a_device_is_replaced_and_the_device_is_not(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to("/dev/null")
    write_atomically(link, "text")
    assert link.read_text() == "text"
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("table.csv", r"--to \S+table.csv: give a name that ends in .json"),
        ("folder.json", "is a folder"),
        ("records/cell.json", "lies among the records of a run"),
    ],
)
def test_a_file_that_is_not_to_be_replaced_is_refused(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "run.json").touch()
    require_suffix(tmp_path / "new.JSON", ".json", "--to")
    with pytest.raises(InputError, match=said):
        require_suffix(tmp_path / name, ".json", "--to")
