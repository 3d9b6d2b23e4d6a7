"""The one exception for a user's mistake."""

LONGEST = 1500
"""Characters of a message."""


class InputError(ValueError):
    """The user's input is wrong: the message names the file or option, the value and the remedy.

    The command line prints the message alone, without a traceback, and exits with 2. What it tells of a file can hold
    anything: it is cut where it would be endless, and control characters, which a terminal would obey, are written out.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


def readable(text: str) -> str:
    """`text` as a terminal can show it: printable, and its middle left out beyond `LONGEST` characters."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 3]} … {text[-LONGEST // 2 :]}"
    return "".join(one if one.isprintable() or one == "\n" else repr(one)[1:-1] for one in text)
