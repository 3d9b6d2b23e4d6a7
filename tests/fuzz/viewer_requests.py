"""What a page of the viewer asks for, and whether a refusal of it blames what is wrong."""

import json
import re
from pathlib import Path
from typing import Any

from tests.fuzz.watch import Fault

REQUEST: dict[str, Any] = {
    "client": "c", "generation": 1, "scene": "ball", "methods": ["nerf"], "width": 16,
    "attention": {"kind": "foveal", "row": 0.5, "column": 0.5},
    "place": {"azimuth": 0.1, "elevation": 0.2, "distance": 4.0, "target": [0.0, 0.0, 0.0]},
}  # fmt: skip
RIGHT = {**REQUEST, **REQUEST["attention"], **REQUEST["place"], "view": 0}
"""For every key, wherever it stands."""
NEEDED = REQUEST.keys() - {"width"}


def asked(folder: Path) -> None:
    """A fault for a refusal that blames something else than what is wrong."""
    from harness.viewer.asked import BadRequest, ViewRequest, parsed

    body = (folder / "request.json").read_bytes()
    try:
        assert isinstance(parsed(body), ViewRequest)
    except BadRequest as refusal:
        said = str(refusal)
        if said.startswith("the request"):
            if is_request(body):
                raise Fault(f"the whole request is blamed, no value: {said[:200]!r}") from refusal
            raise
        try:
            parsed(put_right(body, said))
        except BadRequest as still:
            if str(still) == said:
                raise Fault(f"a refusal that begins with no value that is wrong: {said[:200]!r}") from refusal
        raise


def is_request(body: bytes) -> bool:
    """Whether it is one as a whole: JSON of a size that is read, with the keys that must be there, and no others."""
    from harness.viewer.asked import LARGEST_BODY

    try:
        told = json.loads(body, parse_constant=_refused)
    except (ValueError, RecursionError):
        return False
    return len(body) <= LARGEST_BODY and isinstance(told, dict) and NEEDED <= told.keys() <= REQUEST.keys()


def _refused(constant: str) -> None:
    raise ValueError(constant)


def put_right(body: bytes, said: str) -> bytes:
    """The request with right values for the keys that a refusal names before its colon."""
    blamed, colon, _ = said.partition(":")
    named = RIGHT.keys() & set(re.findall(r"\w+", blamed)) if colon else set()

    def mended(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {key: RIGHT[key] if key in named else mended(one) for key, one in value.items()}

    return json.dumps(mended(json.loads(body))).encode()
