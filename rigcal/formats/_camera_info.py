"""A lens as ROS's CameraInfo and Foxglove's CameraCalibration have it: distortion model, D, K, R, P.

``plumb_bob`` is k1 k2 p1 p2 k3, ``rational_polynomial`` adds k4 k5 k6 (longer in ROS where thin prism terms are
zero), and the fisheye of Kannala and Brandt k1..k4 goes by the name ``equidistant`` in ROS and ``kannala_brandt`` in
Foxglove. K is of the raw image; R and P describe a rectified one and are passed over on import.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rigcal.camera import MODELS, Camera
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import coefficients_of

PLUMB_BOB, RATIONAL = "plumb_bob", "rational_polynomial"
_COUNTS: Mapping[str, tuple[int, ...]] = MappingProxyType({PLUMB_BOB: (0, 4, 5), RATIONAL: (8, 12, 14)})


def distortion_of(lens: Camera, fisheye_name: str) -> tuple[str, list[float]]:
    """The name of the distortion model and its coefficients D."""
    if lens.is_fisheye:
        return fisheye_name, lens.distortion.tolist()
    if lens.model == "opencv8":
        return RATIONAL, lens.distortion.tolist()
    return PLUMB_BOB, coefficients_of(lens, MODELS["opencv5"][4:])


def projection_of(lens: Camera) -> list[list[float]]:
    """(3, 4) P of an image that is not rectified: K and no translation."""
    return [[*row, 0.0] for row in lens.matrix.tolist()]


def lens_of(model: Entry, D: Entry, K: Entry, size_wh: tuple[int, int], fisheye_name: str) -> Camera:
    """A lens from the entries of a file.

    Raises:
        FormatEntryError: for another distortion model, or coefficients that do not fit it.
    """
    if model.value == fisheye_name:
        return K.camera("fisheye4", size_wh, np.concatenate([K.focal_and_centre(), D.numbers(4)]))
    if model.text() not in _COUNTS:
        raise model.error("one of " + ", ".join((*_COUNTS, fisheye_name)))
    values = D.numbers(*_COUNTS[model.text()])
    if values[8:].any():
        raise D.error("zeros after k6: no lens model here has thin prism or tilt terms", values[8:].tolist())
    name = "opencv8" if model.value == RATIONAL else "opencv5"
    return K.camera(name, size_wh, np.concatenate([K.focal_and_centre(), values[:8]]))
