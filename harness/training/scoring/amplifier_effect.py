"""The effect of the amplifier on a trained method's pictures: the same weights, rendered without Eq. 4."""

from baselines.amplifiers import without_effect
from baselines.numerics.encoding import PHI
from harness.training.batches import Cameras
from harness.training.learner import Learner
from harness.training.scoring.evaluate import mean_of, render_view, spread_indices, view_scores
from scenes.view_sets.view_set import Split

VIEWS = 3
"""The test views that are rendered again, evenly spread."""


def amplifier_effect(
    trainer: Learner, cameras: Cameras, split: Split, scored: list[float | None], chunk: int
) -> dict[str, float | None]:
    """Return `alpha_phi`, the factor α φ of Eq. 4, which is the identity at 1, and `psnr_without_amplifier`, the change
    of PSNR in dB if Eq. 4 and β are removed after training, mean over `VIEWS` views; nothing for a method without an
    amplifier. `scored` is the PSNR of every view of `split` as the method renders it.
    """
    alpha = trainer.amplifier_scalars()["alpha"]
    if alpha is None:
        return {}
    chosen = spread_indices(VIEWS, len(cameras))
    with without_effect(getattr(field, "amplifier", None) for field in trainer.fields.children()):
        again = [
            view_scores(render_view(trainer, cameras, index, chunk), split, index, ("psnr",)).psnr for index in chosen
        ]
    changes = (
        None if before is None or after is None else after - before
        for before, after in zip((scored[index] for index in chosen), again, strict=True)
    )
    return {"alpha_phi": alpha * PHI, "psnr_without_amplifier": mean_of(changes)}
