"""COLMAP's lens models, shared by its rig configuration and its model files.

COLMAP has the centre of the first pixel at (0.5, 0.5), so cx and cy are half a pixel larger than here. FULL_OPENCV and
OPENCV_FISHEYE hold every lens model, so nothing is ever lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rigcal.camera import MODELS, Camera
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import coefficients_of

HALF_PIXEL = 0.5
COEFFICIENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "SIMPLE_PINHOLE": ("f", "cx", "cy"),
        "PINHOLE": ("fx", "fy", "cx", "cy"),
        "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
        "RADIAL": ("f", "cx", "cy", "k1", "k2"),
        "OPENCV": MODELS["opencv4"],
        "OPENCV_FISHEYE": MODELS["fisheye4"],
        "FULL_OPENCV": MODELS["opencv8"],
    }
)
"""COLMAP's parameters of each model, in its order; f is fx and fy."""
_COLMAP_MODEL = {
    "opencv4": "OPENCV",
    "opencv5": "FULL_OPENCV",
    "opencv8": "FULL_OPENCV",
    "fisheye4": "OPENCV_FISHEYE",
}


def colmap_lens(lens: Camera) -> tuple[str, list[float]]:
    """COLMAP's model name and parameters of a lens."""
    model = _COLMAP_MODEL[lens.model]
    params = coefficients_of(lens, COEFFICIENTS[model])
    params[2], params[3] = params[2] + HALF_PIXEL, params[3] + HALF_PIXEL
    return model, params


def lens_of_colmap(name: Entry, params: Entry, size: Entry) -> Camera:
    """The lens of a model name, its parameters, and the image's width and height.

    Raises:
        FormatEntryError: for a model that rigcal does not have, or a malformed entry.
    """
    if name.text() not in COEFFICIENTS:
        raise name.error("one of " + ", ".join(COEFFICIENTS))
    names = COEFFICIENTS[name.text()]
    values = dict(zip(names, params.numbers(len(names)).tolist(), strict=True))
    if "f" in values:
        values["fx"] = values["fy"] = values.pop("f")
    values["cx"], values["cy"] = values["cx"] - HALF_PIXEL, values["cy"] - HALF_PIXEL
    model = _smallest_model(name.text(), values)
    return params.camera(model, size.size_wh(), np.array([values.get(key, 0.0) for key in MODELS[model]]))


def _smallest_model(colmap_model: str, values: Mapping[str, float]) -> str:
    """opencv5 is written as FULL_OPENCV with k4 k5 k6 of 0, and is read back as what it was."""
    if colmap_model == "OPENCV_FISHEYE":
        return "fisheye4"
    if colmap_model != "FULL_OPENCV":
        return "opencv4"
    return "opencv8" if any(values[name] for name in ("k4", "k5", "k6")) else "opencv5"
