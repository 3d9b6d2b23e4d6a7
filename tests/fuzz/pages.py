"""Whole pages from records that are not as they were: exit code 0 or 3, or 2 with a reason, never a traceback,
and never code of a record's in the page.

A drawing follows from its panel and name alone: one that was drawn before is not drawn again. Nor is a template
compiled again.
"""

import contextlib
import importlib
import io
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from reports.__main__ import main
from reports.drawing.figure import svg
from reports.page import shell
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
    """Return `python -m reports OUT …` in this process."""

    def read(folder: Path) -> None:
        for old in folder.glob("*.html"):
            old.unlink()
        errors, printed = io.StringIO(), io.StringIO()
        with contextlib.ExitStack() as stack:
            stack.enter_context(mock.patch.object(shell, "environment", ENVIRONMENT))
            for name in DRAWING:
                stack.enter_context(mock.patch.object(importlib.import_module(f"reports.{name}"), "svg", _svg_once))
            stack.enter_context(contextlib.redirect_stderr(errors))
            stack.enter_context(contextlib.redirect_stdout(printed))
            code = main([str(folder), *options])
        if code == 2:
            raise InputError(errors.getvalue().strip())
        assert code in (0, 3), f"exit code {code}: {errors.getvalue()[-300:]}"
        text = Path(printed.getvalue().splitlines()[-1]).read_text(encoding="utf-8")
        assert len(text) > 1000
        assert CODE not in text, f"text of a record has become code: {text[text.index(CODE) - 80 :][:200]!r}"

    return read


ENVIRONMENT = cache(shell.environment)
DRAWN: dict[tuple[str, str], Any] = {}


def _svg_once(panel: Any, name: str) -> Any:
    key = repr(panel), name
    if key not in DRAWN:
        if len(DRAWN) > MOST_DRAWN:
            DRAWN.clear()
        DRAWN[key] = svg(panel, name)
    return DRAWN[key]
