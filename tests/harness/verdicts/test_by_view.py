"""Tables with a row per view: means over views, the same views for all, and where a score comes from."""

from pathlib import Path

import numpy as np
import pytest

from harness.verdicts.tables.result_table import read_table
from scenes.files.errors import InputError


def table(folder: Path, rows: list[str], header: str = "scene,method,image,psnr") -> Path:
    path = folder / "views.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def rows(change: dict[str, str] | None = None) -> list[str]:
    """Return the scores 10 · scene + method + view / 10 of 3 views, 2 methods and 2 scenes."""
    every = {f"s{s},m{m},r_{v}": f"{10 * s + m + v / 10}" for s in (2, 3) for m in (0, 1) for v in range(3)}
    return [f"{cell},{score}" for cell, score in (every | (change or {})).items() if score != "gone"]


def test_a_cell_is_the_mean_over_its_views(tmp_path: Path) -> None:
    read = read_table([table(tmp_path, rows())])
    np.testing.assert_allclose(read.values[..., 0], [[20.1, 30.1], [21.1, 31.1]])
    assert any("means over the views" in note for note in read.notes)
    assert read.origins == ["views 3", "views 3"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"s2,m1,r_1": "gone"}, "line 5: image r_1 of s2 is in this cell or in that of .*line 2, not both"),
        ({"s2,m1,r_9": "20"}, "image r_9 of s2"),
        ({"s3,m1,r_2": ""}, "line 13: psnr of this view is missing"),
        ({"s3,m1,r_2,1\ns3,m1,r_2": "1"}, "line 14: repeats image r_2 of .*line 13"),
    ],
)
def test_cells_of_different_views_are_refused(change: dict[str, str], why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=why):
        read_table([table(tmp_path, rows(change))])


def test_the_files_of_methods_are_named_where_there_are_several(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("scene,method,psnr,source,width\ns1,m0,1,paper,800\ns2,m0,2,paper,800\n")
    (tmp_path / "b.csv").write_text("scene,method,psnr,width\ns1,m1,1,800\ns2,m1,2,800\n")
    assert not read_table([tmp_path / "a.csv", tmp_path / "b.csv"]).notes
    assert read_table([tmp_path / "a.csv", tmp_path / "b.csv"]).origins == [
        "a.csv; paper; width 800",
        "b.csv; width 800",
    ]


def test_a_method_of_two_files_on_one_scene_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("scene,method,seed,psnr\ns1,m0,0,1\ns2,m0,0,2\ns1,m1,0,1\ns2,m1,0,3\n")
    (tmp_path / "b.csv").write_text("scene,method,seed,psnr\ns1,m0,7,1\ns2,m0,7,2\n")
    (note,) = read_table([tmp_path / "a.csv", tmp_path / "b.csv"]).notes
    assert note == f"m0: the results in {tmp_path / 'a.csv'} and {tmp_path / 'b.csv'} are taken as those of one method."


def test_methods_without_any_result_are_named_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("scene,method,psnr\n" + "".join(f"s{s},{m},{s}\n" for s in (1, 2) for m in "ab"))
    (tmp_path / "b.csv").write_text("scene,method,psnr\ns1,c,\ns1,d,-\n")
    assert read_table([tmp_path / "a.csv", tmp_path / "b.csv"]).notes == ["Without any result, left out: c, d."]


def test_a_column_of_that_name_with_one_row_per_cell_says_something_else(tmp_path: Path) -> None:
    path = table(tmp_path, [f"s{s},m{m},renders/{s}{m}.png,{s + m}" for s in (1, 2) for m in (0, 1)])
    read = read_table([path])
    assert read.values[..., 0].tolist() == [[1.0, 2.0], [2.0, 3.0]]
    assert read.origins == ["", ""]
