"""One camera of a live run: its packets to the recording, its frames to the gathering, and what is wrong with it.

Two threads serve a camera. The receiver takes packets as they come and waits for nothing: every packet goes to the
recording, then to the decoder if that has room. The decoder works through what it was given. A decoder that falls
behind by :data:`CAPACITY` packets loses them and gets nothing more until the next key frame, counted; the recording is
not concerned.
After a frame that cannot be decoded nothing is shown to the networks up to the next key frame either: what decoders
make of the rest is smeared.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, Queue
from threading import Event

from recognition.live.gathering import Gathering
from recognition.live.journal import Journal, Level
from recognition.live.keygate import KeyGate
from recognition.live.recording import PacketRecording
from recognition.monitoring import ClockWatch
from recognition.recording.messages import jpeg
from recognition.sources.decoding import DecodedFrame, Decoder
from recognition.sources.stream import ClockStep, Interruption, Packet, Stream
from rigcal.errors import RigcalError

_NOT_YET, _ENDED, _LATE = "it has not sent anything yet", "its stream has ended", "there is no time to decode it"
CAPACITY = 60
"""Packets that may wait for the decoder: two seconds at 30 fps, after which catching up helps nobody."""


@dataclass(frozen=True, slots=True)
class Shared:
    """What the cameras of a run share."""

    recording: PacketRecording
    gathering: Gathering[DecodedFrame]
    journal: Journal
    stopping: Event


class _Undecoded:
    """Packets that were not decoded."""

    def __init__(self) -> None:
        self.count = self.unrecorded = 0

    def add(self, packet: Packet) -> None:
        self.count += 1
        self.unrecorded += not packet.is_recordable


class LiveCamera:
    """A camera's two threads, :meth:`receive` and :meth:`decode`, and its counts."""

    def __init__(self, camera_id: str, stream: Stream, shared: Shared) -> None:
        self.camera_id, self.index = camera_id, stream.camera
        self._stream, self._shared = stream, shared
        self._packets: Queue[Packet | None] = Queue(CAPACITY + 1)
        self._gate, self._broken = KeyGate(), KeyGate()
        self._watch, self._step_s = ClockWatch(), 0.0
        self._clock_fault: str | None = None
        self._blindness: str | None = None
        self._lateness: str | None = None
        self._said: set[str] = set()
        self._loss: str | None = _NOT_YET
        self._lost_ns: int | None = None
        """Since when; None where it is there, or was never lost."""
        self.received = 0
        self.corrupt = 0
        """Frames that could not be decoded; packets among them count as undecoded too."""
        self._not_given, self._passed_over = _Undecoded(), _Undecoded()
        """By the receiver and by the decoder, so that each is counted by one thread."""
        self.interruptions = 0
        self.lag_ns: int | None = None
        """Of the latest packet: arrival minus capture; None while the camera is lost."""

    @property
    def undecoded(self) -> int:
        """Packets that the decoder had no room for, or that came before the key frame which let it go on."""
        return self._not_given.count + self._passed_over.count

    @property
    def unrecorded(self) -> int:
        """Packets of which only decoded frames could have been recorded, and that were not decoded."""
        return self._not_given.unrecorded + self._passed_over.unrecorded

    @property
    def fault(self) -> str | None:
        """What is wrong with it; None: nothing is."""
        known = (self._loss, self._blindness, self._lateness, self._clock_fault, self._watch.fault)
        return ", ".join(filter(None, known)) or None

    def judge_clock_model(self, fault: str | None) -> None:
        """Why its clock model cannot be trusted now; None where it can."""
        if fault is not None and self._clock_fault is None:
            self._say("error", f"NOT USED, {fault}")
            self._shared.gathering.lose(self.index)
        self._clock_fault = fault

    def broken(self, error: RigcalError) -> None:
        """A frame of it cannot be made an image of; where others build on it, they wait for the next key frame."""
        self.corrupt += 1
        self._blindness = error.what
        self._say_once("error", f"frames cannot be used up to the next key frame: {error.what}")

    def close(self) -> None:
        """End the stream; both threads end soon after."""
        self._stream.close()

    def receive(self) -> None:
        """Take packets until the stream ends."""
        try:
            for item in self._stream.packets():
                match item:
                    case Packet():
                        self._received(item)
                    case Interruption():
                        self._interrupted(item)
                    case ClockStep():
                        self._step_s += item.step_s
                        self._say("warning", item.reason)
            if not self._shared.stopping.is_set():
                self._loss = _ENDED
        except RigcalError as error:
            self._loss = error.what
            self._say("error", f"the camera is lost for good: {error.what}")
        finally:
            self._packets.put(None)

    def decode(self) -> None:
        """Decode until the receiver ends."""
        try:
            decoder = self._stream.decoder()
            while (packet := self._packets.get()) is not None:
                if not self._shared.stopping.is_set():
                    self._decode(decoder, packet)
            self._deliver(decoder.flush())
        finally:
            self._shared.gathering.end(self.index)

    def _received(self, packet: Packet) -> None:
        if packet.is_recordable:
            self._shared.recording.put(packet)
        if self._loss is not None:
            if self._lost_ns is not None:
                self._say("warning", f"the camera is back after {(packet.t_ns - self._lost_ns) * 1e-9:.1f} s")
            self._loss = self._lost_ns = None
        self.received += 1
        self.lag_ns = None if packet.receive_ns is None else packet.receive_ns - packet.t_ns
        self._judge_clock(packet)
        if self._packets.qsize() < CAPACITY and self._gate.passes(is_key=packet.is_key):
            self._lateness = None
            self._packets.put(packet)
        else:
            self._leave_undecoded(packet)

    def _leave_undecoded(self, packet: Packet) -> None:
        """Give up a packet, and what waits before it: nothing that is two seconds old is worth decoding."""
        self._gate.shut()
        self._not_given.add(packet)
        with suppress(Empty):
            while (waiting := self._packets.get_nowait()) is not None:
                self._not_given.add(waiting)
        self._lateness = _LATE
        self._shared.gathering.lose(self.index)
        self._say_once("warning", f"{_LATE}: frames up to the next key frame are recorded, but not looked at")

    def _judge_clock(self, packet: Packet) -> None:
        before = self._watch.fault
        self._watch.see(packet.t_ns, packet.receive_ns)
        if self._watch.fault != before:
            if self._watch.fault:
                self._say("error", f"NOT USED, {self._watch.fault}")
                self._shared.gathering.lose(self.index)
            else:
                self._say("warning", "its clock is back where it was, the camera is used again")

    def _interrupted(self, item: Interruption) -> None:
        where = f" ({item.error.where})" if item.error.where else ""
        self._say("error", f"the camera is lost: {item.reason}{where}; {item.error.do_next}")
        self.interruptions += self._loss is None
        self._loss, self.lag_ns = f"lost: {item.reason}", None
        self._lost_ns = self._lost_ns or item.t_ns
        self._watch.interrupted(self._step_s)
        self._gate.shut()
        self._shared.gathering.lose(self.index)

    def _decode(self, decoder: Decoder, packet: Packet) -> None:
        if not self._broken.passes(is_key=packet.is_key):
            self._passed_over.add(packet)
            return
        self._blindness = None
        try:
            frames = decoder.decode(packet)
        except RigcalError as error:
            self.broken(error)
            self._passed_over.add(packet)
            self._broken.shut()
            self._shared.gathering.lose(self.index)
        else:
            self._deliver(frames)

    def _deliver(self, frames: Sequence[DecodedFrame]) -> None:
        for frame in frames:
            if not frame.packet.is_recordable:
                self._record_decoded(frame)
            if self._clock_fault is None and self._watch.fault is None:
                self._shared.gathering.add(self.index, frame.packet.t_ns, frame)

    def _record_decoded(self, frame: DecodedFrame) -> None:
        encoded = jpeg(frame.image_bgr())
        self._shared.recording.put(replace(frame.packet, encoded=encoded, encoding="jpeg", is_key=True))

    def _say_once(self, level: Level, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            self._say(level, text)

    def _say(self, level: Level, text: str) -> None:
        self._shared.journal.say(level, f"{self.camera_id}: {text}")
