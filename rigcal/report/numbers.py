"""Figures as one reads them: as many digits as they are worth, and round lengths for scales."""

from __future__ import annotations

import math

ABSENT = "-"
"""Stands for a figure that was not measured or has no meaning."""


def fixed(value: float | None, decimals: int = 2) -> str:
    """A figure with fixed decimals, or with two significant digits where fixed decimals would leave fewer."""
    if value is None:
        return ABSENT
    if value == 0:
        return "0"
    if abs(value) < 10.0 ** (1 - decimals):
        return f"{value:.2g}"
    return f"{value:.{decimals}f}"


def scaled(value: float | None, factor: float, decimals: int = 2) -> str:
    """A figure in a smaller unit, such as metres in millimetres with ``factor`` 1000."""
    return fixed(None if value is None else value * factor, decimals)


def signed(value: float, decimals: int = 3) -> str:
    """A figure with its sign, such as a mean that should be zero."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def with_sigma(value: float, sigma: float | None) -> str:
    """A figure and one sigma of it, both to the sigma's second digit: ``1413.69 ± 0.66``."""
    if sigma is None or sigma == 0:
        return fixed(value)
    decimals = min(max(1 - math.floor(math.log10(sigma)), 0), 9)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"


def significant(value: float | None, digits: int = 3) -> str:
    """A figure with that many significant digits; the digits before the point are never cut."""
    if value is None:
        return ABSENT
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def beside_limit(value: float | None, limit: float) -> str:
    """A gate's figure, with more than three digits where three would make it look equal to its limit."""
    shown = next((significant(value, n) for n in (3, 4, 5, 6) if significant(value, n) != significant(limit, n)), None)
    return significant(value) if shown is None else shown


def round_down(value: float) -> float:
    """The greatest of ..., 0.1, 0.2, 0.5, 1, 2, 5, 10, ... that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1 + 1e-9))


def round_up(value: float) -> float:
    """The least of ..., 0.1, 0.2, 0.5, 1, 2, 5, 10, ... that is not below a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9))
