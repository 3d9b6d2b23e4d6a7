"""How much of a gradient an optimiser is given: one rule for all methods, whatever they are made of."""

NORMS_REMEMBERED = 20


class Clipping:
    """To a fixed norm and to a multiple of the usual one: what a fixed bound passes may be a hundred times as much."""

    def __init__(self, norm: float, ratio: float) -> None:
        self.norm = norm
        self.ratio = ratio
        self.usual_norm: float | None = None
        """Running mean of the norm of clipped gradients; None before the first that is not zero."""

    def allowed(self, norm: float) -> float:
        """What a gradient of that norm is clipped to; remembers it for those after it."""
        usual = self.usual_norm
        allowed = self.norm if usual is None else min(self.norm, self.ratio * usual)
        if norm > 0.0:
            clipped = min(norm, allowed)
            self.usual_norm = clipped if usual is None else usual + (clipped - usual) / NORMS_REMEMBERED
        return allowed
