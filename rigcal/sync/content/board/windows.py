"""Which frames to look at for a board that moves: a few everywhere first, then all of them where it moves.

Context: a clock needs consecutive frames of a moving board that two cameras see, and minutes between them for its
drift; searching every frame of minutes of video takes longer than the check before a recording may. Decision: looks
three times a second in stretches over the recording; then windows of 1.5 s, one in each part of the recording, where
the most cameras see the board move the most. Cost: a board that is shown for less than a second may be missed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.geometry import Bools, Floats
from rigcal.sync.content.board.frames import Run

LOOKS_PER_S = 3.0
"""Hands move a board to and fro about once a second."""
STRETCHES = 3
WINDOW_S = 1.5
"""As long as a board carried by hand takes to move one way and back."""
_MARGIN_S = 0.1  # what looks three times a second leave open of an offset
_FAST_PX_S = 600.0  # faster boards are blurred: 20 px in a thirtieth of a second
_SLOW_PX_S = 5.0


def looking_runs(times_s: Sequence[Floats], looks: int) -> list[Run]:
    """Runs to look at first: the whole recording, or of longer ones its beginning, middle and end.

    Args:
        times_s: Per camera (F,) stamps of its frames.
        looks: Most frames to look at per camera.
    """
    runs = []
    for camera, times in enumerate(times_s):
        if len(times) < 2:
            continue
        stride = max(1, round(1 / LOOKS_PER_S / float(np.median(np.diff(times)))))
        if len(times) <= looks * stride:
            runs += [Run(camera, 0, len(times), stride)]
            continue
        length = looks // STRETCHES * stride
        starts = np.linspace(0, len(times) - length, STRETCHES).astype(int).tolist()
        runs += [Run(camera, start, start + length, stride) for start in starts]
    return runs


def moving_windows(
    times_s: Sequence[Floats], seen: Sequence[tuple[Floats, Floats]], offset_s: Floats, frames: int
) -> list[Run]:
    """Runs of consecutive frames where cameras see the board move.

    Args:
        times_s: Per camera (F,) stamps of its frames.
        seen: Per camera (n,) stamps at which the board was seen, and (n, 2) where its middle was in pixels.
        offset_s: (M,) to add to stamps, as far as it is known.
        frames: Most frames per camera.
    """
    spacing_s = min((float(np.median(np.diff(t))) for t in times_s if len(t) > 1), default=1.0)
    count = max(1, int(frames * spacing_s / WINDOW_S))
    speeds = [_speeds(times, middles) for times, middles in seen]
    stamps = [times + offset for (times, _), offset in zip(seen, offset_s, strict=True)]
    if not any(len(t) for t in stamps):
        return []
    low, high = min(t[0] for t in stamps if len(t)), max(t[-1] for t in stamps if len(t))
    starts = np.arange(low, max(high - WINDOW_S / 2, low + 1e-9), WINDOW_S / 3)
    motion = np.stack([_in_windows(t, s, starts) for t, s in zip(stamps, speeds, strict=True)], axis=1)
    chosen = starts[_choose(motion, count)]
    return [
        Run(camera, *_between(times + offset, start - _MARGIN_S, start + WINDOW_S + _MARGIN_S))
        for camera, (times, offset) in enumerate(zip(times_s, offset_s, strict=True))
        for start in chosen
    ]


def _speeds(times: Floats, middles: Floats) -> Floats:
    """(n,) pixels per second from one look to the next, 0 across gaps."""
    if len(times) < 2:
        return np.zeros(len(times))
    gap = np.diff(times)
    speed = np.linalg.norm(np.diff(middles, axis=0), axis=1) / np.maximum(gap, 1e-9)
    speed = np.where(gap < 2 / LOOKS_PER_S, np.minimum(speed, _FAST_PX_S), 0.0)
    return np.append(speed, speed[-1])


def _in_windows(stamps: Floats, speeds: Floats, starts: Floats) -> Floats:
    """(W,) mean speed of the board in each window, 0 where it is not seen."""
    inside = (stamps >= starts[:, None]) & (stamps < starts[:, None] + WINDOW_S)
    return np.asarray((inside * speeds).sum(axis=1) / max(WINDOW_S * LOOKS_PER_S, 1.0))


def _choose(motion: Floats, count: int) -> list[int]:
    """Windows in which pairs of cameras see motion, those first that show cameras of which there is little yet."""
    chosen: list[int] = []
    shown = np.zeros(motion.shape[1])
    free: Bools = (motion > _SLOW_PX_S).sum(axis=1) > 1
    while free.any() and len(chosen) < count:
        distance = np.min([np.abs(np.arange(len(motion)) - c) for c in chosen], axis=0, initial=len(motion))
        worth = (motion / (1 + shown)).sum(axis=1) * np.minimum(distance, len(motion) / count)
        best = int(np.argmax(np.where(free, worth, -1.0)))
        chosen.append(best)
        shown += motion[best] > _SLOW_PX_S
        free[max(0, best - 2) : best + 3] = False
    return sorted(chosen)


def _between(times: Floats, first_s: float, last_s: float) -> tuple[int, int]:
    return int(np.searchsorted(times, first_s)), int(np.searchsorted(times, last_s))
