"""The exception tree of recognition; messages have the form of :class:`rigcal.errors.RigcalError`.

RecognitionError
├── RigRefusedError           the rig file is valid, but must not be run
├── SourceError               a video, image folder or detection file that cannot be used
│   ├── DetectionsFileError
│   ├── BrokenFrameError      a frame that cannot be decoded; the next ones may be
│   └── StreamError           a live camera that cannot be used, or not any more
├── DatasetError              a data set with a truth that cannot be evaluated
├── ModelError                a network or its manifest that cannot be used
├── AlarmsError               an alarms file, or the queue that it names, that cannot be used
├── AnswerError               an operator's answer that cannot be taken
├── RulesError                a rule file with a mistake
├── BatchError                recordings that cannot be gone through as asked
├── CommissionError           a walk or a commissioning record that cannot be used
├── EventsError               an events file, or events of a recording, that cannot be used
└── RecordingError            an MCAP file that cannot be written, read or recovered
    └── NoRoomError
"""

from __future__ import annotations

from pathlib import Path

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


class RulesError(RecognitionError):
    """A rule file with a mistake; ``line`` and ``column`` say where, both from 1."""

    def __init__(
        self, problem: str, *, where: Path | str, line: int, column: int, expected: str, got: object, do_next: str
    ) -> None:
        self.line, self.column = line, column
        super().__init__(
            f"rule file: {problem}", where=f"{where}:{line}:{column}", expected=expected, got=got, do_next=do_next
        )


class BatchError(RecognitionError):
    """Recordings that cannot be gone through as asked; one that cannot be judged is a row of the result instead."""


class CommissionError(RecognitionError):
    """A walk or a commissioning record that cannot be used, or that stands for something else."""


class EventsError(RecognitionError):
    """An events file, or events of a recording, that cannot be used."""


class AlarmsError(RecognitionError):
    """An alarms file, or the queue that it names, that cannot be used; its message shows nothing out of the file."""


class AnswerError(RecognitionError):
    """An operator's answer that cannot be taken."""


class RecordingError(RecognitionError):
    """A recording that cannot be written, read or recovered."""


class NoRoomError(RecordingError):
    """A recording that its disk has no room for."""
