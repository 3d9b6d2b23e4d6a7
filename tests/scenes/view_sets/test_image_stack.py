"""Images in a file are bit-identical to images in memory; a disk that refuses them is named."""

import gc
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.image_stack import ImageStack, require_room


def images(count: int = 5, shape: tuple[int, ...] = (6, 7, 4)) -> np.ndarray:
    return np.random.default_rng(count).uniform(size=(count, *shape)).astype(np.float32)


@pytest.mark.parametrize("shape", [(6, 7, 4), (6, 7), (1, 1, 3)])
def test_what_is_read_is_what_was_appended(tmp_path: Path, shape: tuple[int, ...]) -> None:
    expected = images(5, shape)
    stack = ImageStack.of(expected, tmp_path)
    assert stack.shape == expected.shape
    assert len(stack) == 5
    assert np.array_equal(np.stack(list(stack)), expected)
    assert np.array_equal(stack[np.int64(3)], expected[3])
    assert np.array_equal(stack[-1], expected[-1])
    assert stack[0].dtype == np.float32
    index = np.random.default_rng(1).integers(0, 5 * shape[0] * shape[1], 1000)
    assert np.array_equal(stack.pixels(index), expected.reshape(-1, *shape[2:])[index])
    assert stack.pixels(index[:0]).shape == (0, *shape[2:])


def test_what_is_read_is_a_copy_and_another_index_or_size_is_refused(tmp_path: Path) -> None:
    stack = ImageStack.of(images(), tmp_path)
    stack[2][:] = 0.0
    assert np.array_equal(stack[2], images()[2])
    for index in (5, -6):
        with pytest.raises(IndexError):
            stack[index]
    with pytest.raises(ValueError, match="among"):
        stack.append(np.zeros((6, 8, 4), np.float32))
    assert len(stack) == 5


def open_files(folder: Path) -> int:
    """How many files in `folder` this process holds open, with a name or without."""
    gc.collect()
    result = 0
    for link in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the descriptor that lists them
            result += str(link.readlink()).startswith(f"{folder}/")
    return result


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="no /proc to see open files in")
def test_the_file_is_in_the_folder_without_a_name_and_gone_with_the_stack(tmp_path: Path) -> None:
    stack = ImageStack.of(images(), tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert open_files(tmp_path) == 1
    del stack
    assert open_files(tmp_path) == 0


def test_a_file_that_lost_its_end_is_an_error_and_never_a_number(tmp_path: Path) -> None:
    stack = ImageStack.of(images(), tmp_path)
    assert stack._file is not None
    stack._file.truncate(4 * 6 * 7 * 4 * 4)
    assert np.array_equal(stack[3], images()[3])
    with pytest.raises(OSError, match="bytes were read"):
        stack[4]
    with pytest.raises(OSError, match="bytes were read"):
        stack.pixels(np.array([0, 5 * 6 * 7 - 1]))


@contextmanager
def disk_of_4000_bytes() -> Iterator[None]:
    """A write past that is refused by the system, after what still fits has been taken: as on a full disk.

    Not a fixture: pytest's own output may go to a file, and is written before a fixture is torn down.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fills_up_is_named_and_what_was_whole_stays(tmp_path: Path) -> None:
    stack = ImageStack((6, 7, 4), tmp_path)  # 672 bytes an image
    for image in images(9)[:5]:
        stack.append(image)
    with disk_of_4000_bytes(), pytest.raises(InputError) as caught:
        stack.append(images(9)[5])
    assert str(caught.value).startswith(f"{tmp_path}: the decoded images cannot be put there (File too large)")
    assert "--out" in str(caught.value)
    assert len(stack) == 5
    assert np.array_equal(stack[4], images(9)[4])


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing: .*No such file"):
        ImageStack.of(images(), tmp_path / "nothing")
    with pytest.raises(InputError, match=r"nothing: .*No such file"):
        require_room([(6, 7, 4)], 1, tmp_path / "nothing")


def test_room_is_asked_for_all_stacks_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=8 << 20))
    shapes = [(512, 512, 4), (512, 512)]  # 5 MiB
    require_room(shapes, 1, tmp_path)
    with pytest.raises(InputError, match="they take 10 MiB, 8 MiB are free"):
        require_room(shapes, 2, tmp_path)
