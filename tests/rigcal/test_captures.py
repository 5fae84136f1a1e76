"""Captures on disk: the three forms, their order, and what is wrong with a broken one."""

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from rigcal.captures import natural_key, open_capture, read_frames
from rigcal.errors import BrokenFileError, CaptureError, EmptyCaptureError, ImageSizeError

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data"


def grey(value=90, size_wh=(64, 48)):
    return np.full((size_wh[1], size_wh[0]), value, dtype=np.uint8)


def write(path, image=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), grey() if image is None else image)


def write_video(path, frames=5, size_wh=(64, 48), fps=25):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(fps))
        stream.width, stream.height, stream.pix_fmt = *size_wh, "yuv420p"
        for value in range(frames):
            image = np.repeat(grey(40 + 20 * (value % 8), size_wh)[..., None], 3, axis=2)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


def test_a_folder_of_images_per_camera(tmp_path):
    for camera in ("cam10", "cam2"):
        for name in ("f10.png", "f9.png", "notes.txt", ".hidden.png"):
            write(tmp_path / camera / name) if name.endswith("png") else (tmp_path / camera / name).write_text("x")
    (tmp_path / "empty").mkdir()
    capture = open_capture(tmp_path)
    assert [camera.id for camera in capture.cameras] == ["cam2", "cam10"]
    assert capture.cameras[0].frames == ("f9", "f10")
    assert capture.cameras[0].size_wh == (64, 48)


def test_flat_images_named_camera_then_number(tmp_path):
    for name in ("left01.jpg", "left02.jpg", "right_01.png", "right_02.png", "poster.png"):
        write(tmp_path / name)
    capture = open_capture(tmp_path)
    assert [(camera.id, camera.frames) for camera in capture.cameras] == [
        ("left", ("left01", "left02")),
        ("right", ("right_01", "right_02")),
    ]


def test_one_video_per_camera(tmp_path):
    write_video(tmp_path / "cam_1.mp4")
    write_video(tmp_path / "cam_0.mp4", frames=4)
    (tmp_path / "timestamps.txt").write_text("x")
    capture = open_capture(tmp_path)
    assert [camera.id for camera in capture.cameras] == ["cam_0", "cam_1"]
    camera = capture.cameras[1]
    assert camera.frames == ("000000", "000001", "000002", "000003", "000004")
    assert camera.fps == 25
    assert np.allclose(camera.times_s, np.arange(5) / 25)
    values = [int(image.mean()) for _, image in read_frames(camera)]
    assert np.allclose(values, 40 + 20 * np.arange(5), atol=4)
    _, image = next(read_frames(camera, colour=True))
    assert image.shape == (48, 64, 3)


@pytest.mark.parametrize("codec", ["mpeg4", "libx264"])
def test_wanted_frames_of_a_video_are_the_same_as_among_all(tmp_path, codec):
    rng = np.random.default_rng(0)
    with av.open(str(tmp_path / "cam.mp4"), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(25), options={"bf": "3"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for index in range(60):
            image = np.roll(rng.integers(0, 255, (48, 64), dtype=np.uint8) // 8 + 4 * index % 200, index, axis=1)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode())
    camera = open_capture(tmp_path).cameras[0]
    every = dict(read_frames(camera))
    assert sorted(every) == list(range(60))
    for wanted in ({3, 10, 17, 59}, {0}, set(range(0, 60, 7))):
        some = dict(read_frames(camera, wanted=wanted))
        assert sorted(some) == sorted(wanted)
        assert all(np.array_equal(image, every[index]) for index, image in some.items())


def test_the_site_file_orders_the_cameras_and_must_name_them_all(tmp_path):
    for camera in ("a", "b"):
        write(tmp_path / camera / "0.png")
    assert [c.id for c in open_capture(tmp_path, camera_order=["b", "a"]).cameras] == ["b", "a"]
    with pytest.raises(CaptureError) as caught:
        open_capture(tmp_path, camera_order=["b", "c"])
    assert "the capture has other cameras than the site file" in str(caught.value)
    assert "expected: b, c" in str(caught.value)
    assert "got:      a, b" in str(caught.value)


def test_pixels_come_as_stored_and_sixteen_bits_become_eight(tmp_path):
    write(tmp_path / "a" / "0.png", (grey(100).astype(np.uint16) * 257))
    camera = open_capture(tmp_path).cameras[0]
    assert [(index, int(image[0, 0])) for index, image in read_frames(camera)] == [(0, 100)]


@pytest.mark.parametrize("got", ["no such folder", "a file", "an empty folder", "readme.md"])
def test_a_place_without_cameras_says_what_is_there(tmp_path, got):
    path = tmp_path / "x"
    if got == "a file":
        path.write_text("x")
    elif got != "no such folder":
        path.mkdir()
        if got == "readme.md":
            (path / got).write_text("x")
    with pytest.raises(EmptyCaptureError) as caught:
        open_capture(path)
    assert "no camera images or videos here" in str(caught.value)
    assert f"got:      {got}" in str(caught.value)


@pytest.mark.parametrize(("suffix", "cut"), [(".jpg", 0.6), (".png", 0.6), (".png", 0.0)])
def test_a_broken_image_is_named(tmp_path, suffix, cut):
    write(tmp_path / "a" / f"0{suffix}")
    noise = np.random.default_rng(0).integers(0, 255, (480, 640), dtype=np.uint8)
    path = tmp_path / "a" / f"1{suffix}"
    write(tmp_path / "a" / f"0{suffix}", noise)
    write(path, noise)
    path.write_bytes(path.read_bytes()[: int(cut * path.stat().st_size)])
    with pytest.raises(BrokenFileError) as caught:
        list(read_frames(open_capture(tmp_path).cameras[0]))
    assert str(path) in str(caught.value)
    assert "cannot decode this file" in str(caught.value)
    assert "do next:  copy it again from the camera" in str(caught.value)


def test_images_of_another_size_are_refused(tmp_path):
    write(tmp_path / "a" / "0.png")
    write(tmp_path / "a" / "1.png", grey(size_wh=(32, 24)))
    with pytest.raises(ImageSizeError) as caught:
        list(read_frames(open_capture(tmp_path).cameras[0]))
    assert "camera a has images of another size" in str(caught.value)
    assert "64x48 px, as in 0.png" in str(caught.value)


def test_a_broken_video_is_named(tmp_path):
    path = tmp_path / "cam0.mp4"
    path.write_bytes(b"this is no video at all")
    with pytest.raises(BrokenFileError) as caught:
        open_capture(tmp_path)
    assert str(path) in str(caught.value)


def test_a_video_that_ends_early_is_named_with_both_counts(tmp_path):
    path = tmp_path / "cam0.mkv"
    write_video(path, frames=30)
    camera = open_capture(tmp_path).cameras[0]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(BrokenFileError) as caught:
        list(read_frames(camera))
    assert "expected: 30 frames" in str(caught.value)


def test_two_videos_of_one_camera_are_refused(tmp_path):
    write_video(tmp_path / "cam0.mp4")
    write_video(tmp_path / "cam0.avi")
    with pytest.raises(CaptureError, match="camera cam0 has two videos"):
        open_capture(tmp_path)


def test_the_digest_follows_the_content(tmp_path):
    write(tmp_path / "a" / "0.png")
    first = open_capture(tmp_path).digest()
    assert open_capture(tmp_path).digest() == first
    write(tmp_path / "a" / "0.png", grey(91))
    assert open_capture(tmp_path).digest() != first


def test_names_sort_naturally():
    assert sorted(["cam10", "cam2", "Cam1"], key=natural_key) == ["Cam1", "cam2", "cam10"]


@pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")
def test_the_real_captures_open():
    def opened(path):
        return [(c.id, c.kind, len(c.frames), c.size_wh) for c in open_capture(REAL / path).cameras]

    assert opened("calibration/opencv_stereo_chess") == [
        ("left", "images", 13, (640, 480)),
        ("right", "images", 13, (640, 480)),
    ]
    assert opened("calibration/caliscope_charuco_calibration/calibration/extrinsic") == [
        (f"cam_{i}", "video", 111, (1280, 720)) for i in range(4)
    ]
    assert opened("calibration/pose2sim_singleperson/calibration/intrinsics")[3] == (
        "int_cam04_img", "images", 7, (1088, 1920),
    )  # fmt: skip
