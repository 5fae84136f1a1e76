"""By how much a rule was violated, over time, as an SVG picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby, pairwise

from recognition.events import Event, Margin, actors_text, utc

_WIDTH, _HEIGHT, _LEFT, _TOP, _RIGHT, _BELOW = 640, 240, 64, 74, 24, 84
_MOST = 2000
"""Points that are drawn; of more, the least and the greatest of each stretch."""
_GRID, _INK, _SOFT, _BAD, _UNKNOWN = "#e4e4e4", "#222", "#666", "#c62828", "#f0f0f0"


def margin_plot(event: Event) -> str:
    """The margins of an event: over 0 the rule is violated, by a share of its limit; grey where it was unknown."""
    axes = _Axes.of(event)
    height = _TOP + _HEIGHT + _BELOW
    width = _LEFT + _WIDTH + _RIGHT
    body = (*_frame(event, axes), *_unknown(event.margins, axes), *_curve(event.margins, axes), *_times(event, axes))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="12" fill="{_INK}"><rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join(body)}</svg>\n"
    )


@dataclass(frozen=True, slots=True)
class _Axes:
    """Time to the right, margins upwards."""

    start_ns: int
    first_ns: int
    last_ns: int

    @classmethod
    def of(cls, event: Event) -> _Axes:
        times = [margin.t_ns for margin in event.margins] or [event.start_ns]
        return cls(event.start_ns, min(*times, event.start_ns), max(*times, event.raised_ns, event.start_ns + 1))

    def x(self, t_ns: int) -> float:
        return _LEFT + _WIDTH * (t_ns - self.first_ns) / (self.last_ns - self.first_ns)

    def y(self, value: float) -> float:
        return _TOP + _HEIGHT * (1 - value) / 2

    @property
    def ticks_s(self) -> list[float]:
        """About six round times after the start."""
        long_s = (self.last_ns - self.first_ns) * 1e-9
        step = 10.0 ** math.floor(math.log10(long_s / 3))
        step = next(step * factor for factor in (1, 2, 5, 10) if long_s / (step * factor) <= 6)
        first = math.ceil((self.first_ns - self.start_ns) * 1e-9 / step)
        last = math.floor((self.last_ns - self.start_ns) * 1e-9 / step)
        return [step * number for number in range(first, last + 1)]


def _frame(event: Event, axes: _Axes) -> Iterator[str]:
    title = escape(f"{event.rule}: {event.sentence}")
    yield f'<text x="{_LEFT}" y="24" font-size="15" font-weight="bold">{title}</text>'
    when = utc(event.start_ns) or f"{event.start_ns * 1e-9:.3f} s"
    yield _text(_LEFT, 44, f"{actors_text(event)}; since {when}; rig {event.rig_verdict}, {event.status}", _SOFT)
    yield _text(_LEFT, 60, f"rules {event.rules_digest[:26]}...; {event.event_id}", _SOFT)
    for value, words in ((1.0, "by the limit"), (0.0, "at the limit"), (-1.0, "")):
        y = axes.y(value)
        yield f'<path d="M{_LEFT} {y:.1f}h{_WIDTH}" stroke="{_INK if value == 0 else _GRID}"/>'
        yield f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
        yield _text(_LEFT + 4, y - 4 if value == 0 else y + 14, words, _SOFT)
    for t_s in axes.ticks_s:
        x = axes.x(event.start_ns + round(t_s * 1e9))
        yield f'<path d="M{x:.1f} {_TOP}v{_HEIGHT}" stroke="{_GRID}"/>'
        yield f'<text x="{x:.1f}" y="{_TOP + _HEIGHT + 16}" text-anchor="middle">{t_s:g}</text>'
    below = _TOP + _HEIGHT
    yield _text(_LEFT, below + 34, "seconds after the start; up: violated by so large a share of the limit", _SOFT)
    yield from (_text(_LEFT, below + 52 + 15 * n, words, _SOFT) for n, words in enumerate(_cut(event.caveats)))


def _cut(caveats: Sequence[str]) -> list[str]:
    return [caveat if len(caveat) <= 110 else f"{caveat[:107]}..." for caveat in caveats[:2]]


def _unknown(margins: Sequence[Margin], axes: _Axes) -> Iterator[str]:
    """Grey where nothing was known: from an unknown instant to the next known one."""
    for one, following in pairwise(margins):
        if math.isnan(one.value):
            x = axes.x(one.t_ns)
            yield _box(x, axes.x(following.t_ns) - x, _UNKNOWN)


def _curve(margins: Sequence[Margin], axes: _Axes) -> Iterator[str]:
    """The margins as a line that ends where they are unknown, red where the rule is violated."""
    for is_unknown, group in groupby(_fewer(margins), key=lambda margin: math.isnan(margin.value)):
        points = [] if is_unknown else [(axes.x(one.t_ns), one.value) for one in group]
        if not points:
            continue
        line = "L".join(f"{x:.1f} {axes.y(value):.1f}" for x, value in points)
        over = "L".join(f"{x:.1f} {axes.y(max(value, 0.0)):.1f}" for x, value in _with_crossings(points))
        ground = f"L{points[-1][0]:.1f} {axes.y(0):.1f}L{points[0][0]:.1f} {axes.y(0):.1f}Z"
        yield f'<path d="M{over}{ground}" fill="{_BAD}" fill-opacity="0.25"/>'
        yield f'<path d="M{line}" fill="none" stroke="{_INK}" stroke-width="1.5"/>'
        yield from (f'<circle cx="{x:.1f}" cy="{axes.y(v):.1f}" r="1.5"/>' for x, v in points if len(points) <= 300)


def _with_crossings(points: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Points (x, value), and between them those at which the line crosses 0."""
    yield points[0]
    for (x, value), (next_x, following) in pairwise(points):
        if value * following < 0:
            yield x + (next_x - x) * value / (value - following), 0.0
        yield next_x, following


def _fewer(margins: Sequence[Margin]) -> list[Margin]:
    """At most :data:`_MOST` of them, with every peak and dip."""
    if len(margins) <= _MOST:
        return list(margins)
    width = math.ceil(2 * len(margins) / _MOST)
    kept = []
    for at in range(0, len(margins), width):
        stretch = margins[at : at + width]
        known = [one for one in stretch if not math.isnan(one.value)]
        ends = {min(known, key=lambda one: one.value), max(known, key=lambda one: one.value)} if known else {stretch[0]}
        kept += sorted(ends)
    return kept


def _times(event: Event, axes: _Axes) -> Iterator[str]:
    for name, t_ns in (("raised", event.raised_ns), ("ended", event.end_ns)):
        if t_ns is not None and axes.first_ns <= t_ns <= axes.last_ns:
            x = axes.x(t_ns)
            yield f'<path d="M{x:.1f} {_TOP}v{_HEIGHT}" stroke="{_BAD}" stroke-dasharray="4 3"/>'
            yield f'<text x="{x + 4:.1f}" y="{_TOP + _HEIGHT - 6}" fill="{_BAD}">{name}</text>'


def _box(x: float, width: float, color: str) -> str:
    return f'<rect x="{x:.1f}" y="{_TOP}" width="{width:.1f}" height="{_HEIGHT}" fill="{color}"/>'


def _text(x: float, y: float, words: str, color: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{color}">{escape(words)}</text>'
