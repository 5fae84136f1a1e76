"""Frame sets from captures: cameras matched to the rig's, one rig time, encoded frames handed on where they can be."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from recognition.errors import SourceError
from recognition.sources.capture import open_source
from rigcal.camera import Camera
from rigcal.formats import import_rig
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigfile import rig_of

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data"
SIZE = (64, 48)
LENS = Camera("opencv4", SIZE, np.array([60.0, 60, 32, 24, 0, 0, 0, 0]))


def rig_with(*ids, clock=None):
    poses = [Pose.identity()] + [Pose(np.eye(3), np.array([float(i), 0, 0])) for i in range(1, len(ids))]
    cameras = tuple(
        RigCamera(i, LENS, p, clock=clock if n else None) for n, (i, p) in enumerate(zip(ids, poses, strict=True))
    )
    return Rig("s", cameras, ids[0], "PASS")


def image(value):
    return np.full((SIZE[1], SIZE[0], 3), value, dtype=np.uint8)


def stills(folder, names, suffix=".png"):
    folder.mkdir(parents=True)
    for index, name in enumerate(names):
        assert cv2.imwrite(str(folder / f"{name}{suffix}"), image(20 * index))


def video(path, frames=6, fps=30, **options):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps), options={"crf": "18", **options})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index in range(frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image(20 + 18 * index), format="bgr24")))
        container.mux(stream.encode())


def opened(path, rig, use=None, fps=30.0):
    return open_source(path, rig, use=use or [True] * len(rig.cameras), fps=fps)


def test_images_are_decoded_and_their_own_bytes_handed_on(tmp_path):
    stills(tmp_path / "cam0", ["0", "1"])
    stills(tmp_path / "cam1", ["0", "1"], ".jpg")
    sets = list(opened(tmp_path, rig_with("cam0", "cam1"), fps=20).frame_sets())
    assert [s.t_ns for s in sets] == [0, 50_000_000]
    assert [v.encoding for v in sets[1].views] == ["png", "jpeg"]
    assert sets[1].views[0].encoded == (tmp_path / "cam0" / "1.png").read_bytes()
    assert int(sets[1].views[1].image_bgr.mean()) == pytest.approx(20, abs=2)


def test_cameras_are_matched_by_name_else_by_number(tmp_path):
    stills(tmp_path / "video_1", ["0"])
    stills(tmp_path / "video_0", ["0"])
    source = opened(tmp_path, rig_with("cam1", "cam0"))
    assert [camera.id for camera in source.cameras] == ["video_1", "video_0"]


def test_h264_without_reordering_is_handed_on_as_annex_b(tmp_path):
    for camera in ("cam0", "cam1"):
        video(tmp_path / f"{camera}.mp4", bf="0", g="3")
    sets = list(opened(tmp_path, rig_with("cam0", "cam1")).frame_sets())
    assert len(sets) == 6
    assert [s.t_ns for s in sets[:3]] == pytest.approx([0, 33_333_333, 66_666_667], abs=1)
    decoder = av.CodecContext.create("h264", "r")
    shown = []
    for frame_set in sets:
        view = frame_set.views[0]
        assert view.encoding == "h264"
        assert view.encoded.startswith(b"\x00\x00\x00\x01")
        shown += decoder.decode(av.Packet(view.encoded))
    shown += decoder.decode(None)
    for frame, frame_set in zip(shown, sets, strict=True):
        decoded = frame.to_ndarray(format="bgr24")
        assert np.abs(decoded.astype(int) - frame_set.views[0].image_bgr).max() <= 2


def test_h264_with_reordered_frames_is_decoded_only(tmp_path):
    for camera in ("cam0", "cam1"):
        video(tmp_path / f"{camera}.mp4", frames=12, bf="2", **{"x264-params": "b-adapt=0"})
    sets = list(opened(tmp_path, rig_with("cam0", "cam1")).frame_sets())
    assert [s.views[0].encoded for s in sets] == [None] * 12
    assert [int(s.views[0].image_bgr.mean()) for s in sets[:6]] == pytest.approx([20 + 18 * i for i in range(6)], abs=3)


def test_times_in_names_pass_through_the_clock_models_and_keep_every_digit(tmp_path):
    start_ns = 1_775_986_201_250_000_123
    stills(tmp_path / "cam0", [f"{start_ns + 40_000_000 * i}" for i in range(3)])
    stills(tmp_path / "cam1", [f"{start_ns + 40_000_000 * i - 500_000_000 + 10}" for i in range(3)])
    clock = ClockModel(0.5, 0.0, "2026-04-12T09:30:01Z", 1e-4, 0.1, "probe")
    source = opened(tmp_path, rig_with("cam0", "cam1", clock=clock))
    assert source.timing.rule == "file times"
    assert source.timing.frame_idx.tolist() == [[0, 0], [1, 1], [2, 2]]
    sets = list(source.frame_sets())
    assert [view.t_ns - start_ns for view in sets[1].views] == [40_000_000, 40_000_010]
    assert sets[1].t_ns - start_ns == 40_000_005
    assert sets[1].times_ns == tuple(view.t_ns for view in sets[1].views)


def test_a_dropped_frame_leaves_a_gap_and_nothing_shifts(tmp_path):
    stills(tmp_path / "cam0", ["0", "1", "2"])
    stills(tmp_path / "cam1", ["0", "2"])
    sets = list(opened(tmp_path, rig_with("cam0", "cam1")).frame_sets())
    assert [[v.frame_idx if v else None for v in s.views] for s in sets] == [[0, 0], [1, None], [2, 1]]


def test_cameras_can_be_left_out(tmp_path):
    stills(tmp_path / "cam0", ["0"])
    sets = list(opened(tmp_path, rig_with("cam0", "cam1"), use=[True, False]).frame_sets())
    assert [v is None for v in sets[0].views] == [False, True]


def test_a_missing_camera_is_named(tmp_path):
    stills(tmp_path / "cam0", ["0"])
    with pytest.raises(SourceError) as caught:
        opened(tmp_path, rig_with("cam0", "cam1"))
    assert "the capture lacks cam1" in str(caught.value)
    assert "leave cameras out with --views" in str(caught.value)


def test_a_camera_that_is_not_the_rigs_is_named(tmp_path):
    stills(tmp_path / "cam0", ["0"])
    stills(tmp_path / "other", ["0"])
    with pytest.raises(SourceError, match="the rig has no camera other"):
        opened(tmp_path, rig_with("cam0"))


def test_images_of_another_size_than_calibrated_are_refused(tmp_path):
    stills(tmp_path / "cam0", ["0"])
    rig = rig_with("cam0")
    larger = replace(rig.cameras[0], camera=Camera("opencv4", (80, 60), LENS.params))
    with pytest.raises(SourceError) as caught:
        opened(tmp_path, replace(rig, cameras=(larger,)))
    assert "camera cam0 has images of another size than it was calibrated with" in str(caught.value)
    assert "expected: 80x60 px" in str(caught.value)
    assert "got:      64x48 px" in str(caught.value)


def test_repeated_times_are_counted_and_every_frame_is_handed_on(tmp_path):
    for camera in ("cam0", "cam1"):
        stills(tmp_path / camera, ["0", "1", "2"])
    rows = "".join(f"cam{c},{t}\n" for c in (0, 1) for t in (1.0, 1.1, 1.1 if c else 1.2))
    (tmp_path / "timestamps.csv").write_text("cam_id,frame_time\n" + rows)
    source = opened(tmp_path, rig_with("cam0", "cam1"))
    assert [camera.repeated for camera in source.sync.cameras] == [0, 1]
    frames = [[v.frame_idx if v else None for v in s.views] for s in source.frame_sets()]
    assert frames == [[0, 0], [1, 1], [None, 2], [2, None]]


def test_instants_keep_their_numbers_when_cameras_are_left_out(tmp_path):
    stills(tmp_path / "cam0", ["0", "2"])
    stills(tmp_path / "cam1", ["0", "1", "2"])
    source = opened(tmp_path, rig_with("cam0", "cam1"), use=[True, False])
    assert [s.index for s in source.frame_sets()] == [0, 2]


@pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")
def test_videos_of_another_width_than_the_calibration_are_refused():
    path = REAL / "recognition" / "pose2sim_multi" / "dataset.json"
    rig = rig_of(import_rig(path, from_format=None, created_utc="2026-11-22T00:00:00Z"))
    with pytest.raises(SourceError) as caught:
        opened(REAL / "calibration" / "pose2sim_singleperson" / "videos", rig)
    assert "expected: 1088x1920 px" in str(caught.value)
    assert "got:      1080x1920 px" in str(caught.value)
