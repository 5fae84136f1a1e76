"""Recordings as pictures: mosaics of the views with a floor plan, for people without a viewer of recordings.

Heads are blurred before anything else is drawn, and before a picture leaves this package.
"""

from recognition.viewing.floor import FloorPlan
from recognition.viewing.footage import Footage, frame_span, read_footage
from recognition.viewing.layout import foxglove_layout
from recognition.viewing.render import Picture, Rendering, RenderOptions, scenes_between
from recognition.viewing.video import Codec, VideoWriter, encoder_of

__all__ = [
    "Codec",
    "FloorPlan",
    "Footage",
    "Picture",
    "RenderOptions",
    "Rendering",
    "VideoWriter",
    "encoder_of",
    "foxglove_layout",
    "frame_span",
    "read_footage",
    "scenes_between",
]
