"""Families of radiance fields at budgets of core seconds: error against time, and who is ahead how surely."""
