"""Families of radiance fields at budgets of core seconds: who is ahead how surely; imports `evidence` and below."""
