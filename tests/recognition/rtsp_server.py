"""A camera that speaks RTSP on the loopback interface, with faults on demand and a clock whose truth is known.

Interleaved TCP (RFC 2326, 10.12); H.264 as single NAL units and FU-A (RFC 6184, 5.6 and 5.8); RTCP sender reports
(RFC 3550, 6.4.1). Frame ``k`` of a server is taken at ``true_ns(k)``, counted over the loops of its clip; sender
reports say so by a clock with the skew, drift, steps and jitter of its :class:`Camera`.

In a test (after ``sys.path.insert(0, str(Path(__file__).parent))``)::

    from rtsp_server import Camera, Clip, RtspServer, serve_live

    with RtspServer({"cam0": Clip.of_video(path)}, Camera(pace=None)) as server:
        stream = RtspStream(0, "cam0", StreamUrl(server.url("cam0")), None)

Live, paced in real time and looped, one path per camera, all on one timeline::

    with serve_live({"cam0": Path("cam0.mp4"), "cam1": Path("cam1.mp4")}) as server:
        urls = [server.url("cam0"), server.url("cam1")]     # rtsp://127.0.0.1:PORT/cam0
        ...
        server.sent["cam0"]                                 # numbers of the frames sent to the path's last client

From a shell: ``python tests/recognition/rtsp_server.py cam0=cam0.mp4 cam1=cam1.mp4`` prints the URLs and serves.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import random
import struct
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import av
from av.bitstream import BitStreamFilterContext

RTP_HZ = 90_000
NTP_UNIX_S = 2_208_988_800
SSRC, PAYLOAD_TYPE, MTU = 0x5EED_CA4E, 96, 1400
IDR, SPS, PPS, FU_A = 5, 7, 8, 28


@dataclass(frozen=True)
class Clip:
    """Access units of a video, each a tuple of NAL units without start codes; the first is an IDR."""

    units: tuple[tuple[bytes, ...], ...]
    fps: float

    @classmethod
    def of_video(cls, path: Path) -> Clip:
        """The H.264 of an mp4 without B-frames, as it is stored."""
        units = []
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            fps = float(stream.average_rate)
            to_annex_b = BitStreamFilterContext("h264_mp4toannexb", stream)
            for packet in container.demux(stream):
                if packet.size:
                    units += [nal_units(bytes(filtered)) for filtered in to_annex_b.filter(packet)]
        return cls(tuple(units), fps)

    @property
    def parameter_sets(self) -> tuple[bytes, ...]:
        return tuple(nal for nal in self.units[0] if nal[0] & 0x1F in (SPS, PPS))


@dataclass(frozen=True)
class Camera:
    """How the camera behaves; of a server it may be replaced between two connections."""

    pace: float | None = 1.0
    """Speed of the frames, 1 for real time from the present on; None: every frame from ``first`` on at once."""
    loop: bool = False
    first: int = 0
    skew_s: float = 0.0
    """Camera clock less true time."""
    drift_ppm: float = 0.0
    jitter_s: float = 0.0
    """Half-width of the uniform error of each sender report."""
    step_at: int | None = None
    """Frame at which the camera clock is set by ``step_s``."""
    step_s: float = 0.0
    reports: bool = True
    has_wall_clock: bool = True
    """Whether reports say the time: RFC 3550 allows 0 instead."""
    first_report_s: float = 0.2
    """Media time of the first sender report; the others follow every ``report_every_s``."""
    report_every_s: float = 1.0
    lose: frozenset[int] = frozenset()
    """Frames whose last RTP packet is lost."""
    freeze_at: int | None = None
    hang_up_at: int | None = None
    jump_at: int | None = None
    """Frame from which RTP times are ahead by ``jump_s``."""
    jump_s: float = 0.0
    password: str | None = None
    """Of the user ``viewer``; None: everybody may look."""
    media: str = "H264"
    """``H264``; ``H265`` or ``audio``: what the description says instead."""
    parameter_sets_in_band: bool = True
    is_present: bool = True
    """Whether a path exists: 404 otherwise."""


@dataclass
class RtspServer:
    """Serves clips by path; use it in a ``with`` block."""

    clips: Mapping[str, Clip]
    camera: Camera = field(default_factory=Camera)
    host: str = "127.0.0.1"

    def __post_init__(self) -> None:
        self.epoch_ns = time.time_ns()
        self.sent: dict[str, list[int]] = {}
        self.connections = 0
        self._loop = asyncio.new_event_loop()
        self._clients: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._loop.run_forever, name="rtsp-server")

    def __enter__(self) -> RtspServer:
        self._thread.start()
        starting = asyncio.run_coroutine_threadsafe(asyncio.start_server(self._client, self.host, 0), self._loop)
        self._server = starting.result(5)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result(5)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def url(self, path: str, login: str = "") -> str:
        """The URL of a path, ``login`` (``viewer:secret``) in it where there is one."""
        return f"rtsp://{login + '@' if login else ''}{self.host}:{self.port}/{path}"

    def true_ns(self, frame: int, path: str = "") -> int:
        """When frame ``frame`` was taken: true time, nanoseconds since 1970."""
        fps = self.clips[path or next(iter(self.clips))].fps
        return self.epoch_ns + round(frame * 1e9 / fps)

    async def _stop(self) -> None:
        self._server.close()
        for _ in range(5):  # connections that were accepted just now begin, so that they are known
            await asyncio.sleep(0)
        for task in self._clients:
            task.cancel()
        await asyncio.gather(*self._clients, return_exceptions=True)
        await self._server.wait_closed()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        self.connections += 1
        playing: asyncio.Task[None] | None = None
        try:
            while request := await _request(reader):
                method, url, headers = request
                path = url.split("://", 1)[-1].partition("/")[2].split("/")[0]
                status, answer, body = self._answer(method, path, headers)
                writer.write(_response(status, {"CSeq": headers["cseq"], **answer}, body))
                await writer.drain()
                if method == "PLAY" and status.startswith("200"):
                    playing = asyncio.create_task(self._play(path, writer))
                if method == "TEARDOWN":
                    break
        except (ConnectionError, asyncio.IncompleteReadError, asyncio.CancelledError):
            pass
        finally:
            if playing:
                playing.cancel()
                await asyncio.gather(playing, return_exceptions=True)
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()
            self._clients.discard(task)

    def _answer(self, method: str, path: str, headers: Mapping[str, str]) -> tuple[str, dict[str, str], bytes]:
        camera = self.camera
        if method == "OPTIONS":
            return "200 OK", {"Public": "OPTIONS, DESCRIBE, SETUP, PLAY, GET_PARAMETER, TEARDOWN"}, b""
        login = base64.b64encode(f"viewer:{camera.password}".encode()).decode()
        if camera.password is not None and headers.get("authorization") != f"Basic {login}":
            return "401 Unauthorized", {"WWW-Authenticate": 'Basic realm="camera"'}, b""
        if not camera.is_present or path not in self.clips:
            return "404 Not Found", {}, b""
        if method == "DESCRIBE":
            return "200 OK", {"Content-Type": "application/sdp"}, self._description(self.clips[path])
        if method == "SETUP":
            return "200 OK", {"Transport": "RTP/AVP/TCP;unicast;interleaved=0-1", "Session": "1;timeout=60"}, b""
        return "200 OK", {"Session": "1"}, b""

    def _description(self, clip: Clip) -> bytes:
        if self.camera.media == "audio":
            media = ["m=audio 0 RTP/AVP 0", "a=control:track0"]
        else:
            sets = ",".join(base64.b64encode(nal).decode() for nal in clip.parameter_sets)
            form = f";sprop-parameter-sets={sets}" if self.camera.media == "H264" else ""
            media = [
                f"m=video 0 RTP/AVP {PAYLOAD_TYPE}",
                f"a=rtpmap:{PAYLOAD_TYPE} {self.camera.media}/{RTP_HZ}",
                f"a=fmtp:{PAYLOAD_TYPE} packetization-mode=1{form}",
                "a=control:track0",
            ]
        return "\r\n".join(["v=0", "o=- 0 0 IN IP4 127.0.0.1", "s=test", "t=0 0", *media, ""]).encode()

    async def _play(self, path: str, writer: asyncio.StreamWriter) -> None:
        camera, clip = self.camera, self.clips[path]
        sent = self.sent[path] = []
        frame = camera.first
        if camera.pace:
            frame = max(frame, int((time.time_ns() - self.epoch_ns) * 1e-9 * clip.fps * camera.pace) + 1)
        sender = _Sender(camera, clip, self.epoch_ns, (frame - 1) / clip.fps)
        with contextlib.suppress(ConnectionError):
            while camera.loop or frame < len(clip.units):
                if frame == camera.freeze_at:
                    await asyncio.Event().wait()
                if frame == camera.hang_up_at:
                    break
                if camera.pace:
                    due_ns = self.epoch_ns + frame * 1e9 / clip.fps / camera.pace
                    await asyncio.sleep(max(due_ns - time.time_ns(), 0) * 1e-9)
                writer.write(b"".join(sender.packets(frame)))
                await writer.drain()
                sent.append(frame)
                frame += 1
            writer.close()


class _Sender:
    """Makes the interleaved RTP and RTCP packets of one session."""

    def __init__(self, camera: Camera, clip: Clip, epoch_ns: int, start_s: float) -> None:
        self.camera, self.clip, self.epoch_ns = camera, clip, epoch_ns
        self.random = random.Random(7)
        self.sequence, self.base = 65_500, 2**32 - 100_000  # both wrap early
        self.report_due_s = start_s + camera.first_report_s

    def packets(self, frame: int) -> Iterator[bytes]:
        """Of one frame, and the sender report before it where one is due."""
        camera, media_s = self.camera, frame / self.clip.fps
        ahead_s = camera.jump_s if camera.jump_at is not None and frame >= camera.jump_at else 0.0
        rtp_time = (self.base + round((media_s + ahead_s) * RTP_HZ)) % 2**32
        if camera.reports and media_s >= self.report_due_s:
            self.report_due_s += camera.report_every_s
            yield _interleaved(1, self._report(frame, media_s, rtp_time))
        payloads = list(self._payloads(self.clip.units[frame % len(self.clip.units)]))
        for index, payload in enumerate(payloads):
            last = index == len(payloads) - 1
            self.sequence = (self.sequence + 1) % 2**16
            if not (last and frame in camera.lose):
                header = struct.pack(">BBHII", 0x80, PAYLOAD_TYPE | last << 7, self.sequence, rtp_time, SSRC)
                yield _interleaved(0, header + payload)

    def _report(self, frame: int, media_s: float, rtp_time: int) -> bytes:
        camera = self.camera
        stepped = camera.step_s if camera.step_at is not None and frame >= camera.step_at else 0.0
        error_s = camera.skew_s + stepped + camera.drift_ppm * 1e-6 * media_s
        error_s += self.random.uniform(-camera.jitter_s, camera.jitter_s)
        ntp = ((self.epoch_ns + round((media_s + error_s) * 1e9) + NTP_UNIX_S * 10**9) << 32) // 10**9
        known = ntp if camera.has_wall_clock else 0
        return struct.pack(">BBHIQIII", 0x80, 200, 6, SSRC, known, rtp_time, 0, 0)

    def _payloads(self, nals: Sequence[bytes]) -> Iterator[bytes]:
        for nal in nals:
            if nal[0] & 0x1F in (SPS, PPS) and not self.camera.parameter_sets_in_band:
                continue
            if len(nal) <= MTU:
                yield nal
                continue
            pieces = [nal[i : i + MTU] for i in range(1, len(nal), MTU)]
            for index, piece in enumerate(pieces):
                ends = (index == 0) << 7 | (index == len(pieces) - 1) << 6
                yield bytes([nal[0] & 0xE0 | FU_A, ends | nal[0] & 0x1F]) + piece


def nal_units(annex_b: bytes) -> tuple[bytes, ...]:
    """The NAL units of an access unit, without start codes."""
    return tuple(nal.rstrip(b"\x00") for nal in annex_b.split(b"\x00\x00\x01") if nal.strip(b"\x00"))


def serve_live(videos: Mapping[str, Path], **faults: object) -> RtspServer:
    """A server that plays each video in real time over and over; ``faults`` as the fields of :class:`Camera`."""
    clips = {path: Clip.of_video(video) for path, video in videos.items()}
    return RtspServer(clips, Camera(**{"loop": True, "report_every_s": 5.0, **faults}))  # type: ignore[arg-type]


async def _request(reader: asyncio.StreamReader) -> tuple[str, str, dict[str, str]] | None:
    """Method, URL and headers of the next request; RTCP of the client is passed over. None at the end."""
    while (first := await reader.read(1)) == b"$":
        _, length = struct.unpack(">BH", await reader.readexactly(3))
        await reader.readexactly(length)
    if not first:
        return None
    head = (first + await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
    method, url, _ = head[0].split(" ", 2)
    headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in head[1:])}
    await reader.readexactly(int(headers.get("content-length", 0)))
    return method, url, headers


def _response(status: str, headers: Mapping[str, str], body: bytes) -> bytes:
    length = {"Content-Length": str(len(body))} if body else {}
    lines = [f"RTSP/1.0 {status}", *(f"{name}: {value}" for name, value in {**headers, **length}.items()), "", ""]
    return "\r\n".join(lines).encode() + body


def _interleaved(channel: int, packet: bytes) -> bytes:
    return struct.pack(">cBH", b"$", channel, len(packet)) + packet


def main(arguments: Sequence[str]) -> None:
    """Serve ``PATH=VIDEO.mp4`` until the input ends or the keyboard interrupts."""
    videos = {path: Path(video) for path, _, video in (argument.partition("=") for argument in arguments)}
    with serve_live(videos) as server, contextlib.suppress(KeyboardInterrupt):
        for path in videos:
            print(server.url(path), flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1:])
