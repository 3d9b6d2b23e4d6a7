"""Processes of a class of processor: what is forced is forced in them, and undone."""

import os

import pytest

from harness.gate.process import OWN, class_here, classes_here, environment_of, forced, in_child, in_children
from scenes.files.errors import InputError


def test_a_child_is_of_the_class_that_is_forced() -> None:
    oldest = classes_here()[0]
    with forced(oldest):
        assert in_child(class_here) == oldest
        with forced(class_here()):
            assert {key: os.environ.get(key) for key in OWN} == OWN
        assert dict(environment_of(oldest)).items() <= dict(os.environ).items() or oldest == class_here()
    assert {key: os.environ.get(key) for key in OWN} == OWN


def test_children_answer_in_order_and_say_what_failed() -> None:
    assert in_children(divmod, [(7, 2), (9, 4)]) == [(3, 1), (2, 1)]
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        in_child(divmod, 1, 0)


def test_a_class_that_this_processor_cannot_be_is_bad_input() -> None:
    with pytest.raises(InputError, match="--class sse9: this processor can be measured as"):
        environment_of("sse9")
