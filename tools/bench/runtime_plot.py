"""The growth of the runtime with workers and cameras, as an SVG picture: one panel a method, one line a rig."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

_WIDTH, _HEIGHT, _LEFT, _TOP, _GAP = 400, 300, 60, 56, 112
_LINE = 13
_BLUES = ("#6baed6", "#4292c6", "#2171b5", "#08519c", "#08306b")


@dataclass(frozen=True, slots=True)
class Curve:
    """Times of one method on one rig."""

    method: str
    cameras: int
    workers: tuple[int, ...]
    median_ms: tuple[float, ...]


def growth_plot(curves: Sequence[Curve], *, frame_ms: float) -> str:
    """SVG of all curves; ``frame_ms`` is marked, the time that there is for a frame set."""
    methods = list(dict.fromkeys(curve.method for curve in curves))
    times_ms = [value for curve in curves for value in curve.median_ms]
    low, high = np.floor(np.log10(min(times_ms))), np.ceil(np.log10(max(*times_ms, frame_ms)))
    width = _LEFT + len(methods) * (_WIDTH + _GAP)
    height = _TOP + _HEIGHT + 56
    body: list[str] = []
    for index, method in enumerate(methods):
        axes = _Axes(_LEFT + index * (_WIDTH + _GAP), max(curves[0].workers), low, high)
        body += axes.frame(f"{method}: median time of a frame set, ms", frame_ms)
        own = [curve for curve in curves if curve.method == method]
        label_y = _apart([axes.y(curve.median_ms[-1]) for curve in own])
        for number, curve in enumerate(own):
            body += axes.line(curve, _BLUES[number % len(_BLUES)], label_y[number])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="12" fill="#333"><rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join(body)}</svg>\n"
    )


@dataclass(frozen=True, slots=True)
class _Axes:
    """Workers to the right, times upwards on a logarithmic scale."""

    left: float
    most: int
    low: float
    high: float

    def x(self, workers: float) -> float:
        return self.left + _WIDTH * workers / self.most

    def y(self, ms: float) -> float:
        return float(_TOP + _HEIGHT * (self.high - np.log10(ms)) / (self.high - self.low))

    def frame(self, title: str, frame_ms: float) -> Iterator[str]:
        yield f'<text x="{self.left}" y="{_TOP - 24}" font-size="14" font-weight="bold">{title}</text>'
        for power in range(int(self.low), int(self.high) + 1):
            y = self.y(10.0**power)
            yield f'<path d="M{self.left} {y:.1f}h{_WIDTH}" stroke="#ddd"/>'
            yield f'<text x="{self.left - 8}" y="{y + 4:.1f}" text-anchor="end">{10.0**power:g}</text>'
        for workers in range(0, self.most + 1, 4):
            yield f'<text x="{self.x(workers):.1f}" y="{_TOP + _HEIGHT + 18}" text-anchor="middle">{workers}</text>'
        middle = self.left + _WIDTH / 2
        yield f'<text x="{middle}" y="{_TOP + _HEIGHT + 40}" text-anchor="middle">workers</text>'
        y = self.y(frame_ms)
        yield f'<path d="M{self.left} {y:.1f}h{_WIDTH}" stroke="#c0392b" stroke-dasharray="5 4"/>'
        said = f"{1e3 / frame_ms:.0f} frame sets a second"
        yield f'<text x="{self.left + 6}" y="{y - 6:.1f}" fill="#c0392b">{said}</text>'

    def line(self, curve: Curve, colour: str, label_y: float) -> Iterator[str]:
        points = [(self.x(w), self.y(ms)) for w, ms in zip(curve.workers, curve.median_ms, strict=True)]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        yield f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'
        for x, y in points:
            yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>'
        x = points[-1][0] + 8
        yield f'<text x="{x:.1f}" y="{label_y + 4:.1f}" fill="{colour}">{curve.cameras} cameras</text>'


def _apart(heights: Sequence[float]) -> list[float]:
    """Heights of labels, in the order given: moved up, from the lowest, until each has a line of its own."""
    moved, lowest = list(heights), np.inf
    for index in sorted(range(len(heights)), key=lambda i: (-heights[i], i)):
        moved[index] = lowest = min(heights[index], lowest - _LINE)
    return moved
