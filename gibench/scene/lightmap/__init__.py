"""The lightmap: an atlas of texels whose valid texels are the receivers, and how it is made."""

from gibench.scene.lightmap.receivers import (
    Fragments,
    Lightmap,
    Receivers,
    some_receivers,
)

__all__ = ["Fragments", "Lightmap", "Receivers", "some_receivers"]
