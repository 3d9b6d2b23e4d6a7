"""Tables as papers and programs print them give the same numbers; what is no result is left out and named."""

import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.verdicts.judging.judgement import judge
from harness.verdicts.judging.printed import as_csv, as_latex, as_markdown
from harness.verdicts.tables.files import read_rows
from harness.verdicts.tables.result_table import read_table
from scenes.files.errors import InputError
from tests.harness.verdicts.test_table import as_json, read

WIDE = """\
Method,garden,bicycle,room,stump,Avg.
Ours,27.31,25.02,31.98,26.71,27.76
3DGS,27.41,25.25,30.63,26.55,27.46
Mip-NeRF 360,26.98,24.37,31.63,26.40,27.35
"""
(_, *SCENES, _), *ROWS = (line.split(",") for line in WIDE.splitlines())
METHODS = [row[0] for row in ROWS]
VALUES = np.array([row[1:-1] for row in ROWS], dtype=float)
TURNED = "\n".join(map(",".join, zip(["scene", *SCENES, "mean"], *ROWS, strict=True)))
LONG = "Dataset,Model,PSNR ↑\n" + "\n".join(
    f"{scene},{row[0]},{value}" for row in ROWS for scene, value in zip([*SCENES, "average"], row[1:], strict=True)
)
JSON_ROWS = [
    {"scene": scene, "method": row[0], "psnr": float(value)}
    for row in ROWS
    for scene, value in zip(SCENES, row[1:-1], strict=True)
]
MARKDOWN = """\
# PSNR by scene

| Method | garden | bicycle | room | stump | *Mean* |
|:--|--:|--:|--:|--:|--:|
| Ours | 27.31 dB | 25.02 | **31.98** | **26.71** | 27.76 |
| 3DGS | **27.41** ± 0.3 | **25.25** | 30.63 | 26.55 | 27.46 |
| Mip-NeRF 360 | 26.98 ± 0.3 | 24.37 | 31.63 | 26.40 | 27.35 |

Table 3.
"""
LATEX = r"""
\begin{table}\caption{Novel views \textbf{per scene}.}
\begin{tabular}{@{}l*{8}{c}@{}}
\toprule
& \multicolumn{2}{c}{garden} & \multicolumn{2}{c}{bicycle} & \multicolumn{2}{c}{room} & \multicolumn{2}{c}{stump}
\\ \cmidrule(lr){2-3} \cmidrule(lr){4-5}
Method & PSNR$\uparrow$ & LPIPS $\downarrow$ & PSNR$\uparrow$ & LPIPS $\downarrow$
& PSNR$\uparrow$ & LPIPS $\downarrow$ & PSNR$\uparrow$ & LPIPS $\downarrow$ \\ \midrule % the rows
Ours & \cellcolor{red!25}\textbf{27.31} & 0.1 & $25.02 \pm 0.1$ & 0.11 & $31.98 \pm 0.1$ & 0.12 & 26.71 & 0.13 \\
3DGS & \cellcolor{red!25}\textbf{27.41} & 0.1 & $25.25 \pm 0.1$ & 0.11 & $30.63 \pm 0.1$ & 0.12 & 26.55 & 0.13 \\
Mip-NeRF 360 & 26.98 & 0.1 & $24.37 \pm 0.1$ & 0.11 & $31.63 \pm 0.1$ & 0.12 & 26.40 & 0.13 \\
\bottomrule
\end{tabular}\end{table}
"""
FORMS: dict[str, tuple[str, str]] = {
    "wide": ("psnr.csv", WIDE),
    "wide, tabs": ("t.tsv", WIDE.replace(",", "\t")),
    "wide, decimal commas": ("t.csv", WIDE.replace(",", ";").replace("Avg.", "Avg").replace(".", ",")),
    "wide, metric in the corner": ("t.csv", WIDE.replace("Method", "PSNR ↑ (dB)")),
    "turned": ("t.csv", TURNED),
    "long": ("t.csv", LONG),
    "long, decimal commas": ("t.csv", LONG.replace(",", ";").replace(".", ",")),
    "long, a mean without its name": ("t.csv", LONG.replace("average", "eight scenes")),
    "markdown": ("t.md", MARKDOWN),
    "markdown in a text": ("t.txt", MARKDOWN),
    "latex": ("t.tex", LATEX),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_printed_form_gives_the_same_table_and_judgement(form: str, tmp_path: Path) -> None:
    table = read(tmp_path, *FORMS[form])
    assert sorted(table.methods) == sorted(METHODS)
    assert sorted(table.scenes) == sorted(SCENES)
    rows, columns = [*map(table.methods.index, METHODS)], [*map(table.scenes.index, SCENES)]
    assert np.array_equal(table.values[rows][:, columns, 0], VALUES)
    assert (table.metric, table.higher_is_better) == ("psnr", True)
    assert table.read_as.startswith("Read as 3 methods × 4 scenes, psnr ↑")
    assert ("left out" in table.read_as) == (form != "latex")
    expected = judge(read(tmp_path, "expected.csv", WIDE), None, None)
    assert [pair.verdict for pair in judge(table, None, None).given.pairs] == [
        pair.verdict for pair in expected.given.pairs
    ]


def test_other_metrics_of_a_table_are_read_too(tmp_path: Path) -> None:
    table = read(tmp_path, "t.tex", LATEX, "lpips")
    assert not table.higher_is_better
    assert table.values[0, :, 0].tolist() == [0.1, 0.11, 0.12, 0.13]
    both = MARKDOWN + "\n\n" + MARKDOWN.replace("PSNR", "SSIM").replace(" dB", "").replace(" ± 0.3", "")
    two = read(tmp_path, "two.md", both)
    assert two.other_metrics == ["ssim"]
    spreads = read(tmp_path, "spread.md", MARKDOWN)
    assert any("Spreads behind ±" in note for note in spreads.notes)


def test_a_table_that_names_no_metric_holds_psnr_if_its_numbers_can_be_it(tmp_path: Path) -> None:
    text = WIDE.replace("27.31", "0.31")
    with pytest.raises(InputError, match="does not say which metric it holds"):
        read(tmp_path, "t.csv", text)
    assert read(tmp_path, "t.csv", text, "beauty").metric == "beauty"
    assert read(tmp_path, "rmse_table.csv", text).metric == "rmse"
    with pytest.raises(InputError, match="has the columns psnr, ssim and no scenes"):
        read(tmp_path, "t.csv", "Method,PSNR,SSIM\na,30,0.9\nb,31,0.8\n")
    years = [line.replace(",", ",2020," if k else ",Year,", 1) for k, line in enumerate(WIDE.splitlines())]
    table = read(tmp_path, "t.csv", "\n".join(years))
    assert sorted(table.scenes) == sorted(SCENES)
    assert "Left out, as neither results nor their means: Year." in table.notes


def test_missing_results_are_missing(tmp_path: Path) -> None:
    for word in ("-", "–", "N/A", "OOM", "", "x"):
        table = read(tmp_path, "t.csv", WIDE.replace("25.25", word))
        assert np.isnan(table.values).sum() == 1


def gaussian_splatting(method: str, scene: str, psnr: float) -> dict[str, Any]:
    scores = {"SSIM": 0.9, "PSNR": psnr, "LPIPS": 0.1}
    by_view = {name: {"00000.png": score, "00001.png": score} for name, score in scores.items()}
    contents = {"results": {"ours_30000": scores}, "per_view": {"ours_30000": by_view}, "cameras": []}
    return {f"{method}/{scene}/{name}.json": content for name, content in contents.items()}


def ns_eval(method: str, scene: str, psnr: float) -> dict[str, Any]:
    results = {"psnr": psnr, "psnr_std": 1.0, "ssim": 0.9, "fps": 3.0}
    content = {"experiment_name": scene, "method_name": method, "checkpoint": "x.ckpt", "results": results}
    return {f"{method}-{scene}.json": content}


def gsplat(method: str, scene: str, psnr: float) -> dict[str, Any]:
    return {f"{method}/{scene}/stats/val_step29999.json": {"psnr": psnr, "ssim": 0.9, "num_GS": 10}}


@pytest.mark.parametrize("written", [gaussian_splatting, ns_eval, gsplat])
def test_files_of_other_trainers_are_read_as_they_lie(
    written: Callable[[str, str, float], dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`written` maps each file of a method's scene to its content."""
    for method, add in (("ours", 0.5), ("theirs", 0.0)):
        for scene, value in zip(SCENES, VALUES[0], strict=True):
            for name, content in written(method, scene, value + add).items():
                as_json(tmp_path / name, content)
    as_json(tmp_path / ".hidden" / "results.json", {})
    (tmp_path / ".cache").mkdir()
    monkeypatch.chdir(tmp_path / ".cache")
    assert read_table([Path("..")]).methods == read_table([tmp_path]).methods
    table = read_table([tmp_path])
    assert (sorted(table.methods), sorted(table.scenes)) == (["ours", "theirs"], sorted(SCENES))
    ours, theirs = (table.values[table.methods.index(method), :, 0] for method in ("ours", "theirs"))
    assert ours - theirs == pytest.approx([0.5] * 4)
    if written is gaussian_splatting:
        # each folder a method, and the scores by view alone
        assert sorted(read_table([tmp_path / "ours", tmp_path / "theirs"]).methods) == ["ours", "theirs"]
        for file in [*tmp_path.rglob("results.json"), *tmp_path.rglob("cameras.json")]:
            file.unlink()
        assert np.array_equal(read_table([tmp_path]).values, table.values)


def test_names_that_differ_in_capitals_or_blanks_are_one_with_a_note(tmp_path: Path) -> None:
    text = "scene,method,psnr\na,NeRF,30\nA ,nerf ,31\nb,x,32\na,x,33\nb,nerf,34\n"
    with pytest.raises(InputError, match="line 3: repeats scene and method of"):
        read(tmp_path, "t.csv", text)
    table = read(tmp_path, "t.csv", text.replace("A ,", "c,"))
    assert (table.methods, table.scenes) == (["NeRF", "x"], ["a", "c", "b"])
    assert "Taken as one method: 'NeRF', 'nerf'." in table.notes


def with_seeds(ours: list[str], theirs: list[str]) -> str:
    rows = [
        f"s{scene},{method},{seed},{level + scene + 0.1 * place * (scene % 3 - 1)}"
        for method, level, seeds in (("ours", 31, ours), ("theirs", 30, theirs))
        for scene in range(6)
        for place, seed in enumerate(seeds)
    ]
    return "\n".join(["scene,method,seed,psnr", *rows])


def test_seeds_are_numbers_and_methods_with_other_seeds_are_compared_by_their_means(tmp_path: Path) -> None:
    result = judge(read(tmp_path, "t.csv", with_seeds(["0", "1", "2"], ["42", "43", "44"])), None, None)
    (pair,) = result.given.pairs
    assert (pair.scenes, pair.verdict.phrase) == (6, "above 0, matters")
    assert pair.on_these_scenes is None
    assert any("their means over seeds are compared" in note for note in result.notes)
    same = read(tmp_path, "t.csv", with_seeds(["0", "1", "2"], ["0", "1.0", "2.0"]))
    assert same.seeds == ["0", "1", "2"]
    assert judge(same, None, None).given.pairs[0].on_these_scenes
    large = read(tmp_path, "t.csv", with_seeds(["20260001", "20260002"], ["42"]))
    assert {"20260001", "20260002"} <= set(large.seeds)


def test_scores_of_one_scene_at_two_widths_are_refused(tmp_path: Path) -> None:
    def row(scene: str, method: str, width: int) -> dict[str, object]:
        return {"scene": scene, "method": method, "psnr": 30.0, "views": [{}], "made": {"width": width}}

    rows = [row(scene, method, 48) for scene in "ab" for method in ("ours", "theirs")]
    assert read(tmp_path, "scores.json", json.dumps({"cells": rows})).methods == ["ours", "theirs"]
    with pytest.raises(InputError, match=r"row 4: width of b is 24, and 48 in .*row 3: such scores cannot be compared"):
        read(tmp_path, "scores.json", json.dumps({"cells": [*rows[:3], row("b", "theirs", 24)]}))


def test_only_the_methods_that_are_asked_for_are_judged_together(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(WIDE)
    table = read_table([tmp_path / "t.csv"], methods=["3DGS", "Ours"])
    assert table.methods == ["3DGS", "Ours"]
    assert judge(table, None, None).given.family == 1
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


@pytest.mark.parametrize("text", [WIDE, json.dumps(JSON_ROWS)])
def test_a_pipe_of_the_shell_is_read_as_a_file(text: str, tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "63")
    with ThreadPoolExecutor(1) as writer:
        writer.submit(pipe.write_text, text)
        assert set(read_table([pipe]).methods) == set(METHODS)
