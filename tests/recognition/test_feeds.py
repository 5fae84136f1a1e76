"""Instants to run on: frames with detections, single-camera instants, interpolation for all three kinds of input."""

from threading import Barrier

import cv2
import numpy as np
import pytest

from recognition.errors import SourceError
from recognition.feeds import FeedOptions, open_feed
from recognition.observations import ViewDetections
from recognition.recording import Recorder, check_recording, iter_messages
from recognition.runtime import RunOptions, run
from recognition.sources.detections_file import write_detections
from recognition.synthetic import semicircle_rig
from rigcal.cores import core_count
from rigcal.errors import BrokenFileError
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

START_NS = 1_775_986_200_000_000_000
PERIOD_NS = 100_000_000
SIZE_WH = (64, 48)


@pytest.fixture
def rig(tmp_path):
    """Two cameras, as read from their file."""
    made = document_of_rig(
        semicircle_rig(2, size_wh=SIZE_WH), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64
    )
    write_rigfile(made, tmp_path / "s.rig.json")
    return rig_of(read_rigfile(tmp_path / "s.rig.json"))


def stamped(folder, stamps_ns):
    """Images named by their times; the value of an image is 10 times its number."""
    folder.mkdir(parents=True)
    for number, t_ns in enumerate(stamps_ns):
        assert cv2.imwrite(str(folder / f"{t_ns}.png"), np.full((SIZE_WH[1], SIZE_WH[0], 3), 10 * number, np.uint8))


def capture(path, late_ns=40_000_000, lost=()):
    whole = START_NS + PERIOD_NS * np.arange(6)
    stamped(path / "cam0", whole)
    stamped(path / "cam1", np.delete(whole + late_ns, lost))
    return path


def box(left):
    """A bucket whose left side is there, and nobody."""
    return ViewDetections(np.zeros((0, 17, 2)), np.zeros((0, 17)), ("bucket",), [[left, 10, left + 20, 30]], np.ones(1))


class Detector:
    """Finds a bucket that moves 0.5 px from image to image."""

    model_info = ()

    def detect(self, image_bgr):
        return box(float(image_bgr[0, 0, 0]) / 20)


class OnlyTogether(Detector):
    """Finds something only while another image is looked at."""

    def __init__(self):
        self._both = Barrier(2)

    def detect(self, image_bgr):
        self._both.wait(timeout=10)
        return super().detect(image_bgr)


def lefts(feed):
    """Left sides at the common times, per instant."""
    return [[float(v.object_xyxy[0, 0]) if len(v.object_xyxy) else None for v in i.common] for i in feed.instants]


def opened(rig, source, detections=None, use=(True, True), **options):
    detector = None if detections else Detector()
    return open_feed(rig, source, detections, detector, FeedOptions(use, 10.0, **options))


EXPECTED = [[0.1, 0.0], *([0.5 * n + 0.1, 0.5 * n - 0.1] for n in range(1, 5)), [2.5, 2.4]]
"""The common time is a fifth of a period after cam0's frame, and before cam1's; the ends have one neighbour."""


def test_a_detectors_boxes_are_interpolated(rig, tmp_path):
    got = lefts(opened(rig, capture(tmp_path / "c"), interpolate=True))
    np.testing.assert_allclose(got, EXPECTED, atol=1e-9)


def test_detections_with_a_capture_are_interpolated_at_the_frames_own_times(rig, tmp_path):
    write_detections(tmp_path / "d.npz", [[box(0.5 * n)] * 2 for n in range(6)])
    got = lefts(opened(rig, capture(tmp_path / "c"), tmp_path / "d.npz", interpolate=True))
    np.testing.assert_allclose(got, EXPECTED, atol=1e-6)


def test_detections_with_times_of_each_camera_are_interpolated(rig, tmp_path):
    times = 0.1 * np.arange(6)[:, None] + np.array([0.0, 0.04])
    write_detections(tmp_path / "d.npz", [[box(0.5 * n)] * 2 for n in range(6)], time_s=times.tolist())
    feed = opened(rig, None, tmp_path / "d.npz", interpolate=True)
    instants = list(feed.instants)
    assert [i.frame_set.t_ns for i in instants[:2]] == [20_000_000, 120_000_000]
    np.testing.assert_allclose([[v.object_xyxy[0, 0] for v in i.common] for i in instants], EXPECTED, atol=1e-6)


def test_without_the_option_nothing_moves_and_it_is_advised(rig, tmp_path):
    feed = opened(rig, capture(tmp_path / "c"))
    assert feed.warnings == (
        "the cameras are not triggered together, 40.0 ms apart in the median: --interpolate moves what they saw to a "
        "common time",
    )
    assert lefts(feed) == [[0.5 * n, 0.5 * n] for n in range(6)]


@pytest.mark.parametrize("kind", ["capture", "detections", "times"])
def test_interpolating_what_has_no_times_of_its_own_is_refused(rig, tmp_path, kind):
    source = detections = None
    if kind == "capture":
        source = tmp_path / "c"
        for name in ("cam0", "cam1"):
            stamped(source / name, range(3))
    else:
        detections = tmp_path / "d.npz"
        write_detections(detections, [[box(1.0)] * 2] * 3, time_s=[0.0, 0.1, 0.2] if kind == "times" else None)
    with pytest.raises(SourceError) as caught:
        opened(rig, source, detections, interpolate=True)
    got = {"capture": "frame numbers", "detections": "frame numbers at 10 fps", "times": "frame_time_s"}[kind]
    assert str(caught.value) == (
        "there is nothing to interpolate: every camera's detections have the same time\n"
        f"  where:    {source or detections}\n"
        "  expected: a time for each frame of each camera: timestamps.csv, file names that hold times, or frame_time_s "
        "(F, V) in the detections file\n"
        f"  got:      {got}\n"
        "  do next:  leave --interpolate out, or give the cameras' own times"
    )


def test_detections_of_no_frame_are_passed_over_and_counted(rig, tmp_path):
    write_detections(tmp_path / "d.npz", [[box(1.0)] * 2 for _ in range(8)])
    feed = opened(rig, capture(tmp_path / "c", late_ns=0, lost=[2]), tmp_path / "d.npz")
    assert [[len(v.object_class) for v in i.views] for i in feed.instants] == [[1, 1], [1, 1], [1, 0]] + [[1, 1]] * 3
    assert feed.warnings == (
        "5 of the detections are of no frame of the capture and were passed over: the file's frame numbers must count "
        "the instants of the capture",
    )


def test_an_instant_of_one_camera_is_recorded_and_is_no_scene(rig, tmp_path):
    feed = opened(rig, capture(tmp_path / "c", lost=[2]), interpolate=True)
    rig_json = (tmp_path / "s.rig.json").read_bytes()
    with Recorder(tmp_path / "r.mcap", rig=rig, rig_json=rig_json, metadata={}) as recorder:
        result = run(rig, feed.instants, recorder, RunOptions())
    assert (result.instants, [scene.index for scene in result.scenes]) == (6, [0, 1, 3, 4, 5])
    assert check_recording(tmp_path / "r.mcap").ok
    times = {topic: [] for topic in ("/cam0/image", "/cam1/image", "/cam0/annotations", "/cam1/annotations", "/scene")}
    for message in iter_messages(tmp_path / "r.mcap", list(times)):
        assert message.log_ns == message.publish_ns
        times[message.topic].append((message.log_ns - START_NS) // 1_000_000)
        if message.topic != "/scene":
            assert message.message.timestamp.ToNanoseconds() == message.log_ns
    assert times == {
        "/cam0/image": [0, 100, 200, 300, 400, 500],
        "/cam1/image": [40, 140, 340, 440, 540],
        "/cam0/annotations": [0, 100, 200, 300, 400, 500],
        "/cam1/annotations": [40, 140, 340, 440, 540],
        "/scene": [20, 120, 320, 420, 520],
    }


def test_annotations_lie_where_the_detections_were_seen(rig, tmp_path):
    """Interpolated boxes would lie beside the things in the image."""
    feed = opened(rig, capture(tmp_path / "c"), interpolate=True)
    rig_json = (tmp_path / "s.rig.json").read_bytes()
    with Recorder(tmp_path / "r.mcap", rig=rig, rig_json=rig_json, metadata={}) as recorder:
        run(rig, feed.instants, recorder, RunOptions())
    drawn = [m.message.points[0].points[0].x - 0.5 for m in iter_messages(tmp_path / "r.mcap", ["/cam1/annotations"])]
    assert drawn == [0.5 * n for n in range(6)]


def test_a_repeated_instant_is_recorded_and_is_no_scene(rig, tmp_path):
    folder = tmp_path / "c"
    for name in ("cam0", "cam1"):
        stamped(folder / name, range(4))
    rows = "".join(f"cam{c},{t}\n" for c in (0, 1) for t in (1.0, 1.1, 1.1, 1.2))
    (folder / "timestamps.csv").write_text("cam_id,frame_time\n" + rows)
    feed = opened(rig, folder)
    rig_json = (tmp_path / "s.rig.json").read_bytes()
    with Recorder(tmp_path / "r.mcap", rig=rig, rig_json=rig_json, metadata={}) as recorder:
        result = run(rig, feed.instants, recorder, RunOptions())
    assert [scene.t_ns for scene in result.scenes] == [1_000_000_000, 1_100_000_000, 1_200_000_000]
    assert result.detections == {"cam0": 0, "cam1": 0}
    check = check_recording(tmp_path / "r.mcap")
    assert check.ok, check.findings
    assert check.messages["/cam0/image"] == 4


@pytest.mark.skipif(core_count() == 1, reason="one processor looks at one view at a time")
def test_the_views_of_an_instant_are_looked_at_together(tmp_path, rig):
    options = FeedOptions([True, True], 10)
    feed = open_feed(rig, capture(tmp_path / "c"), None, OnlyTogether(), options)
    alone = open_feed(rig, tmp_path / "c", None, Detector(), options)
    assert lefts(feed) == lefts(alone)


def test_a_frame_that_cannot_be_decoded_ends_the_run_with_its_reason(tmp_path, rig):
    path = capture(tmp_path / "c")
    broken = sorted((path / "cam1").iterdir())[3]
    broken.write_bytes(b"no image")
    feed = open_feed(rig, path, None, Detector(), FeedOptions([True, True], 10))
    with pytest.raises(BrokenFileError, match=broken.name):
        list(feed.instants)
