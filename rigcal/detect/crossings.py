"""Corners to a hundredth of a pixel: the picture of a checker crossing, fitted to the grey values around a corner.

Context: every corner of our boards is a place where two straight edges cross and the colours change at each of them,
so that the board's brightness is ``sign(d1) * sign(d2)``, with d the distances from the two edges. Blurred by a lens it
is ``erf(d1 / s) * erf(d2 / s)``. Decision: fit that product, under an illumination that may slope, to the pixels
around a first guess, by Levenberg-Marquardt, all corners of an image at once; parametric corner models fitted to the
grey values are from K. Rohr, "Recognizing corners by fitting parametric models", IJCV 9(3), 1992.
The alternative, ``cv2.cornerSubPix``, takes 1 ms instead of 15-30 ms for 54 corners. Measured on rendered boards
(squares of 10-58 px, blur 0.35-2.5 px, noise of 2-8 grey levels) the fit is 0.01-0.06 px rms from the truth,
cornerSubPix with the best window of each board 0.03-0.09, ``cv2.findChessboardCornersSB`` 0.05-0.22.

The fit also tells how well it fits and which quadrants are light. So it decides as well whether a corner is one, which
way round the board lies, and whether the board goes on beyond its last row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from rigcal.geometry import Bools, Floats, Ints

LARGEST_RADIUS_PX = 12.0
"""Larger windows are fitted in a smaller image: 18 is 10 % nearer on squares of 100 px, at 3 times the cost."""
ANTI_ALIAS_PX = 0.5
"""Gaussian blur before the fit, in pixels of the image that is fitted. The model has no pixel area: without this an
edge sharper than a pixel costs up to 0.4 px; from 0.4 to 0.8 nothing changes."""
SMALLEST_PIXELS = 12
"""A window with fewer pixels inside the image cannot hold the ten parameters."""
LEAST_INSIDE = 0.65
"""Share of a window: a corner at the very border of a real image, half of it unseen, came out 7 px from its place."""
MOST_MISFIT = 0.45
"""Corners of real boards stay below 0.33 with glare and 0.1 without; grids that are no boards reach 0.7-0.9, the border
of the printed squares 0.4-0.55."""
FARTHEST_MOVE = 0.35
"""Of a step: a corner that moved farther from the guess has found another crossing."""
MOST_STEPS, ENOUGH_PX = 15, 4e-3
"""Steps of the fit, and the length of the last: the one after it would be below a thousandth of a pixel."""
STARTING_DAMPING, MOST_DAMPING = 1e-2, 1e4
BLUR_PX = (0.3, 5.0)
CHUNK = 64
"""Corners that are solved together: their derivatives stay in the processor's cache."""

_X, _Y, _TURN1, _TURN2, _LEVEL, _STEP, _BLUR1, _BLUR2, _SLOPE_X, _SLOPE_Y = range(10)
_BLURS = slice(_BLUR1, _BLUR2 + 1)
_Singles: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Fitted corners and the evidence for each."""

    corners_px: Floats
    """(n, 2) pixels, origin at the centre of the top-left pixel."""
    contrast: Floats
    """(n,) half the step between dark and light in grey levels; positive where the quadrant between the two given
    directions is the lighter one."""
    misfit: Floats
    """(n,) rms of what the model leaves unexplained over the rms of the window's grey values: 0 perfect, 1 nothing
    explained; 1 where the window lies outside the image."""
    moved_px: Floats
    """(n,) distance from the first guess."""
    blur_px: Floats
    """(n,) width of the wider of the two edges: the sigma of the Gaussian that blurs it, in pixels of the image."""


def are_crossings(fit: Crossings, along_x_px: Floats, along_y_px: Floats) -> Bools:
    """(n,) whether each fitted corner is a crossing near its guess; steps (..., 2) as for :func:`fit_crossings`."""
    step_px = np.minimum(np.linalg.norm(along_x_px, axis=-1), np.linalg.norm(along_y_px, axis=-1)).ravel()
    return np.asarray((fit.misfit < MOST_MISFIT) & (fit.moved_px < FARTHEST_MOVE * step_px))


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """The pixels around each corner, in the image of the chosen scale."""

    x: _Singles
    """(n, k) columns from the first guess."""
    y: _Singles
    """(n, k) rows from the first guess."""
    grey: _Singles
    """(n, k) grey values, per corner with mean 0 and rms 1."""
    weight: _Singles
    """(n, k) 1 inside the window and the image, else 0."""
    inside: Floats
    """(n,) share of the window that lies inside the image."""
    rms: Floats
    """(n,) grey levels that 1 stands for."""
    radius_px: float
    """Unit of the slopes."""

    def only(self, kept: Ints) -> _Windows:
        """The windows of some corners."""
        x, y, grey, weight = (array[kept] for array in (self.x, self.y, self.grey, self.weight))
        return _Windows(x, y, grey, weight, self.inside[kept], self.rms[kept], self.radius_px)


def fit_crossings(
    grey: NDArray[Any], corners_px: Floats, along_x_px: Floats, along_y_px: Floats, *, reach: float
) -> Crossings:
    """Move corners to the crossings that the grey values show.

    Args:
        grey: (height, width) image, 8 bits.
        corners_px: (n, 2) first guesses; the fit finds its way from about a third of the window.
        along_x_px: (n, 2) step from each corner to the next along the board's x axis, in pixels.
        along_y_px: (n, 2) the same along its y axis.
        reach: radius of the window in steps; it must hold nothing else than the crossing.
    """
    longest_px = reach * float(np.median(np.maximum(*(np.linalg.norm(a, axis=1) for a in (along_x_px, along_y_px)))))
    scale = max(1, int(np.ceil(longest_px / LARGEST_RADIUS_PX)))
    low = np.maximum(np.floor(corners_px.min(axis=0) - 2 * longest_px - 4 * scale).astype(int), 0)
    high = np.ceil(corners_px.max(axis=0) + 2 * longest_px + 4 * scale).astype(int)
    part = grey[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if part.size == 0:
        nothing = np.zeros(len(corners_px))
        return Crossings(corners_px.copy(), nothing, nothing + 1, nothing, nothing)
    small = cv2.GaussianBlur(part.astype(np.float32), (0, 0), ANTI_ALIAS_PX * scale)[::scale, ::scale]
    guess = (corners_px - low) / scale
    pieces = [
        _fit(small, guess[k : k + CHUNK], along_x_px[k : k + CHUNK] / scale, along_y_px[k : k + CHUNK] / scale, reach)
        for k in range(0, len(guess), CHUNK)
    ]
    fitted, contrast, misfit, blur = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    found_px = fitted * scale + low
    own_blur_px = scale * np.sqrt(np.maximum(blur**2 - ANTI_ALIAS_PX**2, 0))
    return Crossings(found_px, contrast, misfit, np.linalg.norm(found_px - corners_px, axis=1), own_blur_px)


def _fit(
    image: NDArray[Any], guess: Floats, along_x: Floats, along_y: Floats, reach: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Corners (n, 2), contrast (n,), misfit (n,) and blur (n,) in one scale of the image."""
    windows = _windows(image, guess, along_x, along_y, reach)
    params, left = _solve(_start(windows, along_x, along_y), windows)
    pixels = windows.weight.sum(axis=1)
    enough = (pixels >= SMALLEST_PIXELS) & (windows.inside >= LEAST_INSIDE) & np.isfinite(params).all(axis=1)
    misfit = np.where(enough, np.minimum(np.sqrt(left / np.maximum(pixels, 1)), 1.0), 1.0)
    corners = guess + np.where(enough[:, None], params[:, :2], 0.0)
    blur = np.where(enough, np.exp(params[:, _BLURS].max(axis=1)), 0.0)
    return corners, np.where(enough, -params[:, _STEP] * windows.rms, 0.0), misfit, blur


def _windows(image: NDArray[Any], guess: Floats, along_x: Floats, along_y: Floats, reach: float) -> _Windows:
    """Ellipses around the corners that are circles of radius ``reach`` on the board; 21 pixels at least."""
    height, width = image.shape
    longest = reach * np.maximum(np.linalg.norm(along_x, axis=1), np.linalg.norm(along_y, axis=1))
    radius = int(np.clip(np.ceil(longest.max()), 2, 2 * LARGEST_RADIUS_PX))
    rows, columns = (a.ravel() for a in np.mgrid[-radius : radius + 1, -radius : radius + 1])
    x, y = np.rint(guess[:, :1]).astype(int) + columns, np.rint(guess[:, 1:]).astype(int) + rows
    off_x, off_y = (x - guess[:, :1]).astype(np.float32), (y - guess[:, 1:]).astype(np.float32)
    area = along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0]
    to_board = (np.stack([along_y[:, 1], -along_y[:, 0], -along_x[:, 1], along_x[:, 0]]) / area).astype(np.float32)
    across, down = (p[:, None] * off_x + q[:, None] * off_y for p, q in (to_board[:2], to_board[2:]))
    near = (across**2 + down**2 <= reach**2) | (off_x**2 + off_y**2 <= 2.3**2)
    used = near.any(axis=0)
    x, y, off_x, off_y, near = (array[:, used] for array in (x, y, off_x, off_y, near))
    weight = (near & (x >= 0) & (x < width) & (y >= 0) & (y < height)).astype(np.float32)
    grey = image[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    count = np.maximum(weight.sum(axis=1, keepdims=True), 1)
    grey = grey - (grey * weight).sum(axis=1, keepdims=True) / count
    rms = np.maximum(np.sqrt((weight * grey**2).sum(axis=1, keepdims=True) / count), 1.0)
    inside = weight.sum(axis=1) / near.sum(axis=1)
    return _Windows(off_x, off_y, grey / rms, weight, inside, rms[:, 0].astype(np.float64), float(radius))


def _start(windows: _Windows, along_x: Floats, along_y: Floats) -> Floats:
    """(n, 10) parameters at the guess: edges along the board's axes, the sign of the step from the grey values."""
    params = np.zeros((len(along_x), 10))
    params[:, _TURN1] = np.arctan2(along_x[:, 0], -along_x[:, 1])
    params[:, _TURN2] = np.arctan2(along_y[:, 0], -along_y[:, 1])
    params[:, _STEP] = 1.0
    model, _ = _model(params, windows)
    params[:, _STEP] = np.where((windows.weight * windows.grey * model).sum(axis=1) < 0, -1.0, 1.0)
    return params


def _model(params: Floats, windows: _Windows) -> tuple[_Singles, _Singles]:
    """Grey values (n, k) of the model, and their derivatives (n, 10, k) by its parameters."""
    single = params.astype(np.float32)[..., None]
    cos1, sin1 = np.cos(single[:, _TURN1]), np.sin(single[:, _TURN1])
    cos2, sin2 = np.cos(single[:, _TURN2]), np.sin(single[:, _TURN2])
    x, y = windows.x - single[:, _X], windows.y - single[:, _Y]
    width1, width2 = (np.float32(np.sqrt(2.0)) * np.exp(single[:, blur]) for blur in (_BLUR1, _BLUR2))
    d1, d2 = (cos1 * x + sin1 * y) / width1, (cos2 * x + sin2 * y) / width2
    side1, side2 = erf(d1), erf(d2)
    slope_x, slope_y = x / np.float32(windows.radius_px), y / np.float32(windows.radius_px)
    step = single[:, _STEP]
    across1 = (step * np.float32(2 / np.sqrt(np.pi)) / width1) * side2 * np.exp(-(d1**2))
    across2 = (step * np.float32(2 / np.sqrt(np.pi)) / width2) * side1 * np.exp(-(d2**2))
    derivatives = np.empty((len(x), 10, x.shape[1]), dtype=np.float32)
    derivatives[:, _X] = -(across1 * cos1 + across2 * cos2)
    derivatives[:, _Y] = -(across1 * sin1 + across2 * sin2)
    derivatives[:, _TURN1] = across1 * (cos1 * y - sin1 * x)
    derivatives[:, _TURN2] = across2 * (cos2 * y - sin2 * x)
    derivatives[:, _LEVEL] = 1.0
    derivatives[:, _STEP] = side1 * side2
    derivatives[:, _BLUR1] = -across1 * d1 * width1
    derivatives[:, _BLUR2] = -across2 * d2 * width2
    derivatives[:, _SLOPE_X] = slope_x
    derivatives[:, _SLOPE_Y] = slope_y
    slopes = single[:, _SLOPE_X] * slope_x + single[:, _SLOPE_Y] * slope_y
    return single[:, _LEVEL] + step * derivatives[:, _STEP] + slopes, derivatives


def _solve(params: Floats, windows: _Windows) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt, every corner with its own damping, until each rests: parameters and squares left over."""
    params = params.copy()
    damping = np.full(len(params), STARTING_DAMPING)
    model, derivatives = _model(params, windows)
    cost = (windows.weight * (windows.grey - model) ** 2).sum(axis=1).astype(np.float64)
    moving = np.arange(len(params))
    for _ in range(MOST_STEPS):
        part = windows.only(moving)
        weighted = derivatives * part.weight[:, None]
        normal = (weighted @ derivatives.transpose(0, 2, 1)).astype(np.float64)
        gradient = (weighted @ (part.grey - model)[..., None]).astype(np.float64)
        diagonal = np.einsum("nii->ni", normal)
        damped = normal + np.eye(10) * (damping[moving, None] * diagonal + 1e-6)[:, None, :]
        trial = params[moving] + np.linalg.solve(damped, gradient)[..., 0]
        trial[:, _BLURS] = np.clip(trial[:, _BLURS], *np.log(BLUR_PX))
        trial_model, trial_derivatives = _model(trial, part)
        trial_cost = (part.weight * (part.grey - trial_model) ** 2).sum(axis=1)
        better = trial_cost < cost[moving]
        step_px = np.abs(trial - params[moving])[:, :2].max(axis=1)
        params[moving] = np.where(better[:, None], trial, params[moving])
        cost[moving] = np.where(better, trial_cost, cost[moving])
        free = damping[moving] <= STARTING_DAMPING  # else the step is short because it was held back
        damping[moving] *= np.where(better, 0.2, 10.0)
        still = ~(better & free & (step_px < ENOUGH_PX)) & (damping[moving] < MOST_DAMPING)
        model = np.where(better[:, None], trial_model, model)[still]
        derivatives = np.where(better[:, None, None], trial_derivatives, derivatives)[still]
        moving = moving[still]
        if not len(moving):
            break
    return params, cost
