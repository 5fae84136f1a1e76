"""The families that there are, by the name that manifests give."""

from __future__ import annotations

from recognition.detectors.family import AnyFamily
from recognition.detectors.fastestdet import FASTESTDET
from recognition.detectors.manifest import AnyManifest, BoxManifest, PeopleManifest, PoseManifest
from recognition.detectors.movenet import MOVENET, MOVENET_MULTIPOSE
from recognition.detectors.rtmpose import RTMPOSE
from recognition.detectors.yolov7 import YOLOV7, YOLOV7_POSE
from recognition.detectors.yolov8 import YOLOV8, YOLOV8_POSE
from recognition.detectors.yolox import YOLOX

BOX_FAMILIES = {"fastestdet": FASTESTDET, "yolov7": YOLOV7, "yolov8": YOLOV8, "yolox": YOLOX}
"""Networks that find boxes of objects, and of people as one class among them."""

PEOPLE_FAMILIES = {"movenet_multipose": MOVENET_MULTIPOSE, "yolov7_pose": YOLOV7_POSE, "yolov8_pose": YOLOV8_POSE}
"""One-stage networks: people with their joints, from the whole image."""

POSE_FAMILIES = {"movenet": MOVENET, "rtmpose": RTMPOSE}
"""Two-stage networks: the joints of one person in a crop; they need the boxes of people."""

FAMILIES: dict[str, AnyFamily] = {**BOX_FAMILIES, **PEOPLE_FAMILIES, **POSE_FAMILIES}
"""All of them."""

FORMS: dict[str, type[AnyManifest]] = {
    **dict.fromkeys(BOX_FAMILIES, BoxManifest),
    **dict.fromkeys(PEOPLE_FAMILIES, PeopleManifest),
    **dict.fromkeys(POSE_FAMILIES, PoseManifest),
}
"""The form of manifest that each family has."""
