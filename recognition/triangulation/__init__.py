"""3D points from associated detections.

:mod:`recognition.triangulation.linear` serves the paper's method; :mod:`recognition.triangulation.fusion` is the
robust update of the tracked method.
"""

from recognition.triangulation.linear import (
    MIN_PARALLAX_RAD,
    Points3D,
    triangulate,
    triangulate_objects,
    triangulate_people,
)

__all__ = ["MIN_PARALLAX_RAD", "Points3D", "triangulate", "triangulate_objects", "triangulate_people"]
