"""Clocks from motion energy: to whole frames, or refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from rigcal.captures import open_capture
from rigcal.errors import ComparisonError
from rigcal.geometry import Floats
from rigcal.stamps import FrameStamps, frame_stamps
from rigcal.sync.content.energy import EnergySeries, energy_lags, lags_of_energy, measure_energy
from rigcal.sync.content.lags import CameraLag

SHARED = Path(__file__).resolve().parents[3].parent / "shared" / "data"


def activity(t_s: Floats, *, seed: int = 1, stop_s: float = 60.0) -> Floats:
    """How much people move at a time: starts, stops and turns of about 0.3 s."""
    at_s = np.arange(-10.0, stop_s, 0.01)
    return np.interp(
        t_s, at_s, np.exp(0.8 * gaussian_filter1d(np.random.default_rng(seed).normal(0, 8, len(at_s)), 25))
    )


def camera(
    camera_id: str, *, offset_s: float = 0.0, fps: float = 30.0, stop_s: float = 30.0, own: float = 0.25, seed: int = 1
) -> EnergySeries:
    """A camera's energy; ``own`` is the part of it (in the logarithm) that no other camera sees."""
    t_s = np.arange(int(stop_s * fps)) / fps
    rng = np.random.default_rng([seed, int(fps)])
    alone = activity(t_s, seed=seed + 100) ** own
    noise = rng.lognormal(0.0, 0.05, len(t_s))
    return EnergySeries(camera_id, t_s, activity(t_s + offset_s) * alone * noise)


def lag_of(one: EnergySeries, two: EnergySeries, *, search_s: float = 10.0) -> CameraLag:
    return lags_of_energy([one, two], reference=one.camera_id, search_s=search_s).cameras[1]


@pytest.mark.parametrize("offset_s", [0.0, 1.0, -2.45, 7.123])
def test_the_offset_is_found_within_its_bound_of_frames(offset_s: float) -> None:
    lag = lag_of(camera("cam0"), camera("cam1", offset_s=offset_s, seed=2))
    assert lag.confident
    assert 1 / 30 <= lag.bound_s < 0.12
    assert abs(lag.offset_s - offset_s) <= lag.bound_s


def test_the_offset_is_a_whole_number_of_frames() -> None:
    lag = lag_of(camera("cam0"), camera("cam1", offset_s=0.95, seed=2))
    assert lag.offset_s * 30 == pytest.approx(round(lag.offset_s * 30), abs=1e-6)


def test_cameras_of_unlike_frame_rates_are_compared_at_the_slower_one() -> None:
    lag = lag_of(camera("cam0", fps=60.0), camera("cam1", fps=25.0, offset_s=1.3, seed=2))
    assert lag.confident
    assert lag.bound_s >= 1 / 25
    assert abs(lag.offset_s - 1.3) <= lag.bound_s


def test_confident_offsets_hold_over_many_pairs_of_cameras() -> None:
    confident = wrong = 0
    for seed in range(30):
        offset_s = np.random.default_rng(seed).uniform(-4, 4)
        one, two = camera("cam0", seed=seed), camera("cam1", offset_s=offset_s, own=0.4, seed=seed + 50)
        lag = lag_of(one, two)
        confident += lag.confident
        wrong += lag.confident and abs(lag.offset_s - offset_s) > lag.bound_s
    assert wrong == 0
    assert confident >= 25  # measured: 30


def test_cameras_that_see_different_people_are_refused() -> None:
    t_s = np.arange(900) / 30
    for seed in range(10):
        other = EnergySeries("cam1", t_s, activity(t_s, seed=seed + 10))
        lag = lag_of(camera("cam0"), other)
        assert not lag.confident
        assert lag.reason.startswith("the motion of the two pictures hardly agrees (correlation 0.")
        assert lag.reason.endswith("record longer, with people who walk, stop and turn in view of all cameras")


def test_motion_that_repeats_is_refused() -> None:
    t_s = np.arange(900) / 30
    beat = 2 + np.sin(2 * np.pi * t_s / 1.7)
    lag = lag_of(EnergySeries("cam0", t_s, beat), EnergySeries("cam1", t_s, beat))
    assert not lag.confident
    assert lag.reason.startswith(("the motion agrees nearly as well at another offset (", "the motion of the two"))


def test_a_clock_that_is_stepped_on_the_way_is_refused() -> None:
    whole = camera("cam1", seed=2)
    stepped = EnergySeries("cam1", whole.t_s, np.where(whole.t_s < 15, whole.grey_per_s, np.roll(whole.grey_per_s, 5)))
    lag = lag_of(camera("cam0"), stepped)
    assert not lag.confident or lag.bound_s >= 3.4 / 30
    gone = EnergySeries("cam1", whole.t_s, np.where(whole.t_s < 15, whole.grey_per_s, np.roll(whole.grey_per_s, 9)))
    assert not lag_of(camera("cam0"), gone).confident


def test_short_recordings_are_refused() -> None:
    lag = lag_of(camera("cam0"), camera("cam1", stop_s=3.0))
    assert (lag.confident, lag.bound_s) == (False, np.inf)
    assert lag.reason == "3.0 s are too short; record 5 s or more of people moving"
    assert not lag_of(camera("cam0"), EnergySeries("cam1", np.zeros(0), np.zeros(0))).confident


def test_recordings_that_do_not_overlap_within_the_search_are_refused() -> None:
    one, two = camera("cam0"), camera("cam1")
    later = EnergySeries("cam1", two.t_s + 100.0, two.grey_per_s)
    assert lag_of(one, later, search_s=5.0).reason == "no 5 s are common within 5 s of the stamps"
    assert lag_of(one, EnergySeries("cam1", two.t_s + 3.0, two.grey_per_s)).offset_s == pytest.approx(-3.0)


def test_the_evidence_is_the_correlation_at_each_lag() -> None:
    lag = lag_of(camera("cam0"), camera("cam1", offset_s=1.0, seed=2))
    assert lag.searched_s is not None
    assert lag.cost is not None
    assert lag.searched_s[np.argmin(lag.cost)] == pytest.approx(lag.offset_s)
    assert (lag.drift_ppm, lag.drift_bound_ppm) == (0.0, 100.0)


def test_the_order_is_kept_and_the_reference_is_at_zero() -> None:
    lags = lags_of_energy([camera("cam1", seed=2, offset_s=0.5), camera("cam0")], reference="cam0")
    assert lags.method == "motion energy"
    assert [lag.camera_id for lag in lags.cameras] == ["cam1", "cam0"]
    assert (lags.cameras[1].offset_s, lags.cameras[1].bound_s, lags.cameras[1].confident) == (0.0, 0.0, True)


def test_cameras_that_cannot_be_compared_are_an_error() -> None:
    with pytest.raises(ComparisonError, match="clocks are compared between cameras"):
        lags_of_energy([camera("cam0")], reference="cam0")
    with pytest.raises(ComparisonError, match="the reference camera is not in the capture"):
        lags_of_energy([camera("cam0"), camera("cam1")], reference="north")


def walking_square(folder: Path, *, frames: int = 200, late: int = 12) -> Path:
    """Two cameras that see a square move and rest; the second's stamps of the same are ``late`` frames later."""
    speed = activity(np.arange(frames + late) / 10)
    place = 20 + np.cumsum(speed) * 1.5
    for name, first in (("cam0", late), ("cam1", 0)):
        (folder / name).mkdir()
        for index in range(frames):
            image = np.full((90, 160), 90, dtype=np.uint8)
            x = int(place[first + index]) % 140
            image[30:60, x : x + 20] = 200
            cv2.imwrite(str(folder / name / f"{index:04d}.png"), image)
    return folder


def test_a_capture_is_measured_and_compared(tmp_path: Path) -> None:
    capture = open_capture(walking_square(tmp_path))
    times_s = np.arange(200) / 10
    told: list[tuple[int, int]] = []
    lags = energy_lags(
        capture,
        FrameStamps("file times", (times_s, times_s)),
        reference="cam0",
        progress=lambda done, total: told.append((done, total)),
    )
    assert lags.cameras[1].confident
    assert lags.cameras[1].offset_s == pytest.approx(-1.2, abs=lags.cameras[1].bound_s)
    assert told[0] == (2, 400)
    assert told[-1] == (400, 400)
    with pytest.raises(ValueError, match=r"stamps of \[200, 3\] frames for a capture of \[200, 200\]"):
        measure_energy(capture, FrameStamps("file times", (times_s, times_s[:3])))
    with pytest.raises(ComparisonError, match="the reference camera is not in the capture"):
        energy_lags(capture, FrameStamps("file times", (times_s, times_s)), reference="north")


def test_real_webcams_agree_to_a_frame_wherever_they_are_confident() -> None:
    folder = SHARED / "calibration/caliscope_charuco_calibration/calibration/extrinsic"
    if not folder.is_dir():
        pytest.skip("the shared captures are not here")
    capture = open_capture(folder)
    stamps = frame_stamps(capture)
    assert stamps is not None
    lags = energy_lags(capture, stamps, reference="cam_0")
    assert [lag.confident for lag in lags.cameras] == [True, False, True, True]
    for lag in lags.cameras:
        assert not lag.confident or abs(lag.offset_s) <= max(lag.bound_s, 0.0)
