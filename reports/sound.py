"""What of a damaged or unfinished run can be shown: the parts that are sound, and a line for each that is not."""

from collections.abc import Callable
from typing import TypeVar

from harness.json_record import DamagedRecord

One = TypeVar("One")


def if_sound(read: Callable[[], One], without: One, left_out: list[str] | None) -> One:
    """What `read` gives. Where it raises `DamagedRecord`: `without`, and a line in `left_out`; raises it where that is
    None."""
    try:
        return read()
    except DamagedRecord as problem:
        if left_out is None:
            raise
        left_out.append(str(problem))
        return without
