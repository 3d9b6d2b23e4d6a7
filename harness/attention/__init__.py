"""Attention-prioritised rendering (§8.2, Eq. 7): which regions of a view are rendered first, and with how many samples.

The paper's "consciousness bridge" is no more than the formula; what follows from it is in `priorities`.
"""
