"""Clocks from tracks: exact without noise, within their bounds with it, refused where the content does not decide."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.errors import OptionError, TracksError
from rigcal.geometry import Pose
from rigcal.sync.content.points.interpolate import interpolate
from rigcal.sync.content.points.seen import prepare
from rigcal.sync.content.points.solve import LagOptions, estimate_lags
from rigcal.sync.content.synthetic import CameraClock, carried_board, exact_tracks, with_noise
from rigcal.sync.content.tracks import PointTracks
from rigcal.synthetic import arc_rig

BOARD = Checkerboard(4, 3, 0.12)
RIG = arc_rig(3, arc_deg=60, radius_m=3.0)
CLOCKS = {
    "cam0": CameraClock(phase_s=0.011),
    "cam1": CameraClock(0.2137, 40.0, phase_s=0.003),
    "cam2": CameraClock(-0.3071, -25.0, phase_s=0.029),
}
NEAR = {camera_id: clock.offset_s for camera_id, clock in CLOCKS.items()}
QUICK = LagOptions(search_s=0.1)


def truth_s(lag, clocks=CLOCKS):
    clock = clocks[lag.camera_id]
    return clock.offset_s + clock.drift_ppm * 1e-6 * lag.at_s


@pytest.fixture(scope="module")
def tracks():
    return exact_tracks(RIG, BOARD, carried_board(RIG, BOARD, seed=1), CLOCKS, seconds=9.0)


def lags_of(tracks, options=QUICK, start_s=NEAR, rig=RIG):
    return estimate_lags(rig, tracks, method="board", options=options, start_s=start_s)


def test_exact_tracks_give_offset_and_drift_from_nothing(tracks):
    lags = lags_of(tracks, LagOptions(search_s=0.6), None)
    assert [lag.camera_id for lag in lags.cameras] == ["cam0", "cam1", "cam2"]
    assert lags.reference == "cam0"
    assert lags.camera("cam0").offset_s == lags.camera("cam0").bound_s == 0.0
    for lag in lags.cameras[1:]:
        assert lag.confident, lag.reason
        assert abs(lag.offset_s - truth_s(lag)) < 5e-6  # measured: 1.2 us, what cubics leave of the motion
        assert abs(lag.drift_ppm - CLOCKS[lag.camera_id].drift_ppm) < 2.0
        assert lag.searched_s[np.nanargmin(lag.cost)] == pytest.approx(truth_s(lag), abs=0.012)
    assert lags.residual_s < 1e-5


def test_noise_stays_within_the_bound(tracks):
    for seed in range(3):
        for lag in lags_of(with_noise(tracks, 0.1, seed=seed)).cameras[1:]:
            assert lag.confident
            assert abs(lag.offset_s - truth_s(lag)) < lag.bound_s < 0.5e-3
            assert abs(lag.offset_s - truth_s(lag)) < 0.05e-3  # measured: 0.01 ms


def test_stamps_that_are_moved_move_the_offset_by_as_much(tracks):
    noisy = with_noise(tracks, 0.3, seed=5)
    later = [replace(t, t_s=t.t_s + 0.040) if t.camera_id == "cam1" else t for t in noisy]
    moved = NEAR | {"cam1": NEAR["cam1"] - 0.040}
    before, after = lags_of(noisy), lags_of(later, start_s=moved)
    assert after.camera("cam1").offset_s - before.camera("cam1").offset_s == pytest.approx(-0.040, abs=1e-5)
    assert after.camera("cam2").offset_s == pytest.approx(before.camera("cam2").offset_s, abs=1e-5)


def test_noise_of_three_pixels_does_not_pull_offsets_to_half_a_frame():
    clocks = {"cam0": CameraClock(), "cam1": CameraClock(), "cam2": CameraClock()}  # frames at the same instants
    motion = carried_board(RIG, BOARD, seed=3, speed=0.5)
    exact = exact_tracks(RIG, BOARD, motion, clocks, seconds=12.0)
    for seed in range(2):
        for lag in lags_of(with_noise(exact, 3.0, seed=seed), start_s=None).cameras[1:]:
            assert lag.confident
            assert abs(lag.offset_s) < min(lag.bound_s, 1.5e-3)


def test_a_calibration_that_is_off_by_pixels_does_not_bias(tracks):
    turned = [c.cam_from_rig.perturbed([0.0012, -0.0009, 0.001], [0.002, 0.003, -0.002]) for c in RIG.cameras[1:]]
    cameras = [replace(c, cam_from_rig=pose) for c, pose in zip(RIG.cameras[1:], turned, strict=True)]
    off = replace(RIG, cameras=(RIG.cameras[0], *cameras))
    assert np.linalg.norm(off.cameras[1].camera.params[0] * 0.0012) > 1.5  # pixels
    for lag in lags_of(with_noise(tracks, 0.1, seed=1), rig=off).cameras[1:]:
        assert lag.confident
        assert abs(lag.offset_s - truth_s(lag)) < min(lag.bound_s, 0.1e-3)  # measured: 0.02 ms


@pytest.mark.parametrize("estimated", [False, True])
def test_rows_of_a_rolling_shutter_are_given_or_estimated(estimated):
    clocks = {camera_id: replace(clock, readout_s=0.02) for camera_id, clock in CLOCKS.items()}
    exact = exact_tracks(RIG, BOARD, carried_board(RIG, BOARD, seed=2), clocks, seconds=9.0)
    given = {} if estimated else dict.fromkeys(clocks, 0.02)
    lags = lags_of(with_noise(exact, 0.1, seed=2), replace(QUICK, readout_s=given, estimate_readout=estimated))
    for lag in lags.cameras:
        assert lag.confident
        assert abs(lag.offset_s - truth_s(lag, clocks)) < 0.1e-3
        assert lag.readout_s == pytest.approx(0.02, abs=1e-3)
        assert (lag.readout_sigma_s is not None) == estimated


def test_points_that_are_often_missing_do(tracks):
    rng = np.random.default_rng(0)
    holes = [
        replace(t, points_px=np.where(rng.random(t.points_px.shape[:2])[..., None] < 0.15, np.nan, t.points_px))
        for t in with_noise(tracks, 0.3, seed=0)
    ]
    for lag in lags_of(holes).cameras[1:]:
        assert lag.confident
        assert abs(lag.offset_s - truth_s(lag)) < lag.bound_s < 2e-3


def test_wild_points_are_not_believed(tracks):
    rng = np.random.default_rng(0)
    wild = [
        replace(t, points_px=np.where(rng.random(t.points_px.shape[:2])[..., None] < 0.02, 300.0, t.points_px))
        for t in with_noise(tracks, 0.1, seed=0)
    ]
    for lag in lags_of(wild).cameras[1:]:
        assert abs(lag.offset_s - truth_s(lag)) < lag.bound_s < 2e-3


def test_a_short_recording_tells_no_drift(tracks):
    short = [replace(t, t_s=t.t_s[:180], points_px=t.points_px[:180]) for t in with_noise(tracks, 0.5, seed=0)]
    for lag in lags_of(short).cameras[1:]:
        assert (lag.drift_ppm, lag.drift_bound_ppm) == (0.0, 100.0)


def test_stamps_of_the_unix_epoch_lose_no_digits_that_matter(tracks):
    late = [replace(t, t_s=t.t_s + 1.8e9) for t in tracks]
    for lag, plain in zip(lags_of(late).cameras, lags_of(tracks).cameras, strict=True):
        assert lag.offset_s == pytest.approx(plain.offset_s, abs=2e-6)
        assert lag.at_s - 1.8e9 == pytest.approx(plain.at_s, abs=1e-3)


def moved_by(path):
    """A board that is carried along ``path(t)`` in its own frame."""
    rest = carried_board(RIG, BOARD, seed=0, speed=0.0)(0.0)
    return lambda t: Pose(rest.rotation, rest.translation_m + rest.rotation @ np.asarray(path(t)))


def refused(motion, *, seconds=8.0, options=LagOptions(search_s=1.5), ids=("cam0", "cam1", "cam2")):
    clocks = {camera_id: CLOCKS[camera_id] for camera_id in ids}
    exact = exact_tracks(RIG, BOARD, motion, clocks, seconds=seconds)
    lags = estimate_lags(RIG, with_noise(exact, 0.1, seed=0), method="board", options=options)
    assert not any(lag.confident for lag in lags.cameras)
    return lags.cameras[1].reason


def test_a_still_board_is_refused():
    assert refused(moved_by(lambda t: [0.0, 0.0, 0.0])) == "nothing moves"


def test_periodic_motion_is_refused():
    reason = refused(moved_by(lambda t: [0.2 * np.sin(8 * t), 0.15 * np.cos(8 * t), 0.1 * np.cos(8 * t)]))
    assert reason.startswith("the best two offsets are alike: ")
    assert reason.count(" ms") == 2


def test_motion_along_epipolar_lines_is_refused():
    baseline = -RIG.cameras[1].cam_from_rig.inverse().translation_m
    rest = carried_board(RIG, BOARD, seed=0, speed=0.0)(0.0)
    along = rest.rotation.T @ baseline / np.linalg.norm(baseline)
    reason = refused(moved_by(lambda t: 0.2 * np.sin(3 * t + np.sin(t)) * along), ids=("cam0", "cam1"))
    assert reason == "nothing moves across the epipolar lines, so that every offset fits alike"


def test_recordings_that_do_not_overlap_are_refused(tracks):
    apart = [replace(t, t_s=t.t_s + 100.0 * index) for index, t in enumerate(tracks)]
    lags = lags_of(apart, LagOptions(search_s=0.5), None)
    assert lags.camera("cam1").reason == "too little overlap: no other camera saw the same points at the same time"
    assert not lags.camera("cam0").confident


def test_an_offset_at_the_end_of_the_search_is_refused(tracks):
    lags = lags_of(tracks[:2], LagOptions(search_s=0.2), None)
    assert lags.camera("cam1").reason.endswith("is at an end of the search, 0.2 s either way")


def test_one_camera_that_does_not_decide_leaves_the_others(tracks):
    still = replace(tracks[2], points_px=np.repeat(tracks[2].points_px[:1], len(tracks[2].t_s), axis=0))
    lags = lags_of([*with_noise(tracks[:2], 0.1, seed=0), still], LagOptions(search_s=0.5), None)
    assert [lag.confident for lag in lags.cameras] == [True, True, False]


def test_the_instrument_shares_no_noise_with_the_position():
    rng = np.random.default_rng(0)
    t_s = np.arange(8) / 30 + rng.uniform(-0.004, 0.004, 8)
    noise = PointTracks("cam0", t_s, rng.normal(500, 1.0, (8, 20000, 2)))
    seen = prepare(RIG.cameras[0], noise, 0.0)
    view = interpolate(seen, seen.t_s, 0.0, np.array([seen.t_s[3] + 0.008]))
    residual, instrument, slope = (
        v[0, :, 0] - v[0, :, 0].mean() for v in (view.px, view.instrument_px_s, view.velocity_px_s)
    )
    assert abs(np.mean(residual * instrument)) < 0.03 * residual.std() * instrument.std()
    assert abs(np.mean(residual * slope)) > 0.2 * residual.std() * slope.std()
    variance = np.var(seen.px[..., 0])
    assert np.mean(instrument * slope) / variance == pytest.approx(view.shared_noise[0, 0], rel=0.05)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda t: t[:1], "clocks are compared between cameras"),
        (lambda t: [t[0], replace(t[1], camera_id="door")], "camera door is not in the rig"),
        (lambda t: [t[0], replace(t[1], points_px=t[1].points_px[:, :3])], "cameras have unlike numbers of points"),
        (lambda t: [t[0], replace(t[1], t_s=t[1].t_s[::-1])], "the stamps of cam1 do not ascend"),
    ],
)
def test_tracks_that_cannot_be_compared_are_named(tracks, broken, message):
    with pytest.raises(TracksError, match=message) as caught:
        lags_of(broken(tracks))
    assert caught.value.do_next


@pytest.mark.parametrize(
    "bad",
    [{"search_s": 0.0}, {"drift_limit_ppm": -1.0}, {"readout_s": {"cam1": 20.0}}],
    ids=lambda bad: next(iter(bad)),
)
def test_options_out_of_range_are_named(bad):
    with pytest.raises(OptionError, match=f"option {next(iter(bad))}"):
        LagOptions(**bad)
