"""Tables in the shapes in which people have them: the same scores are read from all; what is no result is left out."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from harness.verdicts.judging.judgement import judge
from harness.verdicts.tables.numbers import number, plain
from harness.verdicts.tables.result_table import ResultTable, read_table
from scenes.files.errors import InputError
from tests.harness.verdicts.test_table import as_json, read

SCENES = ("bicycle", "garden", "stump", "room", "counter", "kitchen")
METHODS = ("3DGS", "Mip-NeRF 360", "Ours")
PSNR = np.array(
    [
        [25.16, 27.5, 26.63, 31.53, 29.74, 30.43],
        [25.43, 27.86, 27.12, 32.09, 29.68, 30.23],
        [25.71, 28.25, 26.99, 32.07, 29.88, 30.72],
    ]
)
LPIPS = np.round(0.9 - PSNR / 40, 3)
Row = tuple[str, Sequence[object]]


def rows(scores: np.ndarray = PSNR) -> list[Row]:
    return [(name, values.tolist()) for name, values in zip(METHODS, scores, strict=True)]


def turned(scores: np.ndarray = PSNR) -> list[Row]:
    return [(name, values.tolist()) for name, values in zip(SCENES, scores.T, strict=True)]


def csv(*lines: Row, mark: str = ",") -> str:
    return "\n".join(mark.join(map(str, [name, *cells])) for name, cells in lines) + "\n"


def markdown(head: Row, *lines: Row) -> str:
    width = len(head[1]) + 1
    return f"| {csv(head, mark=' | ').strip()} |\n|{'---|' * width}\n" + "".join(
        f"| {csv(line, mark=' | ').strip()} |\n" for line in lines
    )


def latex(*lines: str, columns: str = "l*{9}{c}", kind: str = "tabular") -> str:
    return f"\\begin{{{kind}}}{{{columns}}}\n\\toprule\n" + " \\\\\n".join(lines) + f" \\\\\n\\end{{{kind}}}\n"


def amp(name: str, cells: Sequence[object]) -> str:
    return " & ".join(map(str, [name, *cells]))


def tidy(metrics: dict[str, np.ndarray]) -> list[tuple[str, str, str, float]]:
    return [
        (scene, method, metric, float(scores[row, column]))
        for row, method in enumerate(METHODS)
        for column, scene in enumerate(SCENES)
        for metric, scores in metrics.items()
    ]


def wrapped(before: str, after: str) -> list[str]:
    return [amp(name, [f"{before}{value}{after}" for value in values]) for name, values in rows()]


BOTH, ONE = {"PSNR": PSNR, "LPIPS": LPIPS}, tidy({"PSNR": PSNR})
SPLIT = [(s, [m, split, v]) for s, m, _, v in ONE for split in ("a", "b")]
INDEXED = [(str(k), [name, *values]) for k, (name, values) in enumerate(rows(), 1)]
TIMES = [(name, [*values, place, 700]) for place, (name, values) in enumerate(rows(), 20)]
MEANS = [(name, [*values, np.mean(values[:3]).round(2), np.mean(values).round(2)]) for name, values in rows()]
PAIRS = [(name, np.stack([PSNR[k], LPIPS[k]], 1).ravel().tolist()) for k, name in enumerate(METHODS)]
BY_SCENE = [(scene, np.stack([PSNR[:, k], LPIPS[:, k]], 1).ravel().tolist()) for k, scene in enumerate(SCENES)]
SHAPES: dict[str, tuple[str, str]] = {
    "an index of pandas": ("t.csv", csv(("", ["method", *SCENES]), *INDEXED)),
    "ranks first": ("t.md", markdown(("#", ["Method", *SCENES]), *INDEXED)),
    "turned, plural": ("t.md", markdown(("Scenes", METHODS), *turned(), ("Average", PSNR.mean(1).round(2).tolist()))),
    "turned, known scenes": ("t.csv", csv(("", METHODS), *turned())),
    "turned, both names": ("t.csv", csv((r"Scene \ Method", METHODS), *turned())),
    "turned, metric in the corner": ("t.csv", csv(("Scene (PSNR ↑)", METHODS), *turned())),
    "turned, two headers": (
        "t.tex",
        latex(r"Scene & " + " & ".join(rf"\multicolumn{{2}}{{c}}{{{name}}}" for name in METHODS),
              amp("", [r"PSNR$\uparrow$", r"LPIPS$\downarrow$"] * 3), *(amp(*line) for line in BY_SCENE)),
    ),
    "merged headers of a spreadsheet": (
        "t.csv",
        csv(("", [name for scene in SCENES for name in (scene, "")]), ("Method", ["PSNR", "LPIPS"] * 6), *PAIRS)),
    "scene and metric in a name": (
        "t.csv", csv(("method", [f"{scene}_{name}" for scene in SCENES for name in ("psnr", "lpips")]), *PAIRS)),
    "a metric per row": (
        "t.csv", csv(("method", ["metric", *SCENES]), *(
            line for k, name in enumerate(METHODS)
            for line in ((name, ["PSNR ↑", *PSNR[k]]), ("", ["LPIPS ↓", *LPIPS[k]]))))),
    "metric and value": (
        "t.csv", csv(("scene", ["method", "metric", "value"]), *((row[0], row[1:]) for row in tidy(BOTH)))),
    "value, named by the file": (
        "psnr.csv", csv(("scene", ["method", "value"]), *((s, [m, v]) for s, m, _, v in ONE))),
    "time first, spreads": ("t.csv", csv(("scene", ["method", "time", "psnr_mean", "psnr_std"]),
                                        *((s, [m, 20, v, 0.1]) for s, m, _, v in ONE))),
    "pivot of pandas": (
        "t.csv", csv(("", ["psnr"] * 6), ("scene", SCENES), ("method", [""] * 6), *rows())),
    "LaTeX of pandas": ("t.tex", latex(amp("scene", SCENES), amp("method", [""] * 6), *(amp(*row) for row in rows()))),
    "names over rows": (
        "t.tex", latex(amp("", ["", "PSNR"]), *(
            amp(rf"\multirow{{3}}{{*}}{{{scene}}}" if k == 0 else "", [name, PSNR[k, j]])
            for j, scene in enumerate(SCENES) for k, name in enumerate(METHODS)))),
    "groups of methods": ("t.md", markdown(("Method", SCENES), ("*Explicit*", [""] * 6), *rows())),
    "blocks of metrics": ("t.md", markdown(("Method", SCENES), ("PSNR ↑", [""] * 6), *rows(), ("Method", SCENES), (
        "LPIPS ↓ (VGG)", [""] * 6), *rows(LPIPS))),
    "blocks of metrics, each with a header": ("t.tex", latex(r"\multicolumn{7}{c}{LPIPS}", amp("Method", SCENES), *(
        amp(*row) for row in rows(LPIPS)), r"\multicolumn{7}{c}{PSNR (dB)}", amp("Method", SCENES), *(
        amp(*row) for row in rows()))),
    "blocks of metrics, named beside": ("t.tex", latex(amp("", SCENES), r"& \multicolumn{6}{c}{PSNR}", *(
        amp(*row) for row in rows()), r"& \multicolumn{6}{c}{LPIPS}", *(amp(*row) for row in rows(LPIPS)))),
    "category": ("t.csv", csv(("Category", ["Method", *SCENES]), *(("explicit", [n, *v]) for n, v in rows()))),
    "data sets": ("psnr.csv", csv(("Dataset", ["Scene", *METHODS]), *(("m360", [s, *v]) for s, v in turned()))),
    "networks": ("t.csv", csv(("", ["Base", *SCENES]), *((n, ["MLP", *v]) for n, v in rows()))),
    "test views behind training views": (
        "t.csv", csv(("scene", ["method", "train_psnr", "test_psnr"]), *((s, [m, 40, v]) for s, m, _, v in ONE))),
    "times and sizes": ("t.md", markdown(("Method", [*SCENES, "Time (min)", "Size (MB)"]), *TIMES)),
    "means of some": ("t.csv", csv(("Method", [*SCENES, "Outdoor avg", "Ø"]), *MEANS)),
    "differences": (
        "psnr.csv", csv(("Method", SCENES), *rows(), ("Δ (Ours − 3DGS)", (PSNR[2] - PSNR[0]).round(2).tolist()))),
    "mean of methods": ("t.csv", csv(("Method", SCENES), *rows(), ("Mean", PSNR.mean(0).round(2).tolist()))),
    "units below": ("t.csv", csv(("Method", SCENES), ("", ["(dB)"] * 6), *rows())),
    "title above": ("t.csv", "PSNR of our methods,,,,,,\n\n" + csv(("Method", SCENES), *rows())),
    "empty columns and rows": (
        "t.csv", csv(("Method", [*SCENES, "", ""]), *((n, [*v, "", ""]) for n, v in rows())) + ",,,,,,,,\n"),
    "Excel's mark": ("t.csv", "sep=;\n" + csv(("Method", SCENES), *rows(), mark=";")),
    "bold in CSV": ("t.csv", csv(("Method", SCENES), *((n, [f"**{v[0]}**", *v[1:]]) for n, v in rows()))),
    "long table": ("t.tex", latex(amp("Method", SCENES), *(amp(*row) for row in rows()), kind="longtable")),
    "row ends with stars and skips": ("t.tex", latex(amp("Method", SCENES), *(amp(*row) for row in rows()))
                                      .replace("\\\\", r"\\*[2pt]% a rule", 3)),
    "row ends by name": ("t.tex", latex(amp("Method", SCENES), *(amp(*row) for row in rows())).replace(
        "\\\\", r"\tabularnewline")),
    "cells of several lines": ("t.tex", latex(amp(r"\begin{tabular}[c]{@{}l@{}}\\Method\end{tabular}", SCENES), *(
        amp(*row) for row in rows())).replace("360", r"\begin{tabular}[c]{@{}c@{}}\\ 360\end{tabular}")),
    "NiceTabular": ("t.tex", latex(amp("Method", [r"\Block{1-1}{" + scene + "}" for scene in SCENES]), *(
        amp(*row) for row in rows()), kind="NiceTabular").replace("}}\n", "}}[hvlines]\n", 1)),
    "lowered spreads": ("t.tex", latex(amp("Method", SCENES), *wrapped("$", r"_{\pm 0.12}$"))),
    "raised marks": ("t.tex", latex(amp("Method", SCENES), *wrapped("", r"$^{1}$"))),
    "boxes": ("t.tex", latex(amp("Method", SCENES), *wrapped(r"\colorbox{red!30}{", "}"))),
    "rules with arguments": ("t.tex", latex(r"\Xhline{1pt} Method & " + " & ".join(SCENES), *(
        r"\addlinespace[2pt] \cdashline{1-7} " + amp(*row) for row in rows()))),
    "several scores in a cell": (
        "t.md", "PSNR / LPIPS\n\n" + markdown(("Method", SCENES), *(
            (name, [f"{p} / {q}" for p, q in zip(PSNR[k], LPIPS[k], strict=True)]) for k, name in enumerate(METHODS)))),
    "two tables with means": (
        "t.md", "PSNR\n\n" + markdown(("Method", [*SCENES[:3], "Avg"]), *((n, [*v[:3], 27]) for n, v in rows()))
        + "\nPSNR, indoor\n\n" + markdown(("Method", [*SCENES[3:], "Avg"]), *((n, [*v[3:], 30]) for n, v in rows()))),
    "times in another table": (
        "t.md", "PSNR\n\n" + markdown(("Method", SCENES), *rows())
        + "\nTraining time in minutes\n\n" + markdown(("Method", SCENES), *((n, [20] * 6) for n, _ in rows()))),
    "names in capitals in another table": (
        "t.md", "PSNR\n\n" + markdown(("Method", SCENES), *rows())
        + "\nLPIPS\n\n" + markdown(("Method", [name.title() for name in SCENES]), *rows(LPIPS))),
    "captions of two tables": (
        "t.tex", "".join(
            r"\begin{table}" + latex(amp("Method", SCENES), *(amp(*row) for row in rows(scores)))
            + rf"\caption{{{name} per scene.}}\end{{table}}" for name, scores in (("LPIPS", LPIPS), ("PSNR", PSNR)))),
    "wide records": ("t.json", json.dumps([{"method": n, **dict(zip(SCENES, v, strict=True))} for n, v in rows()])),
    "arrows in records": ("t.json", json.dumps([
        {"scene": s, "method": m, "LPIPS ↓": 0.1, "PSNR ↑": v} for s, m, _, v in ONE])),
    "split data frame": ("t.json", json.dumps({"columns": SCENES, "index": METHODS, "data": PSNR.tolist()})),
    "methods of scenes": ("psnr.json", json.dumps({n: dict(zip(SCENES, v, strict=True)) for n, v in rows()})),
    "methods of scenes of metrics": (
        "t.json", json.dumps({n: {s: {"psnr": x} for s, x in zip(SCENES, v, strict=True)} for n, v in rows()})),
    "lines of JSON": ("t.jsonl", "\n".join(
        json.dumps({"scene": s, "method": m, "psnr": v}) for s, m, _, v in ONE)),
}  # fmt: skip


NAMES = (
    "DiffusioNeRF", "Mean-Teacher NeRF", "Mean Teacher", "Ours (S)", "3DGS 7k steps", "Time-aware GS", "PSNR-opt",
    "2DGS", "Delta-GS", "Average-NeRF", "seed-GS", "w/o mean loss", "Best-NeRF", "Zip-NeRF*", "Ours†",
)  # fmt: skip
PLACES = ("mean_street", "time_square", "gain_hill", "scene_01", "train", "truck", "kitchen_2", "memory lane")


def require_psnr(table: ResultTable, seeds: int = 1) -> None:
    assert table.values.shape[2] == seeds
    assert (table.metric, table.higher_is_better) == ("psnr", True)
    assert (sorted(table.methods), sorted(table.scenes)) == (sorted(METHODS), sorted(SCENES))
    found = [[np.nanmean(table.values[table.methods.index(m), table.scenes.index(s)]) for s in SCENES] for m in METHODS]
    assert np.array_equal(found, PSNR)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_same_scores_are_read_from_every_shape(shape: str, tmp_path: Path) -> None:
    require_psnr(read(tmp_path, *SHAPES[shape]))


@pytest.mark.parametrize("is_turned", [False, True])
def test_names_are_names_whatever_words_they_hold(is_turned: bool, tmp_path: Path) -> None:
    scores = np.round(25 + np.random.default_rng(0).normal(size=(len(NAMES), len(PLACES))), 2)
    heads, labels, values = (NAMES, PLACES, scores.T) if is_turned else (PLACES, NAMES, scores)
    lines = [(label, row.tolist()) for label, row in zip(labels, values, strict=True)]
    for write in (csv, markdown):
        table = read(
            tmp_path, "t.md" if write is markdown else "t.csv", write(("scene" if is_turned else "", heads), *lines)
        )
        assert (sorted(table.methods), sorted(table.scenes)) == (sorted(NAMES), sorted(PLACES))
    suffixed = csv(
        ("method", [f"{place}_psnr" for place in PLACES]),
        *((n, v.tolist()) for n, v in zip(NAMES, scores, strict=True)),
    )
    assert read(tmp_path, "t.csv", suffixed).scenes == list(PLACES)


@pytest.mark.parametrize(
    "row",
    [
        "Std",
        "Rank",
        "Time (s)",
        "FPS",
        "Gain",
        "#views",
        "Median",
        "Max",
        "p-value",
        "Avg. PSNR",
        "Δ",
        "Tr. time",
        "CR",
        "GFLOPs",
        "Rend. FPS",
        "Num. GS",
        "Compression ratio",
    ],
)
def test_rows_and_columns_of_statistics_are_left_out_and_named(row: str, tmp_path: Path) -> None:
    below = csv(("Method", SCENES), *rows(), (row, [1.5] * 6))
    beside = csv(("Method", [*SCENES, row]), *((name, [*values, 20]) for name, values in rows()))
    for name, text in (("psnr.csv", below), ("psnr.csv", beside), ("t.csv", below)):
        table = read(tmp_path, name, text)
        require_psnr(table)
        assert any(row.rstrip(".") in said for said in (*table.notes, table.read_as))


@pytest.mark.parametrize(
    ("heading", "metric", "higher"),
    [("CD ↓", "cd", False), ("NIQE ↓ (lower is better)", "niqe", False), ("1 - LPIPS ↑", "1 - lpips", True)],
)
def test_an_arrow_decides_which_way_is_better(heading: str, metric: str, higher: bool, tmp_path: Path) -> None:
    table = read(tmp_path, "t.csv", csv((heading, SCENES), *rows()))
    assert (table.metric.startswith(metric), table.higher_is_better) == (True, higher)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (csv(("bicycle", SCENES[1:]), *((str(v[0]), v[1:]) for _, v in rows())), "has no column of names"),
        (csv(("PSNR ↓", SCENES), *rows()), "marks psnr as ↓, the wrong way"),
        (csv(("", SCENES), *rows()).replace("25.16", "#DIV/0!"), "line 2: '#DIV/0!' is not a number"),
        (csv(("", ["7K", "30K"] * 3), *rows()), "line 2: a second psnr of 3DGS on 7K"),
        (csv(("Standard deviation of PSNR", SCENES), *rows()), "holds a time or a size"),
        (csv(("Training time (min) ↓", SCENES), *((n, [20] * 6) for n, _ in rows())),
         "holds a time or a size, and no scores"),
        (csv(("Step", [f"3DGS-{scene} - psnr" for scene in SCENES]), ("1000", PSNR[0]), ("2000", PSNR[1])),
         "has a row per Step"),
        (csv(("scene", ["method", "psnr"]), *((s, [f"{m}-{s}", v]) for s, m, _, v in ONE)),
         "no two methods have two scenes in common"),
        # metrics in rows keep the other columns
        (csv(("scene", ["method", "width", "metric", "value"]),
             *((s, [m, 400 if m == "3DGS" else 800, k, v]) for s, m, k, v in tidy(BOTH))),
         r"width of bicycle is 800, and 400 in"),
        (csv(("scene", ["method", "iteration", "psnr"]), *SPLIT),
         r"they differ in iteration \(a, b\): keep the rows of one"),
    ],
)  # fmt: skip
def test_what_would_be_read_wrongly_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, "t.csv", text)


def test_seeds_are_read_from_names_columns_and_rows(tmp_path: Path) -> None:
    of_methods = [(f"{name} (seed {seed})", values) for name, values in rows() for seed in (0, 1)]
    of_scenes = [f"{scene}_seed{seed}" for scene in SCENES for seed in (0, 1)]
    twice = [(name, [value for value in values for _ in range(2)]) for name, values in rows()]
    for text in (csv(("Method", SCENES), *of_methods), csv(("Method", of_scenes), *twice)):
        require_psnr(read(tmp_path, "psnr.csv", text), seeds=2)
    in_rows = csv(("method", ["seed", *SCENES]), *((n, [seed, *v]) for n, v in rows() for seed in (42, 43)))
    require_psnr(read(tmp_path, "t.csv", in_rows), seeds=2)


@pytest.mark.parametrize(
    ("names", "seeds"),
    [
        (["psnr_seed0", "psnr_seed7"], ["0", "7"]), (["PSNR_1", "PSNR_2"], ["1", "2"]),
        (["test PSNR (0) ↑", "test PSNR (1) ↑"], ["0", "1"]), (["psnr", "psnr_1"], [""]), (["psnr_5", "psnr"], [""]),
    ],
)  # fmt: skip
def test_columns_of_seeds_are_one_metric(names: list[str], seeds: list[str], tmp_path: Path) -> None:
    text = csv(("scene", ["method", *names, "ssim"]), *((s, [m, v, v, 0.5]) for s, m, _, v in ONE))
    records = json.dumps([{"scene": s, "method": m, **dict.fromkeys(names, v), "ssim": 0.5} for s, m, _, v in ONE])
    for table in (read(tmp_path, "t.csv", text), read(tmp_path, "t.json", records)):
        require_psnr(table, seeds=len(seeds))
        assert table.seeds == seeds
        assert any(note.startswith("A column is read as a seed") for note in table.notes) == (len(seeds) > 1)
    assert np.isfinite(read(tmp_path, "t.csv", text, "ssim").values).sum() == PSNR.size


def test_a_table_among_others_in_a_text_is_read_and_the_others_are_named(tmp_path: Path) -> None:
    settings = markdown(("Option", ["default"]), ("--lr", ["small"]), ("--bs", ["large"]))
    table = read(tmp_path, "README.md", f"{settings}\nPSNR\n\n{markdown(('Method', SCENES), *rows())}")
    require_psnr(table)
    assert any(note.startswith("Table of line 1 left out: ") for note in table.notes)


def test_rows_without_results_are_titles(tmp_path: Path) -> None:
    table = read(tmp_path, "t.md", markdown(("Method", SCENES), *rows(), ("Oldest", [""] * 6)))
    require_psnr(table)
    assert "Rows without results, taken as titles: Oldest." in table.notes


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "cp1252"])
def test_tables_of_spreadsheets_are_read(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(csv(("Méthode — method", SCENES), *rows()).encode(encoding))
    table = read_table([tmp_path / "t.csv"])
    require_psnr(table)
    assert any("Windows-1252" in note for note in table.notes) == (encoding == "cp1252")


@pytest.mark.parametrize("name", ["LPIPS", "1-SSIM", "ssim_error", "DSSIM"])
def test_a_metric_that_is_better_when_lower_is_known_by_its_name(name: str, tmp_path: Path) -> None:
    text = csv(("scene", ["method", name]), *((s, [m, v]) for s, m, _, v in tidy({name: LPIPS})))
    assert not read(tmp_path, "t.csv", text).higher_is_better
    prose = "Unlike PSNR and SSIM, perceptual metrics differ.\n\n## LPIPS ↓\n\n" + markdown(
        ("Method", SCENES), *rows(LPIPS)
    )
    assert read(tmp_path, "t.md", prose).metric == "lpips"
    title = markdown(("Method", SCENES), ("LPIPS ↓", [""] * 6), *rows(LPIPS))
    assert read(tmp_path, "t.md", title).metric == "lpips"
    figure = r"\begin{figure}\caption{PSNR over time.}\end{figure}\begin{table}\caption{LPIPS per scene.}"
    table = read(
        tmp_path, "t.tex", figure + latex(amp("", SCENES), *(amp(*row) for row in rows(LPIPS))) + r"\end{table}"
    )
    assert (table.metric, table.higher_is_better) == ("lpips", False)


def test_a_guess_of_psnr_is_stated(tmp_path: Path) -> None:
    assert any("No metric is named" in note for note in read(tmp_path, "t.csv", csv(("", SCENES), *rows())).notes)


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        ("31.2", 31.2), ("31,2", 31.2), ("−0.5", -0.5), ("31.2 dB", 31.2), ("31.2 ± 0.3", 31.2), ("31.2 (0.3)", 31.2),
        (r"\textbf{31.2}", 31.2), (r"\underline{\textbf{31.2}}", 31.2), (r"\cellcolor{red!20}31.2", 31.2),
        ("$31.2_{}$", 31.2), (r"$31.2 \pm 0.3$", 31.2), ("**31.2**", 31.2), ("<b>31.2</b>", 31.2), ("31.2†", 31.2),
        ("1e-3", 1e-3), ("nan", None), ("inf", None), ("1.234,5", None), ("26.3 cm", None), ("9k", None), ("", None),
        (r"\ding{55}", None), (r"\underline{27.1}$_2$", 27.1), ("27.1<sup>2</sup>", 27.1),
        ("1_0", None), (r"27.12\textsuperscript{1}", 27.12), (r"27.12$^\dagger$", 27.12), ("27.12²", 27.12),
        (r"$27.12_{1}$", 27.12), (r"27.12\textsubscript{2}", 27.12), (r"\ms{27.12}{3}", 27.12),
        (r"27.1{\tiny +0.4}", 27.1),
        (r"27.12 {\footnotesize 0.31}", 27.12), (r"$2.1\times 10^{-3}$", 0.0021), (r"\va", None),
        (r"$27.31_{\pm 0.12}$", 27.31), (r"27.31\std{.12}", 27.31), (r"\colorbox{red!30}{27.31}", 27.31),
        (r"\phantom{1}9.12", 9.12), (r"$\hphantom{-}9.12$", 9.12), (r"\phantom{\textbf{1}}{\bf 9.12}", 9.12),
        (r"\hspace*{2pt}{\bf 9.12}", 9.12), (r"\makebox[1em][r]{9.12}", 9.12), (r"\hskip 1em 9.12", 9.12),
        (r"\;9.12\!", 9.12), (r"33.5$_{\color{red}+0.5}$", 33.5), (r"\underline{33.5}$_{\textcolor{red}{+0.5}}$", 33.5),
        (r"33.5$^{\textcolor{red}{+0.5}}$", 33.5), (r"33.5{\tiny\textcolor{red}{+0.5}}", 33.5),
        ("27.12 ↑0.4", 27.12), ("27.12 [26.9, 27.7]", 27.12), ('<span style="color:red">25.71</span>', 25.71),
    ],
)  # fmt: skip
def test_marks_do_not_change_a_number(cell: str, value: float | None) -> None:
    assert number(plain(cell)) == value


@pytest.mark.parametrize(
    ("cell", "name"),
    [
        (r"Mip-NeRF 360$^\dagger$~\cite{barron2022}", "Mip-NeRF 360"), (r"\makecell[l]{Mip-NeRF\\360}", "Mip-NeRF 360"),
        ("[3DGS](https://example.org)", "3DGS"), (r"F$^2$-NeRF", "F2-NeRF"), (r"\rotatebox{90}{garden}", "garden"),
        (r"\rule{0pt}{2.5ex}Ours", "Ours"), (r"\diagbox{Scene}{Method}", "Scene / Method"), (r"\ours", "ours"),
        (r"\rowcolor[gray]{.9}[0pt][0pt] Ours", "Ours"), ("scene_01_psnr", "scene_01_psnr"), ("NeRF[^1]", "NeRF"),
        (r"\makecell{Mip\\*[2pt] 360}", "Mip 360"), (r"Mip-NeRF 360$_{large}$", "Mip-NeRF 360_large"),
    ],
)  # fmt: skip
def test_names_are_read_without_their_marks(cell: str, name: str) -> None:
    assert plain(cell) == name


def test_failed_runs_are_missing_and_counted(tmp_path: Path) -> None:
    table = read(tmp_path, "t.csv", csv(("", SCENES), *rows()).replace("25.16", "OOM").replace("28.25", "diverged"))
    assert np.isnan(table.values).sum() == 2
    assert "2 results are missing, as their runs gave none (OOM, diverged)." in table.notes


def test_commas_divide_thousands_where_no_number_has_another_use_for_them(tmp_path: Path) -> None:
    lines = [(scene, [method, '"30,000"', value]) for scene, method, _, value in ONE]
    assert read(tmp_path, "t.csv", csv(("scene", ["method", "steps", "psnr"]), *lines)).steps == [30_000.0] * 3


def test_a_scene_is_not_taken_for_a_mean_because_its_coarse_numbers_are_near_it(tmp_path: Path) -> None:
    ssim = np.array([[0.80, 0.75, 0.85, 0.7, 0.9], [0.81, 0.76, 0.86, 0.71, 0.91]])
    names = ["middle", "low", "high", "lower", "higher"]
    lines = [(name, values.tolist()) for name, values in zip("ab", ssim, strict=True)]
    assert read(tmp_path, "ssim.csv", csv(("Method", names), *lines)).scenes == names
    total = read(tmp_path, "t.csv", csv(("Method", [*SCENES[:5], "total"]), *rows()))
    assert "total" in total.scenes, "its values are no means"


def in_folders(path: Callable[[str, str], str], folder: Path) -> ResultTable:
    for name, values in rows():
        for scene, value in zip(SCENES, values, strict=True):
            as_json(folder / path(name, scene), {"PSNR": value, "SSIM": 0.9})
    as_json(folder / "dataparser_transforms.json", {"scale": 1.0})
    return read_table([folder])


@pytest.mark.parametrize(
    "path",
    [
        lambda method, scene: f"{method}/{scene}/results.json",
        lambda method, scene: f"{scene}/{method}/metrics.json",
        lambda method, scene: f"{method}/m360/{scene}/stats/val_step29999.json",
        lambda method, scene: f"{method}/{scene}/seed_1/metrics.json",
        lambda method, scene: f"{method}/{scene}.json",
    ],
)
def test_folders_name_methods_scenes_and_seeds(path: Callable[[str, str], str], tmp_path: Path) -> None:
    as_json(tmp_path / "3DGS" / "bicycle" / "stats" / "train_step29999_rank0.json", {"mem": 1.0})
    require_psnr(in_folders(path, tmp_path))


def test_results_at_several_steps_are_several_methods_and_a_file_may_hold_all_scenes(tmp_path: Path) -> None:
    for step in (6999, 29999):
        in_folders(lambda method, scene, at=step: f"{method}/{scene}/stats/val_step{at}.json", tmp_path / "steps")  # type: ignore[misc]
    assert "Ours step 6999" in read_table([tmp_path / "steps"]).methods
    for name, values in rows():
        as_json(tmp_path / "files" / f"{name}.json", {s: {"psnr": v} for s, v in zip(SCENES, values, strict=True)})
    require_psnr(read_table([tmp_path / "files"]))


def test_commas_are_decimal_marks_where_no_number_has_a_point(tmp_path: Path) -> None:
    text = markdown(
        ("FID", SCENES), *((name, [f"{value:.3f}".replace(".", ",") for value in values]) for name, values in rows())
    )
    assert read(tmp_path, "t.md", text).values[0, 0, 0] == 25.16


def test_data_sets_divide_scenes(tmp_path: Path) -> None:
    means = [(s, [m, data, 30]) for s, data in (("Avg.", "a"), ("Avg.", "b"), ("room", "mean")) for m in METHODS]
    table = read(tmp_path, "t.csv", csv(("scene", ["method", "dataset", "psnr"]), *SPLIT, *means))
    assert sorted(table.scenes) == sorted(f"{data}/{scene}" for data in "ab" for scene in SCENES)
    assert table.read_as.endswith("left out as means of the others: a/Avg., b/Avg., mean/room")


def test_a_missing_cell_does_not_hide_the_signs_of_pairs_that_have_all_scenes(tmp_path: Path) -> None:
    """No flip of five signs is rarer than 1 in 16; with Holm's procedure the other pairs keep theirs."""
    apart = PSNR + np.array([[0.0], [3.0], [6.0]])
    text = csv(("Method", SCENES), *rows(apart))
    complete, lacking = (
        judge(read(tmp_path, "psnr.csv", each), None, None) for each in (text, text.replace("25.16", ""))
    )
    assert all(pair.distinguished for result in (complete, lacking) for pair in result.given.pairs)


def test_means_of_data_sets_are_judged_with_a_caution(tmp_path: Path) -> None:
    names = ["Mip-NeRF 360", "Tanks & Temples", "Deep Blending", "NeRF-Synthetic", "LLFF avg.", "new"]
    notes = read(tmp_path, "psnr.csv", csv(("Method", names), *rows())).notes
    assert [note for note in notes if note.startswith("Means of data sets are taken for scenes")] == [
        f"Means of data sets are taken for scenes, but vary less: {', '.join(names[:5])}. Give results by scene."
    ]
    assert not any("data sets" in note for note in read(tmp_path, "psnr.csv", csv(("Method", SCENES), *rows())).notes)
