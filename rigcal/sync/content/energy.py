"""Clocks from how restless each picture is: to whole frames, where there is no rig, no lamp and no board.

Whoever walks through several views makes all of them restless at the same time. The motion energy of a camera is the
mean absolute difference of its grey values from frame to frame; the offset is where the energies of two cameras
correlate best (Pearson's r at whole frames, as Pose2Sim does with speeds of joints). Different views see different
motion, and encoders that started together pulse together, so that a peak must stand out of chance and of all other
peaks, and both halves of what is common must have it; what is less clear is refused. The claim is one and a half
frames, plus what the halves differ by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter

from rigcal.captures import Capture, CaptureCamera, read_frames
from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.stamps import FrameStamps
from rigcal.sync.content.lags import CameraLag, ContentLags
from rigcal.sync.content.light.lags import check_cameras

_SIDE_PX = 180  # the shorter side of the pictures that are compared
_DARK_GREY = 0.05  # keeps the logarithm of a still picture finite
_PULSE_S = 0.1  # single frames that an encoder coded better or worse than the rest
_SLOW_S = 1.0  # what changes more slowly says where somebody is, not when they moved
_LEAST_COMMON_S = 5.0
_LEAST_CORRELATION = 0.6
_LEAST_SIGMAS = 5.0  # of Fisher's z: 60 pairs of unrelated activities reached 3.9 by chance
_CLEAR = 0.15  # by how much the peak must exceed every other one
_PEAK_S = 0.5  # lags this close belong to the same peak
_PEAK_FRAMES = 1.5
"""Bound of a peak that both halves agree on: 178 simulated pairs that were claimed were off by up to 1.01."""
_HALVES_FRAMES = 2  # halves of the recording that differ by more do not have the same peak
_DRIFT_LIMIT_PPM = 100.0  # what clocks of cameras may drift; whole frames do not tell it


@dataclass(frozen=True, slots=True, eq=False)
class EnergySeries:
    """How restless one camera's picture is over time."""

    camera_id: str
    t_s: Floats
    """(n,) middle of each pair of successive frames by the camera's own clock, ascending, in seconds."""
    grey_per_s: Floats
    """(n,) mean absolute difference of grey values per second between them."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, t_s=(None,), grey_per_s=(len(self.t_s),))


def energy_lags(
    capture: Capture,
    stamps: FrameStamps,
    *,
    reference: str,
    search_s: float = 10.0,
    progress: Callable[[int, int], None] | None = None,
) -> ContentLags:
    """Offset of every camera against the reference to whole frames; see :func:`lags_of_energy`.

    Args:
        capture: the capture; every frame is decoded.
        stamps: its frames' stamps.
        reference: the camera that the others are compared with.
        search_s: the most that the stamps of two cameras may be apart.
        progress: told frames done and frames in all.

    Raises:
        ComparisonError: for fewer than two cameras, or a reference that is none of them.
        BrokenFileError, ImageSizeError: where frames cannot be decoded.
        ValueError: where the stamps are another capture's.
    """
    check_cameras([camera.id for camera in capture.cameras], reference)
    return lags_of_energy(measure_energy(capture, stamps, progress=progress), reference=reference, search_s=search_s)


def measure_energy(
    capture: Capture, stamps: FrameStamps, *, progress: Callable[[int, int], None] | None = None
) -> tuple[EnergySeries, ...]:
    """The motion energy of every camera.

    Raises:
        BrokenFileError, ImageSizeError: where frames cannot be decoded.
        ValueError: where the stamps are another capture's.
    """
    counts = stamps.counts_for(capture)
    series: list[EnergySeries] = []
    for index, (camera, t_s) in enumerate(zip(capture.cameras, stamps.times_s, strict=True)):
        differences = []
        for done, difference in enumerate(_differences(camera), start=2):
            differences.append(difference)
            if progress is not None:
                progress(sum(counts[:index]) + done, sum(counts))
        steps_s = np.diff(t_s)
        apart = steps_s > 0
        per_s = np.array(differences)[apart] / steps_s[apart]
        series.append(EnergySeries(camera.id, (t_s[1:] - steps_s / 2)[apart], per_s))
    return tuple(series)


def _differences(camera: CaptureCamera) -> Iterator[float]:
    """Mean absolute difference of each frame from the one before."""
    last: NDArray[np.uint8] | None = None
    for _, image in read_frames(camera):
        scale = min(1.0, _SIDE_PX / min(image.shape))
        small = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        if last is not None:
            yield float(cv2.absdiff(small, last).mean())
        last = small


def lags_of_energy(series: Sequence[EnergySeries], *, reference: str, search_s: float = 10.0) -> ContentLags:
    """Offset of every camera against the reference, to whole frames, from motion energies.

    Args:
        series: one per camera, in rig order.
        reference: the camera that the others are compared with.
        search_s: the most that the stamps of two cameras may be apart.

    Returns:
        Offsets whose bound is one and a half frame periods of the slower camera, plus what the halves of the recording
        differ by. Drift is not told. ``residual_s`` is the root-mean-square of what the halves differ by.

    Raises:
        ComparisonError: for fewer than two cameras, or a reference that is none of them.
    """
    check_cameras([one.camera_id for one in series], reference)
    base = next(one for one in series if one.camera_id == reference)
    found = [_compared(one, base, search_s) for one in series if one is not base]
    lags = {one.lag.camera_id: one.lag for one in found}
    middle_s = float(base.t_s[0] + base.t_s[-1]) / 2 if len(base.t_s) else 0.0
    lags[reference] = CameraLag(reference, True, "", 0.0, middle_s, 0.0, 0.0, 0.0)
    residual_s = float(np.sqrt(np.mean([one.halves_differ_s**2 for one in found])))
    return ContentLags("motion energy", reference, tuple(lags[one.camera_id] for one in series), residual_s)


@dataclass(frozen=True, slots=True)
class _Found:
    lag: CameraLag
    halves_differ_s: float


def _compared(one: EnergySeries, base: EnergySeries, search_s: float) -> _Found:
    least = min(np.ptp(one.t_s), np.ptp(base.t_s)) if len(one.t_s) > 2 and len(base.t_s) > 2 else 0.0
    if least < _LEAST_COMMON_S:
        reason = f"{least:.1f} s are too short; record {_LEAST_COMMON_S:g} s or more of people moving"
        return _Found(_refused(one, reason), 0.0)
    period_s = max(float(np.median(np.diff(series.t_s))) for series in (one, base))
    mine, theirs = (_liveliness(series, period_s) for series in (one, base))
    start_s = float(base.t_s[0] - one.t_s[0])  # the offset where both series begin together
    lags, r = _correlations(theirs, mine, round(_LEAST_COMMON_S / period_s))
    near = np.abs(start_s + lags * period_s) <= search_s
    if not near.any():
        return _Found(_refused(one, f"no {_LEAST_COMMON_S:g} s are common within {search_s:g} s of the stamps"), 0.0)
    lags, r = lags[near], r[near]
    best = int(np.argmax(r))
    halves = _halves_frames(theirs, mine, int(lags[best]))
    reason = _doubt(r, np.abs(lags - lags[best]) * period_s <= _PEAK_S, halves, _independent(theirs, mine))
    offset_s = start_s + float(lags[best]) * period_s
    lag = CameraLag(
        one.camera_id,
        not reason,
        reason,
        offset_s,
        float(one.t_s[0] + one.t_s[-1]) / 2,
        (_PEAK_FRAMES + halves) * period_s,
        0.0,
        _DRIFT_LIMIT_PPM,
        searched_s=start_s + lags * period_s,
        cost=1 - r,
    )
    return _Found(lag, halves * period_s)


def _refused(one: EnergySeries, reason: str) -> CameraLag:
    at_s = float(one.t_s.mean()) if len(one.t_s) else 0.0
    return CameraLag(one.camera_id, False, reason, 0.0, at_s, np.inf, 0.0, _DRIFT_LIMIT_PPM)


def _liveliness(series: EnergySeries, period_s: float) -> Floats:
    """(k,) logarithm of the energy at even spacing, without pulses of single frames and without what is slow."""
    at_s = np.arange(series.t_s[0], series.t_s[-1], period_s)
    energy = np.log(np.interp(at_s, series.t_s, series.grey_per_s) + _DARK_GREY)
    energy = median_filter(energy, size=2 * (round(_PULSE_S / period_s) // 2) + 1, mode="nearest")
    return np.asarray(energy - gaussian_filter1d(energy, _SLOW_S / period_s, mode="nearest"))


def _correlations(base: Floats, other: Floats, least: int) -> tuple[Ints, Floats]:
    """Lags at which ``other[n]`` falls on ``base[n + lag]``, ``least`` samples or more in common, and r of each."""
    lags = np.arange(least - len(other), len(base) - least + 1)
    r = [_pearson(*_overlap(base, other, int(lag))) for lag in lags]
    return lags, np.array(r)


def _overlap(base: Floats, other: Floats, lag: int) -> tuple[Floats, Floats]:
    start, stop = max(lag, 0), min(len(base), len(other) + lag)
    return base[start:stop], other[start - lag : stop - lag]


def _pearson(one: Floats, two: Floats) -> float:
    one, two = one - one.mean(), two - two.mean()
    scale = float(np.sqrt((one @ one) * (two @ two)))
    return float(one @ two) / scale if scale > 0 else 0.0


def _halves_frames(base: Floats, other: Floats, lag: int) -> int:
    """By how many frames the best lags of the two halves of what is common differ from the best of all."""
    one, two = _overlap(base, other, lag)
    middle, most = len(one) // 2, _HALVES_FRAMES + 1
    shifts = range(-most, most + 1)
    differ = []
    for half in (slice(0, middle), slice(middle, len(one))):
        r = [_pearson(*_overlap(one[half], two[half], shift)) for shift in shifts]
        differ.append(abs(shifts[int(np.argmax(r))]))
    return max(differ)


def _independent(base: Floats, other: Floats) -> float:
    """How many independent samples two series have in common (Bartlett, 1935: by their autocorrelations)."""
    count = min(len(base), len(other))
    overlap = [
        _pearson(base[k:], base[: len(base) - k]) * _pearson(other[k:], other[: len(other) - k])
        for k in range(1, count // 4)
    ]
    return count / max(1 + 2 * float(np.sum(overlap)), 1.0)


def _doubt(r: Floats, peak: Bools, halves: int, independent: float) -> str:
    """Why a peak is not clear; empty where it is."""
    best, other = float(r.max()), float(r[~peak].max(initial=0.0))
    sigmas = float(np.arctanh(min(best, 0.999)) * np.sqrt(max(independent - 3, 0.0)))
    again = "record longer, with people who walk, stop and turn in view of all cameras"
    if best < _LEAST_CORRELATION or sigmas < _LEAST_SIGMAS:
        return f"the motion of the two pictures hardly agrees (correlation {best:.2f}, {sigmas:.1f} sigma); {again}"
    if best - other < _CLEAR:
        return f"the motion agrees nearly as well at another offset ({best:.2f} and {other:.2f}); {again}"
    if halves > _HALVES_FRAMES:
        return f"the halves of the recording disagree by more than {_HALVES_FRAMES} frames; {again}"
    return ""
