"""Tables as papers and programs print them give the same numbers; what is no result is left out and named."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.verdicts.judging.judgement import judge
from harness.verdicts.judging.printed import as_csv, as_latex, as_markdown
from harness.verdicts.tables.files import read_rows
from harness.verdicts.tables.numbers import number, plain
from harness.verdicts.tables.result_table import ResultTable, read_table
from scenes.files.errors import InputError

METHODS, SCENES = ["Ours", "3DGS", "Mip-NeRF 360"], ["garden", "bicycle", "room", "stump"]
VALUES = np.array([[27.31, 25.02, 31.98, 26.71], [27.41, 25.25, 30.63, 26.55], [26.98, 24.37, 31.63, 26.40]])
MEANS = VALUES.mean(axis=1)


def wide(mark: str = ",", decimal: str = ".", corner: str = "Method", mean: str = "Avg.") -> str:
    rows = [[corner, *SCENES, mean]]
    rows += [
        [method, *(f"{value:.2f}".replace(".", decimal) for value in (*row, row.mean()))]
        for method, row in zip(METHODS, VALUES, strict=True)
    ]
    return "\n".join(mark.join(row) for row in rows) + "\n"


def turned() -> str:
    rows = [["scene", *METHODS]]
    rows += [[scene, *(f"{value:.2f}" for value in row)] for scene, row in zip(SCENES, VALUES.T, strict=True)]
    return "\n".join(",".join(row) for row in [*rows, ["mean", *(f"{mean:.2f}" for mean in MEANS)]])


def long(mark: str = ",", decimal: str = ".", average: str = "average") -> str:
    rows = [["Dataset", "Model", "PSNR ↑"]]
    for method, row in zip(METHODS, VALUES, strict=True):
        named = zip([*SCENES, average], [*row, row.mean()], strict=True)
        rows += [[scene, method, f"{value:.2f}".replace(".", decimal)] for scene, value in named]
    return "\n".join(mark.join(row) for row in rows)


def markdown() -> str:
    lines = ["# PSNR by scene", "", f"| Method | {' | '.join(SCENES)} | *Mean* |", "|:--|" + "--:|" * 5]
    for k, (method, row) in enumerate(zip(METHODS, VALUES, strict=True)):
        cells = [f"**{value:.2f}**" if value == VALUES[:, j].max() else f"{value:.2f}" for j, value in enumerate(row)]
        cells[0] += " ± 0.3" if k else " dB"
        lines.append(f"| [{method}] | {' | '.join(cells)} | {row.mean():.2f} |".replace("[", "").replace("]", ""))
    return "\n".join([*lines, "", "Table 3."])


def latex() -> str:
    """Two rows of headers, spans, rules, bold and coloured cells, spreads, a comment, a second metric."""
    head = " & ".join(rf"\multicolumn{{2}}{{c}}{{{scene}}}" for scene in SCENES)
    under = " & ".join([r"PSNR$\uparrow$ & LPIPS $\downarrow$"] * len(SCENES))
    lines = [r"\begin{table}\caption{Novel views \textbf{per scene}.}", r"\begin{tabular}{@{}l*{8}{c}@{}}", r"\toprule"]
    lines += [rf"& {head} \\ \cmidrule(lr){{2-3}} \cmidrule(lr){{4-5}}", rf"Method & {under} \\ \midrule % the rows"]
    for method, row in zip(METHODS, VALUES, strict=True):
        first = rf"\cellcolor{{red!25}}\textbf{{{row[0]:.2f}}} & 0.1"
        rest = [rf"${value:.2f} \pm 0.1$ & {0.1 + 0.01 * k:.3f}" for k, value in enumerate(row[1:], 1)]
        lines.append(rf"{method} & {' & '.join([first, *rest])} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}\end{table}"])


FORMS: dict[str, tuple[str, str]] = {
    "wide": ("psnr.csv", wide()),
    "wide, tabs": ("t.tsv", wide("\t")),
    "wide, decimal commas": ("t.csv", wide(";", ",")),
    "wide, metric in the corner": ("t.csv", wide(corner="PSNR ↑ (dB)")),
    "turned": ("t.csv", turned()),
    "long": ("t.csv", long()),
    "long, decimal commas": ("t.csv", long(";", ",")),
    "long, a mean without its name": ("t.csv", long(average="eight scenes")),
    "markdown": ("t.md", markdown()),
    "markdown in a text": ("t.txt", markdown()),
    "latex": ("t.tex", latex()),
}


def read(folder: Path, name: str, text: str, metric: str | None = None) -> ResultTable:
    (folder / name).write_text(text, encoding="utf-8")
    return read_table([folder / name], metric)


@pytest.mark.parametrize("form", FORMS)
def test_every_printed_form_gives_the_same_table_and_judgement(form: str, tmp_path: Path) -> None:
    table = read(tmp_path, *FORMS[form])
    assert sorted(table.methods) == sorted(METHODS)
    assert sorted(table.scenes) == sorted(SCENES)
    rows, columns = map(table.methods.index, METHODS), list(map(table.scenes.index, SCENES))
    assert np.array_equal(table.values[list(rows)][:, columns, 0], VALUES)
    assert (table.metric, table.higher_is_better) == ("psnr", True)
    assert table.read_as.startswith("Read as 3 methods × 4 scenes, psnr ↑")
    assert ("left out" in table.read_as) == (form != "latex")
    expected = judge(read(tmp_path, "expected.csv", wide()), None, None, {})
    assert [pair.verdict for pair in judge(table, None, None, {}).given.pairs] == [
        pair.verdict for pair in expected.given.pairs
    ]


def test_other_metrics_of_a_table_are_read_too(tmp_path: Path) -> None:
    table = read(tmp_path, "t.tex", latex(), "lpips")
    assert not table.higher_is_better
    assert table.values[0, :, 0].tolist() == [0.1, 0.11, 0.12, 0.13]
    both = markdown() + "\n\n" + markdown().replace("PSNR", "SSIM").replace(" dB", "").replace(" ± 0.3", "")
    two = read(tmp_path, "two.md", both)
    assert two.other_metrics == ["ssim"]
    spreads = read(tmp_path, "spread.md", markdown())
    assert any("Spreads behind ±" in note for note in spreads.notes)


def test_a_table_that_names_no_metric_holds_psnr_if_its_numbers_can_be_it(tmp_path: Path) -> None:
    text = wide().replace("27.31", "0.31")
    with pytest.raises(InputError, match="does not say which metric it holds"):
        read(tmp_path, "t.csv", text)
    assert read(tmp_path, "t.csv", text, "beauty").metric == "beauty"
    assert read(tmp_path, "rmse_table.csv", text).metric == "rmse"
    with pytest.raises(InputError, match="has the columns psnr, ssim and no scenes"):
        read(tmp_path, "t.csv", "Method,PSNR,SSIM\na,30,0.9\nb,31,0.8\n")
    years = "Method,Year," + wide().split(",", 1)[1].replace("Ours", "Ours,2025")
    lines = [line.replace(",", ",2020,", 1) if k else line for k, line in enumerate(wide().splitlines())]
    lines[0] = years.splitlines()[0]
    table = read(tmp_path, "t.csv", "\n".join(lines))
    assert sorted(table.scenes) == sorted(SCENES)
    assert "Columns left out, which are no scenes: Year." in table.notes


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("31.2", 31.2), ("31,2", 31.2), ("−0.5", -0.5), ("31.2 dB", 31.2), ("31.2 ± 0.3", 31.2), ("31.2 (0.3)", 31.2),
        (r"\textbf{31.2}", 31.2), (r"\underline{\textbf{31.2}}", 31.2), (r"\cellcolor{red!20}31.2", 31.2),
        ("$31.2_{}$", None), (r"$31.2 \pm 0.3$", 31.2), ("**31.2**", 31.2), ("<b>31.2</b>", 31.2), ("31.2†", 31.2),
        ("1e-3", 1e-3), ("nan", None), ("inf", None), ("1.234,5", None), ("26.3 cm", None), ("9k", None), ("", None),
    ],
)  # fmt: skip
def test_cells_of_printed_tables(cell: str, value: float | None) -> None:
    assert number(plain(cell)) == value


def test_missing_results_are_missing_and_nan_is_refused(tmp_path: Path) -> None:
    for word in ("-", "–", "N/A", "OOM", "", "x"):
        table = read(tmp_path, "t.csv", wide().replace("25.25", word))
        assert np.isnan(table.values).sum() == 1
    with pytest.raises(InputError, match="psnr is 'nan', not a finite number"):
        read(tmp_path, "t.csv", wide().replace("25.25", "nan"), "psnr")


def gaussian_splatting(folder: Path, method: str, add: float) -> None:
    for scene, value in zip(SCENES, VALUES[0], strict=True):
        place = folder / method / scene
        place.mkdir(parents=True)
        scores = {"SSIM": 0.9, "PSNR": value + add, "LPIPS": 0.1}
        (place / "results.json").write_text(json.dumps({"ours_30000": scores}))
        by_view = {name: {"00000.png": score, "00001.png": score} for name, score in scores.items()}
        (place / "per_view.json").write_text(json.dumps({"ours_30000": by_view}))
        (place / "cameras.json").write_text("[]")


def ns_eval(folder: Path, method: str, add: float) -> None:
    for scene, value in zip(SCENES, VALUES[0], strict=True):
        results = {"psnr": value + add, "psnr_std": 1.0, "ssim": 0.9, "fps": 3.0}
        content = {"experiment_name": scene, "method_name": method, "checkpoint": "x.ckpt", "results": results}
        (folder / f"{method}-{scene}.json").write_text(json.dumps(content))


def gsplat(folder: Path, method: str, add: float) -> None:
    for scene, value in zip(SCENES, VALUES[0], strict=True):
        place = folder / method / scene / "stats"
        place.mkdir(parents=True)
        (place / "val_step29999.json").write_text(json.dumps({"psnr": value + add, "ssim": 0.9, "num_GS": 10}))


@pytest.mark.parametrize("write", [gaussian_splatting, ns_eval, gsplat])
def test_files_of_other_trainers_are_read_as_they_lie(
    write: Callable[[Path, str, float], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for method, add in (("ours", 0.5), ("theirs", 0.0)):
        write(tmp_path, method, add)
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "results.json").write_text("{}")
    (tmp_path / ".cache").mkdir()
    monkeypatch.chdir(tmp_path / ".cache")
    assert read_table([Path("..")]).methods == read_table([tmp_path]).methods
    table = read_table([tmp_path])
    assert (sorted(table.methods), sorted(table.scenes)) == (["ours", "theirs"], sorted(SCENES))
    ours, theirs = (table.values[table.methods.index(method), :, 0] for method in ("ours", "theirs"))
    assert ours - theirs == pytest.approx([0.5] * 4)
    if write is gaussian_splatting:
        # each folder a method, and the scores by view alone
        assert sorted(read_table([tmp_path / "ours", tmp_path / "theirs"]).methods) == ["ours", "theirs"]
        for file in tmp_path.rglob("results.json"):
            file.unlink()
        for file in tmp_path.rglob("cameras.json"):
            file.unlink()
        assert np.array_equal(read_table([tmp_path]).values, table.values)


def test_names_that_differ_in_capitals_or_blanks_are_one_with_a_note(tmp_path: Path) -> None:
    text = "scene,method,psnr\na,NeRF,30\nA ,nerf ,31\nb,x,32\na,x,33\nb,nerf,34\n"
    with pytest.raises(InputError, match="line 3: repeats scene and method of"):
        read(tmp_path, "t.csv", text)
    table = read(tmp_path, "t.csv", text.replace("A ,", "c,"))
    assert (table.methods, table.scenes) == (["NeRF", "x"], ["a", "c", "b"])
    assert "Taken as one method: 'NeRF', 'nerf ', 'nerf'." in table.notes


def test_seeds_are_numbers_and_methods_with_other_seeds_are_compared_by_their_means(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    rows = ["scene,method,seed,psnr"]
    for scene in range(6):
        for seed in range(3):
            rows.append(f"s{scene},ours,{seed},{31 + scene + random.normal(0, 0.1)}")
            rows.append(f"s{scene},theirs,{42 + seed},{30 + scene + random.normal(0, 0.1)}")
    table = read(tmp_path, "t.csv", "\n".join(rows))
    result = judge(table, None, None, {})
    (pair,) = result.given.pairs
    assert (pair.scenes, pair.verdict.phrase) == (6, "above 0, matters")
    assert pair.on_these_scenes is None
    assert any("their means over seeds are compared" in note for note in result.notes)
    mixed = [row.replace("theirs,42", "theirs,0").replace("theirs,43", "theirs,1.0") for row in rows]
    same = read(tmp_path, "t.csv", "\n".join(row.replace("theirs,44", "theirs,2.0") for row in mixed))
    assert same.seeds == ["0", "1", "2"]
    large = [row.replace(",0,", ",20260001,").replace(",1,", ",20260002,") for row in rows]
    assert {"20260001", "20260002"} <= set(read(tmp_path, "t.csv", "\n".join(large)).seeds)
    assert judge(same, None, None, {}).given.pairs[0].on_these_scenes


def test_scores_of_one_scene_at_two_widths_are_refused(tmp_path: Path) -> None:
    def row(scene: str, method: str, width: int) -> dict[str, object]:
        return {"scene": scene, "method": method, "psnr": 30.0, "views": [{}], "made": {"width": width}}

    rows = [row(scene, method, 48) for scene in "ab" for method in ("ours", "theirs")]
    file = tmp_path / "scores.json"
    file.write_text(json.dumps({"cells": rows}))
    assert read_table([file]).methods == ["ours", "theirs"]
    file.write_text(json.dumps({"cells": [*rows[:3], row("b", "theirs", 24)]}))
    with pytest.raises(InputError, match=r"row 4: width of b is 24, and 48 in .*row 3: such scores cannot be compared"):
        read_table([file])


def test_only_the_methods_that_are_asked_for_are_judged_together(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(wide())
    table = read_table([tmp_path / "t.csv"], methods=["3DGS", "Ours"])
    assert table.methods == ["3DGS", "Ours"]
    assert judge(table, None, None, {}).given.family == 1
    assert read_table([tmp_path / "t.csv"], methods=["3DGS", "Ours", "3DGS"]).methods == table.methods
    with pytest.raises(InputError, match="--methods NeRF: no such method; methods of the table: Ours, 3DGS"):
        read_table([tmp_path / "t.csv"], methods=["NeRF", "Ours"])


def test_the_judgement_is_printed_for_papers() -> None:
    rows = [("method", "mean", "minus"), ("a_b|c & d", "30.1", "−0.5 [−1, 0] 5 %")]
    assert as_markdown(rows).splitlines()[2] == "| a_b\\|c & d | 30.1 | −0.5 [−1, 0] 5 % |"
    assert r"a\_b|c \& d & 30.1 & $-$0.5 [$-$1, 0] 5 \% \\" in as_latex(rows).splitlines()
    assert as_csv(rows).splitlines()[0] == "method,mean,minus"


def test_lpips_of_two_networks_are_two_metrics(tmp_path: Path) -> None:
    cells = [
        {"scene": scene, "method": method, "psnr": 1.0, "lpips": value, "made": {"width": 40, "lpips_network": network}}
        for scene in ("a", "b")
        for method, network, value in (("x", "alex", 0.1), ("y", "vgg", 0.2))
    ]
    (tmp_path / "scores.json").write_text(json.dumps({"cells": cells}))
    columns = read_rows([tmp_path / "scores.json"]).columns
    assert (columns["lpips"], columns["lpips_vgg"]) == ([0.1, None, 0.1, None], [None, 0.2, None, 0.2])
