"""The files that an XML scene depends on, by Mitsuba's rules; reading always ends."""

from pathlib import Path

import pytest

from scenes.catalog.mitsuba_xml import xml_scene
from scenes.files.errors import InputError

BALL = '<shape type="sphere"/><emitter type="constant"/>'
OBJ = '<shape type="obj"><string name="filename" value="{}"/></shape>'


def written(folder: Path, files: dict[str, str]) -> Path:
    """`top.xml` and others; contents of XML files stand inside <scene>."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f'<scene version="3.0.0">{text}</scene>' if name.endswith(".xml") else text)
    return folder / "top.xml"


def files_of(file: Path) -> set[str]:
    return set(xml_scene(file, "mine").build()["file"]["files"])


@pytest.mark.parametrize(
    ("files", "depends"),
    [
        # Mitsuba searches the folder of the outermost file, also for names in an included file
        ({"top.xml": BALL + '<include filename="sub/a.xml"/>', "sub/a.xml": OBJ.format("m.obj"), "m.obj": "1"},
         {"sub/a.xml", "m.obj"}),
        ({"top.xml": BALL + '<include filename="sub/b.xml"/>', "sub/b.xml": '<include filename="c.xml"/>',
          "sub/c.xml": "", "c.xml": ""}, {"sub/b.xml", "sub/c.xml", "c.xml"}),
        ({"top.xml": BALL + OBJ.format("m.obj") + '<path value="sub"/>', "sub/m.obj": "1"}, {"sub/m.obj"}),
        ({"top.xml": BALL + '<spectrum name="x" filename="s.spd"/>', "s.spd": "1"}, {"s.spd"}),
        ({"top.xml": BALL + '<spectrum name="x" value="s.spd"/>', "s.spd": "1"}, {"s.spd"}),
        ({"top.xml": '<default name="a" value="1"/><default name="ab" value="m"/>' + BALL + OBJ.format("$ab.obj"),
          "m.obj": "1", "1b.obj": "2"}, {"m.obj"}),
        # two files of one name
        ({"top.xml": BALL + '<include filename="sub/top.xml"/>', "sub/top.xml": ""}, {"sub/top.xml"}),
    ],
)  # fmt: skip
def test_images_depend_on_all_that_mitsuba_reads(tmp_path: Path, files: dict[str, str], depends: set[str]) -> None:
    file = written(tmp_path / "here", files)
    assert files_of(file) == {"top.xml", *depends}
    there = xml_scene(written(tmp_path / "there", files), "mine").build()
    assert there == xml_scene(file, "mine").build()  # wherever the folder lies
    for name in ("top.xml", *depends):
        before = xml_scene(file, "mine").build()
        written(tmp_path / "here", {name: files[name] + " "})
        assert xml_scene(file, "mine").build() != before


def test_includes_that_double_are_read_once_and_too_many_are_refused(tmp_path: Path) -> None:
    def chain(levels: int, times: int) -> Path:
        files = {f"{i}.xml": f'<include filename="{i + 1}.xml"/>' * times for i in range(levels)}
        top = {"top.xml": BALL + '<include filename="0.xml"/>'}
        return written(tmp_path, {**top, **files, f"{levels}.xml": ""})

    assert len(files_of(chain(7, 2))) == 9
    for levels, times, message in ((13, 2, "more than 1000 files"), (16, 1, "15 levels deep")):
        with pytest.raises(InputError, match=message):
            files_of(chain(levels, times))


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"top.xml": BALL + '<include filename="top.xml"/>'}, "top.xml includes top.xml"),
        ({"top.xml": BALL + '<include filename="a.xml"/>', "a.xml": '<include filename="top.xml"/>'}, "a.xml includes"),
        ({"top.xml": BALL + '<bsdf type="twosided" id="a"><ref id="a"/><ref id="a"/></bsdf>'}, "'a' holds itself"),
        ({"top.xml": BALL + '<bsdf type="twosided" id="a"><ref id="b"/></bsdf><bsdf type="twosided" id="b">'
          '<ref id="a"/></bsdf>'}, "holds itself"),
        ({"top.xml": BALL + '<include filename="a.xml"/>', "a.xml": "<"}, "top.xml: includes .*a.xml: not well"),
    ],
)  # fmt: skip
def test_circles_and_bad_includes_are_refused_by_name(tmp_path: Path, files: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        files_of(written(tmp_path, files))


@pytest.mark.parametrize(("value", "depth"), [("²", 8), ("12", 12), ("999999999999", 64), ("-1", 8), ("1", 2)])
def test_the_depth_of_light_paths(tmp_path: Path, value: str, depth: int) -> None:
    text = BALL + f'<integrator type="path"><integer name="max_depth" value="{value}"/></integrator>'
    assert xml_scene(written(tmp_path, {"top.xml": text}), "mine").max_depth == depth


@pytest.mark.parametrize("version", ["0.5.0", "0.6.0", "1.0"])
def test_names_before_mitsuba_2_are_those_of_today(tmp_path: Path, version: str) -> None:
    fog = '<medium type="homogeneous"><rgb name="sigmaT" value="1 2 3"/><float name="intIOR" value="1.5"/></medium>'
    path = '<default name="maxDepth" value="3"/><integrator><integer name="maxDepth" value="$maxDepth"/></integrator>'
    file = written(tmp_path, {"top.xml": BALL + fog + path})
    file.write_text(file.read_text().replace("3.0.0", version))
    scene = xml_scene(file, "mine")
    assert scene.max_depth == 3
    assert scene.build()["file"]["part 2"] == {"type": "homogeneous", "sigma_t": [1.0, 2.0, 3.0], "int_ior": 1.5}


@pytest.mark.parametrize(
    ("transform", "up"),
    [
        ('<lookat origin="0 0 5" target="0 0 0" up="0, 1, 0"/>', (0, 1, 0)),
        # as Bitterli's scenes: camera to world, row by row
        ('<matrix value="-1 0 0 0 0 1 0 1 0 0 -1 6.8 0 0 0 1"/>', (0, 1, 0)),
        ('<matrix value="1 0 0 0 0 -1 0 1 0"/>', (0, 0, 1)),
        ('<rotate x="1" angle="90"/><translate z="3"/>', (0, 0, 1)),
        ('<rotate value="0 0 2" angle="-90"/>', (1, 0, 0)),
        ('<scale value="2"/><matrix value="0 1 0 0 0 1 1 0 0"/><rotate z="1" angle="90"/>', (0, 1, 0)),
        ("", (0, 0, 1)),
    ],
)
def test_up_is_that_of_the_first_sensor(transform: str, up: tuple[float, ...], tmp_path: Path) -> None:
    sensor = f'<sensor type="perspective"><transform name="to_world">{transform}</transform></sensor>'
    scene = xml_scene(written(tmp_path, {"top.xml": BALL + sensor}), "mine")
    assert scene.build()["file"]["up"] == pytest.approx(up, abs=1e-12)


def test_a_document_type_is_refused_in_any_encoding(tmp_path: Path) -> None:
    text = '<?xml version="1.0"?><!DOCTYPE scene [<!ENTITY a "b">]><scene version="3.0.0"></scene>'
    for encoding in ("utf-8", "utf-16"):
        (tmp_path / "top.xml").write_text(text, encoding=encoding)
        with pytest.raises(InputError, match="declares a document type"):
            xml_scene(tmp_path / "top.xml", "mine")
