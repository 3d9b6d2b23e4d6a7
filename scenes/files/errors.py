"""Exceptions of which a user sees only the message."""

LONGEST = 1500


class _Readable(ValueError):
    """Text from a file can hold anything: long messages are cut and control characters (line ends too) are escaped."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)).replace("\n", "\\n"))


class InputError(_Readable):
    """The user's input is wrong: the message, all that a command prints, names file or option, value and remedy."""


class DamagedRecord(_Readable):
    """A record is damaged or unknown to this version: the message names the file, the reason and the remedy."""


def readable(text: str) -> str:
    """Return `text` in printable characters; beyond `LONGEST` of them its middle is left out."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 3]} … {text[-LONGEST // 2 :]}"
    return printable(text)


def printable(text: str) -> str:
    """Return `text` with control characters escaped, except line ends."""
    return "".join(letter if letter.isprintable() or letter == "\n" else repr(letter)[1:-1] for letter in text)


def shown(value: object) -> str:
    """Return the representation of a value for a message, cut to a readable length."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"


def short(error: Exception, length: int = 300) -> str:
    """Return the message of a library's error on one short line."""
    return " ".join(str(error).split())[:length] or type(error).__name__


def named(error: BaseException, length: int = 300) -> str:
    """Return the kind and the message of an error on one short line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:length]


def as_text(text: str) -> str:
    """Return `text` with lone surrogates escaped, which stand for bytes of a name that is not UTF-8."""
    return text.encode(errors="backslashreplace").decode()
