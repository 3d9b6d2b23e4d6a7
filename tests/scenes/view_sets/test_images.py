"""Image files: round trips, and every way in which one can be bad."""

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenes.files.errors import InputError
from scenes.view_sets.images import display_image, read_channels, read_image, write_channels, write_png
from tests.scenes.captures import flip
from tests.scenes.view_sets.test_image_stack import disk_of_4000_bytes


def random_rgba(height: int = 7, width: int = 11) -> np.ndarray:
    rgba = np.random.default_rng(5).uniform(size=(height, width, 4)).astype(np.float32)
    rgba[0, :, 3] = 0.0
    return rgba


def write(file: Path, rgba: np.ndarray) -> None:
    """Write a PNG or an EXR file."""
    if file.suffix == ".png":
        write_png(file, rgba)
    else:
        write_channels(file, {name: rgba[..., i] for i, name in enumerate("RGBA")})


def test_png_keeps_straight_alpha_as_others_read_it(tmp_path: Path) -> None:
    rgba = random_rgba()
    write_png(tmp_path / "a.png", rgba)
    levels = np.round(rgba * 255).astype(np.uint8)
    assert np.array_equal(np.array(Image.open(tmp_path / "a.png")), levels)
    assert np.abs(read_image(tmp_path / "a.png") - levels / 255).max() < 1e-6


def test_16_bit_png(tmp_path: Path) -> None:
    levels = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
    Image.fromarray(levels).save(tmp_path / "c.png")
    assert read_image(tmp_path / "c.png")[..., 0] == pytest.approx(levels / 65535, abs=1e-6)


def test_display_colour_is_neither_linear_light_nor_turned(tmp_path: Path) -> None:
    write_channels(tmp_path / "light.exr", {name: np.full((3, 4), 4.998) for name in "RGBA"})
    with pytest.raises(InputError, match=re.escape("light.exr: has floating-point pixels, up to 4.998; save")):
        display_image(tmp_path / "light.exr")
    exif = Image.Exif()
    for turned, suffix in ((1, "jpg"), (6, "jpg"), (3, "png")):
        file = tmp_path / f"{turned}.{suffix}"
        exif[0x0112] = turned
        Image.new("RGB", (4, 2)).save(file, exif=exif)
        if turned == 1:
            assert display_image(file).shape == (2, 4, 3)
        else:
            with pytest.raises(InputError, match=rf"EXIF orientation {turned}"):
                display_image(file)


def test_channels_round_trip_bit_for_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    channels = {name: random.normal(size=(5, 9)).astype(np.float32) for name in ("R", "G", "B", "A", "Z", "N.X", "V.A")}
    channels["R"][0, 0] = 1e30
    channels["V.A"][0, 1] = 1e-30
    write_channels(tmp_path / "d.exr", channels)
    result = read_channels(tmp_path / "d.exr")
    assert set(result) == set(channels)
    assert all(np.array_equal(result[name], channels[name]) for name in channels)


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png_claiming(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", ["png", "exr"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.99])
def test_truncated_files_are_refused(
    tmp_path: Path, suffix: str, kept: float, capfd: pytest.CaptureFixture[str]
) -> None:
    complete, cut = tmp_path / f"whole.{suffix}", tmp_path / f"cut.{suffix}"
    write(complete, random_rgba(40, 40))
    data = complete.read_bytes()
    cut.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(InputError, match=f"cut.{suffix}"):
        read_image(cut)
    assert capfd.readouterr() == ("", "")  # one clear message: libraries print nothing


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"hello", "not an image"),
        (png_claiming(100_000, 100_000), "not an image|larger"),
        (png_claiming(20_000, 10_000), "larger"),
        (png_claiming(0, 5), "bad.png"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "bad.png"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.png") as caught:
        read_image(file)
    assert re.search(message, str(caught.value))


def test_a_flipped_bit_is_noticed(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", random_rgba())
    flip(tmp_path / "a.png")
    with pytest.raises(InputError, match="damaged"):
        read_image(tmp_path / "a.png")


def test_writing_where_nothing_can_be_written_is_an_os_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for target in ("no/such/folder/x.png", "file/x.png", "no/such/folder/x.exr", "file/x.exr"):
        with pytest.raises(OSError, match=r"x\.(png|exr)"):
            write(tmp_path / target, random_rgba())


@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_a_full_disk_is_noticed(tmp_path: Path, suffix: str) -> None:
    """OpenImageIO says nothing for a PNG."""
    with disk_of_4000_bytes(), pytest.raises(OSError, match=rf"full\.{suffix}"):
        write(tmp_path / f"full.{suffix}", random_rgba(100, 100))
