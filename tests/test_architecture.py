"""The architecture: imports go down only, lazy and TYPE_CHECKING imports included; small rooms, plain names.

Each check is a function from a source tree to complaints, so that it can be tested on a bad tree.
"""

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.harness.ball import write_ball

ROOT = Path(__file__).parent.parent
FLOORS = (
    "reports.__main__", "reports.run", "reports.claims", "reports.studies", "reports.page", "reports.drawing",
    "reports.data",
    "harness.__main__", "harness.command", "harness.gate", "harness.studies.stability", "harness.studies.choices",
    "harness.studies.frontier", "harness.studies.evidence", "harness.studies.devices", "harness.studies.speed",
    "harness.studies.serving",
    "harness.studies.conformance", "harness.studies", "harness.viewer", "harness.execution", "harness.playback",
    "harness.training", "harness.run_folder", "harness.verdicts", "harness.plan", "harness.machine",
    "harness.records",
    "baselines",
    "scenes.__main__", "scenes.rendering", "scenes.catalog", "scenes.modelling", "scenes.view_sets", "scenes.files",
)  # fmt: skip
"""Every room, from the top: a room imports itself and rooms below it. A nested room precedes the folder that holds it,
whose other modules are a room too.
"""
LEAVES = {
    "reports": ("reports", "harness.records", "harness.verdicts", "scenes.files"),
    "harness.verdicts": ("harness.verdicts", "harness.records", "scenes.files"),
    "harness.records": ("harness.records", "scenes.files"),
    "baselines": ("baselines",),
    "baselines.numerics": ("baselines.numerics",),
}
"""Rooms with further limits: they may import only these."""
DRAWERS = {"utils", "util", "helpers", "helper", "common", "misc"}
MOST_ENTRIES = {"harness": 14, "reports": 8}
MOST_FILES = 12
MOST_LINES = 500
UNPICKLING = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}


def modules(root: Path) -> dict[str, Path]:
    """Dotted name → file of every module of the four packages."""
    files = {}
    for package in ("reports", "harness", "baselines", "scenes"):
        for file in sorted((root / package).rglob("*.py")):
            parts = file.relative_to(root).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return files


def imported(name: str, file: Path, known: set[str]) -> set[str]:
    """Return the modules of the four packages and of `tools` that a module imports anywhere in its source."""
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                names.add(inner if inner in known else base)
    return {name for name in names if name.partition(".")[0] in ("tools", "reports", "harness", "baselines", "scenes")}


def graph_of(root: Path) -> dict[str, set[str]]:
    files = modules(root)
    return {name: imported(name, file, set(files)) for name, file in files.items()}


def is_in(module: str, room: str) -> bool:
    return module == room or module.startswith(f"{room}.")


def floor_of(module: str) -> int:
    """Return the index in `FLOORS`; −1 for the `__init__` of a package, which is above all of its rooms."""
    return next((place for place, room in enumerate(FLOORS) if is_in(module, room)), -1)


def wrong_arrows(root: Path) -> Iterator[str]:
    for name, targets in graph_of(root).items():
        if floor_of(name) < 0 and "." in name:
            yield f"{name} is in no room"
        for target in sorted(targets):
            if floor_of(target) < floor_of(name):
                yield f"{name} imports {target}, upwards"
            for leaf, allowed in LEAVES.items():
                if is_in(name, leaf) and not any(is_in(target, room) for room in allowed):
                    yield f"{name} imports {target}, which {leaf} may not"


def circles(root: Path) -> Iterator[str]:
    graph = graph_of(root)
    for start in graph:
        reached: set[str] = set()
        waiting = list(graph[start])
        while waiting:
            name = waiting.pop()
            if name not in reached:
                reached.add(name)
                waiting += graph.get(name, ())
        if start in reached:
            yield f"{start} imports itself through other modules"


def full_rooms(root: Path) -> Iterator[str]:
    for folder in sorted({file.parent for file in modules(root).values()}):
        entries = [entry for entry in folder.iterdir() if entry.name != "__pycache__"]
        files, name = sum(entry.is_file() for entry in entries), folder.relative_to(root).as_posix()
        if files > MOST_FILES:
            yield f"{name} has {files} files"
        if len(entries) > MOST_ENTRIES.get(name, len(entries)):
            yield f"{name} has {len(entries)} entries"
        introduction = folder / "__init__.py"
        if not introduction.is_file() or len(introduction.read_text(encoding="utf-8").splitlines()) != 1:
            yield f"{name} is not introduced in one line of an __init__.py"


def drawers(root: Path) -> Iterator[str]:
    yield from (f"{name} is a drawer" for name in modules(root) if DRAWERS & set(name.split(".")))


def long_files(root: Path) -> Iterator[str]:
    """Tests, scripts and style included."""
    for folder in ("tools", "reports", "harness", "baselines", "scenes", "tests"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix in (".py", ".js", ".css", ".html"):
                lines = len(file.read_text(encoding="utf-8").splitlines())
                if lines > MOST_LINES:
                    yield f"{file.relative_to(root)} has {lines} lines"


def names_twice(root: Path) -> Iterator[str]:
    """Modules and public classes of the harness that share their name with another."""
    files = {name: file for name, file in modules(root).items() if is_in(name, "harness")}
    words = Counter(name.rpartition(".")[2] for name in files if "__" not in name)
    classes = Counter(
        node.name
        for file in files.values()
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    yield from (f"{count} modules are called {word}" for word, count in words.items() if count > 1)
    yield from (f"{count} classes are called {name}" for name, count in classes.items() if count > 1)


def second_writers(root: Path) -> Iterator[str]:
    """Only one module locks files, and only one writes temporary files."""
    for name, file in modules(root).items():
        if name not in ("scenes.files.lock", "scenes.files.atomic"):
            text = file.read_text(encoding="utf-8")
            for match in re.findall(r'fcntl|filelock|mkstemp|NamedTemporaryFile|\.part["{]', text):
                yield f"{name} has its own {match}"


def unpickling(root: Path) -> Iterator[str]:
    """Nothing that is read from a file is unpickled: seen in the sources; `tests.endurance` tries it with files."""
    for name, file in modules(root).items():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            used = [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            if isinstance(node, ast.Import):
                used = [alias.name for alias in node.names]
            yield from (f"{name} imports {module}" for module in used if module.partition(".")[0] in UNPICKLING)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                called = f"{node.func.value.id}.{node.func.attr}" if isinstance(node.func.value, ast.Name) else ""
                allowed = {word.arg: getattr(word.value, "value", None) for word in node.keywords}
                is_array = called in ("np.load", "numpy.load") and allowed.get("allow_pickle", "unsaid") is not False
                if is_array or called in ("torch.load", "pd.read_pickle", "pandas.read_pickle"):
                    yield f"{name} calls {called}"


CHECKS = [wrong_arrows, circles, full_rooms, drawers, long_files, names_twice, second_writers, unpickling]
Check = Callable[[Path], Iterator[str]]


@pytest.mark.parametrize("check", CHECKS)
def test_the_house_has_no_complaints(check: Check) -> None:
    assert list(check(ROOT)) == []


def test_the_house_is_looked_at() -> None:
    graph = graph_of(ROOT)
    assert {floor_of(name) for name in graph if "." in name} == set(range(len(FLOORS)))
    assert graph["harness.training.lockstep"] > {"harness.training.scoring.evaluate", "scenes.view_sets.view_set"}


def written(files: dict[str, str], folder: Path) -> None:
    for name, text in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)


LAZY = "def f():\n    "
TYPED = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    "


@pytest.mark.parametrize(
    ("check", "files", "said"),
    [
        (wrong_arrows, {"scenes/files/a.py": "import baselines.b"}, "scenes.files.a imports baselines.b"),
        (wrong_arrows, {"baselines/a.py": LAZY + "from harness import x"}, "baselines.a imports harness"),
        (wrong_arrows, {"baselines/a.py": "from scenes.files.b import x"}, "baselines.a imports scenes.files.b"),
        (wrong_arrows, {"reports/data/a.py": "from harness.plan.b import P"}, "reports.data.a imports harness.plan.b"),
        (wrong_arrows, {"harness/plan/a.py": TYPED + "from harness.execution.b import C"}, "harness.plan.a imports"),
        (wrong_arrows, {"harness/studies/evidence/a.py": LAZY + "from harness.studies.stability.b import c"},
         "harness.studies.evidence.a imports"),
        (wrong_arrows, {"harness/studies/a.py": "import harness.studies.speed.b"}, "harness.studies.a imports"),
        (wrong_arrows, {"scenes/view_sets/a.py": "from ..catalog import b"}, "scenes.view_sets.a imports"),
        (wrong_arrows, {"harness/cellar/a.py": ""}, "harness.cellar.a is in no room"),
        (wrong_arrows, {"reports/run/a.py": LAZY + "from tools.b import c"}, "reports.run.a imports tools.b"),
        (circles, {"harness/plan/a.py": TYPED + "import harness.plan.b", "harness/plan/b.py": "import harness.plan.a"},
         "harness.plan.b imports itself"),
        (circles,
         {"scenes/a.py": "import scenes.b", "scenes/b.py": "from . import c", "scenes/c.py": "import scenes.a"},
         "scenes.c imports itself"),
        (full_rooms, {f"scenes/files/a{i}.py": "" for i in range(13)}, "scenes/files has 13 files"),
        (full_rooms, {f"reports/a{i}/b.py": "" for i in range(9)} | {"reports/b.py": ""}, "reports has 10 entries"),
        (full_rooms, {"scenes/files/__init__.py": "a = 1\nb = 2\n"}, "scenes/files is not introduced"),
        (drawers, {"harness/utils.py": ""}, "harness.utils is a drawer"),
        (long_files, {"scenes/a.py": "\n" * 501}, "scenes/a.py has 501 lines"),
        (long_files, {"tests/scenes/test_a.py": "\n" * 600}, "tests/scenes/test_a.py has 600 lines"),
        (names_twice, {"harness/plan/a.py": "", "harness/machine/a.py": ""}, "2 modules are called a"),
        (names_twice, {"harness/plan/a.py": "class A: ...", "harness/plan/b.py": "class A: ..."},
         "2 classes are called A"),
        (second_writers, {"reports/page/a.py": "b.with_name(f'.{c}.part{d}').replace(b)"},
         "reports.page.a has its own .part{"),
        (second_writers, {"harness/plan/a.py": LAZY + "import fcntl"}, "harness.plan.a has its own fcntl"),
        *((unpickling, {"scenes/files/a.py": text}, "scenes.files.a ") for text in (
            "import pickle", "from pickle import loads", "torch.load(path)", "np.load(path)",
            "np.load(path, allow_pickle=True)", "np.load(path, allow_pickle=given)",
        )),
    ],
)  # fmt: skip
def test_a_bad_house_is_complained_about(check: Check, files: dict[str, str], said: str, tmp_path: Path) -> None:
    written(files, tmp_path)
    assert any(complaint.startswith(said) for complaint in check(tmp_path))


@pytest.mark.parametrize(
    "files",
    [
        {"reports/data/a.py": "from harness.records.b import A\nfrom harness import records",
         "harness/records/b.py": ""},
        {"harness/plan/a.py": "import scenes.files.b, baselines.c\nfrom harness.records.d import e"},
        {"harness/plan/a.py": LAZY + "import harness.plan.b", "harness/plan/b.py": "import harness.records.a"},
        {"scenes/files/a.py": "np.load(path, allow_pickle=False)"},
    ],
)  # fmt: skip
def test_a_good_house_is_not_complained_about(files: dict[str, str], tmp_path: Path) -> None:
    written(files | {f"{Path(name).parent}/__init__.py": '"""A room."""\n' for name in files}, tmp_path)
    assert [complaint for check in (wrong_arrows, circles, full_rooms, drawers, unpickling)
            for complaint in check(tmp_path)
            if "in one line" not in complaint] == []  # fmt: skip


HEAVY = ("torch", "mitsuba", "drjit", "OpenImageIO", "colour", "pandas", "matplotlib", "flip_evaluator")


def heavy_imports_of(code: str) -> set[str]:
    """Return the heavy packages that a fresh interpreter has imported after `code`."""
    probe = f"import sys\n{code}\nprint('HEAVY', *[name for name in {HEAVY!r} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(next(line for line in ran.stdout.splitlines() if line.startswith("HEAVY")).split()[1:])


def run_module(*arguments: str) -> str:
    return (
        # a command that ends with os._exit would not reach the probe
        f"import os, runpy\nos._exit = sys.exit\nsys.argv = {list(arguments)!r}\n"
        "try:\n    runpy.run_module(sys.argv[0], run_name='__main__')\n"
        "except SystemExit:\n    pass"
    )


LIGHT = [
    "harness --help", "harness run --help", "harness sweep --help", "harness speed --help", "harness judge --help",
    "harness view --help", "harness render --help", "harness gate --list", "harness stability --list",
    "reports --help", "scenes --help",
]  # fmt: skip


def test_nothing_heavy_is_imported_where_nothing_heavy_is_done() -> None:
    """By none of them: one interpreter does all, as starting one takes longer than most."""
    imports = "import harness.records.cells, harness.records.study, scenes.modelling.needs"
    imports += ", harness.studies.stability.cases"
    assert heavy_imports_of("\n".join([imports, *(run_module(*command.split()) for command in LIGHT)])) == set()


def test_reading_a_view_set_and_what_a_scene_needs_takes_neither_torch_nor_mitsuba(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball", size=8, train=1, test=1)
    code = f"from scenes.view_sets.view_set import read_view_set\nread_view_set({str(tmp_path / 'ball')!r})\n"
    code += "from scenes.catalog.entries import scene_named\nfrom scenes.modelling.needs import needs\n"
    code += "needs(scene_named('lego').build())"
    assert heavy_imports_of(code) & {"torch", "mitsuba", "drjit"} == set()


@pytest.mark.thorough
@pytest.mark.slow
def test_a_dry_run_and_a_case_of_arithmetic_need_no_mitsuba(tmp_path: Path) -> None:
    dry = run_module("harness", "run", "--profile", "smoke", "--dry-run", "--need", "outside_box")
    assert heavy_imports_of(dry) & {"mitsuba", "drjit"} == set()
    case = run_module("harness", "stability", "--cases", "Q1", "--quick", "--quiet", "--out", str(tmp_path / "q1"))
    assert heavy_imports_of(case) & {"mitsuba", "drjit"} == set()
    assert (tmp_path / "q1" / "stability.json").exists()


def test_the_probe_sees_a_heavy_import() -> None:
    assert heavy_imports_of("import pandas") == {"pandas"}
