"""The exception tree of recognition; messages have the form of :class:`rigcal.errors.RigcalError`.

RecognitionError
├── RigRefusedError           the rig file is valid, but must not be run
├── SourceError               a video, image folder or detection file that cannot be used
│   ├── DetectionsFileError
│   ├── BrokenFrameError      a frame that cannot be decoded; the next ones may be
│   └── StreamError           a live camera that cannot be used, or not any more
├── DatasetError              a data set with a truth that cannot be evaluated
├── ModelError                a network or its manifest that cannot be used
└── RecordingError            an MCAP file that cannot be written, read or recovered
    └── NoRoomError
"""

from __future__ import annotations

from rigcal.errors import RigcalError


class RecognitionError(RigcalError):
    """A problem that the user can mend; its message is complete and is shown without a traceback."""


class RigRefusedError(RecognitionError):
    """The rig file is valid, but its verdict or its cameras forbid the run."""


class SourceError(RecognitionError):
    """A source of frames or detections that cannot be used."""


class DetectionsFileError(SourceError):
    """A detections file that does not have the documented form."""


class DatasetError(RecognitionError):
    """A data set that cannot be evaluated."""


class BrokenFrameError(SourceError):
    """A frame that cannot be decoded; the next ones may be."""


class StreamError(SourceError):
    """A live camera that cannot be used, or not any more; its message never shows credentials."""


class ModelError(RecognitionError):
    """A network or its manifest that cannot be used."""


class RecordingError(RecognitionError):
    """A recording that cannot be written, read or recovered."""


class NoRoomError(RecordingError):
    """A recording that its disk has no room for."""
