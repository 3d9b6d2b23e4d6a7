"""Fixtures of the gate's tests."""

from tests.harness.gate.gate_runs import limits, measuring

__all__ = ["limits", "measuring"]
