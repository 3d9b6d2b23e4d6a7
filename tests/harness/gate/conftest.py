"""Fixtures of the gate's tests."""

from tests.harness.gate.gate_runs import limits, measuring, stored

__all__ = ["limits", "measuring", "stored"]
