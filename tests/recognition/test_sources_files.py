"""Files as packets, and packets as frames: as they are stored, numbered as they are shown."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from recognition.errors import BrokenFrameError, SourceError
from recognition.h264 import is_key_frame
from recognition.sources.capture import open_source
from recognition.sources.decoding import Decoder
from recognition.sources.files import FileStream
from rigcal.camera import Camera
from rigcal.captures import open_capture
from rigcal.errors import BrokenFileError
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera

SIZE = (64, 48)
CODECS = {
    "h264": ("libx264", ".mp4", {"bf": "0", "g": "5"}),
    "reordered": ("libx264", ".mp4", {"bf": "2", "x264-params": "b-adapt=0"}),
    "reordered, times unknown": ("libx264", ".avi", {"bf": "2", "x264-params": "b-adapt=0"}),
    "in order, times unknown": ("libx264", ".avi", {"bf": "0"}),
    "hevc": ("libx265", ".mkv", {"x265-params": "log-level=none"}),
    "mpeg4": ("mpeg4", ".mp4", {}),
}
COPIED = ("h264", "in order, times unknown")


def grey(number):
    return 20 + 18 * number


def video(path, frames=12, codec="libx264", **options):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(25), options={"crf": "12", **options})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for number in range(frames):
            image = np.full((SIZE[1], SIZE[0], 3), grey(number), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


def stream_of(folder, camera=2, start_ns=7_000_000_000):
    (found,) = open_capture(folder).cameras
    return FileStream(camera, found, start_ns + 40_000_000 * np.arange(len(found.frames)))


def decoded(stream, decoder):
    frames = [frame for packet in stream.packets() for frame in decoder.decode(packet)]
    return frames + decoder.flush()


@pytest.mark.parametrize("is_quick", [True, False])
@pytest.mark.parametrize("form", CODECS)
def test_every_frame_of_a_video_comes_with_its_number_and_time(tmp_path, form, is_quick):
    codec, suffix, options = CODECS[form]
    video(tmp_path / f"cam0{suffix}", codec=codec, **options)
    stream = stream_of(tmp_path)
    frames = decoded(stream, stream.decoder(is_quick=is_quick))
    assert [frame.packet.number for frame in frames] == list(range(12))
    assert [frame.packet.t_ns for frame in frames] == [7_000_000_000 + 40_000_000 * n for n in range(12)]
    assert [int(frame.image_bgr().mean()) for frame in frames] == pytest.approx([grey(n) for n in range(12)], abs=8)
    assert {(p.camera, p.receive_ns, p.is_recordable) for p in stream.packets()} == {(2, None, form in COPIED)}
    assert {frame.view().encoding for frame in frames} == {"h264" if form in COPIED else ""}


def test_h264_in_order_is_copied_as_annex_b_and_decoded_frame_by_frame(tmp_path):
    video(tmp_path / "cam0.mp4", bf="0", g="5")
    stream = stream_of(tmp_path)
    decoder = stream.decoder()
    for packet in stream.packets():
        assert packet.encoded.startswith(b"\x00\x00\x00\x01")
        assert is_key_frame(packet.encoded) == packet.is_key == (packet.number % 5 == 0)
        (frame,) = decoder.decode(packet)
        assert frame.packet is packet
    assert decoder.flush() == []


@pytest.mark.parametrize(("suffix", "encoding"), [(".png", "png"), (".jpg", "jpeg"), (".bmp", "bmp"), (".tif", "tiff")])
def test_images_are_packets_and_decoded_when_asked_for(tmp_path, suffix, encoding):
    (tmp_path / "cam0").mkdir()
    for number in range(3):
        image = np.full((SIZE[1], SIZE[0], 3), grey(number), dtype=np.uint8)
        assert cv2.imwrite(str(tmp_path / "cam0" / f"{number}{suffix}"), image)
    stream = stream_of(tmp_path)
    packets = list(stream.packets())
    assert [(p.number, p.encoding, p.is_key) for p in packets] == [(n, encoding, True) for n in range(3)]
    assert packets[1].encoded == (tmp_path / "cam0" / f"1{suffix}").read_bytes()
    assert {p.is_recordable for p in packets} == {encoding in ("png", "jpeg")}
    (frame,) = stream.decoder().decode(packets[2])
    assert frame.image_bgr().mean() == pytest.approx(grey(2), abs=2)


def test_a_file_that_changed_since_it_was_listed_is_an_error(tmp_path):
    video(tmp_path / "cam0.mp4")
    stream, before = stream_of(tmp_path), stream_of(tmp_path)
    video(tmp_path / "cam0.mp4", frames=8)
    with pytest.raises(BrokenFileError) as caught:
        list(stream.packets())
    assert "expected: 12 frames" in str(caught.value)
    assert "got:      8 frames" in str(caught.value)
    (tmp_path / "cam0.mp4").write_bytes(b"no video")
    with pytest.raises(BrokenFileError, match="cannot decode this file"):
        list(before.packets())


def test_a_damaged_frame_is_an_error_and_the_next_key_frame_is_decoded(tmp_path):
    video(tmp_path / "cam0.mp4", bf="0", g="5")
    stream = stream_of(tmp_path)
    decoder, shown = stream.decoder(), []
    for packet in stream.packets():
        if packet.number == 5:
            broken = type(packet)(2, 5, packet.t_ns, None, b"\x00\x00\x00\x01\x65" + bytes(40), "h264", True)
            with pytest.raises(BrokenFrameError) as caught:
                decoder.decode(broken)
        else:
            shown += [(f.packet.number, int(f.image_bgr().mean())) for f in decoder.decode(packet)]
    assert "a frame of camera cam0 cannot be decoded" in str(caught.value)
    assert f"where:    frame 5, at {7_000_000_000 + 5 * 40_000_000} ns" in str(caught.value)
    assert [shown[0], *shown[-2:]] == [(n, pytest.approx(grey(n), abs=4)) for n in (0, 10, 11)]


def test_a_still_that_is_no_image_or_of_another_size_is_an_error(tmp_path):
    (tmp_path / "cam0").mkdir()
    assert cv2.imwrite(str(tmp_path / "cam0" / "0.png"), np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8))
    assert cv2.imwrite(str(tmp_path / "cam0" / "1.png"), np.zeros((10, 20, 3), dtype=np.uint8))
    (tmp_path / "cam0" / "2.png").write_bytes(b"no image")
    stream = stream_of(tmp_path)
    _, small, broken = (stream.decoder().decode(packet)[0] for packet in stream.packets())
    with pytest.raises(SourceError) as caught:
        small.image_bgr()
    assert "expected: 64x48 px\n  got:      20x10 px" in str(caught.value)
    with pytest.raises(BrokenFrameError, match="no image"):
        broken.image_bgr()


def test_video_of_another_size_than_calibrated_is_an_error(tmp_path):
    video(tmp_path / "cam0.mp4", bf="0")
    decoder = Decoder("cam0", (1920, 1080))
    with pytest.raises(SourceError, match="images of another size than it was calibrated with"):
        [decoder.decode(packet) for packet in stream_of(tmp_path).packets()]


def test_close_ends_a_stream(tmp_path):
    video(tmp_path / "cam0.mp4", bf="0")
    stream = stream_of(tmp_path)
    packets = stream.packets()
    next(packets)
    stream.close()
    assert list(packets) == []


def test_the_streams_of_a_capture_have_the_times_of_its_frame_sets(tmp_path):
    lens = Camera("opencv4", SIZE, np.array([60.0, 60, 32, 24, 0, 0, 0, 0]))
    poses = Pose.identity(), Pose(np.eye(3), np.array([1.0, 0, 0]))
    clock = ClockModel(0.5, 0.0, "2026-04-12T09:30:01Z", 1e-4, 0.1, "probe")
    cameras = (RigCamera("cam0", lens, poses[0]), RigCamera("cam1", lens, poses[1], clock=clock))
    start_s = 1_775_986_201.25
    rows = [(camera, start_s + 0.04 * n - 0.5 * camera) for camera, count in ((0, 6), (1, 5)) for n in range(count)]
    for camera, count in ((0, 6), (1, 5)):
        video(tmp_path / f"cam{camera}.mp4", frames=count, bf="0")
    (tmp_path / "timestamps.csv").write_text("cam_id,frame_time\n" + "".join(f"cam{c},{t:.3f}\n" for c, t in rows))
    source = open_source(tmp_path, Rig("s", cameras, "cam0", "PASS"), use=[True, True], fps=30.0)
    expected = [[(v.frame_idx, v.t_ns, v.encoded) for s in source.frame_sets() if (v := s.views[c])] for c in (0, 1)]
    for stream, frames in zip(source.streams(), expected, strict=True):
        assert [(p.number, p.t_ns, p.encoded) for p in stream.packets()] == frames
    left_out = open_source(tmp_path, Rig("s", cameras, "cam0", "PASS"), use=[True, False], fps=30.0)
    assert left_out.streams()[1] is None
