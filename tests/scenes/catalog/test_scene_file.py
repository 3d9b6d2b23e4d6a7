"""Scenes of a user's own: what is known of a file without Mitsuba, where it is put, what is refused, one rendering."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from scenes.__main__ import main
from scenes.catalog.entries import CATALOG
from scenes.catalog.scene_file import mistakes_in, name_of_file, scene_from_file
from scenes.files.errors import InputError
from scenes.modelling.placement import VISIBLE_RADIUS, upright
from scenes.rendering.store import checked_order, ensure_view_set
from scenes.view_sets.view_set import read_view_set
from scenes.view_sets.viewpoints import FOV_X_RADIANS, all_poses

IMPORT = "from scenes.modelling.scene import Scene\n"
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
BALL = """<scene version="3.0.0">
  <shape type="sphere"><bsdf type="diffuse"/></shape>
  <emitter type="constant"/>
</scene>"""
COUNTS, SPP = {"train": 2, "val": 0, "test": 1}, {"train": 2, "val": 2, "test": 2}


def written(folder: Path, text: str, name: str = "mine.xml") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_names_are_fit_for_records_and_never_of_the_catalogue() -> None:
    assert name_of_file(Path("a/My scene (2).xml")) == "My-scene-2"
    assert name_of_file(Path("a/…….py")) == "scene"
    assert name_of_file(Path("lego.xml")) == "lego-file"
    assert all(name_of_file(Path(f"{name}.py")) not in CATALOG for name in CATALOG)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("mine.xml", "<scene", "not well-formed"),
        ("mine.xml", "<html/>", "<html>"),
        ("mine.xml", '<scene version="3.0.0"><emitter type="constant"/></scene>', "no <shape>"),
        ("mine.xml", '<scene version="3.0.0"><shape type="sphere"/></scene>', "no <emitter>"),
        ("mine.xml", BALL.replace("<emitter", '<include filename="no.xml"/><emitter'), "no.xml., which is not there"),
        ("mine.py", "SCENE = 3", "no SCENE"),
        ("mine.py", "def", r"SyntaxError"),
        ("mine.py", "a = 1\n1 / 0", r"ZeroDivisionError in line 2: division by zero"),
        ("mine.py", "raise SystemExit(3)", "SystemExit in line 1"),
        (
            "mine.py",
            f"{IMPORT}def build():\n    return {{}}['x']\nSCENE = Scene('a', 'b', build)",
            "KeyError in line 3",
        ),
        ("mine.py", "import os\nos._exit(0)", "mine.py: ends the process with exit code 0"),
        (
            "mine.py",
            f"{IMPORT}import random\nSCENE = Scene('a', 'b', lambda: {{'x': random.random()}})",
            "gives a different result each time",
        ),
        ("mine.py", f"{IMPORT}SCENE = Scene('a', 'b', lambda: [1])", "build.. gives list"),
        ("mine.py", f"{IMPORT}SCENE = Scene('a', 'b', dict, near=7.0)", "near 7.0"),
    ],
)
def test_a_file_that_is_no_scene(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        scene_from_file(written(tmp_path, text, name))
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_neighbour_can_be_imported_and_the_path_is_left_as_it_was(tmp_path: Path) -> None:
    import sys

    written(tmp_path, "HEIGHT = 2.0", "neighbour_of_mine.py")
    text = (EXAMPLES / "my_scene.py").read_text().replace("import numpy", "import neighbour_of_mine\nimport numpy")
    before = list(sys.path)
    scene = scene_from_file(written(tmp_path, text, "mine.py"))
    assert (scene.name, scene.title) == ("mine", "Three blocks: flat faces, sharp edges")
    assert sys.path == before
    del sys.modules["neighbour_of_mine"]


def test_python_scenes_are_brought_into_the_picture(tmp_path: Path) -> None:
    order = checked_order(scene_from_file(EXAMPLES / "my_scene.py"), 8, COUNTS, SPP)
    assert order.similarity is not None  # its tower is too high for cameras four units away
    corners = np.array([[x, y, z] for x in (-0.6, 0.6) for y in (-0.6, 0.6) for z in (-1.2, 0.0)])
    assert np.linalg.norm(order.similarity.points(corners), axis=1).max() <= VISIBLE_RADIUS


def test_a_disk_that_fails_later_is_told_apart_from_a_file_that_fails(tmp_path: Path) -> None:
    """What `build` reads may be gone when it is called again; what the cache says is not the file's mistake."""
    data = written(tmp_path, "1", "data.txt")
    text = f"import os\n{IMPORT}def build():\n    return {{'x': os.stat({str(data)!r})[6]}}\n"
    scene = scene_from_file(written(tmp_path, text + "SCENE = Scene('a', 'b', build)", "mine.py"))
    data.unlink()
    with pytest.raises(InputError, match=r"mine\.py: FileNotFoundError in line 4"):
        ensure_view_set(scene, resolution=8, counts=COUNTS, spp=SPP, cache_folder=tmp_path, variant="scalar_rgb")
    for file, others in ((scene.file, OSError), (None, ())):
        with pytest.raises(OSError, match="full"), mistakes_in(file, but=others):
            raise OSError("full")


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0.2), (1, 0, 0), (0, 0, 1), (0.1, 0, -3)])
def test_a_placed_scene_is_upright_right_handed_and_seen_whole(up: tuple[float, float, float]) -> None:
    box = np.array([[10.0, -4, 2], [14.0, 8, 3]])
    placed = upright(box, np.array(up))
    assert np.linalg.det(placed.rotation) == pytest.approx(1.0)
    axis = np.zeros(3)
    axis[np.abs(up).argmax()] = np.sign(up[int(np.abs(up).argmax())])
    assert np.allclose(placed.rotation @ axis, [0, 0, 1])
    corners = np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]])
    moved = placed.points(corners)
    assert np.allclose(np.linalg.norm(moved, axis=1), VISIBLE_RADIUS)
    assert np.allclose(placed.box(box), [moved.min(axis=0), moved.max(axis=0)])
    for pose in all_poses("test")[::40]:
        inside = (moved - pose[:3, 3]) @ pose[:3, :3]
        assert (np.abs(inside[:, :2]) <= -inside[:, 2:] * math.tan(FOV_X_RADIANS / 2) * (1 + 1e-9)).all()
        # the same points before the same camera in the file: all directions alike
        theirs = placed.camera(pose)
        seen = (corners - theirs[:3, 3]) @ theirs[:3, :3] * placed.scale
        assert np.allclose(seen, inside, atol=1e-9)
        assert np.allclose(theirs[:3, :3] @ theirs[:3, :3].T, np.eye(3))


def render(file: Path, cache: Path, *options: str) -> int:
    command = ["render", "--scene-file", str(file), "--view-sets", str(cache), "--variant", "scalar_rgb"]
    return main([*command, "--train", "2", "--spp-train", "4", *options])


def rendered(file: Path, cache: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert render(file, cache, "--resolution", "24", "--test", "1", "--spp-test", "4") == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert "note" in events[0]
    return Path(events[-1]["path"])


@pytest.mark.slow
def test_both_examples_are_rendered_where_they_are_said_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = rendered(EXAMPLES / "my_scene.xml", tmp_path, capsys)
    assert rendered(EXAMPLES / "my_scene.xml", tmp_path, capsys) == folder
    result = read_view_set(folder)
    assert result.name == "my_scene"
    assert np.abs(result.bounds).max() < VISIBLE_RADIUS + 0.1
    manifest = json.loads((folder / "view_set.json").read_text())
    change = manifest["normalised"]
    placed = np.array(change["rotation"]) * change["scale"]
    centre = placed @ [-1.2, 1.0, 0.0] + change["shift"]
    assert result.test.depth is not None
    assert result.test.normal is not None
    for pose, rgba, depth, normal in zip(
        result.test.camera_to_world, result.test.rgba, result.test.depth, result.test.normal, strict=True
    ):
        x, y, z = (centre - pose[:3, 3]) @ pose[:3, :3]
        row, column = int(12 + result.focal * y / z), int(12 - result.focal * x / z)
        assert rgba[row, column, 0] > 2 * rgba[row, column, 1]  # the red ball is where it was put
        distance = float(np.linalg.norm(centre - pose[:3, 3]))
        assert depth[row, column] == pytest.approx(distance - change["scale"], abs=0.02)
        assert normal[row, column] @ (pose[:3, 3] - centre) / distance > 0.95
    other = read_view_set(rendered(EXAMPLES / "my_scene.py", tmp_path, capsys))
    assert other.test.rgba[0][..., 3].max() == 1
    border = np.concatenate([other.test.rgba[0][0, :, 3], other.test.rgba[0][:, 0, 3]])
    assert border.max() == 0


DARK = BALL.replace('type="constant"/>', 'type="constant"><rgb name="radiance" value="0"/></emitter>')
TEXTURE = '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="no.png"/>'
ROUGH: dict[str, tuple[str, str]] = {
    "dark.xml": (DARK, "every view is black"),
    "texture.xml": (
        BALL.replace('<bsdf type="diffuse"/>', f"{TEXTURE}</texture></bsdf>"),
        "Mitsuba cannot load.*no.png",
    ),
    "plugin.xml": (BALL.replace('"sphere"', '"klein-bottle"'), "Mitsuba cannot load.*klein-bottle"),
    "glowing.xml": (BALL.replace('<bsdf type="diffuse"/>', '<emitter type="area"/>'), "no shape that is seen"),
    "huge.xml": (BALL.replace('<bsdf type="diffuse"/>', '<float name="radius" value="1e6"/>'), "Mitsuba's ray epsilon"),
    "hidden.xml": (BALL.replace('"diffuse"', '"null"'), "nothing is seen"),
    "type.py": (
        "from scenes.modelling.scene import Scene\nSCENE = Scene('a', 'b', lambda: {'x': {'type': 'klein-bottle'}})",
        "klein-bottle",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ROUGH)
def test_what_mitsuba_refuses_is_one_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text, message = ROUGH[name]
    file = written(tmp_path, text, name)
    assert render(file, tmp_path / "cache", "--resolution", "8", "--test", "0") == 2
    err = capfd.readouterr().err.strip()
    assert re.search(message, err), err
    assert str(file) in err
    assert "\n" not in err
    assert list((tmp_path / "cache").iterdir()) == []
