"""Times and sizes as one writes them: ``10min``, ``200GB``. A bare number is refused, for nobody can know its unit."""

from __future__ import annotations

import re

from rigcal.errors import OptionError

_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
_BYTES = {"MB": 1e6, "GB": 1e9, "TB": 1e12}
_AMOUNT = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]+)")


def seconds(option: str, text: str) -> float:
    """``90s``, ``10min`` or ``1h`` in seconds; OptionError where it is no such time above 0."""
    return _amount(option, text, _SECONDS, "a time above 0, such as 90s, 10min or 1h")


def size_bytes(option: str, text: str) -> int:
    """``500MB``, ``200GB`` or ``1.5TB`` in bytes; OptionError where it is no such size above 0."""
    return round(_amount(option, text, _BYTES, "a size above 0, such as 500MB, 200GB or 1.5TB"))


def _amount(option: str, text: str, units: dict[str, float], expected: str) -> float:
    match = _AMOUNT.fullmatch(text.strip())
    value = float(match[1]) * units.get(match[2], 0.0) if match else 0.0
    if value <= 0:
        raise OptionError(option, expected=expected, got=text)
    return value
