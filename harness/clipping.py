"""How much of a gradient an optimiser is given: one rule for all methods, whatever they are made of."""

NORMS_REMEMBERED = 20
SPIKE = 10.0
"""A norm counts in the running mean as at most this many times what was allowed. One spike of any height makes the mean
(10 · 4 − 1) / 20 + 1 = 2.95 times as large at most; norms that last or come again raise it in a few steps, which norms
counted only as they are clipped would not: one in ten batches would be cut to 6 times the others' norm for good."""


class Clipping:
    """To a fixed norm and to a multiple of the usual one: what a fixed bound passes may be a hundred times as much."""

    def __init__(self, norm: float, ratio: float) -> None:
        self.norm = norm
        self.ratio = ratio
        self.usual_norm: float | None = None
        """Running mean of the norm, spikes cut; None before the first that is not zero."""
        self.clipped_steps = 0

    @property
    def allowed(self) -> float:
        """The largest norm that the next gradient may have."""
        return self.norm if self.usual_norm is None else min(self.norm, self.ratio * self.usual_norm)

    def scale(self, norm: float) -> float:
        """What a gradient of that finite norm is multiplied by, in (0, 1]; remembers the norm for those after it."""
        allowed = self.allowed
        if norm > 0.0:
            counted, usual = min(norm, SPIKE * allowed), self.usual_norm
            self.usual_norm = counted if usual is None else usual + (counted - usual) / NORMS_REMEMBERED
        if norm <= allowed:
            return 1.0
        self.clipped_steps += 1
        return allowed / norm
