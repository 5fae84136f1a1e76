"""What a probe measures: four times of each exchange with a host, two by either clock (RFC 5905, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Bools, Floats, Ints, freeze

UNKNOWN = -1
"""A monotonic time that the host did not tell."""


@dataclass(frozen=True, slots=True, eq=False)
class Exchanges:
    """Answered probes of one host, in the order in which they were sent; times in nanoseconds, UTC by either clock."""

    sent_ns: Ints
    """(n,) T1: the rig's clock when the request left."""
    received_ns: Ints
    """(n,) T2: the host's clock when the request arrived."""
    replied_ns: Ints
    """(n,) T3: the host's clock when the answer left."""
    returned_ns: Ints
    """(n,) T4: the rig's clock when the answer arrived."""
    rig_monotonic_ns: Ints
    """(n,) the rig's monotonic clock at T4; it is never stepped, so that a step of the rig's own clock shows."""
    host_monotonic_ns: Ints
    """(n,) the host's monotonic clock at T3; ``UNKNOWN`` where the host does not tell it (plain NTP)."""

    def __post_init__(self) -> None:
        count = len(self.sent_ns)
        fields = ("sent_ns", "received_ns", "replied_ns", "returned_ns", "rig_monotonic_ns", "host_monotonic_ns")
        freeze(self, np.int64, **dict.fromkeys(fields, (count,)))

    @classmethod
    def joined(cls, parts: Sequence[Exchanges]) -> Exchanges:
        """The exchanges of several probes of one host, in the order of the parts."""
        names = cls.__slots__
        return cls(*(np.concatenate([getattr(part, name) for part in parts] or [[]]) for name in names))

    def __len__(self) -> int:
        return len(self.sent_ns)

    def __getitem__(self, chosen: slice | Ints | Bools) -> Exchanges:
        return Exchanges(
            self.sent_ns[chosen],
            self.received_ns[chosen],
            self.replied_ns[chosen],
            self.returned_ns[chosen],
            self.rig_monotonic_ns[chosen],
            self.host_monotonic_ns[chosen],
        )

    @property
    def round_trip_s(self) -> Floats:
        """(n,) seconds on the way, there and back: ``(T4 - T1) - (T3 - T2)``."""
        on_the_way = (self.returned_ns - self.sent_ns) - (self.replied_ns - self.received_ns)
        return np.asarray(on_the_way * 1e-9)

    @property
    def least_offset_s(self) -> Floats:
        """(n,) lower bound of the offset (rig minus host) at T2: no request arrives before it was sent."""
        return np.asarray((self.sent_ns - self.received_ns) * 1e-9)

    @property
    def greatest_offset_s(self) -> Floats:
        """(n,) upper bound of the offset (rig minus host) at T3: no answer arrives before it was sent."""
        return np.asarray((self.returned_ns - self.replied_ns) * 1e-9)
