"""MCAP recordings: write, read, check and recover. Only this package imports ``mcap``.

``/CAMERA/video`` or ``/CAMERA/image``, ``/CAMERA/calibration``, ``/CAMERA/annotations``, ``/tf``, ``/scene`` and
``/log`` are Foxglove messages in protobuf; ``/CAMERA/detections`` has a schema of our own, also protobuf, and holds
what a replay computes from. The rig file is an attachment and the run's options are metadata, in every segment.
"""

from recognition.recording.annotations import ViewTracks
from recognition.recording.budget import DiskBudget
from recognition.recording.check import RecordingCheck, SequenceCheck, check_recording, check_run, check_sequence
from recognition.recording.detections import DETECTIONS, RecordedView
from recognition.recording.findings import Finding
from recognition.recording.naming import recording_files, unfinished_notes
from recognition.recording.reader import (
    RecordedMessage,
    iter_detections,
    iter_messages,
    read_metadata,
    read_rig_attachment,
    read_segment,
)
from recognition.recording.recover import Recovery, recover_recording
from recognition.recording.writer import Recorded, Recorder

__all__ = [
    "DETECTIONS",
    "DiskBudget",
    "Finding",
    "Recorded",
    "RecordedMessage",
    "RecordedView",
    "Recorder",
    "RecordingCheck",
    "Recovery",
    "SequenceCheck",
    "ViewTracks",
    "check_recording",
    "check_run",
    "check_sequence",
    "iter_detections",
    "iter_messages",
    "read_metadata",
    "read_rig_attachment",
    "read_segment",
    "recording_files",
    "recover_recording",
    "unfinished_notes",
]
