"""What every source of frames hands on: packets, one a frame, as the camera encoded them; and what befell the camera.

A stream is a blocking iterator for one thread. Packets come in the order in which they are stored or sent, which is
that of their times wherever :attr:`Packet.is_recordable`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

from recognition.errors import SourceError

if TYPE_CHECKING:
    from recognition.sources.decoding import Decoder


@dataclass(frozen=True, slots=True)
class Packet:
    """One frame of one camera, encoded."""

    camera: int
    """Index of the camera in the rig."""
    number: int
    """Number of the frame in its stream, from 0, in the order of their times; it goes on after an interruption."""
    t_ns: int
    """Capture time in rig time, nanoseconds."""
    receive_ns: int | None
    """When its last byte arrived, in rig time; None for files."""
    encoded: bytes = field(repr=False)
    """The camera's own bytes."""
    encoding: str
    """``h264`` (an Annex B access unit), ``jpeg`` or ``png``; else FFmpeg's name of a codec that only files have."""
    is_key: bool
    """Whether decoding can begin here."""
    is_recordable: bool = True
    """Whether a recording holds ``encoded`` as it is: not so for other codecs, nor for video with reordered frames,
    which players of single messages cannot show. Such a frame is recorded decoded."""

    @property
    def to_record(self) -> tuple[bytes | None, str]:
        """``encoded`` and ``encoding`` where they can be recorded, as a :class:`ViewFrame` has them; None and empty
        otherwise."""
        return (self.encoded, self.encoding) if self.is_recordable else (None, "")


@dataclass(frozen=True, slots=True)
class Interruption:
    """A camera was lost, or is still lost for another reason than was said; the next packet says that it is back."""

    camera: int
    t_ns: int
    """When that was noticed, rig time in nanoseconds."""
    error: SourceError
    """Its message is complete: what, where, what to do next."""

    @property
    def reason(self) -> str:
        """One line: what happened, and what was got."""
        return self.error.what if self.error.got is None else f"{self.error.what}: {self.error.got}"


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A camera's clock was set while it ran.

    Capture times go on as if it had not been: they follow the camera's media clock, which cannot be set, and so stay
    true to the clock model that was measured before. After the next interruption they follow the clock as it is then.
    """

    camera: int
    t_ns: int
    """Capture time of the frame at which it was certain, rig time in nanoseconds."""
    camera_id: str
    step_s: float
    """By how much the camera's clock went ahead."""

    @property
    def reason(self) -> str:
        """One line: what happened, and what to do."""
        return (
            f"the clock of camera {self.camera_id} was set by {self.step_s:+.3f} s while it ran: times go on without "
            "the step until the next interruption; measure its clock again with rigcal sync probe"
        )


StreamEvent: TypeAlias = Packet | Interruption | ClockStep


class Stream(Protocol):
    """A camera, seen as a source of packets."""

    @property
    def camera(self) -> int:
        """Index of the camera in the rig."""

    def packets(self) -> Iterator[StreamEvent]:
        """Packets until the end of a file, or until :meth:`close`; to be run through once.

        Raises:
            CaptureError: where a file cannot be read. A live camera's faults are interruptions, never exceptions.
        """

    def decoder(self) -> Decoder:
        """A decoder for this stream's packets, to be used by one thread."""

    def close(self) -> None:
        """End :meth:`packets`, from any thread and without waiting; a blocked read ends within 2 s, the opening of a
        live camera that does not answer within 10 s."""
