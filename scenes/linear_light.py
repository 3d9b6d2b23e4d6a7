"""The light of a single view, for those who want more of it than display colour holds."""

import numpy as np

from scenes.images import read_channels
from scenes.manifest import checked
from scenes.pixels import area_average, decode_srgb, display_from_linear, over_white
from scenes.view_set import ViewSet


def linear_over_white(views: ViewSet, name: str) -> np.ndarray | None:
    """Linear light over white [height, width, 3] of the view `name` at the view set's size, not clipped; None where the
    view set is not ours and holds display colour alone. Errors as in `read_view_set`.

    Display colour is put over white, as everywhere (CONVENTIONS.md), and then decoded; what is brighter than white is
    added. So an image that is the display colour has no error but where the light exceeds what display colour holds.
    """
    if "files" not in views.rendered:
        return None
    channels = read_channels(checked(views.path, views.path / f"{name}.exr", views.rendered))
    rgba = np.stack([channels[channel] for channel in "RGBA"], axis=-1)
    if rgba.shape[1] != views.width:
        rgba = area_average(rgba, views.width)
    return decode_srgb(over_white(display_from_linear(rgba))) + _beyond_white(rgba)


def _beyond_white(rgba: np.ndarray) -> np.ndarray:
    """How much more light [..., 3] comes from each pixel, linear and premultiplied, than if what covers it were white:
    alpha · max(colour − 1, 0)."""
    return np.maximum(rgba[..., :3] - rgba[..., 3:].clip(0.0, 1.0), 0.0)
