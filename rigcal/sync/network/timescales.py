"""Clocks that are right, but count another time than UTC."""

from __future__ import annotations

_TAI_UTC_S, _GPS_UTC_S = 37.0, 18.0
"""Seconds that TAI and GPS time are ahead of UTC since the last leap second, 1 January 2017."""
_SLACK_S = 0.2
"""A clock on another time scale may be wrong by itself too; nothing else is within this of 37 s or 18 s."""


def tai_confusion(offset_s: float, bound_s: float) -> str | None:
    """Whether an offset (rig minus camera) looks like TAI or GPS time in place of UTC, and what to do about it.

    Cameras that take their time from PTP count TAI where the network's grandmaster does not announce UTC, while
    PTP itself reports an offset of nanoseconds (basler/pypylon, issue 656). None where the offset is another, or
    its bound is too wide to tell.
    """
    if bound_s > _SLACK_S:
        return None
    ahead = "the camera's host is ahead of the rig's clock" if offset_s < 0 else "the rig's clock is ahead of the host"
    if abs(abs(offset_s) - _TAI_UTC_S) <= _SLACK_S:
        whose = "the camera's host" if offset_s < 0 else "this machine"
        return (
            f"{ahead} by {abs(offset_s):.3f} s: TAI, the time of PTP, runs {_TAI_UTC_S:g} s ahead of UTC. Have the PTP "
            f"grandmaster announce its UTC offset (currentUtcOffset {_TAI_UTC_S:g}, valid), or have {whose} "
            "apply it (phc2sys -w), then probe again"
        )
    if abs(abs(offset_s) - _GPS_UTC_S) <= _SLACK_S:
        return (
            f"{ahead} by {abs(offset_s):.3f} s: GPS time runs {_GPS_UTC_S:g} s ahead of UTC. Set the GPS receiver or "
            "the time server behind it to give UTC, then probe again"
        )
    return None
