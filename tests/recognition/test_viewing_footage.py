"""Frames out of a recording of H.264: the right ones, from wherever one begins, and past what is broken."""

from fractions import Fraction

import av
import av.codec
import cv2
import numpy as np
import pytest

from recognition.errors import RecordingError
from recognition.h264 import is_key_frame
from recognition.observations import FrameSet, ViewDetections
from recognition.recording import Recorder
from recognition.sources.recording import open_recording
from recognition.sources.stream import Packet
from recognition.synthetic import semicircle_rig
from recognition.viewing import Rendering, RenderOptions, read_footage
from recognition.viewing.footage import STALE_S, CameraFrames
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

pytestmark = pytest.mark.skipif("libx264" not in av.codec.codecs_available, reason="nothing here encodes H.264")
SIZE_WH, FRAMES, GOP = (64, 48), 12, 4
T0, STEP_NS = 1_800_000_000_000_000_000, 100_000_000


def grey(k):
    return 30 + 15 * k


def access_units():
    """H.264 of frames of one grey each, a key frame every GOP."""
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = *SIZE_WH, "yuv420p"
    context.framerate, context.gop_size, context.max_b_frames = 10, GOP, 0
    context.time_base = Fraction(1, 1_000_000)
    context.options = {"tune": "zerolatency", "x264-params": f"keyint={GOP}:scenecut=0:repeat-headers=1:annexb=1"}
    units = []
    for k in [*range(FRAMES), None]:
        frame = None
        if k is not None:
            frame = av.VideoFrame.from_ndarray(np.full((*SIZE_WH[::-1], 3), grey(k), np.uint8), format="bgr24")
            frame.pts = k * 100_000
        units += [bytes(packet) for packet in context.encode(frame)]
    return units


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Makes a recording of access units of cam0."""
    folder = tmp_path_factory.mktemp("footage")
    made = document_of_rig(
        semicircle_rig(2, size_wh=SIZE_WH), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64
    )
    write_rigfile(made, folder / "s.rig.json")
    rig = rig_of(read_rigfile(folder / "s.rig.json"))

    def record(name, units, encoding="h264", step_ns=STEP_NS, seen=None, **options):
        json = (folder / "s.rig.json").read_bytes()
        with Recorder(folder / f"{name}.mcap", rig=rig, rig_json=json, metadata={}, **options) as recorder:
            for k, unit in enumerate(units):
                recorder.write_packet(Packet(0, k, T0 + k * step_ns, None, unit, encoding, is_key_frame(unit)))
                if seen is not None:
                    recorder.write_detections(FrameSet(k, T0 + k * step_ns, (None, None)), (seen, seen))
        return read_footage(open_recording(folder / f"{name}.mcap"))

    return record


def greys(footage, numbers):
    frames = CameraFrames(footage, "cam0", numbers[0])
    return [float(frames.frame(number)[1].mean()) for number in numbers], frames.broken


def test_frames_are_the_right_ones_from_the_middle_of_a_group_on(recorded):
    footage = recorded("whole", access_units())
    assert footage.topics == {"cam0": "/cam0/video"}
    for numbers in ([0, 1, 2, 3], [6, 7, 11], [3], [4]):
        found, broken = greys(footage, numbers)
        assert broken == 0
        np.testing.assert_allclose(found, [grey(k) for k in numbers], atol=4)


def test_frames_go_on_over_segments(recorded):
    footage = recorded("cut", access_units(), segment_s=0.35)
    assert len(footage.run.files) == 3
    np.testing.assert_allclose(greys(footage, [2, 5, 9])[0], [grey(2), grey(5), grey(9)], atol=4)


def test_a_broken_frame_is_counted_and_the_one_before_it_shown(recorded):
    units = access_units()
    at = units[6].index(b"\x00\x00\x01") + 4
    units[6] = units[6][:at] + bytes(len(units[6]) - at)
    frames = CameraFrames(recorded("broken", units), "cam0", 5)
    shown = [frames.frame(number) for number in (5, 6, 8)]
    assert [number for number, _ in shown] == [5, 5, 8], "heads are where they were in frame 5"
    np.testing.assert_allclose([image.mean() for _, image in shown], [grey(5), grey(5), grey(8)], atol=4)
    assert frames.broken == 1


def test_a_broken_still_is_counted_and_the_one_before_it_shown(recorded):
    stills = [cv2.imencode(".jpg", np.full((*SIZE_WH[::-1], 3), grey(k), np.uint8))[1].tobytes() for k in range(3)]
    stills[1] = b"\xff\xd8 no picture"
    frames = CameraFrames(recorded("stills", stills, "jpeg"), "cam0", 0)
    shown = [frames.frame(number) for number in range(3)]
    assert ([number for number, _ in shown], frames.broken) == ([0, 0, 2], 1)


def test_a_part_begins_where_it_can_be_decoded_and_ends_soon_after(recorded):
    units = access_units()
    whole = recorded("whole part", units)
    slow = recorded("slow", units, step_ns=3_000_000_000)
    part = read_footage(slow.run, from_s=18.0, to_s=19.0)
    assert part.span_ns == slow.span_ns == (T0, T0 + (FRAMES - 1) * 3_000_000_000)
    times = part.times_ns["cam0"]
    assert times == tuple(T0 + k * 3_000_000_000 for k in range(3, 10)), "10 s before it, where frame 4 is a key frame"
    number = part.nearest("cam0", T0 + 18_000_000_000)
    np.testing.assert_allclose(greys(part, [number])[0], grey(6), atol=4)
    assert read_footage(whole.run, from_s=0.6).times_ns == whole.times_ns


def test_a_part_reaches_back_as_far_as_its_key_frame(recorded):
    slow = recorded("slower", access_units(), step_ns=4_000_000_000)
    part = read_footage(slow.run, from_s=28.0)
    assert part.times_ns == slow.times_ns, "frame 7: its key frame, 4, is 12 s before it"
    np.testing.assert_allclose(greys(part, [part.nearest("cam0", T0 + 28_000_000_000)])[0], grey(7), atol=4)


def test_the_nearest_frame_is_shown_unless_it_is_stale(recorded):
    footage = recorded("near", access_units())
    assert [footage.nearest("cam0", T0 + round(at * STEP_NS)) for at in (0, 2.4, 2.6, -1)] == [0, 2, 3, 0]
    assert footage.nearest("cam0", T0 - round(STALE_S * 1e9) - 1) is None
    assert footage.nearest("cam1", T0) is None
    assert footage.span_ns == (T0, T0 + (FRAMES - 1) * STEP_NS)


def test_h264_is_shown_on_over_segments_from_any_time_on(recorded):
    footage = recorded("shown", access_units(), segment_s=0.35)
    shown = RenderOptions((True, False), from_s=0.5, show_faces=True)
    pictures = list(Rendering(read_footage(footage.run, from_s=0.5), shown).pictures())
    assert [round(picture.after_s, 3) for picture in pictures] == [0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1]
    means = [picture.image_bgr[60:200, 20:280].mean() for picture in pictures]
    np.testing.assert_allclose(means, [grey(k) for k in range(5, FRAMES)], atol=4)


def test_instants_of_a_part_are_those_of_the_whole_that_were_recorded_then(recorded):
    seen = ViewDetections(np.full((1, 17, 2), 7.0), np.ones((1, 17)), ("ladder",), np.ones((1, 4)), np.ones(1))
    run = recorded("instants", access_units(), segment_s=0.35, seen=seen).run
    numbers = [instant.frame_set.index for instant in run.instants()]
    part = run.between(T0 + 3 * STEP_NS, T0 + 8 * STEP_NS)
    found = list(part.instants())
    assert numbers == list(range(FRAMES))
    assert [instant.frame_set.index for instant in found] == [3, 4, 5, 6, 7, 8]
    assert [len(view.people_px) for view in found[0].views] == [1, 1]
    np.testing.assert_array_equal(found[0].views[0].people_px, seen.people_px)
    assert [i.frame_set.index for i in run.between(None, T0 + STEP_NS).instants()] == [0, 1]


def test_a_camera_that_has_no_frames_cannot_be_shown_alone(recorded):
    footage = recorded("other", access_units())
    with pytest.raises(RecordingError, match="there are no frames to show") as caught:
        Rendering(footage, RenderOptions((False, True)))
    assert "cameras cam0" in caught.value.expected
