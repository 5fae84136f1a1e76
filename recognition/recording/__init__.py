"""MCAP recordings: write, read, check and recover. Only this package imports ``mcap``.

``/CAMERA/video`` or ``/CAMERA/image``, ``/CAMERA/calibration``, ``/CAMERA/annotations``, ``/tf``, ``/scene`` and
``/log`` are Foxglove messages in protobuf; the rig file is an attachment and the run's options are metadata.
"""

from recognition.recording.annotations import ViewTracks
from recognition.recording.check import RecordingCheck, check_recording
from recognition.recording.findings import Finding
from recognition.recording.reader import RecordedMessage, iter_messages, read_metadata, read_rig_attachment
from recognition.recording.recover import Recovery, recover_recording
from recognition.recording.writer import Recorded, Recorder

__all__ = [
    "Finding",
    "Recorded",
    "RecordedMessage",
    "Recorder",
    "RecordingCheck",
    "Recovery",
    "ViewTracks",
    "check_recording",
    "iter_messages",
    "read_metadata",
    "read_rig_attachment",
    "recover_recording",
]
