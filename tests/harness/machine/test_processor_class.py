"""Processes of a class of processor: what is forced is forced in them, and undone."""

import os

import pytest

from harness.machine.processor_class import OWN, class_here, classes_here, environment_of, forced, in_child
from scenes.files.errors import InputError


def test_a_child_is_of_the_class_that_is_forced() -> None:
    oldest = classes_here()[0]
    with forced(oldest):
        assert in_child(class_here) == oldest
        with forced(class_here()):
            assert {key: os.environ.get(key) for key in OWN} == OWN
        assert dict(environment_of(oldest)).items() <= dict(os.environ).items() or oldest == class_here()
    assert {key: os.environ.get(key) for key in OWN} == OWN


def test_a_child_answers_and_says_what_failed(capfd: pytest.CaptureFixture[str]) -> None:
    assert in_child(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        in_child(divmod, 1, 0)
    assert capfd.readouterr() == ("", "")


def test_a_class_that_this_processor_cannot_be_is_bad_input() -> None:
    with pytest.raises(InputError, match="--class sse9: this processor can be measured as"):
        environment_of("sse9")
