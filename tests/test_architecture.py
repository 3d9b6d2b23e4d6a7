"""The tree keeps its shape: arrows one way, no cycles, no drawers, short files, heavy imports only where needed.

Each check is a function of a tree that gives a list of complaints, so that each is also shown a bad tree.
"""

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.harness.ball import write_ball

ROOT = Path(__file__).parent.parent
ALLOWED = {
    "scenes": {"scenes"},
    "baselines": {"baselines"},
    "harness": {"harness", "scenes", "baselines"},
    "reports": {
        "reports",
        "harness.records",
        "harness.json_record",
        "harness.record_types",
        "harness.comparisons",  # of records alone: what judges methods judges outputs
        "harness.statistics",  # pure functions of arrays
        "harness.failures",
        "harness.pictures_record",
        "harness.targets_record",
        "harness.speed_record",
        "harness.chart_record",
        "harness.stability_record",
        "harness.evidence_record",
        "harness.serving_record",
        "harness.judge.record",
        "harness.judge.wording",
        "scenes.installed",
        "scenes.stopping",
    },
}
"""What a package may import of ours: whole packages, or single modules."""
DRAWERS = {"utils", "util", "helpers", "helper", "common", "misc"}
MOST_LINES = 500


def modules(root: Path) -> dict[str, Path]:
    """Dotted name → file of every module of the four packages."""
    found = {}
    for package in ALLOWED:
        for file in sorted((root / package).rglob("*.py")):
            parts = file.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imported(name: str, file: Path, known: set[str], top_level_only: bool) -> set[str]:
    """The modules of ours that a module imports, as precisely as they are named; relative imports resolved."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in _run_on_import(tree) if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found.add(inner if inner in known else base)
    return {one for one in found if one.partition(".")[0] in ALLOWED}


def _run_on_import(tree: ast.AST) -> list[ast.AST]:
    """Statements that run when the module is imported: not those in functions or under TYPE_CHECKING."""
    found: list[ast.AST] = []
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        found += [node, *_run_on_import(node)]
    return found


def wrong_arrows(root: Path) -> list[str]:
    found = modules(root)
    complaints = []
    for name, file in found.items():
        allowed = ALLOWED[name.partition(".")[0]]
        for target in sorted(imported(name, file, set(found), top_level_only=False)):
            if target.partition(".")[0] not in allowed and target not in allowed:
                complaints.append(f"{name} imports {target}")
    return complaints


def cycles(root: Path) -> list[str]:
    """Modules that import themselves by way of others, while they are imported."""
    found = modules(root)
    graph = {name: imported(name, file, set(found), top_level_only=True) for name, file in found.items()}
    complaints = []
    for start in graph:
        reached: set[str] = set()
        waiting = list(graph[start])
        while waiting:
            name = waiting.pop()
            if name not in reached:
                reached.add(name)
                waiting += graph.get(name, ())
        if start in reached:
            complaints.append(f"{start} imports itself by way of others")
    return complaints


def drawers(root: Path) -> list[str]:
    return [f"{name} is a drawer" for name in modules(root) if DRAWERS & set(name.split("."))]


def long_files(root: Path) -> list[str]:
    """Of all our folders, tests included."""
    files = [file for folder in (*ALLOWED, "tests") for file in sorted((root / folder).rglob("*.py"))]
    lengths = {file: len(file.read_text(encoding="utf-8").splitlines()) for file in files}
    return [f"{file.relative_to(root)} has {lines} lines" for file, lines in lengths.items() if lines > MOST_LINES]


CHECKS = [wrong_arrows, cycles, drawers, long_files]


@pytest.mark.parametrize("check", CHECKS)
def test_the_tree_has_no_complaints(check: Callable[[Path], list[str]]) -> None:
    assert check(ROOT) == []


def test_the_tree_is_looked_at() -> None:
    names = modules(ROOT)
    for package in ALLOWED:
        assert sum(name.partition(".")[0] == package for name in names) > 5
    assert imported("harness.lockstep", names["harness.lockstep"], set(names), True) > {
        "harness.evaluate",  # from harness import evaluate
        "scenes.view_set",
    }


@pytest.mark.parametrize(
    ("check", "files", "said"),
    [
        (wrong_arrows, {"scenes/a.py": "import baselines.b"}, "scenes.a imports baselines.b"),
        (wrong_arrows, {"baselines/a.py": "def f():\n    from harness import x"}, "baselines.a imports harness"),
        (wrong_arrows, {"baselines/a.py": "from scenes.b import x"}, "baselines.a imports scenes.b"),
        (wrong_arrows, {"harness/a.py": "import reports"}, "harness.a imports reports"),
        (wrong_arrows, {"reports/a.py": "from harness import plan", "harness/plan.py": ""}, "reports.a imports"),
        (wrong_arrows, {"reports/a.py": "from harness.plan import Plan"}, "reports.a imports harness.plan"),
        (wrong_arrows, {"reports/deep/a.py": "import scenes"}, "reports.deep.a imports scenes"),
        (cycles, {"harness/a.py": "import harness.b", "harness/b.py": "from harness import a"}, "harness.a imports"),
        (cycles, {"scenes/a.py": "import scenes.b", "scenes/b.py": "from . import c", "scenes/c.py": "import scenes.a"},
         "scenes.c imports itself"),
        (drawers, {"harness/utils.py": ""}, "harness.utils is a drawer"),
        (drawers, {"baselines/common/a.py": ""}, "baselines.common.a is a drawer"),
        (long_files, {"scenes/a.py": "\n" * 501}, "scenes/a.py has 501 lines"),
        (long_files, {"tests/scenes/test_a.py": "\n" * 600}, "tests/scenes/test_a.py has 600 lines"),
    ],
)  # fmt: skip
def test_a_bad_tree_is_complained_about(
    check: Callable[[Path], list[str]], files: dict[str, str], said: str, tmp_path: Path
) -> None:
    for name, text in files.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    assert any(complaint.startswith(said) for complaint in check(tmp_path))


@pytest.mark.parametrize(
    "files",
    [
        {"reports/a.py": "from harness.records import A\nfrom harness import records", "harness/records.py": ""},
        {"harness/a.py": "import scenes.b, baselines.c\nfrom harness.d import e"},
        {"harness/a.py": "def f():\n    import harness.b", "harness/b.py": "import harness.a"},
        {"harness/a.py": "if TYPE_CHECKING:\n    import harness.b", "harness/b.py": "import harness.a"},
    ],
)  # fmt: skip
def test_a_good_tree_is_not_complained_about(files: dict[str, str], tmp_path: Path) -> None:
    for name, text in files.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    assert [complaint for check in CHECKS for complaint in check(tmp_path)] == []


HEAVY = ("torch", "mitsuba", "drjit", "OpenImageIO", "colour", "pandas", "matplotlib", "flip_evaluator")


def heavy_imports_of(code: str) -> set[str]:
    """The heavy packages that a fresh interpreter holds after `code`."""
    probe = f"import sys\n{code}\nprint('HEAVY', *[name for name in {HEAVY!r} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(next(line for line in ran.stdout.splitlines() if line.startswith("HEAVY")).split()[1:])


def run_module(*arguments: str) -> str:
    return (
        # a command that ends at once would not be asked what it holds
        f"import os, runpy\nos._exit = sys.exit\nsys.argv = {list(arguments)!r}\n"
        "try:\n    runpy.run_module(sys.argv[0], run_name='__main__')\n"
        "except SystemExit:\n    pass"
    )


@pytest.mark.parametrize(
    "code",
    [
        run_module("harness", "--help"),
        run_module("harness", "run", "--help"),
        run_module("harness", "sweep", "--help"),
        run_module("harness", "equivalence", "--help"),
        run_module("harness", "omissions", "--help"),
        run_module("harness", "speed", "--help"),
        run_module("harness", "stability", "--help"),
        run_module("harness", "gate", "--help"),
        run_module("harness", "judge", "--help"),
        run_module("harness", "view", "--help"),
        run_module("harness", "render", "--help"),
        run_module("harness", "gate", "--list"),
        run_module("harness", "stability", "--list"),
        run_module("reports", "--help"),
        run_module("scenes", "--help"),
        "import harness.records, harness.stability_record, harness.speed_record",
        "import scenes.needs, harness.stability.catalog",
    ],
)
def test_nothing_heavy_is_imported_where_nothing_heavy_is_done(code: str) -> None:
    assert heavy_imports_of(code) == set()


def test_reading_a_view_set_needs_neither_torch_nor_mitsuba(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball", size=8, train=1, test=1)
    code = f"from scenes.view_set import read_view_set\nread_view_set({str(tmp_path / 'ball')!r})"
    assert heavy_imports_of(code) & {"torch", "mitsuba", "drjit"} == set()


def test_what_a_scene_needs_is_known_without_mitsuba() -> None:
    code = "from scenes.catalog import scene_named\nfrom scenes.needs import needs\nneeds(scene_named('lego').build())"
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


def without_mitsuba(folder: Path) -> dict[str, str]:
    """An environment in which `import mitsuba` and `import drjit` fail, in child processes as well."""
    for name in ("mitsuba", "drjit"):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text("raise ImportError('this test allows no Mitsuba')")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


@pytest.mark.thorough
@pytest.mark.slow
def test_training_on_a_stored_view_set_never_imports_mitsuba(tmp_path: Path) -> None:
    environment = without_mitsuba(tmp_path / "blocked")
    blocked = subprocess.run([sys.executable, "-c", "import mitsuba"], env=environment, capture_output=True)
    assert blocked.returncode == 1
    write_ball(tmp_path / "ball", size=16, train=3, test=1)
    options = "run --profile smoke --view-set ball --out run --resolution 16 --methods nerf --seeds 1 --budget-steps 3"
    command = [sys.executable, "-m", "harness", *options.split(), "--quiet"]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert [file.name for file in (tmp_path / "run/records/cells").iterdir()] == ["ball.nerf.0.json"]
