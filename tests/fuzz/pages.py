"""Whole pages from records that are not as they were: exit code 0 or 3, or 2 with a reason, never a traceback,
and never code of a record's in the page.

A drawing follows from its panel and name alone: one that was drawn before is not drawn again. Nor is a template
compiled again.
"""

import contextlib
import io
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from scenes.files.errors import InputError
from tests.fuzz.mutations import TEXTS, of_either, of_its_kind
from tests.fuzz.seals import record_sealed

DRAWING = ("drawing.figure", "drawing.series_charts", "studies.study_page")
"""Modules of `reports` that ask for drawings."""
MOST_DRAWN = 5000
CODE = "<script>alert(1)</script>"
"""One of the texts that inputs are made of."""
assert CODE in TEXTS


def mutate(random: Random, valid: bytes) -> bytes:
    """A record that is mostly still one: what its reader refuses no page meets."""
    return record_sealed(of_its_kind(random, valid)) if random.randrange(4) else of_either(random, valid)


def page(*options: str) -> Callable[[Path], None]:
    """`python -m reports OUT …` in this process."""

    def read(folder: Path) -> None:
        from reports.__main__ import main

        for old in folder.glob("*.html"):
            old.unlink()
        said, told = io.StringIO(), io.StringIO()
        with _made_once(), contextlib.redirect_stderr(said), contextlib.redirect_stdout(told):
            code = main([str(folder), *options])
        if code == 2:
            raise InputError(said.getvalue().strip())
        assert code in (0, 3), f"exit code {code}: {said.getvalue()[-300:]}"
        made = Path(told.getvalue().splitlines()[-1])
        text = made.read_text(encoding="utf-8")
        assert len(text) > 1000
        assert CODE not in text, f"text of a record has become code: {text[text.index(CODE) - 80 :][:200]!r}"

    return read


@contextlib.contextmanager
def _made_once() -> Iterator[None]:
    import importlib

    from reports.page import shell

    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(shell, "environment", _environment_once()))
        for name in DRAWING:
            module = importlib.import_module(f"reports.{name}")
            stack.enter_context(mock.patch.object(module, "svg", _remembering()))
        yield


@cache
def _environment_once() -> Callable[[], Any]:
    from reports.page import shell

    return cache(shell.environment)


@cache
def _remembering() -> Callable[[Any, str], Any]:
    from reports.drawing.figure import svg

    drawn: dict[tuple[str, str], Any] = {}

    def remembered(panel: Any, name: str) -> Any:
        key = repr(panel), name
        if key not in drawn:
            if len(drawn) > MOST_DRAWN:
                drawn.clear()
            drawn[key] = svg(panel, name)
        return drawn[key]

    return remembered
