"""Claims about histories: what a capture, a recording, probes and pictures say of clocks over time, on one axis."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from rigcal.camera import Camera
from rigcal.captures import Capture, CaptureCamera, open_capture
from rigcal.errors import NoStampsError, RecordedClocksError
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigfile import document_of_rig, write_rigfile
from rigcal.site import Site
from rigcal.sync.check.findings import Colour
from rigcal.sync.content.lags import CameraLag, ContentLags
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.history.build import history_of_capture, history_of_recording
from rigcal.sync.history.judged import colour_of
from rigcal.sync.history.minutes import minutes_of, summary_per_minute
from rigcal.sync.log import PROBE_LOG, append_exchanges, read_exchanges
from rigcal.sync.recording import read_recording

START_S = 1_776_000_010.0  # 2026-04-12T13:20:10Z
FPS = 30.0
NO_PROBES = "the log holds no probes of its host from the time of this recording that tell its clock"
CALISCOPE = (
    Path(__file__).resolve().parents[3].parent
    / "shared/data/calibration/caliscope_charuco_calibration/calibration/extrinsic"
)


def utc(t_s):
    return datetime.fromtimestamp(t_s, UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def offset_s(t_s, *, offset=0.004, drift_ppm=2.0, step=0.0, step_at_s=300.0):
    """Rig minus camera at rig times."""
    return offset + drift_ppm * 1e-6 * (t_s - START_S) + np.where(t_s - START_S >= step_at_s, step, 0.0)


def stamps_of(seconds=600.0, fps=FPS, **clock):
    """Stamps by the camera's clock of frames that are taken evenly in rig time."""
    t_s = START_S + np.arange(int(seconds * fps)) / fps
    return t_s - offset_s(t_s, **clock)


def named(camera_id, stamps_s):
    """A camera whose images bear their times."""
    names = tuple(f"{round(t * 1e6)}" for t in stamps_s)
    return CaptureCamera(camera_id, "images", tuple(Path(name + ".jpg") for name in names), names, (640, 480))


def capture(**stamps):
    return Capture(Path("/captures/hall-3"), tuple(named(camera_id, s) for camera_id, s in stamps.items()))


def probes(seconds=600.0, *, seed=1, delay_s=100e-6, **clock):
    """An exchange a second with a host of that clock."""
    rng = np.random.default_rng(seed)
    sent_s = START_S + np.arange(0.0, seconds)
    out_s, back_s = delay_s + rng.exponential(40e-6, (2, len(sent_s)))
    arrived_s, replied_s = sent_s + out_s, sent_s + out_s + 50e-6
    returned_s = replied_s + back_s
    columns = (
        sent_s, arrived_s - offset_s(arrived_s, **clock), replied_s - offset_s(replied_s, **clock), returned_s,
        returned_s - START_S, replied_s - START_S,
    )  # fmt: skip
    return Exchanges(*(np.rint(column * 1e9).astype(np.int64) for column in columns))


def rig_document(clocks, camera_ids=("cam0", "cam1")):
    params = np.array([500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0])
    pose = [Pose(np.eye(3), np.array([float(i), 0.0, 0.0])) for i in range(len(camera_ids))]
    cameras = tuple(
        RigCamera(camera_id, Camera("opencv4", (640, 480), params), pose[i], clock=clocks.get(camera_id))
        for i, camera_id in enumerate(camera_ids)
    )
    rig = Rig("hall-3", cameras, "cam0", "IMPORTED")
    return document_of_rig(rig, created_utc=utc(START_S), inputs_sha256="0" * 64)


def model(offset=0.004, drift_ppm=2.0, *, bound_s=2e-4, drift_bound_ppm=1.0, age_s=0.0, method="video"):
    at_s = START_S - age_s
    return ClockModel(offset - 2e-6 * age_s, drift_ppm, utc(at_s), bound_s, drift_bound_ppm, method)


def only(history, camera_id="cam1"):
    return next(camera for camera in history.cameras if camera.camera_id == camera_id)


def test_a_capture_without_clocks_or_probes_tells_its_frames_and_that_no_clock_is_known():
    history = history_of_capture(capture(cam0=stamps_of(60), cam1=stamps_of(60)))
    assert (history.title, history.epoch) == ("hall-3", True)
    assert (history.fastest_motion_m_per_s, history.clock_error_m) == (2.0, 0.02)
    assert history.remarks == ("frames are timed by file times",)
    camera = only(history)
    assert (len(camera.frame_t_s), camera.offsets, history.error_m(camera)) == (1800, (), None)
    assert camera.delivered_fps == pytest.approx(30 * (1 + 2e-6), rel=1e-6)
    assert colour_of(history, camera) is Colour.AMBER
    assert camera.remarks == (
        "no clock of it is in the rig file, so that nothing corrects its stamps: run rigcal sync probe or video",
    )


def test_frames_are_placed_with_the_rig_files_clock_and_its_bound_widens():
    document = rig_document({"cam1": model(age_s=3600)})
    history = history_of_capture(capture(cam0=stamps_of(), cam1=stamps_of()), document=document)
    camera = only(history)
    np.testing.assert_allclose(camera.frame_t_s, START_S + np.arange(18000) / FPS, atol=2e-6)
    assert camera.model is not None
    np.testing.assert_allclose(camera.model.offset_s, offset_s(camera.model.t_s), atol=2e-8)
    np.testing.assert_allclose(camera.model.bound_s[[0, -1]], [2e-4 + 3600e-6, 2e-4 + 4200e-6], atol=1e-7)
    assert history.error_m(camera) == pytest.approx(2 * (2e-4 + 4200e-6), abs=1e-6)
    assert colour_of(history, camera) is Colour.GREEN
    assert camera.remarks == (
        "its clock was measured 70 min before the end of the recording: by then the bound has grown from 0.2 to "
        "4.4 ms, 8.8 mm at 2 m/s",
    )


def test_probes_through_the_recording_show_what_the_rig_files_clock_left():
    log = {"cam1": probes()}
    document = rig_document({"cam1": model(drift_ppm=0.0)})
    history = history_of_capture(capture(cam0=stamps_of(), cam1=stamps_of()), document=document, log=log)
    camera = only(history)
    (left,) = camera.misplaced
    assert left.method == "probe"
    truth_s = 2e-6 * (left.t_s - START_S)
    assert (np.abs(left.offset_s - truth_s) <= left.bound_s).all()
    assert np.abs(left.offset_s - truth_s).max() < 25e-6
    assert history.error_m(camera) == pytest.approx(2 * (600 * 2e-6 + 120e-6), rel=0.2)
    assert camera.clock.drift_ppm == pytest.approx(2.0, abs=0.1)
    assert only(history, "cam0").remarks[-1] == NO_PROBES


def test_without_a_rig_file_the_whole_offset_is_the_error():
    history = history_of_capture(capture(cam1=stamps_of(60, offset=0.0123)), log={"1": probes(60, offset=0.0123)})
    camera = only(history)
    assert history.error_m(camera) == pytest.approx(2 * (0.0123 + 120e-6 + 200e-6), abs=2e-4)
    assert colour_of(history, camera) is Colour.RED


def test_probes_of_another_day_say_nothing():
    old = probes(60)
    fields = {name: getattr(old, name) - 86_400 * 10**9 for name in Exchanges.__dataclass_fields__}
    history = history_of_capture(capture(cam1=stamps_of(60)), log={"cam1": Exchanges(**fields)})
    assert only(history).measured == ()
    assert only(history).remarks[-1] == NO_PROBES


def test_the_capture_latency_of_the_site_file_moves_the_offset_and_widens_the_bound():
    site = Site.model_validate(
        {
            "site": "hall-3", "fastest_motion_m_per_s": 1.0, "gates": {"clock_error_m": 0.03},
            "cameras": [{"id": "cam1", "fps": 25, "capture_latency_s": 0.012, "capture_latency_bound_s": 0.004}],
        }
    )  # fmt: skip
    plain, moved = (
        history_of_capture(capture(cam1=stamps_of(60)), log={"cam1": probes(60)}, site=s) for s in (None, site)
    )
    before, after = only(plain).measured[0], only(moved).measured[0]
    np.testing.assert_allclose(before.offset_s - after.offset_s, 0.012)
    np.testing.assert_allclose(after.bound_s - before.bound_s, 0.004)
    assert colour_of(moved, only(moved)) is Colour.AMBER
    assert (moved.fastest_motion_m_per_s, moved.clock_error_m, only(moved).declared_fps) == (1.0, 0.03, 25.0)
    assert (
        "it declares 25 fps and delivers 30 (+20 %): it runs freely, or its exposure is too long" in only(moved).remarks
    )


def test_a_host_clock_alone_is_not_green_because_the_camera_adds_its_latency():
    held = rig_document({"cam1": model(method="probe")})
    site = Site.model_validate({"site": "hall-3", "cameras": [{"id": "cam1", "capture_latency_s": 0.0}]})
    seen = capture(cam0=stamps_of(60), cam1=stamps_of(60))
    bare, probed = history_of_capture(seen, document=held), history_of_capture(seen, log={"cam1": probes(60)})
    told, compared = (history_of_capture(seen, document=held, **k) for k in ({"site": site}, {"content": lags("cam1")}))
    assert [only(h).latency_unknown for h in (bare, probed, told, compared)] == [True, True, False, False]
    assert [colour_of(h, only(h)) for h in (bare, told)] == [Colour.AMBER, Colour.GREEN]
    assert only(bare).remarks[-1] == (
        "the clock of its host is known, what the camera adds until it stamps a frame is not: give capture_latency_s "
        "and its bound in the site file, or measure both by rigcal sync video"
    )


def test_a_stepped_host_clock_shows_once_with_its_size_from_stamps_and_from_probes():
    clock = {"step": -0.012}
    document = rig_document({"cam1": model()})
    history = history_of_capture(
        capture(cam0=stamps_of(), cam1=stamps_of(**clock)), document=document, log={"cam1": probes(**clock)}
    )
    camera = only(history)
    np.testing.assert_allclose(camera.steps_t_s, START_S + 300, atol=1.0)
    assert colour_of(history, camera) is Colour.RED
    assert camera.remarks[0] == (
        "its stamps jump by +12 ms at 13:25:10 and stay there: its clock was stepped, or the camera restarted; no "
        "single clock model serves both sides, so split the recording there"
    )
    assert camera.remarks[1].startswith("its host's clock was set forward by 12 ms at 13:25:1")
    assert camera.remarks[2].startswith("probes and the rig file's clock exclude each other from 13:25:1")
    assert "by up to 12 ms" in camera.remarks[2]


def test_a_step_that_nothing_measured_is_never_within_the_limit():
    document = rig_document({"cam1": model()})
    history = history_of_capture(capture(cam0=stamps_of(), cam1=stamps_of(step=-0.012)), document=document)
    assert history.error_m(only(history)) < 0.02
    assert colour_of(history, only(history)) is Colour.RED


def test_missing_and_repeated_frames_are_counted_and_placed():
    stamps_s = stamps_of(60)
    kept = np.delete(stamps_s, [300, 301, 302, 1200])
    kept[900] = kept[899]
    history = history_of_capture(capture(cam0=stamps_s, cam1=kept))
    camera = only(history)
    np.testing.assert_allclose(camera.missing_t_s, stamps_s[[300, 301, 302, 1200]], atol=1e-3)
    np.testing.assert_allclose(camera.repeated_t_s, [kept[900]])
    assert colour_of(history, camera) is Colour.AMBER
    assert camera.remarks[1:] == (
        "4 frames are missing: 3 after 13:20:19, 1 after 13:20:49",
        "1 frame or its stamp came twice, the first at 13:20:40",
    )
    many = only(history_of_capture(capture(cam0=stamps_s, cam1=np.delete(stamps_s, [90, 300, 301, 600, 900, 1200]))))
    assert many.remarks[1] == "6 frames are missing in 5 places, most after 13:20:19: 2 in a row"


def test_arrival_times_are_never_green():
    rng = np.random.default_rng(3)
    late = stamps_of(60) + rng.exponential(0.004, 1800)
    document = rig_document({"cam1": model(bound_s=1e-5)})
    history = history_of_capture(capture(cam0=stamps_of(60), cam1=np.sort(late)), document=document)
    assert only(history).arrival_stamps
    assert colour_of(history, only(history)) is Colour.AMBER
    assert only(history).remarks[-1].startswith("its stamps look like times of arrival, not of exposure (")


def lags(camera, *, confident=True):
    entry = CameraLag("cam0", True, "", 0.0, START_S + 30, 0.0, 0.0, 0.0)
    other = CameraLag(camera, confident, "" if confident else "nobody moved", 0.004, START_S + 30, 5e-4, 2.0, 3.0)
    return ContentLags("board", "cam0", (entry, other), 1e-4)


def test_pictures_are_put_beside_the_rig_file_through_the_reference_cameras_clock():
    document = rig_document({"cam0": model(offset=0.001, drift_ppm=0.0), "cam1": model(offset=0.005, drift_ppm=2.0)})
    history = history_of_capture(
        capture(cam0=stamps_of(60), cam1=stamps_of(60)), document=document, content=lags("cam1")
    )
    assert only(history, "cam0").measured == ()
    (video,) = only(history).measured
    at = np.argmin(np.abs(video.t_s - (START_S + 30)))
    assert (video.method, video.offset_s[at]) == ("video", pytest.approx(0.005 + 60e-6 + 0.004, abs=1e-6))
    assert video.bound_s[at] == pytest.approx(5e-4 + 2e-4 + 30e-6, abs=2e-5)
    (left,) = only(history).misplaced
    assert left.offset_s[at] == pytest.approx(0.004, abs=1e-6)


def test_without_a_rig_file_pictures_are_relative_to_the_reference_camera():
    history = history_of_capture(capture(cam0=stamps_of(60), cam1=stamps_of(60)), content=lags("cam1"))
    assert history.error_m(only(history, "cam0")) == 0.0
    assert only(history, "cam0").remarks == (
        "rig time is taken to be its own: the others were compared with it, and no rig file holds a clock of it",
    )
    assert history.error_m(only(history)) == pytest.approx(2 * (0.004 + 5e-4 + 60e-6 + 90e-6), rel=0.01)


def test_pictures_that_do_not_decide_are_not_drawn_but_said():
    history = history_of_capture(capture(cam0=stamps_of(60), cam1=stamps_of(60)), content=lags("cam1", confident=False))
    assert only(history).measured == ()
    assert only(history).remarks[-1] == "its pictures do not tell its clock: nobody moved"


def test_times_without_an_epoch_take_no_clocks_and_count_from_the_first_frame(tmp_path):
    stamps = [stamps_of(30) - START_S, stamps_of(30) - START_S]
    rows = [f"{i},{t:.9f}" for i, camera in enumerate(stamps) for t in camera]
    (tmp_path / "timestamps.csv").write_text("\n".join(["cam_id,frame_time", *rows]))
    plain = Capture(tmp_path, tuple(named(f"cam{i}", camera) for i, camera in enumerate(stamps)))
    document = rig_document({"cam1": model()})
    history = history_of_capture(plain, document=document, log={"cam1": probes(30)})
    assert (history.epoch, history.span_s[0], only(history).offsets) == (False, 0.0, ())
    assert history.remarks == (
        "the times of timestamps.csv do not count from 1970 (UTC): neither the rig file's clocks nor probes apply to "
        "them; stamp frames with seconds since 1970, or compare pictures (rigcal sync video)",
    )
    relative = replace(lags("cam1"), cameras=tuple(replace(c, at_s=10.0) for c in lags("cam1").cameras))
    (video,) = only(history_of_capture(plain, content=relative)).measured
    assert video.offset_s[np.argmin(np.abs(video.t_s - 10))] == pytest.approx(0.004, abs=1e-6)


def test_images_without_times_say_what_to_do():
    camera = CaptureCamera("cam0", "images", (Path("0001.jpg"),), ("0001",), (640, 480))
    with pytest.raises(NoStampsError) as caught:
        history_of_capture(Capture(Path("/captures/hall-3"), (camera,)))
    assert str(caught.value) == (
        "the capture does not say when its frames were taken\n"
        "  where:    /captures/hall-3\n"
        "  expected: timestamps.csv, times in the names of images, or videos with presentation times\n"
        "  got:      images without times\n"
        "  do next:  write timestamps.csv with columns cam_id, frame_time (seconds), or let the recorder name images "
        "by their time, such as 20260412T093001.250000Z.jpg"
    )


def test_a_torn_log_is_said(tmp_path):
    append_exchanges(tmp_path / PROBE_LOG, {"cam1": probes(60)})
    with (tmp_path / PROBE_LOG).open("a") as file:
        file.write("cam1,17")
    history = history_of_capture(capture(cam1=stamps_of(60)), log=read_exchanges(tmp_path / PROBE_LOG))
    assert history.remarks[-1] == (
        "the last row of the probe log is unfinished and was left out: its writer was stopped"
    )
    assert len(only(history).measured) == 1


def test_minutes_hold_offset_bound_drops_and_rate_of_each_minute():
    stamps_s = np.delete(stamps_of(150), np.arange(2000, 2090))
    document = rig_document({"cam1": model(drift_ppm=0.0)})
    history = history_of_capture(
        capture(cam0=stamps_of(150), cam1=stamps_s), document=document, log={"cam1": probes(150)}
    )
    minutes = minutes_of(history, only(history))
    assert [m.start_s - START_S for m in minutes] == [-10, 50, 110]
    assert [m.missing for m in minutes] == [0, 90, 0]
    assert [m.frames for m in minutes] == pytest.approx([1500, 1710, 1200], abs=1)
    assert [m.delivered_fps for m in minutes] == pytest.approx([30, 28.5, 30], abs=0.05)
    assert [m.misplaced_s for m in minutes] == pytest.approx([50e-6, 160e-6, 260e-6], abs=25e-6)
    assert all(m.offset_s == pytest.approx(0.004 + m.misplaced_s, abs=1e-9) for m in minutes)
    assert all(100e-6 < m.bound_s < 300e-6 and m.error_m >= 2 * (m.misplaced_s + 1e-4) for m in minutes)


def test_the_summary_is_json_with_utc_minutes():
    history = history_of_capture(capture(cam0=stamps_of(90), cam1=stamps_of(90)), log={"cam1": probes(90)})
    summary = json.loads(json.dumps(summary_per_minute(history), allow_nan=False))
    cameras = {camera["camera"]: camera for camera in summary["cameras"]}
    assert cameras["cam0"]["colour"] == "amber"
    assert cameras["cam0"]["error_m"] is None
    assert cameras["cam1"]["measured_by"] == ["probe"]
    assert [m["start_utc"] for m in cameras["cam1"]["minutes"]] == ["2026-04-12T13:20:00Z", "2026-04-12T13:21:00Z"]


@pytest.mark.skipif(not CALISCOPE.exists(), reason="the captures of ../shared/data are not here")
def test_a_real_capture_of_webcams_is_stamped_on_arrival():
    history = history_of_capture(open_capture(CALISCOPE))
    assert [len(camera.frame_t_s) for camera in history.cameras] == [111] * 4
    assert all(camera.arrival_stamps and len(camera.missing_t_s) == 0 for camera in history.cameras)
    assert history.span_s[1] == pytest.approx(18.3, abs=0.3)
    assert not history.epoch


def recorded(path, document, times_ns, *, kind="video", latency_ns=0, metadata=None, attach=True, finish=True):
    """An MCAP as recognition run writes it, with messages that no one decodes."""
    rig_path = path.with_suffix(".rig.json")
    write_rigfile(document, rig_path)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=2000, compression=CompressionType.ZSTD)
        writer.start()
        if attach:
            data = rig_path.read_bytes() if attach is True else attach
            writer.add_attachment(0, 0, "rig.json", "application/json", data)
        writer.add_metadata("rigcal", metadata or {})
        schema = writer.register_schema("foxglove.CompressedVideo", "protobuf", b"")
        topics = {camera: writer.register_channel(f"/{camera}/{kind}", "protobuf", schema) for camera in times_ns}
        other = writer.register_channel("/tf", "protobuf", schema)
        for i in range(max(map(len, times_ns.values()))):
            writer.add_message(other, 0, b"x" * 50, 0)
            for camera, t_ns in times_ns.items():
                if i < len(t_ns):
                    writer.add_message(topics[camera], int(t_ns[i]) + latency_ns, b"p" * 70, int(t_ns[i]), i)
        if finish:
            writer.finish()
    return path


def test_a_recordings_frames_bear_rig_time_and_its_rig_files_clocks(tmp_path):
    document = rig_document({"cam1": model()}, ("cam0", "cam1", "cam2"))
    t_ns = (np.int64(START_S) * 10**9) + np.arange(900, dtype=np.int64) * 33_333_333
    metadata = {"sync": json.dumps({"warnings": ["cam1: its frames may be grouped with the wrong ones"]})}
    path = recorded(
        tmp_path / "run.mcap", document, {"cam0": t_ns, "cam1": np.delete(t_ns, 450)}, latency_ns=9, metadata=metadata
    )
    told = []
    recording = read_recording(path, progress=lambda done, of: told.append((done, of)))
    np.testing.assert_array_equal(recording.cameras[0].captured_ns, t_ns)
    np.testing.assert_array_equal(recording.cameras[0].logged_ns, t_ns + 9)
    assert len(recording.cameras[2].captured_ns) == 0
    assert told[-1][0] == told[-1][1] == len(told) > 10
    history = history_of_recording(recording, log={"cam1": probes(30)})
    assert (history.title, history.epoch) == ("run.mcap", True)
    assert history.remarks == ("cam1: its frames may be grouped with the wrong ones",)
    camera = only(history)
    np.testing.assert_allclose(camera.missing_t_s, t_ns[450] * 1e-9, atol=1e-5)
    assert [series.method for series in camera.offsets] == ["probe", "rig file"]
    assert history.error_m(camera) < 0.002
    assert colour_of(history, only(history, "cam2")) is Colour.AMBER


def test_a_run_on_detections_alone_is_timed_by_its_annotations(tmp_path):
    t_ns = np.arange(90, dtype=np.int64) * 33_333_333
    path = recorded(tmp_path / "run.mcap", rig_document({}), {"cam0": t_ns, "cam1": t_ns}, kind="annotations")
    history = history_of_recording(read_recording(path))
    assert not history.epoch
    assert history.remarks[0] == (
        "the recording's times do not count from 1970 (UTC): neither the rig file's clocks nor probes apply to them; "
        "stamp frames with seconds since 1970, or compare pictures (rigcal sync video)"
    )
    assert len(only(history).frame_t_s) == 90
    assert only(history).remarks == (
        "its times are as regular as times made from frame numbers: lost frames and clocks do not show in such",
    )


def refused(path):
    with pytest.raises(RecordedClocksError) as caught:
        read_recording(path)
    assert caught.value.where == str(path)
    return caught.value


def test_an_absent_recording_says_to_check_the_path(tmp_path):
    error = refused(tmp_path / "none.mcap")
    assert (error.what, error.do_next) == ("there is no such recording", "check the path")


@pytest.mark.parametrize(("content", "got"), [(b"RIFF1234....", "b'RIFF1234'"), (b"", "an empty file")])
def test_another_file_is_told_from_a_recording(tmp_path, content, got):
    (tmp_path / "run.mcap").write_bytes(content)
    error = refused(tmp_path / "run.mcap")
    assert error.what == "not an MCAP file"
    assert error.got.endswith(got)
    assert error.do_next == "give the .mcap file or the folder of the capture"


def test_an_unfinished_recording_names_the_command_that_mends_it(tmp_path):
    t_ns = np.arange(90, dtype=np.int64) * 33_333_333
    path = recorded(tmp_path / "run.mcap.part", rig_document({}), {"cam0": t_ns}, finish=False)
    error = refused(path)
    assert error.what == "the recording is unfinished or damaged"
    assert error.do_next == f"run `recognition recover {path} -o {tmp_path / 'run.mcap'}`, then report on that file"
    whole = recorded(tmp_path / "run.mcap", rig_document({}), {"cam0": t_ns})
    whole.write_bytes(whole.read_bytes()[:-500])
    assert f"-o {tmp_path / 'run-recovered.mcap'}`" in refused(whole).do_next
    assert refused(whole).got == "no end mark"


def test_a_recording_without_a_rig_or_with_a_changed_one_is_refused(tmp_path):
    t_ns = np.arange(9, dtype=np.int64)
    error = refused(recorded(tmp_path / "run.mcap", rig_document({}), {"cam0": t_ns}, attach=False))
    assert (error.what, error.expected) == (
        "the recording does not say which rig it is of",
        "an attachment rig.json",
    )
    changed = (tmp_path / "run.rig.json").read_bytes().replace(b"hall-3", b"hall-4")
    error = refused(recorded(tmp_path / "run.mcap", rig_document({}), {"cam0": t_ns}, attach=changed))
    assert error.what == "the rig file inside the recording cannot be used"
    assert error.got.startswith("its digest is sha256:")
    error = refused(recorded(tmp_path / "run.mcap", rig_document({}), {"cam0": t_ns}, attach=b"{}"))
    assert error.do_next == f"run `recognition check {tmp_path / 'run.mcap'}`, which says what is wrong with it"


def test_a_recording_without_frames_names_its_topics(tmp_path):
    path = recorded(tmp_path / "run.mcap", rig_document({}), {"other": np.arange(9, dtype=np.int64)})
    error = refused(path)
    assert error.what == "the recording holds no frames of the rig's cameras"
    assert (error.expected, error.got) == ("topics such as /cam0/video", "/other/video, /tf")
