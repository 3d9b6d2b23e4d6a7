"""`occupancy.json` beside a view set of ours: where there truly is matter (`scenes.occupancy`).

It is no part of the view set, whose name and checksums stay what they were: it is added to view sets that were rendered
before, and bound to its view set by the digest of the order.
"""

import base64
import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.manifest import DamagedViewSet, read_manifest
from scenes.occupancy import CELLS, inside
from scenes.order import Order
from scenes.transforms import read_json
from scenes.view_set import ViewSet

NAME = "occupancy.json"
SCHEMA = 1


def with_occupancy(folder: Path, order: Order) -> Path:
    """The folder of a whole view set, with the file in it if it can be: not for shapes whose inside is not known, nor
    where the folder cannot be written."""
    manifest = read_manifest(folder)
    with suppress(DamagedViewSet):
        if _read(folder, manifest) is not None:
            return folder
    scene = order.scene
    found = None if scene.load else inside(order.description, np.array(manifest["bounds"]), scene.emitters_seen)
    if found is not None:
        _write(folder / NAME, _bound_to(manifest), np.packbits(found).tobytes())
    return folder


def read_occupancy(views: ViewSet) -> np.ndarray | None:
    """bool [32, 32, 32] over x, y, z of the view set's box; None where it is not known, or another box was asked for.

    Raises `DamagedViewSet` for a file that is damaged or of another view set.
    """
    if "bounds" not in views.rendered or not np.array_equal(views.bounds, views.rendered["bounds"]):
        return None
    return _read(views.path, views.rendered)


def _bound_to(manifest: dict[str, Any]) -> dict[str, Any]:
    return {"schema": SCHEMA, "digest": manifest.get("digest"), "bounds": manifest["bounds"], "cells": CELLS}


def _read(folder: Path, manifest: dict[str, Any]) -> np.ndarray | None:
    file = folder / NAME
    if not file.is_file():
        return None
    try:
        content = read_json(file)
        claimed = content.pop("checksum")
        bits = base64.b64decode(content.pop("inside"), validate=True)
        if content != _bound_to(manifest) or claimed != _checksum(content, bits) or len(bits) != CELLS**3 // 8:
            raise ValueError("it is damaged, or not of this view set")
    except (InputError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DamagedViewSet(f"{file}: {error}; delete it, the next run makes it again") from error
    cells = np.unpackbits(np.frombuffer(bits, dtype=np.uint8)).astype(bool)
    return cells.reshape(CELLS, CELLS, CELLS)


def _checksum(content: dict[str, Any], bits: bytes) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode() + bits).hexdigest()


def _write(file: Path, content: dict[str, Any], bits: bytes) -> None:
    whole = {**content, "inside": base64.b64encode(bits).decode("ascii"), "checksum": _checksum(content, bits)}
    beside = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        beside.write_text(json.dumps(whole), encoding="ascii")
        beside.replace(file)
    except OSError:
        pass  # a cache that others keep: what is inside then stays unknown, and the report says so
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
