"""A valid input → one that may be wrong, by choices of a random source: Python's own or atheris's."""

import copy
import json
import math
import struct
from collections.abc import Callable
from functools import lru_cache
from random import Random
from typing import Any

TEXTS = (
    "", " ", "\0", "a\0b", "a\nb", "../../etc/passwd", "/etc/passwd", "..", ".", "C:\\x", "\\\\host\\x", "~root/x",
    "file:///etc/passwd", "train/../../x", "é", "Ω" * 40, "\u202egnp", "\ud800", "<script>alert(1)</script>", "x" * 300,
    "x" * 100_000, "%s%n", "{0}", "nan", "NaN", "Infinity", "1e999", "None", "true", "-1", "--help", "-", "a" * 5000,
    "all", "nerf", "qnerf", "./train/r_0", "train/r_1", "/dev/zero", "con", "\x1b[31m", "$(id)", "'", '"', "\\", "0",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 3, 7, 255, 256, 65535, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63 - 1, 2**63, 2**64, 10**9, 10**18,
    -(2**31), -(2**63), -(10**18), 10**400, 0.0, -0.0, 0.5, -0.5, 1e-9, 1e-320, 1e9, 1e38, 1e39, 1e154, 1e300, 1e308,
    -1e308, math.pi, math.nan, math.inf, -math.inf,
)  # fmt: skip
WHOLE = tuple(number for number in NUMBERS if isinstance(number, int))
FINITE = tuple(number for number in NUMBERS if isinstance(number, float) and math.isfinite(number))
OTHERS: tuple[Any, ...] = (
    None, True, False, [], {}, [[]], [{}], {"": None}, [None], [0, 0], [1.0, -1.0], ["", ""], [[0.0] * 4] * 4, {"a": 1},
    [1e308, -1e308], [True], [[1], [2]], list(range(1000)),
)  # fmt: skip
RAW = ("[" * 100_000, '{"a":' * 50_000, "1" * 5000, "NaN", "-Infinity", "1e99999", "0" * 50, "-", "tru", '"', "\ufeff")
"""In the place of a value, as it is."""
WORDS = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\x80\0\0\0")

Step = tuple[str | int, ...]
"""The way from the root of a JSON value to a place in it."""


def of_json(random: Random, valid: bytes) -> bytes:
    """1 to 4 changes of the value, and sometimes of the text that it becomes."""
    value, places = _parsed(valid)
    for number in range(_few(random)):
        value = _changed(random, value, _places(value) if number else places)
    text = _text(value)
    kind = random.randrange(12)
    if kind == 0:
        text = _doubled_key(random, value, text)
    elif kind == 1:
        mark = '"a place for what is raw"'
        text = _text(_put(value, random.choice(_places(value)), json.loads(mark))).replace(mark, random.choice(RAW), 1)
    data = text.encode("utf-8", "surrogatepass")
    return of_bytes(random, data) if kind == 2 else data


def of_bytes(random: Random, valid: bytes) -> bytes:
    """1 to 4 changes of the bytes: of one, of a word, cut off, cut out, doubled, put in."""
    data = bytearray(valid)
    for _ in range(_few(random)):
        if not data:
            return random.choice((b"", b"\0", b"{}"))
        # headers are where claims are made
        end = len(data) if random.randrange(2) else min(len(data), 400)
        at = random.randrange(end)
        kind = random.randrange(9)
        if kind == 0:
            data[at] ^= 1 << random.randrange(8)
        elif kind == 1:
            data[at] = random.randrange(256)
        elif kind == 2:
            data[at : at + 4] = random.choice(WORDS)
        elif kind == 3:
            data[at : at + 4] = struct.pack(random.choice("<>") + "I", random.choice((1, 0xFFFF, 10**9, 1 << 28)))
        elif kind == 4:
            del data[at:]
        elif kind == 5:
            del data[at : at + 1 + random.randrange(64)]
        elif kind == 6:
            piece = bytes(data[at : at + 1 + random.randrange(64)])
            data[at:at] = piece * random.choice((1, 2, 30))
        elif kind == 7:
            data[at:at] = random.choice(TEXTS).encode("utf-8", "surrogatepass")
        else:
            data[at : at + 16] = bytes(16)
    return bytes(data)


def of_either(random: Random, valid: bytes) -> bytes:
    """A JSON file as a value seven times of eight, else as bytes."""
    return of_json(random, valid) if random.randrange(8) else of_bytes(random, valid)


def of_its_kind(random: Random, valid: bytes) -> bytes:
    """1 to 4 values of a JSON file are others of their kind, so that types are as they were; each key is as likely as
    those beside it, however much is in it."""
    value, _ = _parsed(valid)
    for _ in range(_few(random)):
        place = _descended(random, value)
        value = _put(value, place, _of_its_kind(random, value, _at(value, place)))
    return _text(value).encode("utf-8", "surrogatepass")


@lru_cache(maxsize=64)
def _parsed(valid: bytes) -> tuple[Any, list[Step]]:
    """Nobody changes what it gives: changes copy the way to their place."""
    value = json.loads(valid)
    return value, _places(value)


def _few(random: Random) -> int:
    return 1 + (random.randrange(2) and random.randrange(4))


def _text(value: Any) -> str:
    try:
        return json.dumps(value, ensure_ascii=False)
    except (ValueError, RecursionError):  # a number of more digits than Python says
        return json.dumps(str(type(value)))


def _places(value: Any, here: Step = ()) -> list[Step]:
    """Every place, the root first; of long lists the first and the last ones alone."""
    places: list[Step] = [here]
    if isinstance(value, dict):
        for key, inner in value.items():
            places += _places(inner, (*here, key))
    elif isinstance(value, list):
        for index in dict.fromkeys([*range(min(3, len(value))), *range(max(0, len(value) - 1), len(value))]):
            places += _places(value[index], (*here, index))
    return places


def _at(value: Any, place: Step) -> Any:
    for step in place:
        value = value[step]
    return value


def _put(value: Any, place: Step, new: Any) -> Any:
    if not place:
        return new
    changed = copy.copy(value)
    changed[place[0]] = _put(value[place[0]], place[1:], new)
    return changed


def _changed(random: Random, value: Any, places: list[Step]) -> Any:
    place = random.choice(places)
    if random.randrange(3):  # leaves are many, and one list of a thousand would take all choices
        place = place[: 1 + random.randrange(len(place))] if place else place
    return _put(value, place, random.choice(CHANGES)(random, value, _at(value, place)))


def _other(random: Random, root: Any, here: Any) -> Any:
    return copy.deepcopy(random.choice(OTHERS))


def _number(random: Random, root: Any, here: Any) -> Any:
    if isinstance(here, int | float) and random.randrange(2):
        return random.choice((-here, here + 1, here - 1, float(here) if abs(here) < 1e300 else 0, here // 2, str(here)))
    return random.choice(NUMBERS)


def _string(random: Random, root: Any, here: Any) -> Any:
    if isinstance(here, str) and here and random.randrange(2):
        cut = random.randrange(len(here))
        return here[:cut] + random.choice(TEXTS) + random.choice((here[cut:], ""))
    return random.choice(TEXTS)


def _from_elsewhere(random: Random, root: Any, here: Any) -> Any:
    return copy.deepcopy(_at(root, random.choice(_places(root))))


def _like_from_elsewhere(random: Random, root: Any, here: Any) -> Any:
    like = [there for place in _places(root) if type(there := _at(root, place)) is type(here)]
    return copy.deepcopy(random.choice(like))


def _reshaped(random: Random, root: Any, here: Any) -> Any:
    """Of lists and objects: one left out, one more, none, doubled, turned round."""
    if isinstance(here, dict) and here:
        changed, key = dict(here), random.choice(list(here))
        inner = changed.pop(key)
        kind = random.randrange(5)
        if kind == 0:
            changed[random.choice(TEXTS)] = inner
        elif kind == 1:
            changed = {**here, random.choice((*TEXTS, "checksum", "digest")): inner}
        return {} if kind == 2 else changed
    if isinstance(here, list) and here:
        at = random.randrange(len(here))
        ways = (here[:at], here[:at] + here[at + 1 :], [*here, here[at]], here[::-1], [], here * 2, [here], here[at])
        return copy.deepcopy(random.choice(ways))
    return [here]


def _of_its_kind(random: Random, root: Any, here: Any) -> Any:
    """None becomes a number: it is what stands where there is none."""
    if isinstance(here, bool):
        return not here
    if isinstance(here, str):
        return _string(random, root, here)
    if isinstance(here, int):
        return random.choice((-here, here + 1, here - 1, 0, *WHOLE))
    if isinstance(here, float) or here is None:
        return random.choice((-(here or 0.0), 1.5 * (here or 1.0), *FINITE)) if random.randrange(8) else None
    return _reshaped(random, root, here)


def _descended(random: Random, value: Any) -> Step:
    """A place at the end of a way down; one of four ends early."""
    place: Step = ()
    while isinstance(value, dict | list) and value and (not place or random.randrange(4)):
        step = random.choice(list(value)) if isinstance(value, dict) else random.randrange(len(value))
        place, value = (*place, step), value[step]
    return place


CHANGES: tuple[Callable[[Random, Any, Any], Any], ...] = (
    *(_other, _string, _from_elsewhere),
    *(_number, _like_from_elsewhere, _reshaped) * 2,
)


def _doubled_key(random: Random, value: Any, text: str) -> str:
    objects = [here for place in _places(value) if isinstance(here := _at(value, place), dict) and here]
    if not objects:
        return text
    chosen = random.choice(objects)
    whole, key = _text(chosen), random.choice(list(chosen))
    again = f"{whole[:-1]}, {_text(key)}: {_text(random.choice((*OTHERS, *NUMBERS[:20], *TEXTS[:10])))}}}"
    return text.replace(whole, again, 1)


def of_safetensors(random: Random, valid: bytes) -> bytes:
    """The header as JSON with its length put right, or bytes anywhere."""
    if random.randrange(3) == 0:
        return of_bytes(random, valid)
    length = int.from_bytes(valid[:8], "little")
    header, rest = of_json(random, valid[8 : 8 + length]), valid[8 + length :]
    if random.randrange(4) == 0:
        rest = of_bytes(random, rest)
    return len(header).to_bytes(8, "little") + header + rest
