"""A trial tells how code ends its process, and shows nothing that it prints."""

import pytest

from scenes.files.trial import how_it_ends


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("print(arguments)", ""),
        ("raise ValueError(3)", ""),
        ("raise SystemExit(3)", ""),
        ("import os; os._exit(0)", "ends the process with exit code 0"),
        ("import os; os._exit(7)", "ends the process with exit code 7"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "ends the process with signal 9"),
        ("raise KeyboardInterrupt", "raises KeyboardInterrupt"),
        ("assert arguments == ['one', 'two words']; import os; os._exit(1)", "ends the process with exit code 1"),
    ],
)
def test_how_it_ends(code: str, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert how_it_ends(code, "one", "two words") == message
    assert capfd.readouterr() == ("", "")
