"""A layout for Foxglove: a panel per camera with calibration and annotations, the scene in 3D, and the log.

The form is that of a layout exported by the application (``configById`` and a tree of ``layout``); whoever opens a
recording imports it by Layouts, Import from file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, sqrt
from typing import Any

import numpy as np

from recognition.recording.messages import RIG_FRAME, WORLD_FRAME
from rigcal.geometry import Pose
from rigcal.rig import Rig

SCENE_PANEL, LOG_PANEL = "3D!scene", "RosOut!log"
_FLOOR = {
    "instanceId": "floor", "layerId": "foxglove.Grid", "label": "floor, 1 m", "visible": True, "frameId": WORLD_FRAME,
    "size": 30, "divisions": 30, "lineWidth": 1, "color": "#666666",
}  # fmt: skip


def foxglove_layout(rig: Rig, video_topics: Mapping[str, str]) -> dict[str, Any]:
    """The layout for a rig's recordings, to be written as JSON.

    Args:
        rig: The rig.
        video_topics: The topic of frames of each camera that gets a panel.
    """
    panels = {f"Image!{camera_id}": _image_panel(camera_id, topic) for camera_id, topic in video_topics.items()}
    beside: Any = _split("column", SCENE_PANEL, LOG_PANEL, 75.0)
    return {
        "configById": {**panels, SCENE_PANEL: _scene_panel(rig), LOG_PANEL: {"topicToRender": "/log"}},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", _grid(list(panels)), beside, 65.0) if panels else beside,
    }


def _image_panel(camera_id: str, topic: str) -> dict[str, Any]:
    return {
        "foxglovePanelTitle": camera_id,
        "imageMode": {
            "imageTopic": topic,
            "calibrationTopic": f"/{camera_id}/calibration",
            "synchronize": False,
            "annotations": {f"/{camera_id}/annotations": {"visible": True}},
        },
        "topics": {"/scene": {"visible": False}},
    }


def _scene_panel(rig: Rig) -> dict[str, Any]:
    has_world = rig.world_from_rig is not None
    shown = {f"/{camera_id}/calibration": {"visible": True} for camera_id in rig.camera_ids}
    panel: dict[str, Any] = {
        "foxglovePanelTitle": "scene",
        "followTf": WORLD_FRAME if has_world else RIG_FRAME,
        "followMode": "follow-none",
        "topics": {"/scene": {"visible": True}, "/tf": {"visible": True}, **shown},
        "cameraState": _seen_from(rig),
    }
    if has_world:
        panel["layers"] = {"floor": _FLOOR}
    return panel


def _seen_from(rig: Rig) -> dict[str, Any]:
    """All cameras of the rig, from above one side."""
    places = np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras])
    places = (rig.world_from_rig or Pose.identity()).apply(places)
    low, high = places.min(axis=0), places.max(axis=0)
    return {
        "perspective": True,
        "distance": max(5.0, 1.5 * float(np.linalg.norm(high - low))),
        "phi": 55.0,
        "thetaOffset": 45.0,
        "targetOffset": [*((low + high) / 2)[:2].tolist(), 0.0],
    }


def _grid(panels: Sequence[str]) -> Any:
    columns = ceil(sqrt(len(panels)))
    rows = [_even("row", panels[at : at + columns]) for at in range(0, len(panels), columns)]
    return _even("column", rows)


def _even(direction: str, panels: Sequence[Any]) -> Any:
    """Panels side by side with the same share each, as the tree of splits in two that Foxglove wants."""
    if len(panels) == 1:
        return panels[0]
    return _split(direction, panels[0], _even(direction, panels[1:]), 100.0 / len(panels))


def _split(direction: str, first: Any, second: Any, percentage: float) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}
