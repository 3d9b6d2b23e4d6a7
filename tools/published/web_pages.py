"""python -m tools.published.web_pages: make the pages that can be opened from the repository, from published data.

Each is made by a process of its own, as names inside a page count the figures that its process has drawn.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from reports.run.saving.archive import unpack

ROOT = Path(__file__).parents[2]


def _call(docs: Path, *words: object) -> None:
    """Run a module of the project in the folder `docs`: a page of a table names the file as it was given."""
    command = [sys.executable, "-m", *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=docs, env=environment, check=True, stdout=subprocess.DEVNULL)


def _of_run(docs: Path, source: str, out: Path) -> Path:
    unpack(docs / source, out)
    _call(docs, "reports", out, "--quiet")
    return out / "report.html"


def _of_studies(docs: Path, source: str, out: Path) -> Path:
    out.mkdir()
    shutil.copy(docs / source, out)
    _call(docs, "reports", out, "--quiet")
    return out / f"{Path(source).stem}.html"


def _of_table(docs: Path, source: str, out: Path) -> Path:
    _call(docs, "harness", "judge", source, "--out", out)
    return out / "judgement.html"


PAGES: dict[str, tuple[str, Callable[[Path, str, Path], Path]]] = {
    "reduced/report.html": ("reduced/run.zip", _of_run),
    "frontier/frontier.html": ("frontier/frontier.json", _of_studies),
    "examples/judgement.html": ("examples/nerfbaselines-blender.csv", _of_table),
}
"""Page → its data, both below docs, and the function that makes it in a fresh folder."""


def published(docs: Path) -> list[str]:
    """Return the pages whose data are published."""
    return [page for page, (source, _) in PAGES.items() if (docs / source).is_file()]


def made(page: str, docs: Path) -> bytes:
    source, make = PAGES[page]
    with tempfile.TemporaryDirectory() as folder:
        return make(docs, source, Path(folder) / "out").read_bytes()


def main(docs: Path = ROOT / "docs") -> int:
    for page in published(docs):
        content = made(page, docs)
        if not (docs / page).is_file() or (docs / page).read_bytes() != content:
            (docs / page).write_bytes(content)
            sys.stdout.write(f"{docs / page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
