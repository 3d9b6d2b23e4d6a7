"""Plain descriptions, loaded as a scene without a place in the catalogue."""

from scenes.modelling.scene import Description, Scene
from scenes.rendering.render import LoadedScene
from scenes.rendering.variant import Variant


def load(
    description: Description, variant: Variant, size: int, width: int | None = None, max_depth: int = 4,
    emitters_seen: bool = False,
) -> LoadedScene:  # fmt: skip
    scene = Scene("test", "A test scene", lambda: description, max_depth=max_depth, emitters_seen=emitters_seen)
    return LoadedScene(scene, description, variant, width or size, size)
