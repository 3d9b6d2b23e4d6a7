"""The exceptions whose message is all that a user is shown."""

LONGEST = 1500
"""The largest number of characters of a message."""


class _Readable(ValueError):
    """Text taken from a file can hold anything: it is cut if it would be endless, and what a terminal would obey, the
    ends of lines among it, is written out.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)).replace("\n", "\\n"))


class InputError(_Readable):
    """The user's input is wrong: the message names the file or option, the value and the remedy.

    The command line prints the message alone, without a traceback, and exits with 2.
    """


class DamagedRecord(_Readable):
    """A file of records is not what this version writes: the message names the file, the reason and the remedy."""


def readable(text: str) -> str:
    """Return `text` as a terminal can show it: printable, and its middle left out beyond `LONGEST` characters."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 3]} … {text[-LONGEST // 2 :]}"
    return printable(text)


def printable(text: str) -> str:
    """Return `text` with what a terminal would obey, but for the ends of lines, written out."""
    return "".join(letter if letter.isprintable() or letter == "\n" else repr(letter)[1:-1] for letter in text)


def short(error: Exception, length: int = 300) -> str:
    """Return the message of a library on one short line."""
    return " ".join(str(error).split())[:length] or type(error).__name__


def as_text(text: str) -> str:
    """Return `text` with the halves of characters written out, which a name that is not UTF-8 has."""
    return text.encode(errors="backslashreplace").decode()
