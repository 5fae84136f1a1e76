"""MCAP recordings: write, read, check and recover. Only this package imports ``mcap``.

``/CAMERA/video`` or ``/CAMERA/image``, ``/CAMERA/calibration``, ``/CAMERA/annotations``, ``/tf``, ``/scene``,
``/events`` and ``/log`` are Foxglove messages in protobuf; ``/CAMERA/detections`` and ``/tracks`` have schemas of our
own, also protobuf, and hold what a replay places and judges anew. The rig file and the rule file are attachments and
the run's options are metadata, in every segment.
"""

from recognition.recording.annotations import ViewTracks
from recognition.recording.budget import DiskBudget
from recognition.recording.check import RecordingCheck, SequenceCheck, check_recording, check_run, check_sequence
from recognition.recording.detections import DETECTIONS, RecordedView
from recognition.recording.events import EVENTS, SPEAKER, Phase, event_words, recorded_events
from recognition.recording.findings import Finding
from recognition.recording.naming import recording_files, unfinished_notes
from recognition.recording.reader import (
    RecordedMessage,
    holds_tracks,
    iter_detections,
    iter_messages,
    iter_tracks,
    read_metadata,
    read_rig_attachment,
    read_rules_attachment,
    read_segment,
)
from recognition.recording.recover import Recovery, recover_recording
from recognition.recording.tracks import TRACKS, TrackedInstant
from recognition.recording.writer import Recorded, Recorder

__all__ = [
    "DETECTIONS",
    "EVENTS",
    "SPEAKER",
    "TRACKS",
    "DiskBudget",
    "Finding",
    "Phase",
    "Recorded",
    "RecordedMessage",
    "RecordedView",
    "Recorder",
    "RecordingCheck",
    "Recovery",
    "SequenceCheck",
    "TrackedInstant",
    "ViewTracks",
    "check_recording",
    "check_run",
    "check_sequence",
    "event_words",
    "holds_tracks",
    "iter_detections",
    "iter_messages",
    "iter_tracks",
    "read_metadata",
    "read_rig_attachment",
    "read_rules_attachment",
    "read_segment",
    "recorded_events",
    "recording_files",
    "recover_recording",
    "unfinished_notes",
]
