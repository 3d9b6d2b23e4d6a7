"""The type of a JSON object whose values are checked where they are read."""

from typing import Any

JsonObject = dict[str, Any]
