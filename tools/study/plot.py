"""Curves of the study as one SVG picture: a panel for each kind of error and detector, a line for each violation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from types import MappingProxyType

import numpy as np

from recognition.evaluation.violations import KINDS
from tools.study.faults import Axis
from tools.study.figures import Curve

_COLUMNS, _WIDTH, _HEIGHT, _LEFT, _TOP, _ACROSS, _DOWN = 3, 300, 190, 56, 92, 76, 100
_LOWEST = 0.4
RATE = "kbit_per_s"
"""Name of a curve's bit rates."""
_COLOURS: Mapping[str, str] = MappingProxyType(
    {"no_hat": "#1f77b4", "ladder": "#d95f02", "window": "#2ca02c", "platform": "#7b3294"}
)
_DETECTORS: Mapping[str, str] = MappingProxyType(
    {
        "open": "nothing hidden, exact",
        "seen": "exact of what shows",
        "measured": "errors of the networks",
        "networks": "the networks themselves",
    }
)


def study_plot(curves: Sequence[Curve], axes: Mapping[str, Axis]) -> str:
    """SVG of all curves; gates of rigcal are dashed lines at their defaults."""
    rows = -(-len(curves) // _COLUMNS)
    width, height = _LEFT + _COLUMNS * (_WIDTH + _ACROSS), _TOP + rows * (_HEIGHT + _DOWN)
    body = list(_legend())
    for number, curve in enumerate(curves):
        panel = _Panel(
            _LEFT + number % _COLUMNS * (_WIDTH + _ACROSS), _TOP + number // _COLUMNS * (_HEIGHT + _DOWN), curve.levels
        )
        body += panel.frame(axes[curve.axis], _DETECTORS[curve.detector])
        body += panel.rates(curve)
        body += panel.lines(curve)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="11" fill="#333"><rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join(body)}</svg>\n"
    )


def _legend() -> Iterator[str]:
    yield f'<text x="{_LEFT}" y="20" font-size="14" font-weight="bold">Balanced accuracy against injected errors</text>'
    x = _LEFT
    for name in (*KINDS, "mean"):
        colour = _COLOURS.get(name, "#333")
        yield f'<path d="M{x} 34h18" stroke="{colour}" stroke-width="{3 if name == "mean" else 2}"/>'
        yield f'<text x="{x + 24}" y="38">{name}</text>'
        x += 100
    yield f'<path d="M{x} 34h18" stroke="#c0392b" stroke-dasharray="4 3"/>'
    yield f'<text x="{x + 24}" y="38">gate of rigcal</text>'
    yield f'<path d="M{x + 130} 34h18" stroke="#333" stroke-width="10" opacity="0.12"/>'
    yield f'<text x="{x + 154}" y="38">95 % of what the error costs the mean, over sequences</text>'


@dataclass(frozen=True, slots=True)
class _Panel:
    """Levels to the right, one step each as they double; balanced accuracy upwards."""

    left: float
    top: float
    levels: tuple[float, ...]

    def x(self, level: float) -> float:
        """Of a level, also between those that were tried."""
        places = np.arange(len(self.levels))
        ascending = self.levels[0] < self.levels[-1]
        at = np.interp(level, self.levels if ascending else self.levels[::-1], places if ascending else places[::-1])
        return float(self.left + _WIDTH * at / max(len(self.levels) - 1, 1))

    def y(self, share: float) -> float:
        return self.top + _HEIGHT * (1 - (min(max(share, _LOWEST), 1.0) - _LOWEST) / (1 - _LOWEST))

    def frame(self, axis: Axis, detector: str) -> Iterator[str]:
        yield f'<text x="{self.left}" y="{self.top - 20}" font-size="12" font-weight="bold">{axis.title}</text>'
        yield f'<text x="{self.left}" y="{self.top - 6}" fill="#777">{detector}</text>'
        for percent in range(40, 101, 20):
            y = self.y(percent / 100)
            yield f'<path d="M{self.left} {y:.1f}h{_WIDTH}" stroke="#ddd"/>'
            yield f'<text x="{self.left - 6}" y="{y + 4:.1f}" text-anchor="end">{percent} %</text>'
        for level in self.levels:
            yield f'<text x="{self.x(level):.1f}" y="{self.top + _HEIGHT + 15}" text-anchor="middle">{level:g}</text>'
        if axis.unit:
            middle = self.left + _WIDTH / 2
            yield f'<text x="{middle}" y="{self.top + _HEIGHT + 42}" text-anchor="middle">{axis.unit}</text>'
        if axis.gate is not None:
            x = self.x(axis.gate[1])
            yield f'<path d="M{x:.1f} {self.top}v{_HEIGHT}" stroke="#c0392b" stroke-dasharray="4 3"/>'

    def rates(self, curve: Curve) -> Iterator[str]:
        """Bit rates below the levels that have some."""
        for level, rate in zip(curve.levels, curve.about.get(RATE, np.zeros(0)).tolist(), strict=False):
            x, y = self.x(level), self.top + _HEIGHT + 28
            yield f'<text x="{x:.1f}" y="{y}" text-anchor="middle" fill="#777">{rate / 1e3:.2g} Mb/s</text>'

    def lines(self, curve: Curve) -> Iterator[str]:
        low, high = (curve.mean[0] - curve.cost[:, column] for column in (2, 1))
        if not np.isnan(low).any():
            around = [*zip(curve.levels, high, strict=True), *reversed([*zip(curve.levels, low, strict=True)])]
            points = " ".join(f"{self.x(at):.1f},{self.y(float(value)):.1f}" for at, value in around)
            yield f'<polygon points="{points}" fill="#333" opacity="0.12"/>'
        for kind, name in enumerate(KINDS):
            yield self._line(curve, curve.accuracy[:, kind].tolist(), _COLOURS[name], 1.5)
        yield self._line(curve, curve.mean.tolist(), "#333", 3)

    def _line(self, curve: Curve, values: Sequence[float], colour: str, thick: float) -> str:
        known = [(at, value) for at, value in zip(curve.levels, values, strict=True) if not isnan(value)]
        points = " ".join(f"{self.x(at):.1f},{self.y(value):.1f}" for at, value in known)
        return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{thick}"/>'
