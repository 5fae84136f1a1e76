"""Clocks from a light: cells of brightness made from the truth, so that every shutter and lamp is exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from rigcal.captures import open_capture
from rigcal.errors import ComparisonError, OptionError
from rigcal.geometry import Floats
from rigcal.stamps import frame_stamps
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.content.light.brightness import BrightnessSeries, measure_brightness
from rigcal.sync.content.light.changes import find_changes
from rigcal.sync.content.light.lags import LightOptions, light_lags, stamp_jitter_s

SHARED = Path(__file__).resolve().parents[3].parent / "shared" / "data"
BANDS, COLUMNS, HEIGHT = 32, 8, 1080
EVENTS = np.array([1.3, 2.71, 4.02, 4.93, 6.77, 7.61, 9.18, 10.49, 12.35, 13.22, 14.87, 15.64])
"""Times of switching, unevenly apart."""


@dataclass(frozen=True)
class Shutter:
    """A camera, how it exposes, and its clock: ``t_rig = t_cam + offset_s + drift_ppm 1e-6 t_cam``."""

    exposure_s: float = 0.030
    readout_s: float = 0.0
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    fps: float = 30.0
    phase_s: float = 0.0
    noise_grey: float = 0.05
    dark: float = 0.10
    lamp: float = 0.35
    seed: int = 1


@dataclass(frozen=True)
class Lamp:
    """A lamp that is off before the first time, on to the second, and so on."""

    times_s: Floats = field(default_factory=lambda: EVENTS)
    rise_s: float = 0.0

    def gathered_s(self, t_s: Floats) -> Floats:
        total = np.zeros_like(t_s)
        for index, at_s in enumerate(self.times_s):
            late_s = np.maximum(t_s - at_s, 0.0)
            ramp_s = np.minimum(late_s, self.rise_s)
            total += (-1.0) ** index * (late_s - ramp_s + (ramp_s**2 / (2 * self.rise_s) if self.rise_s else 0.0))
        return total


def film(
    camera_id: str, shutter: Shutter, lamp: Lamp, *, stop_s: float = 17.0, start_s: float = 0.0
) -> BrightnessSeries:
    """What a camera measures, from ``start_s`` to ``stop_s`` in rig time."""
    rng = np.random.default_rng(shutter.seed)
    t_s = start_s - shutter.offset_s + shutter.phase_s + np.arange(int((stop_s - start_s) * shutter.fps)) / shutter.fps
    rig_s = t_s + shutter.offset_s + shutter.drift_ppm * 1e-6 * t_s
    rows = (np.arange(BANDS * 4) + 0.5) / (BANDS * 4) - 0.5
    middle_s = rig_s[:, None] + shutter.readout_s * rows
    half_s = shutter.exposure_s / 2
    part = (lamp.gathered_s(middle_s + half_s) - lamp.gathered_s(middle_s - half_s)) / shutter.exposure_s
    texture = rng.uniform(0.3, 1.0, (BANDS, COLUMNS))
    light = (shutter.dark + shutter.lamp * part.reshape(len(t_s), BANDS, 4))[:, :, None, :] * texture[:, :, None]
    cells = (255 * np.clip(light, 0, 1) ** (1 / 2.2)).mean(axis=3)
    cells += shutter.noise_grey * rng.standard_normal(cells.shape)
    return BrightnessSeries(camera_id, t_s, cells, np.zeros((BANDS, COLUMNS)), HEIGHT)


def lag_of(
    one: Shutter, two: Shutter, lamp: Lamp = Lamp(), *, options: LightOptions = LightOptions(), **film_options: float
) -> CameraLag:
    """The second camera's clock beside the first's."""
    series = [film("cam0", one, lamp, **film_options), film("cam1", two, lamp, **film_options)]
    return light_lags(series, reference="cam0", options=options).cameras[1]


def true_offset_s(shutter: Shutter, lag: CameraLag) -> float:
    return shutter.offset_s + shutter.drift_ppm * 1e-6 * lag.at_s


SHUTTERS = {
    "short": Shutter(0.002),
    "medium": Shutter(0.010),
    "long": Shutter(0.030),
    "rolling": Shutter(0.005, 0.020),
    "bottom first": Shutter(0.005, -0.020),
}


@pytest.mark.parametrize("name", SHUTTERS)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_bound_holds_the_truth_for_every_shutter(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = replace(SHUTTERS[name], phase_s=rng.uniform(0, 1 / 30))
    two = replace(SHUTTERS[name], phase_s=rng.uniform(0, 1 / 30), offset_s=rng.uniform(-3, 3), drift_ppm=30.0, seed=7)
    lag = lag_of(one, two)
    assert lag.confident
    assert abs(lag.offset_s - true_offset_s(two, lag)) <= lag.bound_s
    assert abs(lag.drift_ppm - two.drift_ppm) <= lag.drift_bound_ppm


def test_the_offset_is_what_to_add_to_the_stamps_of_the_camera() -> None:
    lag = lag_of(Shutter(), Shutter(offset_s=-0.5, phase_s=0.01))
    assert lag.offset_s == pytest.approx(-0.5, abs=0.002)


def test_long_exposures_tell_the_offset_to_a_millisecond_from_twelve_switchings() -> None:
    errors = []
    for seed in range(3):
        two = Shutter(offset_s=0.2 + 0.007 * seed, phase_s=0.009 * seed, seed=seed)
        lag = lag_of(Shutter(), two)
        errors.append(lag.offset_s - true_offset_s(two, lag))
    assert np.sqrt(np.mean(np.square(errors))) < 1e-3, errors


def test_more_switchings_narrow_the_bound() -> None:
    two = Shutter(offset_s=0.1, phase_s=0.013)
    few, many = (lag_of(Shutter(), two, Lamp(EVENTS[:count])) for count in (2, 12))
    assert many.bound_s < few.bound_s


def test_one_switching_of_short_exposures_is_told_to_a_frame_and_says_so() -> None:
    two = Shutter(0.002, offset_s=0.4, phase_s=0.02)
    lag = lag_of(Shutter(0.002), two, Lamp(EVENTS[:1]), stop_s=4.0)
    assert lag.confident
    assert 1 / 60 < lag.bound_s < 2 / 30
    assert abs(lag.offset_s - two.offset_s) <= lag.bound_s


def test_cameras_of_unlike_frame_rates_are_compared() -> None:
    two = Shutter(0.010, offset_s=-1.2, fps=25.0)
    lag = lag_of(Shutter(0.010), two)
    assert abs(lag.offset_s - two.offset_s) <= lag.bound_s < 0.03


@pytest.mark.parametrize("readout_s", [0.020, -0.020])
def test_the_readout_of_rolling_shutters_is_estimated_with_its_direction(readout_s: float) -> None:
    two = Shutter(0.005, readout_s, offset_s=0.3, fps=27.0)
    lag = lag_of(Shutter(0.005, 0.020), two)
    assert lag.readout_s == pytest.approx(readout_s, abs=4e-3)
    assert lag.readout_sigma_s is not None
    assert abs(lag.readout_s - readout_s) < 2 * lag.readout_sigma_s < 8e-3


def test_a_given_readout_narrows_the_bound() -> None:
    one, two = (Shutter(0.005, 0.020, offset_s=offset_s, phase_s=0.004 * offset_s) for offset_s in (0.0, 1.0))
    options = LightOptions(readout_s={"cam0": 0.020, "cam1": 0.020})
    given, estimated = lag_of(one, two, options=options), lag_of(one, two)
    assert given.readout_s == pytest.approx(0.020)
    assert given.bound_s < estimated.bound_s
    assert abs(given.offset_s - 1.0) <= given.bound_s


def test_drift_is_told_where_the_recording_is_long_enough() -> None:
    times_s = np.concatenate((EVENTS[:6], 300 + EVENTS[:6]))
    two = Shutter(offset_s=0.05, drift_ppm=70.0, fps=15.0, exposure_s=0.05)
    lag = lag_of(Shutter(fps=15.0, exposure_s=0.05), two, Lamp(times_s), stop_s=310.0)
    assert lag.drift_ppm == pytest.approx(70.0, abs=lag.drift_bound_ppm)
    assert lag.drift_bound_ppm < 60.0
    assert abs(lag.offset_s - true_offset_s(two, lag)) <= lag.bound_s


def test_drift_is_none_and_its_bound_the_limit_where_the_recording_is_short() -> None:
    lag = lag_of(Shutter(0.002), Shutter(0.002, offset_s=0.1), Lamp(EVENTS[:3]))
    assert (lag.drift_ppm, lag.drift_bound_ppm) == (0.0, pytest.approx(100.0))


def test_four_cameras_are_solved_together_in_the_order_given() -> None:
    shutters = [Shutter(0.01 + 0.006 * k, offset_s=0.11 * k, phase_s=0.008 * k, seed=k) for k in range(4)]
    series = [film(f"cam{k}", shutter, Lamp()) for k, shutter in enumerate(shutters)]
    lags = light_lags(series, reference="cam2")
    assert (lags.method, lags.reference) == ("light", "cam2")
    assert [lag.camera_id for lag in lags.cameras] == ["cam0", "cam1", "cam2", "cam3"]
    assert (lags.cameras[2].offset_s, lags.cameras[2].bound_s) == (0.0, 0.0)
    for lag, shutter in zip(lags.cameras, shutters, strict=True):
        assert lag.confident
        assert abs(lag.offset_s - (shutter.offset_s - shutters[2].offset_s)) <= lag.bound_s


@pytest.mark.parametrize(
    ("shutter", "length_s"),
    [(Shutter(0.010), 0.06), (Shutter(0.005, 0.020), 0.06), (Shutter(0.005, 0.020), 0.001), (Shutter(0.030), 0.001)],
)
def test_flashes_give_offsets_within_their_bound(shutter: Shutter, length_s: float) -> None:
    bright = replace(shutter, lamp=6.0, dark=0.05)
    lamp = Lamp(np.sort(np.concatenate((EVENTS, EVENTS + length_s))))
    lag = lag_of(bright, replace(bright, offset_s=0.7, phase_s=0.01), lamp)
    assert lag.confident
    assert abs(lag.offset_s - 0.7) <= lag.bound_s < 0.04


def test_a_lamp_that_goes_out_for_a_moment_is_a_dip() -> None:
    times_s = np.sort(np.concatenate(([0.5], EVENTS, EVENTS + 0.08)))
    series = film("cam0", Shutter(0.010), Lamp(times_s))
    assert [change.kind for change in find_changes(series)] == ["on"] + ["dip"] * len(EVENTS)
    lag = lag_of(Shutter(0.010), Shutter(0.010, offset_s=-0.3), Lamp(times_s))
    assert abs(lag.offset_s + 0.3) <= lag.bound_s


def test_dropped_frames_do_no_harm() -> None:
    two = Shutter(0.010, offset_s=0.2, phase_s=0.01)
    whole = [film("cam0", Shutter(0.010), Lamp()), film("cam1", two, Lamp())]
    kept = np.random.default_rng(3).uniform(size=len(whole[1].t_s)) > 0.05
    series = [whole[0], replace(whole[1], t_s=whole[1].t_s[kept], cells=whole[1].cells[kept])]
    lag = light_lags(series, reference="cam0").cameras[1]
    assert lag.confident
    assert abs(lag.offset_s - two.offset_s) <= lag.bound_s


def test_a_lamp_that_takes_milliseconds_to_light_up_is_within_the_bound() -> None:
    two = Shutter(0.010, offset_s=0.2, phase_s=0.01)
    lag = lag_of(Shutter(0.020), two, Lamp(rise_s=0.008))
    assert abs(lag.offset_s - two.offset_s) <= lag.bound_s


def test_stamps_that_jitter_and_coded_frames_widen_the_bound() -> None:
    two = Shutter(offset_s=0.2, phase_s=0.01)
    series = [film("cam0", Shutter(), Lamp()), film("cam1", two, Lamp())]
    stray_s = np.random.default_rng(2).uniform(-0.003, 0.003, len(series[1].t_s))
    exact, jittered, coded = (
        light_lags([series[0], other], reference="cam0").cameras[1]
        for other in (series[1], replace(series[1], t_s=series[1].t_s + stray_s), replace(series[1], coded=True))
    )
    assert exact.bound_s < jittered.bound_s
    assert exact.bound_s < coded.bound_s
    assert abs(jittered.offset_s - 0.2) <= jittered.bound_s


def test_jitter_is_what_stamps_stray_from_even_spacing() -> None:
    even = np.arange(300) / 30
    stray = np.random.default_rng(1).uniform(-0.002, 0.002, 300)
    assert stamp_jitter_s(even) < 1e-12
    assert stamp_jitter_s(np.delete(even, [50, 51, 200])) < 1e-12
    assert stamp_jitter_s(even + stray) >= 0.002


def test_the_same_series_give_the_same_lags() -> None:
    first, second = (lag_of(Shutter(), Shutter(offset_s=0.1, phase_s=0.01)) for _ in range(2))
    assert (first.offset_s, first.bound_s) == (second.offset_s, second.bound_s)


def with_cells(series: BrightnessSeries, change: Callable[[Floats], Floats]) -> BrightnessSeries:
    return replace(series, cells=change(series.cells.copy()))


def test_people_and_clouds_are_no_change_of_the_light() -> None:
    def people(cells: Floats) -> Floats:
        for frame in range(len(cells)):
            column = int(frame / 8) % COLUMNS
            cells[frame, 8:24, column] = 40.0 + 5 * (np.arange(16) % 3)
        return cells + 30 * np.sin(np.arange(len(cells)) / 40)[:, None, None]

    quiet = film("cam0", Shutter(), Lamp(np.array([])))
    assert find_changes(with_cells(quiet, people)) == ()
    busy = [with_cells(film(f"cam{k}", Shutter(offset_s=0.25 * k, seed=k), Lamp()), people) for k in range(2)]
    lag = light_lags(busy, reference="cam0").cameras[1]
    assert lag.confident
    assert abs(lag.offset_s - 0.25) <= lag.bound_s


def test_a_lamp_that_lights_a_corner_is_enough() -> None:
    def corner(cells: Floats) -> Floats:
        cells[:, 6:, :] = cells[0, 6:, :] + np.random.default_rng(1).normal(0, 0.05, (len(cells), BANDS - 6, COLUMNS))
        return cells

    two = Shutter(offset_s=0.3, phase_s=0.01)
    series = [film("cam0", Shutter(), Lamp()), with_cells(film("cam1", two, Lamp()), corner)]
    lag = light_lags(series, reference="cam0").cameras[1]
    assert abs(lag.offset_s - 0.3) <= lag.bound_s < 0.02


def test_one_change_that_one_camera_saw_elsewhere_is_taken_out() -> None:
    lamp = Lamp()
    other = Lamp(EVENTS + np.where(np.arange(12) == 5, 0.03, 0.0))
    two = Shutter(offset_s=0.1, phase_s=0.01)
    lags = light_lags([film("cam0", Shutter(), lamp), film("cam1", two, other)], reference="cam0")
    assert lags.cameras[1].confident
    assert abs(lags.cameras[1].offset_s - 0.1) <= lags.cameras[1].bound_s
    assert lags.residual_s > 0.001


# Refusals


def refusal(series: list[BrightnessSeries], **options: float) -> str:
    lag = light_lags(series, reference="cam0", options=LightOptions(**options)).cameras[1]
    assert not lag.confident
    return lag.reason


def test_a_camera_without_a_change_is_refused() -> None:
    series = [film("cam0", Shutter(), Lamp()), film("cam1", Shutter(), Lamp(np.array([])))]
    assert refusal(series) == (
        "this camera saw no sudden change of the light; switch a lamp that it sees fully on or off, or fire a flash"
    )
    assert refusal([replace(series[1], camera_id="cam0"), replace(series[0], camera_id="cam1")]) == (
        "the reference camera saw no sudden change of the light; switch a lamp that both cameras see"
    )


def test_a_refused_camera_does_not_take_the_others_with_it() -> None:
    series = [film("cam0", Shutter(), Lamp()), film("cam1", Shutter(), Lamp(np.array([])))]
    lags = light_lags([*series, film("cam2", Shutter(offset_s=0.2), Lamp())], reference="cam0").cameras
    assert [lag.confident for lag in lags] == [True, False, True]
    assert lags[1].bound_s == np.inf


def test_even_blinking_is_ambiguous() -> None:
    lamp = Lamp(1.0 + np.arange(14) * 1.0)
    reason = refusal([film("cam0", Shutter(), lamp), film("cam1", Shutter(offset_s=0.3), lamp)])
    assert reason.startswith("the pattern of switching is ambiguous: 14 of the changes fit an offset of +0.3")
    assert "as well; switch the light again, at uneven intervals" in reason


def test_a_lamp_that_lights_up_slowly_is_not_used() -> None:
    lamp = Lamp(EVENTS, rise_s=0.4)
    assert find_changes(film("cam0", Shutter(), lamp)) == ()


def test_changes_further_apart_than_the_search_are_refused() -> None:
    lamp = Lamp(EVENTS[:1])
    series = [film("cam0", Shutter(), lamp, stop_s=4.0), film("cam1", Shutter(offset_s=9.0), lamp, stop_s=4.0)]
    assert refusal(series, search_s=2.0) == (
        "no change of this camera's light is within 2 s of one of the reference's; record both at the same time, or "
        "search further"
    )


def test_a_camera_with_few_frames_is_refused() -> None:
    series = [film("cam0", Shutter(), Lamp()), film("cam1", Shutter(), Lamp(), stop_s=0.2)]
    assert refusal(series) == "this camera has 6 frames; 12 are needed"
    assert refusal([film("cam0", Shutter(), Lamp(), stop_s=0.01), film("cam1", Shutter(), Lamp())]) == (
        "the reference camera has 0 frames; 12 are needed"
    )


def test_a_single_faint_change_is_refused() -> None:
    faint = Shutter(lamp=0.02)
    series = [film(f"cam{k}", faint, Lamp(EVENTS[:1]), stop_s=4.0) for k in range(2)]
    reason = refusal(series)
    assert reason.startswith("only one change of the light was seen, and faintly (")
    assert reason.endswith("switch a lamp that lights the room, or switch it several times at uneven intervals")


def test_a_clock_that_is_stepped_on_the_way_is_refused() -> None:
    whole = film("cam1", Shutter(0.010), Lamp())
    stepped = replace(whole, t_s=whole.t_s + np.where(whole.t_s > 8.0, 0.055, 0.0))
    reason = refusal([film("cam0", Shutter(0.010), Lamp()), stepped])
    assert "changes of the light contradict one clock: the stamps jump, or the cameras saw different lamps" in reason


def test_what_leaves_the_offset_wide_open_is_refused() -> None:
    slow = Shutter(fps=5.0, exposure_s=0.02)
    lamp = Lamp(np.array([1.0, 1.45, 1.9, 2.35]))
    reason = refusal([film("cam0", slow, lamp, stop_s=5.0), film("cam1", slow, lamp, stop_s=5.0)])
    assert reason.startswith("the changes of the light leave the offset open to ")
    assert reason.endswith(" s either way; switch a lamp on or off several times, a second or more apart")


def test_changes_without_steady_light_between_them_are_refused() -> None:
    slow = Shutter(fps=4.0, exposure_s=0.02)
    series = [film(f"cam{k}", slow, Lamp(np.array([2.6, 3.1])), stop_s=8.0) for k in range(2)]
    assert refusal(series) == (
        "the light's changes follow each other too fast; leave half a second or more between them"
    )


def test_short_flashes_of_which_each_camera_misses_most_are_refused() -> None:
    lamp = Lamp(np.sort(np.concatenate((EVENTS, EVENTS + 0.001))))
    shutter = Shutter(0.010, lamp=6.0, dark=0.05)
    series = [film("cam0", shutter, lamp), film("cam1", replace(shutter, offset_s=0.7, phase_s=0.01), lamp)]
    assert refusal(series) == (
        "only 2 of 4 changes in the reference and 4 in this camera fit one offset, which may be chance; switch a lamp "
        "that both see on and off, six times or more at uneven intervals"
    )


def test_cameras_that_cannot_be_compared_are_an_error() -> None:
    series = film("cam0", Shutter(), Lamp())
    with pytest.raises(ComparisonError) as raised:
        light_lags([series], reference="cam0")
    assert str(raised.value) == (
        "clocks are compared between cameras\n"
        "  expected: two cameras or more\n"
        "  got:      cam0\n"
        "  do next:  give a capture of all cameras, recorded at the same time"
    )
    with pytest.raises(ComparisonError) as raised:
        light_lags([series, replace(series, camera_id="cam1")], reference="north")
    assert str(raised.value) == (
        "the reference camera is not in the capture\n"
        "  expected: one of cam0, cam1\n"
        "  got:      north\n"
        "  do next:  name one of the capture's cameras, or record the reference camera too"
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"search_s": 0.0}, "option search_s is out of range"),
        ({"drift_limit_ppm": -1.0}, "option drift_limit_ppm is out of range"),
        ({"readout_s": {"cam1": 20.0}}, "option readout_s of cam1 is out of range"),
    ],
)
def test_options_out_of_range_are_an_error(options: dict[str, float], said: str) -> None:
    with pytest.raises(OptionError, match=said):
        LightOptions(**options)


# Real captures


@pytest.mark.parametrize(
    "folder", ["recognition/pose2sim_multi", "calibration/caliscope_charuco_calibration/calibration/extrinsic"]
)
def test_real_recordings_without_a_lamp_are_refused(folder: str) -> None:
    if not (SHARED / folder).is_dir():
        pytest.skip("the shared captures are not here")
    capture = open_capture(SHARED / folder)
    stamps = frame_stamps(capture)
    assert stamps is not None
    lags = light_lags(measure_brightness(capture, stamps), reference=capture.cameras[0].id)
    assert [lag.confident for lag in lags.cameras] == [True, False, False, False]
