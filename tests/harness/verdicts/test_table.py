"""Tables of results: every form gives the same numbers, rows of views their means, an ambiguous table one line."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.verdicts.tables.result_table import MOST_CELLS, ResultTable, read_table
from scenes.files.errors import InputError

ROWS: list[dict[str, Any]] = [
    {"scene": scene, "method": method, "seed": seed, "psnr": 20.0 + 3 * a + b + 0.1 * seed, "lpips": 0.1}
    | {"seconds": 7.5, "train_core_seconds": 12.5}
    for a, scene in enumerate(("lego", "ship", "mic"))
    for b, method in enumerate(("ours", "theirs"))
    for seed in (0, 1)
]


def read(folder: Path, name: str, text: str, metric: str | None = None) -> ResultTable:
    (folder / name).write_text(text, encoding="utf-8")
    return read_table([folder / name], metric)


def as_csv(path: Path, rows: list[dict[str, Any]] = ROWS, mark: str = ",") -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], delimiter=mark)
        writer.writeheader()
        writer.writerows(rows)
    return path


def as_json(path: Path, data: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(data))
    return path


def as_parquet(path: Path) -> Path:
    arrow = pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    from pyarrow import parquet

    parquet.write_table(arrow.Table.from_pylist(ROWS), path)
    return path


WRITERS = {
    "commas": lambda folder: as_csv(folder / "t.csv"),
    "semicolons": lambda folder: as_csv(folder / "t.csv", mark=";"),
    "capitals": lambda folder: as_csv(folder / "t.txt", [{key.upper(): row[key] for key in row} for row in ROWS]),
    "rows": lambda folder: as_json(folder / "t.json", ROWS),
    "columns": lambda folder: as_json(folder / "t.json", {"scenes": 3, "cells": ROWS, "methods": ["ours", "theirs"]}),
    "parquet": lambda folder: as_parquet(folder / "t.parquet"),
}


@pytest.mark.parametrize("form", WRITERS)
def test_every_form_gives_the_same_numbers(form: str, tmp_path: Path) -> None:
    table = read_table([WRITERS[form](tmp_path)])
    assert (table.methods, table.scenes, table.seeds) == (["ours", "theirs"], ["lego", "ship", "mic"], ["0", "1"])
    assert table.values.tolist() == [
        [[20.0 + 3 * a + b + 0.1 * seed for seed in (0, 1)] for a in range(3)] for b in range(2)
    ]
    assert (table.metric, table.higher_is_better) == ("psnr", True)
    assert (table.seconds, table.core_seconds, table.steps) == ([7.5, 7.5], [12.5, 12.5], [None, None])
    assert table.other_metrics == ["lpips"]


def result_file(method: str, scene: str, psnr: float) -> dict[str, Any]:
    """Return a result file as nerfbaselines writes it; the scores by view in `metrics_raw` are not read."""
    where = {"id": "blender", "scene": scene}
    return {
        "nb_info": {"method": method, "total_train_time": 344.5, "dataset_metadata": where},
        "render_dataset_metadata": where,
        "metrics": {"psnr": psnr, "ssim": 0.98, "lpips": 0.008},
        "metrics_raw": {"psnr": "2rohQuUxIUI="},
        "metrics_sha256": "63",
    }


def test_result_files_of_nerfbaselines_are_read_as_they_are(tmp_path: Path) -> None:
    scores = {("a", "lego"): 30.0, ("a", "mic"): 31.0, ("b", "lego"): 32.0, ("b", "mic"): 33.0}
    for (method, scene), psnr in scores.items():
        as_json(tmp_path / "now" / method / "blender" / f"{scene}.json", result_file(method, scene, psnr))
        old = {"info": {"dataset_scene": scene, "total_train_time": 344.5}, "metrics": {"psnr": psnr}}
        as_json(tmp_path / "old" / method / "blender" / f"{scene}.json", old)
    methods = [
        {"id": m, "name": m.upper(), "scenes": {s: {"id": s, "psnr": v, "total_train_time": 344.5, "link": {}}
                                                for (n, s), v in scores.items() if n == m}} for m in "ab"
    ]  # fmt: skip
    metrics = [{"id": "psnr", "ascending": True}, {"id": "odd", "ascending": False}]
    whole = as_json(tmp_path / "whole.json", {"id": "blender", "metrics": metrics, "methods": methods})
    for paths in ([tmp_path / "now"], [tmp_path / "old"], sorted((tmp_path / "now").glob("*/blender")), [whole]):
        table = read_table(paths)
        assert (table.methods, table.scenes, table.seeds) == (["a", "b"], ["lego", "mic"], [""])
        assert table.values[..., 0].tolist() == [[30.0, 31.0], [32.0, 33.0]]
        assert table.seconds == [344.5, 344.5]


def test_which_way_is_better(tmp_path: Path) -> None:
    def direction(metric: str, **options: Any) -> ResultTable:
        rows = [{**row, metric: row["psnr"] / 100} for row in ROWS]
        return read_table([as_csv(tmp_path / "t.csv", rows)], metric, **options)

    for metric in ("lpips", "lpips_vgg", "FLIP", "depth_rmse", "delta_e"):
        assert not direction(metric).higher_is_better
    assert direction("ssim").higher_is_better
    assert any("--lower beauty" in note for note in direction("beauty").notes)
    declared = direction("beauty", lower=["Beauty"])
    assert not declared.higher_is_better
    assert not any("--lower" in note for note in declared.notes)
    for column, option in (("SSIM", "ssim"), ("beauty ↑", "Beauty"), ("lpips", "psnr")):
        text = as_csv(tmp_path / "t.csv", [{**row, column: 0.5} for row in ROWS])
        with pytest.raises(InputError, match=f"--lower {option}: is better when higher .*; drop it, or rename it"):
            read_table([text], column.strip(" ↑"), lower=[option])
    as_csv(tmp_path / "up.csv", [{**row, "beauty ↑": 1} for row in ROWS])
    as_csv(tmp_path / "down.csv", [{**row, "seed": row["seed"] + 2, "beauty ↓": 1} for row in ROWS])
    with pytest.raises(InputError, match=r"marks beauty as ↑ and as ↓; correct one of the arrows"):
        read_table([tmp_path / "up.csv", tmp_path / "down.csv"], "beauty")


BAD = {
    "scene,method,psnr\na,x,1\na,y,2\nb,x,3\na,x,4\nb,y,1\n": "line 5: repeats scene and method of {}, line 2; give",
    "scene,method,seed,psnr\na,x,0,1\na,x,0,1\n": "line 3: repeats scene, method and seed of {}, line 2; delete one",
    "scene,method,psnr\na,x,nan\na,y,2\n": "line 2: psnr is 'nan', not a finite number within ±1e+12; leave the field",
    "scene,method,psnr\na,x,2\na,y,-1e308\n": "line 3: psnr is '-1e308'",
    "scene,method,psnr\na,x,1\na,y,2\n": "has 1 scene with results",
    "scene,method,psnr\na,x,1\nb,x,2\n": "has 1 method with results; a comparison needs two",
    "scene,method,psnr\na,x,1\nb,y,\n": "has 1 method with results",
    "scene,method,psnr\na,x,1\nb,,2\n": "line 3: has no method",
    "scene,method,psnr\na,x,1\nb,y\n": "line 3: has 2 fields, the header has 3",
    "scene,method,psnr\n\na,x,1\n": "line 2: is empty; delete it",
    "scene,method,PSNR,psnr\na,x,1,1\n": "two columns are called 'psnr'",
    "scene,psnr\na,1\n": "has no column method (columns: scene, psnr)",
    "scene,method,psnr\n": "has a header and no rows",
    "scene,method,comment\na,x,good\na,y,bad\n": "has no column of numbers",
    "": "is empty; give a table with a header and rows",
    '[{"scene": "a", "method": "x", "psnr": NaN}]': "; write null for a missing result",
    '[{"scene": "a", "method": "x", "psnr": true}]': "row 1: psnr is True",
    '[{"scene": "a", "method": "x", "psnr": 1, "psnr": 2}]': "'psnr' is given twice; keep one",
    '{"odd": 3}': "holds no rows; JSON must be",
}


@pytest.mark.parametrize("text", BAD)
def test_what_cannot_be_judged_is_refused_in_a_line(text: str, tmp_path: Path) -> None:
    name = "t.json" if text.startswith(("[", "{")) else "t.csv"
    with pytest.raises(InputError) as refused:
        read(tmp_path, name, text)
    assert BAD[text].format(tmp_path / name) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("column", "value"), [("seconds", "5m30s"), ("core_seconds", "1:05"), ("steps", "9k")])
def test_a_time_in_words_is_left_out_with_a_note_and_stops_no_verdict(column: str, value: str, tmp_path: Path) -> None:
    table = read_table([as_csv(tmp_path / "t.csv", [{"scene": "a", **row, column: value} for row in ROWS])])
    assert (table.metric, getattr(table, column)) == ("psnr", [None, None])
    assert any(note.startswith(f"Left out: {tmp_path}/t.csv, line 2: {column} is {value!r}, ") for note in table.notes)


def test_parquet_that_cannot_be_read_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"t\.parquet: "):
        read(tmp_path, "t.parquet", "scene")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"install the extra parquet of .*, or save the table as CSV"):
        read_table([tmp_path / "t.parquet"])


def test_many_rows_are_read_and_too_many_cells_refused(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(30, 1, (20, 25, 10)).round(3)
    lines = [f"m{i},s{j},{k},{v}" for (i, j, k), v in np.ndenumerate(values)]
    assert np.array_equal(read(tmp_path, "t.csv", "\n".join(["method,scene,seed,psnr", *lines])).values, values)
    side = int(MOST_CELLS ** (1 / 2) / 10)
    large = "method,scene,seed,psnr\n" + "".join(f"m{i % 150},s{i},{i},1\n" for i in range(side))
    with pytest.raises(InputError, match=f"150 × {side} × {side} methods, scenes and seeds are more than"):
        read(tmp_path, "t.csv", large)
    with pytest.raises(InputError, match="201 methods are more than the 200 that are compared"):
        read(tmp_path, "t.csv", "method,scene,psnr\n" + "".join(f"m{i},s,1\n" for i in range(201)))


# a row per view


def of_views(folder: Path, rows: list[str]) -> ResultTable:
    return read(folder, "views.csv", "\n".join(["scene,method,image,psnr", *rows, ""]))


def rows(change: dict[str, str] | None = None) -> list[str]:
    """Return the scores 10 · scene + method + view / 10 of 3 views, 2 methods and 2 scenes."""
    every = {f"s{s},m{m},r_{v}": f"{10 * s + m + v / 10}" for s in (2, 3) for m in (0, 1) for v in range(3)}
    return [f"{cell},{score}" for cell, score in (every | (change or {})).items() if score != "gone"]


def test_a_cell_is_the_mean_over_its_views(tmp_path: Path) -> None:
    table = of_views(tmp_path, rows())
    np.testing.assert_allclose(table.values[..., 0], [[20.1, 30.1], [21.1, 31.1]])
    assert any("means over the views" in note for note in table.notes)
    assert table.origins == ["views 3", "views 3"]


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
        of_views(tmp_path, rows(change))


def test_the_files_of_methods_are_named_where_there_are_several(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("scene,method,psnr,source,width\ns1,m0,1,paper,800\ns2,m0,2,paper,800\n")
    (tmp_path / "b.csv").write_text("scene,method,psnr,width\ns1,m1,1,800\ns2,m1,2,800\n")
    table = read_table([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert (table.notes, table.origins) == ([], ["a.csv; paper; width 800", "b.csv; width 800"])


def test_a_method_of_two_files_and_methods_without_any_result_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("scene,method,seed,psnr\ns1,m0,0,1\ns2,m0,0,2\ns1,m1,0,1\ns2,m1,0,3\n")
    (tmp_path / "b.csv").write_text("scene,method,seed,psnr\ns1,m0,7,1\ns2,m0,7,2\ns1,c,0,\ns1,d,0,-\n")
    assert set(read_table([tmp_path / "a.csv", tmp_path / "b.csv"]).notes) == {
        f"m0: the results in {tmp_path / 'a.csv'} and {tmp_path / 'b.csv'} are taken as those of one method.",
        "Without any result, left out: c, d.",
    }


def test_a_column_of_that_name_with_one_row_per_cell_says_something_else(tmp_path: Path) -> None:
    table = of_views(tmp_path, [f"s{s},m{m},renders/{s}{m}.png,{s + m}" for s in (1, 2) for m in (0, 1)])
    assert table.values[..., 0].tolist() == [[1.0, 2.0], [2.0, 3.0]]
    assert table.origins == ["", ""]
