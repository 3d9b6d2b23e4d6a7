"""python -m tools.published.web_pages: make the pages that can be opened from the repository, from published data."""

import contextlib
import io
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from harness.command.main import main as harness
from reports.__main__ import main as reports
from reports.run.saving.archive import unpack


def _of_run(source: Path, out: Path) -> Path:
    unpack(source, out)
    reports([str(out), "--quiet"])
    return out / "report.html"


def _of_studies(source: Path, out: Path) -> Path:
    out.mkdir()
    shutil.copy(source, out)
    reports([str(out), "--quiet"])
    return out / f"{source.stem}.html"


def _of_table(source: Path, out: Path) -> Path:
    harness(["judge", str(source), "--out", str(out)])
    return out / "judgement.html"


PAGES: dict[str, tuple[str, Callable[[Path, Path], Path]]] = {
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
    quiet = contextlib.redirect_stdout(io.StringIO())
    # a page of a table names the file as it was given
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(docs), quiet:
        return make(Path(source), Path(folder) / "out").read_bytes()


def main(docs: Path = Path("docs")) -> int:
    for page in published(docs):
        content = made(page, docs)
        if not (docs / page).is_file() or (docs / page).read_bytes() != content:
            (docs / page).write_bytes(content)
            sys.stdout.write(f"{docs / page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
