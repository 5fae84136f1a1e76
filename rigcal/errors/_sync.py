"""Clocks: hosts that do not answer, samples and content that do not give a clock."""

from __future__ import annotations

from pathlib import Path

from rigcal.errors._base import RigcalError


class SyncError(RigcalError):
    """Clocks that cannot be measured from what was given."""


class TimeHostError(SyncError):
    """A host that is to tell a camera's time cannot be read, or is no camera's."""


class ServeTimeError(SyncError):
    """The time cannot be served at the address and port that were asked for."""


class KeypointsFileError(SyncError):
    """A file of 2D detections that is not as documented."""

    def __init__(self, path: Path, problem: str, *, expected: str, got: object) -> None:
        super().__init__(
            f"detections file: {problem}",
            where=path,
            expected=expected,
            got=got,
            do_next="write the arrays det_frame, det_view, det_kpts (and frame_time_s where there are times) as "
            "recognition/README.md describes them",
        )


class TracksError(SyncError):
    """Tracks of points from which no clocks can be told."""

    def __init__(self, what: str, *, expected: str, got: object) -> None:
        super().__init__(what, expected=expected, got=got, do_next="give the tracks of one recording of this rig")


class ProbeLogError(SyncError):
    """A file is no log of probes, or a row of it is malformed."""

    def __init__(self, path: Path, *, problem: str, expected: str, got: str, do_next: str) -> None:
        super().__init__(problem, where=path, expected=expected, got=got, do_next=do_next)


class RecordedClocksError(SyncError):
    """A recording does not say when its frames were taken."""


class NoStampsError(SyncError):
    """A capture does not say when its frames were taken."""

    def __init__(self, path: Path) -> None:
        super().__init__(
            "the capture does not say when its frames were taken",
            where=path,
            expected="timestamps.csv, times in the names of images, or videos with presentation times",
            got="images without times",
            do_next="write timestamps.csv with columns cam_id, frame_time (seconds), or let the recorder name images "
            "by their time, such as 20260412T093001.250000Z.jpg",
        )


class StampsError(SyncError):
    """Stamps of frames that are no times."""

    def __init__(self, *, problem: str, expected: str, got: str) -> None:
        super().__init__(problem, expected=expected, got=got, do_next="leave those frames out, or mend their stamps")


class ComparisonError(SyncError):
    """Cameras whose pictures cannot be compared."""

    def __init__(self, problem: str, *, expected: str, got: object, do_next: str) -> None:
        super().__init__(problem, expected=expected, got=got, do_next=do_next)


class NoExchangesError(SyncError):
    """No exchange with a host from which its clock can be told."""

    def __init__(self, *, impossible: int) -> None:
        if impossible:
            got = f"{impossible} answered, each before it was asked by one of the two clocks"
            do_next = "let nothing set the clocks of this computer or of the host meanwhile, and probe again"
        else:
            got = "no answer"
            do_next = "start `rigcal sync serve` (or chronyd) on the host, let UDP to it pass the firewall, probe again"
        super().__init__(
            "the host's clock cannot be told from its answers",
            expected="one answered probe at least, better 60",
            got=got,
            do_next=do_next,
        )
