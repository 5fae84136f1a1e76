"""SVG path data of many points and lines, in few bytes."""

from __future__ import annotations

from rigcal.geometry import Floats


def dots(points: Floats) -> str:
    """A line of no length at each of the points (N, 2): a dot where the stroke has round caps."""
    return "".join(f"M{short(x)} {short(y)}h0" for x, y in points.tolist())


def crosses(points: Floats, half: float) -> str:
    """A diagonal cross of 2 ``half`` units at each of the points (N, 2)."""
    a, b = short(half), short(2 * half)
    return "".join(f"M{short(x)} {short(y)}m-{a}-{a}l{b} {b}m0-{b}l-{b} {b}" for x, y in points.tolist())


def lines(starts: Floats, steps: Floats) -> str:
    """From each of the points (N, 2) along its step (N, 2)."""
    return "".join(
        f"M{short(x)} {short(y)}l{short(dx)} {short(dy)}"
        for (x, y), (dx, dy) in zip(starts.tolist(), steps.tolist(), strict=True)
    )


def polygon(points: Floats) -> str:
    """The closed outline through the points (N, 2)."""
    return polyline(points) + "z"


def polyline(points: Floats) -> str:
    """The line through the points (N, 2)."""
    return "M" + "L".join(f"{short(x)} {short(y)}" for x, y in points.tolist())


def short(value: float) -> str:
    """A coordinate to a tenth of a unit, without a needless fraction or sign."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text
