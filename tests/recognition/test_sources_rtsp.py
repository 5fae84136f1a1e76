"""A live camera: its frames at the times at which it took them, and every fault said, survived and without secrets."""

import errno
import socket
import sys
import threading
import time
import traceback
from dataclasses import replace
from datetime import UTC, datetime
from fractions import Fraction
from itertools import islice, pairwise
from pathlib import Path

import av
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rtsp_server import IDR, PPS, SPS, Camera, Clip, RtspServer, serve_live

from recognition.errors import StreamError
from recognition.h264 import is_key_frame, nal_types
from recognition.sources import rtsp
from recognition.sources.rtsp import RtspStream
from recognition.sources.rtsp_faults import RtspFaults
from recognition.sources.stream import ClockStep, Interruption, Packet
from recognition.sources.urls import SourceUrl
from rigcal.rig import ClockModel

SIZE = (320, 240)
FPS, GOP = 30, 10
TICK_S = 1 / 90_000
BURST = Camera(pace=None)
EXACT_S = TICK_S / 2 + 2e-6
"""Media time is rounded to ticks, the camera's wall clock cut to microseconds by FFmpeg, a report's by its 2**-32 s."""


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """Two seconds of noise in the lower half: access units of one RTP packet and of many."""
    path, rng = tmp_path_factory.mktemp("clip") / "cam0.mp4", np.random.default_rng(3)
    options = {"crf": "16", "bf": "0", "g": str(GOP), "sc_threshold": "0", "threads": "1"}
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(FPS), options=options)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for number in range(2 * FPS):
            image = np.full((SIZE[1], SIZE[0], 3), 40 + 3 * number, dtype=np.uint8)
            if number % 7 == 0:
                image[180:] = rng.integers(0, 255, image[180:].shape)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


@pytest.fixture(scope="module")
def clip(video):
    clip = Clip.of_video(video)
    sizes = [sum(map(len, nals)) for nals in clip.units]
    assert min(sizes) < 200
    assert max(sizes) > 10_000
    return clip


@pytest.fixture(autouse=True)
def short_waits(monkeypatch):
    monkeypatch.setattr(rtsp, "READ_TIMEOUT_S", 0.3)
    monkeypatch.setattr(rtsp, "BACKOFF_FIRST_S", 0.02)
    monkeypatch.setattr(rtsp, "OPEN_TIMEOUT_S", 2.0)


def stream_of(server, clock=None, login="", camera=0):
    return RtspStream(camera, "cam0", SourceUrl.parse(server.url("cam0", login)), clock, SIZE)


def events_of(stream, until=Interruption):
    """Events up to the first one of a kind, that one too."""
    found = []
    for event in stream.packets():
        found.append(event)
        if isinstance(event, until):
            stream.close()
    return found


def packets_of(events):
    return [event for event in events if isinstance(event, Packet)]


def fault_of(clip, camera, login=""):
    """The first interruption by a camera."""
    with RtspServer({"cam0": clip}, camera) as server:
        return events_of(stream_of(server, login=login))[-1]


def errors_s(server, packets, first=0):
    """Capture times less the true ones of frames from number ``first`` on."""
    return [(packet.t_ns - server.true_ns(first + packet.number)) * 1e-9 for packet in packets]


def test_frames_are_handed_on_as_they_were_sent(clip):
    with RtspServer({"cam0": clip}, BURST) as server:
        stream = stream_of(server, camera=3)
        packets = packets_of(events_of(stream))
    assert [p.number for p in packets] == list(range(60))
    assert {(p.camera, p.encoding, p.is_recordable) for p in packets} == {(3, "h264", True)}
    assert [p.is_key for p in packets] == [number % GOP == 0 for number in range(60)]
    for packet, nals in zip(packets, clip.units, strict=True):
        assert packet.encoded.replace(b"\x00\x00\x00\x01", b"\x00\x00\x01") == b"".join(
            b"\x00\x00\x01" + nal for nal in nals
        )
    decoder = stream.decoder()
    frames = [frame for packet in packets for frame in decoder.decode(packet)]
    assert [frame.packet.number for frame in frames] == list(range(60))
    assert [int(f.image_bgr()[:100].mean()) for f in frames] == pytest.approx([40 + 3 * n for n in range(60)], abs=4)


def test_capture_times_are_the_cameras_by_its_clock_model_to_a_tick(clip):
    clock = ClockModel(-2.5, 0.0, datetime.now(UTC).isoformat(), 1e-4, 0.1, "probe")
    with RtspServer({"cam0": clip}, replace(BURST, skew_s=2.5)) as server:
        packets = packets_of(events_of(stream_of(server, clock)))
        assert np.abs(errors_s(server, packets)).max() < EXACT_S
        assert len(packets) == 60


def test_without_a_clock_model_the_cameras_clock_is_rig_time(clip):
    with RtspServer({"cam0": clip}, replace(BURST, skew_s=0.25)) as server:
        packets = packets_of(events_of(stream_of(server)))
        assert np.array(errors_s(server, packets)) == pytest.approx(0.25, abs=EXACT_S)


def test_frames_before_the_first_report_are_timed_by_it(clip):
    with RtspServer({"cam0": clip}, replace(BURST, first_report_s=1.5)) as server:
        packets = packets_of(events_of(stream_of(server)))
        assert len(packets) == 60
        assert np.abs(errors_s(server, packets)).max() < EXACT_S


def test_frames_before_the_first_key_frame_are_dropped(clip):
    with RtspServer({"cam0": clip}, replace(BURST, first=GOP + 3)) as server:
        packets = packets_of(events_of(stream_of(server)))
        assert packets[0].is_key
        assert len(packets) == 40
        assert np.abs(errors_s(server, packets, first=2 * GOP)).max() < EXACT_S


def test_drift_and_jitter_of_the_camera_clock_are_followed(clip):
    camera = replace(BURST, drift_ppm=50, jitter_s=0.001, report_every_s=0.2)
    with RtspServer({"cam0": clip}, camera) as server:
        assert np.abs(errors_s(server, packets_of(events_of(stream_of(server))))).max() < 0.0012


def test_arrival_is_told_beside_capture_and_is_not_used_for_it(clip):
    with serve_live({}, report_every_s=0.5) as server:
        server.clips = {"cam0": clip}
        stream, packets = stream_of(server), []
        for packet in stream.packets():
            packets.append(packet)
            if len(packets) == 20:
                stream.close()
        lag_s = np.array([(p.receive_ns - p.t_ns) * 1e-9 for p in packets])
        first = server.sent["cam0"].index(next(n for n in server.sent["cam0"] if n % GOP == 0))
        assert np.abs(errors_s(server, packets, first=server.sent["cam0"][first])).max() < EXACT_S
    assert 0 < lag_s.min() < 0.03


def test_parameter_sets_of_the_description_are_put_into_key_frames_that_lack_them(clip):
    with RtspServer({"cam0": clip}, replace(BURST, parameter_sets_in_band=False)) as server:
        packets = packets_of(events_of(stream_of(server)))
    keys = [p for p in packets if p.is_key]
    assert len(keys) == 6
    for packet in keys:
        types = nal_types(packet.encoded)
        assert is_key_frame(packet.encoded)
        assert types.index(SPS) < types.index(PPS) < types.index(IDR)


def test_a_lost_packet_spoils_its_frame_and_no_time(clip):
    with RtspServer({"cam0": clip}, replace(BURST, lose=frozenset({7}))) as server:
        packets = packets_of(events_of(stream_of(server)))
        assert len(packets) == 60
        assert len(packets[7].encoded) < sum(map(len, clip.units[7]))
        assert np.abs(errors_s(server, packets)).max() < EXACT_S


def test_a_lost_frame_leaves_a_gap_in_time(clip):
    assert sum(map(len, clip.units[8])) < 1400  # one packet but for its delimiter and sets
    units = tuple(nals[-1:] for nals in clip.units[1:])
    with RtspServer({"cam0": Clip((clip.units[0], *units), FPS)}, replace(BURST, lose=frozenset({8}))) as server:
        packets = packets_of(events_of(stream_of(server)))
        assert [p.number for p in packets] == list(range(59))
        assert (packets[8].t_ns - packets[7].t_ns) * 1e-9 == pytest.approx(2 / FPS, abs=2 * TICK_S)


def test_a_camera_that_freezes_is_lost_and_comes_back(clip):
    with RtspServer({"cam0": clip}, replace(BURST, freeze_at=25)) as server:
        stream, events, back = stream_of(server), [], 0
        for event in stream.packets():
            events.append(event)
            if isinstance(event, Interruption):
                server.camera = replace(BURST, skew_s=5.0)
                back = len(events)
            elif back and len(events) == back + 5:
                stream.close()
    lost = events[25]
    assert lost.reason == "camera cam0 sends no more frames: nothing for 0.3 s"
    assert "check the camera's power and the network; it is tried again until it answers" in str(lost.error)
    assert abs(lost.t_ns - time.time_ns()) < 5e9
    assert len(packets_of(events[:25])) == 25
    assert [p.number for p in events[26:31]] == [25, 26, 27, 28, 29]
    assert events[26].is_key
    assert all(a.t_ns < b.t_ns for a, b in pairwise(packets_of(events)))


def test_a_camera_that_hangs_up_is_connected_to_again(clip):
    with RtspServer({"cam0": clip}, replace(BURST, hang_up_at=12)) as server:
        stream, events = stream_of(server), []
        for event in stream.packets():
            events.append(event)
            server.camera = replace(BURST, skew_s=5.0)
            if isinstance(event, Packet) and event.number == 13:
                stream.close()
        assert server.connections == 2
    assert events[12].reason == "camera cam0 closed the connection: the end of the stream"


def test_a_fault_that_lasts_is_said_once(clip):
    with RtspServer({"cam0": clip}, replace(BURST, is_present=False)) as server:
        stream, events = stream_of(server), []
        for event in stream.packets():
            events.append(event)
            if len(events) == 1:
                threading.Timer(0.3, lambda: setattr(server, "camera", BURST)).start()
            if isinstance(event, Packet):
                stream.close()
        assert server.connections > 3
    assert [type(event) for event in events] == [Interruption, Packet]
    assert events[0].error.what == "camera cam0 has no stream at this path"


def test_a_camera_that_came_back_with_an_earlier_time_is_said(clip):
    with RtspServer({"cam0": clip}, replace(BURST, hang_up_at=40)) as server:
        stream, said = stream_of(server), []
        for event in stream.packets():
            if isinstance(event, Interruption):
                said.append(event.reason)
                if len(said) == 2:
                    stream.close()
    assert said[1] == "the clock of camera cam0 was set back: -1.300 s"


def test_a_clock_that_is_set_while_the_camera_runs_is_said_and_taken_out(clip):
    camera = replace(BURST, report_every_s=0.2, step_at=30, step_s=-0.7)
    with RtspServer({"cam0": clip}, camera) as server:
        events = events_of(stream_of(server))
        packets = packets_of(events)
        assert np.abs(errors_s(server, packets)).max() < EXACT_S
        assert len(packets) == 60
        (step,) = (event for event in events if isinstance(event, ClockStep))
        assert server.true_ns(30) < step.t_ns < server.true_ns(45)
    assert step.step_s == pytest.approx(-0.7, abs=1e-5)
    assert step.reason.startswith("the clock of camera cam0 was set by -0.700 s while it ran")


@pytest.mark.parametrize(
    ("camera", "what", "got"),
    [
        (replace(BURST, media="audio"), "camera cam0 sends no video", "none"),
        (replace(BURST, media="H265"), "camera cam0 sends video of another codec", "hevc"),
        (replace(BURST, jump_at=20, jump_s=-0.5), "the frames of camera cam0 are out of order", "0.467 s before"),
        (replace(BURST, jump_at=20, jump_s=9.0), "the frame times of camera cam0 jumped", "+9.0"),
        (replace(BURST, skew_s=-3600), "the clock of camera cam0 is wrong", "-3600"),
    ],
)
def test_a_camera_that_cannot_be_used_is_said(clip, camera, what, got):
    fault = fault_of(clip, camera)
    assert fault.error.what == what
    assert got in fault.error.got
    assert fault.error.where.startswith("rtsp://127.0.0.1:")
    assert fault.error.expected
    assert fault.error.do_next


def test_a_camera_without_sender_reports_is_not_used_and_what_to_do_is_said(clip, monkeypatch):
    monkeypatch.setattr(rtsp, "REPORT_WAIT_S", 0.2)
    with serve_live({}, pace=5.0, reports=False) as server:
        server.clips = {"cam0": clip}
        (fault,) = events_of(stream_of(server))
    assert fault.error.what == "camera cam0 does not say when it took its frames"
    assert "switch RTCP and NTP time on in the camera" in fault.error.do_next
    assert "times of arrival are not used" in fault.error.do_next


def test_a_camera_without_a_wall_clock_is_not_used(clip, monkeypatch):
    monkeypatch.setattr(rtsp, "REPORT_WAIT_S", 0.2)
    with serve_live({}, pace=5.0, has_wall_clock=False) as server:
        server.clips = {"cam0": clip}
        (fault,) = events_of(stream_of(server))
    assert fault.error.what == "camera cam0 does not say when it took its frames"


def test_a_camera_without_key_frames_is_not_used(clip, monkeypatch):
    monkeypatch.setattr(rtsp, "KEY_WAIT_S", 0.2)
    monkeypatch.setitem(rtsp._OPTIONS, "analyzeduration", "100000")
    with serve_live({}, pace=5.0) as server:
        server.clips = {"cam0": replace(clip, units=(clip.units[0][:-1], *clip.units[1:GOP]))}
        (fault,) = events_of(stream_of(server))
    assert fault.reason == "camera cam0 sends no key frames: none"
    assert "key frame (I-frame) interval" in fault.error.do_next


@pytest.mark.parametrize(
    ("login", "got"),
    [
        ("", "without user and password"),
        ("viewer:wr0ng", "with the user and password of the address"),
    ],
)
def test_a_login_that_is_refused_is_said_without_it(clip, login, got, capfd):
    fault = fault_of(clip, replace(BURST, password="s3cret"), login)
    assert fault.error.what == "camera cam0 refuses the login"
    assert fault.error.got.endswith(got)
    assert "rtsp://USER:PASSWORD@HOST/PATH" in fault.error.do_next
    shown = "".join((*traceback.format_exception(fault.error), repr(fault), *capfd.readouterr()))
    assert "cannot" not in shown
    assert not {word for word in ("viewer", "wr0ng", "s3cret") if word in shown}
    assert fault.error.__context__ is None


def test_a_login_with_escaped_characters_opens_the_camera(clip):
    with RtspServer({"cam0": clip}, replace(BURST, password="s3/c@r:t")) as server:
        events = events_of(stream_of(server, login="viewer:s3%2Fc%40r%3At"), until=(Packet, Interruption))
    assert isinstance(events[0], Packet)


def test_a_camera_that_cannot_be_reached_is_said():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    stream = RtspStream(0, "cam0", SourceUrl(f"rtsp://a:s3cret@127.0.0.1:{port}/x?token=s3cret"), None, SIZE)
    (fault,) = events_of(stream)
    assert str(fault.error) == (
        "camera cam0 cannot be reached\n"
        f"  where:    rtsp://***@127.0.0.1:{port}/x?token=***\n"
        "  expected: an RTSP server that answers within 2 s\n"
        "  got:      Connection refused\n"
        "  do next:  check the address, the port, the cable and the camera's power; it is tried again until it answers"
    )
    assert isinstance(fault.error, StreamError)


def test_a_host_name_that_nobody_knows_is_said():
    faults = RtspFaults("cam0", SourceUrl("rtsp://camera-0/live"))
    fault = faults.not_opened(av.error.OSError(errno.EIO, "Input/output error"), 5.0, is_late=False)
    assert fault.what == "camera cam0 cannot be reached"
    assert fault.got == "Input/output error, which is what FFmpeg makes of a host name that nobody knows"


def test_a_camera_that_accepts_and_never_answers_is_said(monkeypatch):
    monkeypatch.setattr(rtsp, "OPEN_TIMEOUT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = SourceUrl(f"rtsp://127.0.0.1:{silent.getsockname()[1]}/x")
        (fault,) = events_of(RtspStream(0, "cam0", url, None, SIZE))
    assert fault.reason == "camera cam0 cannot be reached: no answer"


def test_what_is_no_rtsp_server_is_said():
    def answer(server):
        connection, _ = server.accept()
        with connection:
            connection.recv(1000)
            connection.sendall(b"SSH-2.0-OpenSSH_9.2\r\n\r\n")

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=answer, args=(server,))
        thread.start()
        url = SourceUrl(f"rtsp://127.0.0.1:{server.getsockname()[1]}/x")
        (fault,) = events_of(RtspStream(0, "cam0", url, None, SIZE))
        thread.join()
    assert fault.error.what in ("camera cam0 answers, but gives no stream", "camera cam0 cannot be reached")


def test_close_from_another_thread_ends_a_blocked_read_within_2_s(clip, monkeypatch):
    monkeypatch.undo()  # the waits of the product
    with RtspServer({"cam0": clip}, replace(BURST, freeze_at=25)) as server:
        stream, all_but_one = stream_of(server), threading.Event()

        def read():
            for packet in stream.packets():
                if packet.number == 23:
                    all_but_one.set()

        thread = threading.Thread(target=read)
        thread.start()
        assert all_but_one.wait(5)
        time.sleep(0.1)
        began = time.monotonic()
        stream.close()
        thread.join(5)
    assert not thread.is_alive()
    assert 1.0 < time.monotonic() - began < 2.0  # it was blocked


def test_close_ends_the_pause_before_the_next_attempt(monkeypatch):
    monkeypatch.setattr(rtsp, "BACKOFF_FIRST_S", 60.0)
    monkeypatch.setattr(rtsp, "BACKOFF_CAP_S", 60.0)
    stream = RtspStream(0, "cam0", SourceUrl("rtsp://127.0.0.1:1/x"), None, SIZE)
    packets = stream.packets()
    assert isinstance(next(packets), Interruption)
    threading.Timer(0.1, stream.close).start()
    began = time.monotonic()
    assert list(packets) == []
    assert time.monotonic() - began < 1.0


def test_pauses_between_attempts_double_up_to_ten_seconds(monkeypatch):
    monkeypatch.undo()
    assert list(islice(rtsp._pauses_s(), 8)) == [0.5, 1, 2, 4, 8, 10, 10, 10]
