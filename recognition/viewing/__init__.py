"""Recordings as pictures: mosaics of the views with a floor plan, for people without a viewer of recordings.

Heads are blurred before anything else is drawn, and before a picture leaves this package.
"""

from recognition.viewing.footage import Footage, read_footage
from recognition.viewing.layout import foxglove_layout
from recognition.viewing.render import Picture, Rendering, RenderOptions
from recognition.viewing.video import Codec, VideoWriter, encoder_of

__all__ = [
    "Codec",
    "Footage",
    "Picture",
    "RenderOptions",
    "Rendering",
    "VideoWriter",
    "encoder_of",
    "foxglove_layout",
    "read_footage",
]
