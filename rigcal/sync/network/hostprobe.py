"""What probing a host gave."""

from __future__ import annotations

from dataclasses import dataclass

from rigcal.sync.exchanges import Exchanges
from rigcal.sync.network.hosts import Target
from rigcal.sync.network.packet import Claim


@dataclass(frozen=True, slots=True)
class HostProbe:
    """One host, probed."""

    target: Target
    address: str | None
    """Where the answers came from; None where none did."""
    port: int | None
    """The port that answered; None where none did."""
    ours: bool
    """Whether ``rigcal sync serve`` answered, which tells the host's monotonic clock too."""
    exchanges: Exchanges
    """Answered requests, late answers among them: a late answer came after it was sent as surely as a prompt one,
    so that its interval of the offset is wider and just as true."""
    sent: int
    """Requests to the port that answered; to every port where none did."""
    lost: int
    """Of these, those that no usable answer came to."""
    late: int
    """Answers after the time allowed."""
    duplicates: int
    """Further answers to a request that was answered, or further copies of one; ignored."""
    spoofed: int
    """Packets that answer no request of this host, or came from elsewhere; ignored."""
    malformed: int
    """Packets from the host that are no answer in NTP's format; ignored."""
    kisses: tuple[str, ...]
    """What the host asked for in place of telling the time: ``RATE`` (ask less often), ``DENY`` or ``RSTR`` (do not
    ask); each once. They are obeyed."""
    claim: Claim | None
    """What the host last said of its own clock."""
    reason: str | None
    """Why nothing came, in words; None where something did."""

    @property
    def stratum(self) -> int | None:
        """Hops of the host from a reference clock; 16 where it is not synchronised, None where it did not say."""
        return None if self.claim is None else self.claim.stratum

    @property
    def leap(self) -> int | None:
        """The host's leap indicator; 3 where it is not synchronised, None where it did not say."""
        return None if self.claim is None else self.claim.leap

    @property
    def claimed_error_s(self) -> float | None:
        """The host's own bound of its clock's error against UTC; None where it claims none."""
        return None if self.claim is None else self.claim.error_s
