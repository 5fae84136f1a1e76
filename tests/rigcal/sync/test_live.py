"""Live sources: stamps, rates and troubles of cameras that speak RTSP, of files, and of cameras that do not answer."""

import base64
import io
import socket
import struct
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

import av
import numpy as np
import pytest

from rigcal.errors import OptionError
from rigcal.pace import judge_pace
from rigcal.sync.live.clock import came_when_sent, producer_stamps
from rigcal.sync.live.watch import watch_sources
from rigcal.sync.live.words import shown_address

NTP_EPOCH_S = 2_208_988_800
EXPOSED_S = 1_764_000_000.25
"""When the camera of the fixture took its first frame, by its own clock."""


@cache
def access_units(frames=300):
    """A short H.264 video: (sequence and picture parameters, the NAL units of every frame)."""
    memory = io.BytesIO()
    with av.open(memory, "w", format="h264") as container:
        stream = container.add_stream("libx264", rate=30, options={"bf": "0", "g": "10", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        units = []
        for i in range(frames):
            picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), i % 200, np.uint8), format="rgb24")
            picture.pts, picture.time_base = i, Fraction(1, 30)
            units += [bytes(packet) for packet in stream.encode(picture)]
        units += [bytes(packet) for packet in stream.encode(None)]
    split = [[nal for nal in unit.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1") if nal] for unit in units]
    parameters = [nal for nal in split[0] if nal[0] & 31 in (7, 8)]
    return parameters, split


@dataclass
class Camera:
    """What the simulated camera does."""

    fps: float = 30.0
    frames: int = 300
    speed: float = 20.0
    """How much faster than real it sends, so that tests are quick."""
    report_every: int = 30
    """Frames between sender reports; 0: none."""
    first_report: int = 3
    skew_ppm: float = 0.0
    """How much faster its frame clock runs than the clock of its reports."""
    report_error_s: dict = field(default_factory=dict)
    """Frame -> how wrong the clock of its reports is from then on."""
    lost: frozenset = frozenset()
    stall_after: int | None = None
    status: str = "200 OK"
    silent: bool = False
    jitter_s: float = 0.0
    """How late frames leave, at most."""
    first_ticks: int = 1_000_000_000
    url: str = ""

    def exposed_s(self, frame):
        """When a frame was taken, by the clock of the reports, errors apart."""
        return EXPOSED_S + frame / self.fps

    def ticks(self, frame):
        return (self.first_ticks + round(frame / self.fps * 90_000 * (1 + self.skew_ppm * 1e-6))) % 2**32


@contextmanager
def serving(camera):
    """The camera on loopback; its address in ``camera.url``."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        camera.url = f"rtsp://127.0.0.1:{server.getsockname()[1]}/live"
        stop = threading.Event()
        thread = threading.Thread(target=accept, args=(server, camera, stop), daemon=True)
        thread.start()
        try:
            yield camera
        finally:
            stop.set()
            server.shutdown(socket.SHUT_RDWR)
            thread.join(5)


def accept(server, camera, stop):
    while not stop.is_set():
        try:
            connection, _ = server.accept()
        except OSError:
            return
        with connection, suppress(BrokenPipeError, ConnectionResetError):
            answer(connection, camera, stop)


def answer(connection, camera, stop):
    """RFC 2326, as much as it takes: requests answered in turn, media interleaved after PLAY."""
    lines = connection.makefile("rb")
    while not stop.is_set():
        request = lines.readline().split()
        if not request:
            return
        headers = {}
        while line := lines.readline().strip():
            name, _, value = line.decode().partition(":")
            headers[name.lower()] = value.strip()
        if camera.silent:
            stop.wait(30)
            return
        method, extra, body = request[0].decode(), "", b""
        if method == "OPTIONS":
            extra = "Public: DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = description()
            extra = f"Content-Base: {camera.url}/\r\nContent-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 7\r\n"
        elif method == "PLAY":
            extra = "Session: 7\r\nRange: npt=now-\r\n"
        status = camera.status if method == "DESCRIBE" else "200 OK"
        if not status.startswith("200"):
            extra, body = 'WWW-Authenticate: Basic realm="camera"\r\n', b""
        connection.sendall(f"RTSP/1.0 {status}\r\nCSeq: {headers['cseq']}\r\n{extra}\r\n".encode() + body)
        if method == "PLAY":
            send_media(connection, camera, stop)
            return
        if method == "TEARDOWN":
            return


def description():
    parameters, _ = access_units()
    sets = ",".join(base64.b64encode(nal).decode() for nal in parameters)
    return (
        "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\n"
        "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=framerate:30\r\n"
        f"a=fmtp:96 packetization-mode=1;sprop-parameter-sets={sets}\r\na=control:track0\r\n"
    ).encode()


def send_media(connection, camera, stop):
    """RTP (RFC 3550, RFC 6184: single NAL units) and sender reports, by the frame."""
    _, units = access_units()
    number, started_s, wrong_s = 0, time.monotonic(), 0.0
    for frame in range(camera.frames):
        if frame == camera.stall_after:
            stop.wait(30)
        late_s = camera.jitter_s * (frame * 7 % 11) / 10
        stop.wait(max(started_s + frame / camera.fps / camera.speed + late_s - time.monotonic(), 0))
        if stop.is_set():
            return
        wrong_s = camera.report_error_s.get(frame, wrong_s)
        since = frame - camera.first_report
        if camera.report_every and since >= 0 and since % camera.report_every == 0:
            connection.sendall(interleaved(1, report(camera, frame, wrong_s)))
        for i, nal in enumerate(units[frame]):
            marker = 0x80 if i == len(units[frame]) - 1 else 0
            header = struct.pack(">BBHII", 0x80, marker | 96, number % 2**16, camera.ticks(frame), 7)
            number += 1
            if frame not in camera.lost:
                connection.sendall(interleaved(0, header + nal))


def interleaved(channel, payload):
    return struct.pack(">cBH", b"$", channel, len(payload)) + payload


def report(camera, frame, wrong_s):
    seconds = camera.exposed_s(frame) + wrong_s + NTP_EPOCH_S
    whole = int(seconds)
    return struct.pack(">BBHIIIIII", 0x80, 200, 6, 7, whole, int((seconds - whole) * 2**32), camera.ticks(frame), 0, 0)


def watched(camera, seconds=3.0):
    with serving(camera):
        (watch,) = watch_sources({"cam1": camera.url}, seconds=seconds)
    return watch


def frames_of(watch, camera):
    """Which frames were received, by their presentation times, which count from the first one."""
    return np.round(watch.stream_s * camera.fps / (1 + camera.skew_ppm * 1e-6)).astype(int)


def assert_true_stamps(watch, camera, within_s):
    assert watch.stamp_source == "producer"
    true_s = camera.exposed_s(frames_of(watch, camera))
    assert np.abs(watch.t_s - true_s).max() < within_s


@pytest.mark.parametrize(
    ("camera", "within_s"),
    [
        (Camera(), 50e-6),
        (Camera(report_every=300), 50e-6),
        (Camera(report_every=90, skew_ppm=100.0), 0.5e-3),
        (Camera(report_every=30, skew_ppm=-50.0), 0.2e-3),
        (Camera(report_every=15, skew_ppm=5700.0), 1e-3),
        (Camera(report_every=30, report_error_s={33: 0.002, 63: -0.002, 93: 0.001, 123: 0.0}), 1e-3),
        (Camera(first_ticks=2**32 - 90_000), 50e-6),
    ],
    ids=["plain", "one report", "skew", "often", "counts frames", "noisy reports", "wraps"],
)
def test_stamps_are_the_camera_s_own_clock(camera, within_s):
    watch = watched(camera)
    assert len(watch.t_s) >= camera.frames - 2
    assert_true_stamps(watch, camera, within_s)


def test_frames_before_the_first_report_have_stamps_too():
    camera = Camera(first_report=100)
    watch = watched(camera)
    assert np.sum(watch.producer_ns < 0) >= 95
    assert_true_stamps(watch, camera, 50e-6)


def test_a_stepped_camera_clock_is_seen_at_its_report():
    camera = Camera(report_error_s={153: 0.413})
    watch = watched(camera)
    frames = frames_of(watch, camera)
    assert np.abs(watch.t_s - camera.exposed_s(frames) - 0.413 * (frames >= 153)).max() < 1e-3
    (step,) = judge_pace(watch.t_s).steps
    assert frames[step.at] == 153
    assert step.jump_s == pytest.approx(0.413, abs=1e-3)


def test_lost_packets_are_missing_frames():
    watch = watched(Camera(lost=frozenset({50, 51, 120})))
    pace = judge_pace(watch.t_s, declared_fps=watch.declared_fps)
    assert [gap.count for gap in pace.missing] == [2, 1]
    assert (pace.source, pace.steps) == ("sensor", ())


def test_without_reports_stamps_are_times_of_arrival():
    camera = Camera(report_every=0, speed=1.0, jitter_s=0.008)
    watch = watched(camera, seconds=3.5)
    assert (watch.stamp_source, watch.trouble) == ("arrival", "")
    assert abs(watch.t_s[-1] - time.time()) < 5
    assert watch.arrived_fps == pytest.approx(30, rel=0.05)
    assert judge_pace(watch.t_s).source == "arrival"
    assert watch.delay_s is None


def test_what_a_stream_says_of_itself_is_told():
    watch = watched(Camera())
    assert (watch.camera_id, watch.size_wh, watch.codec, watch.declared_fps) == ("cam1", (64, 48), "h264", 30.0)
    assert watch.delay_s is not None
    assert watch.trouble == "it ended after 299 frames"


def test_a_camera_that_stalls_is_said_to_have_stalled():
    watch = watched(Camera(stall_after=40, speed=5.0), seconds=5.0)
    assert watch.trouble.startswith("it sends nothing for 2 s after frame ")
    assert len(watch.t_s) > 30


@pytest.mark.parametrize(
    ("status", "trouble"),
    [
        ("401 Unauthorized", "it refuses the user name or the password (401)"),
        ("403 Forbidden", "it refuses to show this stream to this user (403)"),
        ("404 Not Found", "it has no stream of this name (404)"),
    ],
)
def test_refusals_are_told_without_the_password(status, trouble):
    with serving(Camera(status=status)) as camera:
        url = camera.url.replace("rtsp://", "rtsp://admin:s3cret@")
        (watch,) = watch_sources({"cam1": url}, seconds=3.0)
    assert watch.trouble == trouble
    assert watch.address == camera.url
    assert "s3cret" not in repr(watch)
    assert "admin" not in repr(watch)


def test_dead_sources_do_not_hold_up_the_others(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        nothing = f"rtsp://127.0.0.1:{closed.getsockname()[1]}/live"
    (tmp_path / "text.mp4").write_text("no video")
    sources = {"refused": nothing, "absent": str(tmp_path / "no.mp4"), "text": str(tmp_path / "text.mp4")}
    seen = []
    with serving(Camera()) as camera, serving(Camera(silent=True)) as silent:
        sources |= {"well": camera.url, "silent": silent.url}
        started_s = time.monotonic()
        watches = watch_sources(sources, seconds=1.5, progress=lambda done, total: seen.append((done, total)))
        assert time.monotonic() - started_s < 2.2
    assert [watch.camera_id for watch in watches] == list(sources)
    assert {watch.camera_id: watch.trouble for watch in watches} == {
        "refused": "nothing listens there: the connection is refused",
        "absent": "there is no such file",
        "text": "it holds no video that can be read",
        "well": "it ended after 299 frames",
        "silent": "it does not answer within 1.5 s",
    }
    assert len(watches[3].t_s) == 299
    assert (seen[0], seen[-1]) == ((0, 2), (2, 2))


def test_a_file_has_presentation_times_in_their_order(tmp_path):
    path = tmp_path / "video.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"bf": "2", "preset": "fast"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(50):
            picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 4 * i, np.uint8), format="rgb24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    (watch,) = watch_sources({"cam1": str(path)}, seconds=5.0)
    assert (watch.stamp_source, watch.trouble, watch.arrived_fps) == ("presentation times", "", None)
    assert watch.t_s == pytest.approx(np.arange(50) / 25)
    assert (watch.size_wh, watch.declared_fps) == ((64, 48), 25.0)


def test_a_file_without_pictures_is_told(tmp_path):
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    (watch,) = watch_sources({"cam1": str(path)}, seconds=5.0)
    assert (watch.trouble, watch.size_wh, len(watch.t_s)) == ("it carries no video", None, 0)


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("rtsp://admin:s3cret@10.0.0.4:554/stream1", "rtsp://10.0.0.4:554/stream1"),
        ("rtsp://admin:p@ss@camera.local/a/b?token=s3cret#x", "rtsp://camera.local/a/b"),
        ("rtsp://admin:s3/cret@10.0.0.4/stream1", "rtsp://..."),
        ("rtsp://10.0.0.4/user=admin&password=s3cret&channel=1", "rtsp://10.0.0.4/..."),
        ("http://[fe80::1]:80/video", "http://[fe80::1]:80/video"),
        ("captures/cam1.mp4", "captures/cam1.mp4"),
    ],
)
def test_addresses_are_shown_without_what_is_secret(url, shown):
    assert shown_address(url) == shown


def test_frames_held_back_while_opening_are_no_arrivals():
    stream_s = np.arange(100) / 30
    came_s = np.maximum(stream_s, 1.0) + 1e-4 * np.arange(100)
    kept = came_when_sent(stream_s, (came_s * 1e9).astype(np.int64))
    assert np.flatnonzero(kept)[0] == 31


def test_a_camera_that_reports_once_and_late_gives_no_clock():
    assert producer_stamps(np.arange(3) / 30, np.array([-1, -1, 10**18]), clock_hz=90_000.0) is None
    assert producer_stamps(np.zeros(0), np.zeros(0, dtype=np.int64), clock_hz=90_000.0) is None


def test_the_time_to_watch_is_checked():
    with pytest.raises(OptionError, match="option seconds is out of range"):
        watch_sources({}, seconds=0)
