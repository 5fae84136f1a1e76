"""The exception tree of rigcal.

    RigcalError
    ├── BoardSpecError            a --board string that cannot be read, or a size without a unit
    ├── SiteFileError             a hand-written site file with a mistake
    ├── OptionError               an option of a stage outside its range
    │   └── OptionsError              options that do not go together
    ├── OutputError               a file that cannot be written
    ├── TargetError               a board that cannot be printed as asked
    ├── MeasuredLengthError       a length measured by hand that cannot be read, or between unknown cameras
    ├── CaptureError              a capture folder, image or video that cannot be used
    │   ├── EmptyCaptureError
    │   ├── BrokenFileError
    │   ├── TimestampsError
    │   └── ImageSizeError
    ├── DetectionError            images are readable, the board is not in them
    │   ├── NoBoardError
    │   ├── UnclearBoardError
    │   ├── WrongBoardError
    │   ├── WrongSpacingError
    │   └── MirroredImagesError
    ├── CalibrationError          boards were found, the rig cannot be computed from them
    │   ├── TooFewViewsError
    │   ├── NotConnectedError
    │   └── SisterError               declared alike, but not alike
    ├── RigFileError              a rig file that must not be used
    │   ├── RigFileDigestError
    │   ├── RigFileVersionError
    │   ├── RigFileSchemaError
    │   └── EvidenceError         the residuals beside it are another rig's
    ├── RigCaptureError           a capture that does not belong to the rig file
    ├── TableError                a table of points or pixels that cannot be read
    ├── WorldError                measurements that do not give a floor and a vertical
    │   ├── NotFlatError
    │   ├── BelowFloorError
    │   └── WorldPointError
    ├── DriftError                views that cannot tell which camera moved
    ├── SyncError                 clocks that cannot be measured from what was given
    │   ├── KeypointsFileError        a detections file that is not as documented
    │   ├── ProbeLogError             a log of probes that cannot be read
    │   ├── RecordedClocksError       a recording without frame times
    │   ├── NoExchangesError          no answered probe to tell a clock from
    │   ├── NoStampsError             a capture without frame times
    │   ├── ComparisonError           cameras whose pictures cannot be compared
    │   ├── StampsError               stamps of frames that are no times
    │   ├── TimeHostError             a host that cannot be read, or is no camera's
    │   ├── TracksError               tracks of points that tell no clocks
    │   └── ServeTimeError            the time cannot be served at that address and port
    └── FormatError               another tool's file
        ├── FormatEntryError
        ├── UnknownFormatError
        ├── ForeignNameError
        └── LossyExportError

Every message says what is wrong, where, what was expected, what was got, and what to do next.
"""

from __future__ import annotations

from rigcal.errors._base import OptionError, OptionsError, OutputError, RigcalError, writing
from rigcal.errors._calibration import CalibrationError, NotConnectedError, SisterError, TooFewViewsError
from rigcal.errors._captures import (
    BrokenFileError,
    CaptureError,
    DetectionError,
    EmptyCaptureError,
    ImageSizeError,
    MirroredImagesError,
    NoBoardError,
    TimestampsError,
    UnclearBoardError,
    WrongBoardError,
    WrongSpacingError,
)
from rigcal.errors._formats import ForeignNameError, FormatEntryError, FormatError, LossyExportError, UnknownFormatError
from rigcal.errors._inputs import BoardSpecError, MeasuredLengthError, SiteFileError, TargetError
from rigcal.errors._rigs import (
    BelowFloorError,
    DriftError,
    EvidenceError,
    NotFlatError,
    RigCaptureError,
    RigFileDigestError,
    RigFileError,
    RigFileSchemaError,
    RigFileVersionError,
    TableError,
    WorldError,
    WorldPointError,
)
from rigcal.errors._sync import (
    ComparisonError,
    KeypointsFileError,
    NoExchangesError,
    NoStampsError,
    ProbeLogError,
    RecordedClocksError,
    ServeTimeError,
    StampsError,
    SyncError,
    TimeHostError,
    TracksError,
)

__all__ = [
    "BelowFloorError",
    "BoardSpecError",
    "BrokenFileError",
    "CalibrationError",
    "CaptureError",
    "ComparisonError",
    "DetectionError",
    "DriftError",
    "EmptyCaptureError",
    "EvidenceError",
    "ForeignNameError",
    "FormatEntryError",
    "FormatError",
    "ImageSizeError",
    "KeypointsFileError",
    "LossyExportError",
    "MeasuredLengthError",
    "MirroredImagesError",
    "NoBoardError",
    "NoExchangesError",
    "NoStampsError",
    "NotConnectedError",
    "NotFlatError",
    "OptionError",
    "OptionsError",
    "OutputError",
    "ProbeLogError",
    "RecordedClocksError",
    "RigCaptureError",
    "RigFileDigestError",
    "RigFileError",
    "RigFileSchemaError",
    "RigFileVersionError",
    "RigcalError",
    "ServeTimeError",
    "SisterError",
    "SiteFileError",
    "StampsError",
    "SyncError",
    "TableError",
    "TargetError",
    "TimeHostError",
    "TimestampsError",
    "TooFewViewsError",
    "TracksError",
    "UnclearBoardError",
    "UnknownFormatError",
    "WorldError",
    "WorldPointError",
    "WrongBoardError",
    "WrongSpacingError",
    "writing",
]
