"""Bytes as a source of choices: what makes an input by chance makes the same one of the same bytes.

libFuzzer changes the bytes and sees by coverage which choices led to something new, so that inputs which are lists of
choices (command lines, changes of a folder) are guided like any file.
"""

from random import Random


class Choices(Random):
    """A number below n takes one byte, or as many as n needs; where the bytes are at an end it is n − 1: in
    `tests.fuzz` that is mostly another option left out, so that inputs end.
    """

    def __init__(self, data: bytes) -> None:
        super().__init__(0)
        self._data, self._at = data, 0

    def _randbelow(self, n: int) -> int:
        size = max(1, ((n - 1).bit_length() + 7) // 8)
        taken = self._data[self._at : self._at + size]
        self._at += size
        return int.from_bytes(taken, "little") % n if len(taken) == size else n - 1

    def random(self) -> float:
        return self._randbelow(1 << 53) / (1 << 53)

    def getrandbits(self, k: int) -> int:
        return self._randbelow(1 << k)
