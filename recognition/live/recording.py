"""The recording of the cameras' own bytes: a thread of its own that waits for the disk and for nothing else.

What waits to be written is bounded. Where the disk is too slow for that, a camera's packets are given up from the one
that finds no room to before the camera's next key frame, so that everything recorded can be decoded; they are counted
and said, when it begins and when it ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from queue import SimpleQueue

from recognition.live.journal import Journal
from recognition.live.keygate import KeyGate
from recognition.recording import Recorder
from recognition.sources.stream import Packet

CAPACITY_BYTES = 64 * 1024 * 1024
"""What may wait: 21 s of four cameras at 6 Mb/s while the disk stalls."""


class PacketRecording:
    """Hands packets to a recorder in the order in which they came; :meth:`run` is the thread's work."""

    def __init__(
        self,
        recorder: Recorder,
        camera_ids: Sequence[str],
        journal: Journal,
        *,
        capacity_bytes: int = CAPACITY_BYTES,
    ) -> None:
        self._recorder, self._camera_ids, self._journal = recorder, camera_ids, journal
        self._capacity_bytes = capacity_bytes
        self._packets: SimpleQueue[Packet | None] = SimpleQueue()
        self._gates = [KeyGate() for _ in camera_ids]
        self._put_bytes = [0] * len(camera_ids)
        """Per camera, so that each is counted by one thread."""
        self._written_bytes = 0
        self.written = [0] * len(camera_ids)
        """Packets per camera."""
        self.lost = [0] * len(camera_ids)
        """Packets per camera for which there was no room."""
        self._said = [0] * len(camera_ids)

    @property
    def waiting_bytes(self) -> int:
        """What waits to be written."""
        return sum(self._put_bytes) - self._written_bytes

    def put(self, packet: Packet) -> None:
        """Have a packet written; returns at once, whether there is room or not. One thread per camera calls it."""
        camera, size = packet.camera, len(packet.encoded)
        gate = self._gates[camera]
        has_room = self.waiting_bytes + size <= self._capacity_bytes
        if has_room and gate.passes(is_key=packet.is_key):
            self._put_bytes[camera] += size
            self._packets.put(packet)
            if self._said[camera] < self.lost[camera]:
                self._say_what_is_lost(camera)
            return
        if self._said[camera] == self.lost[camera]:
            self._journal.say(
                "error",
                f"{self._camera_ids[camera]}: frames are NOT RECORDED, the disk is too slow: "
                f"{self.waiting_bytes / 1e6:.0f} MB wait to be written",
            )
        gate.shut()
        self.lost[camera] += 1

    def _say_what_is_lost(self, camera: int) -> None:
        lost = self.lost[camera] - self._said[camera]
        self._said[camera] = self.lost[camera]
        self._journal.say("error", f"{self._camera_ids[camera]}: {lost} frames were not recorded, now it goes on")

    def close(self) -> None:
        """Let :meth:`run` end when everything is written."""
        self._packets.put(None)

    def run(self) -> None:
        """Write until closed.

        Raises:
            RecordingError: where the disk refuses; what waits is lost.
        """
        while (packet := self._packets.get()) is not None:
            self._recorder.write_packet(packet)
            self._written_bytes += len(packet.encoded)
            self.written[packet.camera] += self._recorder.stopped is None
