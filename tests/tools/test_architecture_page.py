"""docs/architecture.md: its picture shows the present rooms and arrows, its table names each room, its paths exist."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.harness.shell import ROOT
from tests.test_architecture import FLOORS
from tools.architecture_picture import PICTURE, House, house_drawn, house_of, picture_of

HOW_TO = ["architecture", "add-a-method", "add-a-scene", "add-a-metric"]
REMEDY = "python -m tools.architecture_picture"


def out_of_date(picture: str, house: House) -> Iterator[str]:
    """Yield what a picture shows wrongly; sizes and counts may be older."""
    drawn = house_drawn(picture)
    if list(drawn.rooms) != list(house.rooms):
        yield f"rooms: {sorted(set(drawn.rooms) ^ set(house.rooms))} or their order"
        return
    yield from (f"{start} → {end}: not drawn" for start, end in house.arrows.keys() - drawn.arrows.keys())
    yield from (f"{start} → {end}: drawn, not imported" for start, end in drawn.arrows.keys() - house.arrows.keys())
    if picture != picture_of(drawn):
        yield "it is not what the generator draws of the numbers on it"


def test_the_picture_shows_the_rooms_and_arrows_of_today() -> None:
    assert list(out_of_date(PICTURE.read_text(encoding="utf-8"), house_of(ROOT))) == [], REMEDY


@pytest.mark.parametrize(
    ("pattern", "by", "complaint"),
    [
        (r'<g data-from="harness.plan" data-to="baselines".*\n', "", "harness.plan → baselines: not drawn"),
        (
            'data-to="scenes.rendering"',
            'data-to="harness.gate"',
            "harness.training → harness.gate: drawn, not imported",
        ),
        (r'<g data-room="harness.plan".*\n', "", "rooms: ['harness.plan'] or their order"),
        ('data-imports="[0-9]+"', 'data-imports="999"', "it is not what the generator draws of the numbers on it"),
    ],
)
def test_a_changed_picture_is_complained_about(pattern: str, by: str, complaint: str) -> None:
    picture = PICTURE.read_text(encoding="utf-8")
    changed = re.sub(pattern, by, picture)
    assert changed != picture
    assert complaint in list(out_of_date(changed, house_drawn(picture)))


def test_another_import_makes_the_picture_out_of_date_and_another_line_does_not(tmp_path: Path) -> None:
    plan, files = tmp_path / "harness" / "plan" / "a.py", tmp_path / "scenes" / "files" / "b.py"
    for file in (plan, files):
        file.parent.mkdir(parents=True)
        file.write_text("one = 1\n")
    before = picture_of(house_of(tmp_path))
    assert list(out_of_date(before, house_of(tmp_path))) == []
    plan.write_text("one = 1\n" * 400)
    assert house_of(tmp_path).rooms["harness.plan"] == 400
    assert list(out_of_date(before, house_of(tmp_path))) == []
    plan.write_text("import scenes.files.b\n")
    assert list(out_of_date(before, house_of(tmp_path))) == ["harness.plan → scenes.files: not drawn"]


def test_the_table_has_a_row_for_each_room_in_the_order_of_the_floors() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w/]+)/` \|", text, re.M)
    assert rows == [room.replace(".", "/") for room in FLOORS if not room.endswith("__main__")]


@pytest.mark.parametrize("name", HOW_TO)
def test_the_files_that_a_page_names_exist(name: str) -> None:
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    paths = re.findall(r"`((?:harness|reports|scenes|baselines|tests|docs|gates)/[\w./-]*)`", text)
    assert paths
    assert [path for path in paths if not (ROOT / path).exists()] == []
