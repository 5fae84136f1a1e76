"""What chronyd says of this machine's clock, where it runs: ``chronyc -c tracking``."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, fields

from rigcal.sync.network.packet import UNSYNCHRONISED, UNSYNCHRONISED_LEAP, Claim

_COMMAND = ("chronyc", "-c", "-n")
_TIMEOUT_S = 3.0
_LEAP = {"Normal": 0, "Insert second": 1, "Delete second": 2, "Not synchronised": UNSYNCHRONISED_LEAP}
_LOCAL = "7F7F0101"
"""The reference of a chronyd that serves its own clock, undisciplined (its ``local`` directive)."""


@dataclass(frozen=True, slots=True)
class Tracking:
    """The fields of ``chronyc tracking``, in its order and with its signs (chronyc's manual, *tracking*)."""

    reference_id: str
    """Eight hexadecimal digits."""
    reference: str
    """Name or address of the source; empty where there is none."""
    stratum: int
    reference_utc_s: float
    """When the source was last heard, seconds since the epoch."""
    system_time_s: float
    """What is still to be corrected of the system's clock."""
    last_offset_s: float
    rms_offset_s: float
    frequency_ppm: float
    residual_frequency_ppm: float
    skew_ppm: float
    """Estimated error of the frequency."""
    root_delay_s: float
    root_dispersion_s: float
    update_interval_s: float
    leap_status: str
    """``Normal``, ``Insert second``, ``Delete second`` or ``Not synchronised``."""

    @property
    def synchronised(self) -> bool:
        """Whether a source disciplines the clock; a chronyd that serves its own clock does not count."""
        return self.leap_status != "Not synchronised" and self.reference_id != _LOCAL

    @property
    def bound_s(self) -> float | None:
        """Bound of the clock's error against UTC, None without a source (chronyc's manual, *tracking*, root delay)."""
        if not self.synchronised:
            return None
        return abs(self.system_time_s) + self.root_dispersion_s + self.root_delay_s / 2

    @property
    def claim(self) -> Claim:
        """The same, as a host tells it in an NTP packet; what remains to be corrected goes with the dispersion."""
        if not self.synchronised:
            return UNSYNCHRONISED
        dispersion_s = self.root_dispersion_s + abs(self.system_time_s)
        return Claim(_LEAP[self.leap_status], self.stratum, self.root_delay_s, dispersion_s)


_FIELDS = tuple(field.name for field in fields(Tracking))


@dataclass(frozen=True, slots=True)
class NoTracking:
    """Why chronyd says nothing."""

    reason: str


def read_tracking(arguments: Sequence[str] = ()) -> Tracking | NoTracking:
    """Ask chronyd, on this machine unless ``arguments`` of chronyc (``-h HOST``) say otherwise."""
    try:
        done = subprocess.run(
            [*_COMMAND, *arguments, "tracking"],
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except FileNotFoundError:
        return NoTracking("chrony is not installed on this machine")
    except subprocess.TimeoutExpired:
        return NoTracking(f"chronyc gave no answer within {_TIMEOUT_S:g} s")
    except OSError as error:
        return NoTracking(f"chronyc cannot be run: {error.strerror}")
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip().splitlines()
        return NoTracking(f"chronyd does not run, or does not answer chronyc ({said[-1] if said else 'no message'})")
    return parse_tracking(done.stdout)


def parse_tracking(text: str) -> Tracking | NoTracking:
    """The fields of one line of ``chronyc -c tracking``."""
    parts = text.strip().split(",")
    unknown = NoTracking(f"chronyc answers in a form that is not known here: {text.strip()[:120]!r}")
    if len(parts) != len(_FIELDS) or parts[-1] not in _LEAP:
        return unknown
    reference_id, reference, stratum, *figures, leap_status = parts
    try:
        values = dict(zip(_FIELDS[3:-1], map(float, figures), strict=True))
        hops = int(stratum)
    except ValueError:
        return unknown
    if not all(map(math.isfinite, values.values())):
        return unknown
    return Tracking(reference_id.upper(), reference, hops, **values, leap_status=leap_status)
