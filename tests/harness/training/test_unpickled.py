"""Nothing that is read from a file is unpickled: looked for in the sources; `tests.endurance` tries it with files."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PACKAGES = ("harness", "scenes", "baselines", "reports")
UNPICKLING = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
"""Modules."""


def faults(source: str) -> list[str]:
    """Calls and imports that unpickle what they read, or could."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [name.name for name in node.names if name.name.split(".")[0] in UNPICKLING]
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in UNPICKLING:
            found.append(str(node.module))
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and isinstance(node.func.value, ast.Name)
        ):
            called = f"{node.func.value.id}.{node.func.attr}"
            allowed = {word.arg: getattr(word.value, "value", None) for word in node.keywords}
            if called in ("torch.load", "pd.read_pickle", "pandas.read_pickle"):
                found.append(called)
            if called in ("np.load", "numpy.load") and allowed.get("allow_pickle", "unsaid") is not False:
                found.append(called)
    return found


def test_no_source_of_ours_unpickles() -> None:
    sources = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    assert len(sources) > 100
    found = {str(file.relative_to(ROOT)): faults(file.read_text(encoding="utf-8")) for file in sources}
    assert {name: told for name, told in found.items() if told} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from pickle import loads",
        "torch.load(path)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "np.load(path, allow_pickle=given)",
    ],
)
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert len(faults(source)) == 1
    assert faults("np.load(path, allow_pickle=False)") == []
