"""Functions that a test watches, slows down or lets fail."""

from collections.abc import Callable
from typing import Any

import pytest


def preceded(patch: pytest.MonkeyPatch, owner: Any, name: str, act: Callable[..., object]) -> None:
    """Let `act` get the arguments of a function before each of its calls."""
    original = getattr(owner, name)

    def both(*arguments: Any, **named: Any) -> Any:
        act(*arguments, **named)
        return original(*arguments, **named)

    patch.setattr(owner, name, both)


def changed(patch: pytest.MonkeyPatch, owner: Any, name: str, change: Callable[..., object]) -> None:
    """Let a function return what `change` makes of its result and its arguments."""
    original = getattr(owner, name)
    patch.setattr(owner, name, lambda *arguments: change(original(*arguments), *arguments))
