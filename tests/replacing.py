"""`replace` for records and dataclasses alike, as `copy.replace` of Python 3.13."""

import dataclasses
from typing import Any

from msgspec import Struct, structs


def replace(one: Any, **changes: Any) -> Any:
    return (structs if isinstance(one, Struct) else dataclasses).replace(one, **changes)
