"""Common instants: the three rules, one to one within half a frame period, and clocks."""

from pathlib import Path

import numpy as np
import pytest

from rigcal.captures import Capture, CaptureCamera, open_capture
from rigcal.errors import TimestampsError
from rigcal.instants import find_instants, group_by_time
from rigcal.rig import ClockModel
from rigcal.stamps import match_camera_id

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "data"


def images(tmp_path, **frames):
    return Capture(
        tmp_path,
        tuple(CaptureCamera(c.replace("_", "-"), "images", (), tuple(names), (64, 48)) for c, names in frames.items()),
    )


def with_csv(tmp_path, text, frames=3):
    (tmp_path / "timestamps.csv").write_text(text)
    names = [f"{i}" for i in range(frames)]
    return images(tmp_path, cam_0=names, cam_1=names)


def rows(instants):
    return instants.frame_idx.tolist()


def test_timestamps_come_before_everything_else(tmp_path):
    text = "sync_index,cam_id,frame_index,frame_time\n" + "".join(
        f"{i},{c},9,{10 + 0.1 * i + 0.01 * c}\n" for i in reversed(range(3)) for c in (1, 0)
    )
    instants = find_instants(with_csv(tmp_path, text))
    assert instants.rule == "timestamps.csv"
    assert rows(instants) == [[0, 0], [1, 1], [2, 2]]
    assert np.allclose(instants.spread_s, 0.01)
    assert np.allclose(instants.t_s, [10.005, 10.105, 10.205])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cam_id,time\n0,1\n", "no column frame_time"),
        ("", "no column cam_id, frame_time"),
        ("cam_id,frame_time\n7,1.0\n", "line 2 names camera '7'"),
        ("cam_id,frame_time\n0,soon\n", "line 2 has no time"),
        ("cam_id,frame_time\n0,nan\n", "line 2 has no time"),
        (
            "cam_id,frame_time\n0,1\n0,2\n1,1\n1,2\n1,3\n",
            "expected: 3 rows for the 3 frames of cam-0\n  got:      2 rows",
        ),
    ],
)
def test_mistakes_in_timestamps_are_told(tmp_path, text, words):
    with pytest.raises(TimestampsError) as caught:
        find_instants(with_csv(tmp_path, text))
    assert words in str(caught.value)
    assert str(tmp_path / "timestamps.csv") in str(caught.value)
    assert "do next:  mend the file, or remove it" in str(caught.value)


def test_times_in_file_names_are_read(tmp_path):
    utc = [f"20260412T09300{i}.250000Z" for i in range(3)]
    first_ns = 1775986201_250000000
    nanoseconds = [f"frame_{first_ns + 10**9 * i + 10**6}" for i in range(3)]
    instants = find_instants(images(tmp_path, a=utc, b=nanoseconds))
    assert instants.rule == "file times"
    assert rows(instants) == [[0, -1], [1, 0], [2, 1], [-1, 2]]
    assert instants.t_s[1] == pytest.approx(1775986201.2505, abs=1e-6)
    microseconds = [f"{(first_ns // 1000) + 10**6 * i}" for i in range(3)]
    assert rows(find_instants(images(tmp_path, b=nanoseconds, c=microseconds))) == [[0, 0], [1, 1], [2, 2]]


def test_numbers_at_the_end_of_names_are_the_last_rule(tmp_path):
    capture = images(tmp_path, a=["cam01_00_int", "cam01_02_int"], b=["x_2", "x_3"])
    instants = find_instants(capture)
    assert instants.rule == "frame numbers"
    assert rows(instants) == [[0, -1], [1, 0], [-1, 1]]


@pytest.mark.parametrize("names", [["one", "two"], ["a1", "b1"]])
def test_frames_without_common_instants_stand_alone(tmp_path, names):
    instants = find_instants(images(tmp_path, a=names, b=["0", "1"]))
    assert instants.rule == "none"
    assert rows(instants) == [[0, -1], [1, -1], [-1, 0], [-1, 1]]


def test_clock_models_move_times_before_they_are_grouped(tmp_path):
    times = np.arange(5) / 30
    text = "cam_id,frame_time\n" + "".join(f"0,{t}\n1,{t - 0.5}\n" for t in times)
    clock = ClockModel(0.5, 0.0, "1970-01-01T00:00:00Z", 1e-4, 0.1, "probe")
    assert rows(find_instants(with_csv(tmp_path, text, 5), {"cam-1": clock})) == [[i, i] for i in range(5)]
    assert all(-1 in row for row in rows(find_instants(with_csv(tmp_path, text, 5))))


def test_a_dropped_frame_shifts_nothing():
    times = np.arange(10) / 30
    instants = group_by_time([times, np.delete(times, 4) + 0.002], rule="t")
    assert rows(instants) == [[i, i if i < 4 else -1 if i == 4 else i - 1] for i in range(10)]


def test_frames_that_the_first_camera_lacks_are_still_grouped():
    times = np.arange(10) / 30
    instants = group_by_time([times, np.delete(times, [0, 5]), np.delete(times, [0])], rule="t")
    without = group_by_time([np.delete(times, 5), np.delete(times, 2), np.delete(times, 2)], rule="t")
    assert rows(instants)[0] == [0, -1, -1]
    assert [-1, 4, 4] in rows(without)


@pytest.mark.parametrize("seed", range(20))
def test_every_frame_is_in_exactly_one_instant_and_groups_are_tight(seed):
    rng = np.random.default_rng(seed)
    times = []
    for _ in range(4):
        kept = np.flatnonzero(rng.random(60) > 0.15)
        times.append(kept / 30 + rng.normal(0, 0.003, len(kept)))
    instants = group_by_time(times, rule="t")
    for camera, t in enumerate(times):
        used = instants.frame_idx[:, camera]
        assert sorted(used[used >= 0]) == list(range(len(t)))
    assert instants.spread_s.max() <= 1 / 30
    assert (np.diff(instants.t_s) >= 0).all()
    assert (np.count_nonzero(instants.frame_idx >= 0, axis=1) > 1).mean() > 0.9


@pytest.mark.parametrize(
    ("name", "ids", "expected"),
    [
        ("cam0", ["cam0", "cam1"], "cam0"),
        ("1", ["cam_0", "cam_01"], "cam_01"),
        ("1", ["a1", "b1"], None),
        ("x", ["cam0"], None),
        ("10", ["cam1", "cam10"], "cam10"),
    ],
)
def test_cameras_are_matched_by_name_else_by_their_unique_number(name, ids, expected):
    assert match_camera_id(name, ids) == expected


@pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")
def test_the_real_timestamps_group_every_frame():
    capture = open_capture(REAL / "calibration/caliscope_charuco_calibration/calibration/extrinsic")
    instants = find_instants(capture)
    assert instants.rule == "timestamps.csv"
    assert instants.frame_idx.shape == (111, 4)
    assert (instants.frame_idx >= 0).all()
    assert np.median(instants.spread_s) == pytest.approx(0.003, abs=0.0005)
    assert instants.spread_s.max() == pytest.approx(0.0427, abs=0.0005)


def test_clocks_of_another_epoch_are_not_applied_to_stamps_that_count_from_a_start(tmp_path):
    text = "cam_id,frame_time\n" + "".join(f"{c},{0.1 * i}\n" for i in range(5) for c in (0, 1))
    clock = ClockModel(0.03, 40.0, "2026-11-22T09:00:00Z", 1e-4, 0.1, "probe")
    assert rows(find_instants(with_csv(tmp_path, text, 5), {"cam-1": clock})) == [[i, i] for i in range(5)]
    of_its_start = ClockModel(0.1, 0.0, "1970-01-01T00:00:01Z", 1e-4, 0.1, "video")
    moved = rows(find_instants(with_csv(tmp_path, text, 5), {"cam-1": of_its_start}))
    assert moved != [[i, i] for i in range(5)]
