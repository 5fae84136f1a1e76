"""What a responder may say of how right its clock is: chronyd's word, asked for at intervals, beside the answering."""

from __future__ import annotations

import dataclasses
import threading
import time
from types import TracebackType

from rigcal.sync.network.chrony import Tracking, read_tracking
from rigcal.sync.network.packet import UNSYNCHRONISED, Claim

_REFRESH_S = 16.0
_LEAST_RATE = 15e-6
"""By how much a claim's dispersion grows per second of its age (RFC 5905, PHI), unless chronyd knows its frequency
less well than that, as it does in its first seconds."""


class ClaimKeeper:
    """Asks chronyd every 16 s, in a thread of its own, as chronyc may take seconds to give up."""

    def __init__(self) -> None:
        self._known: tuple[Claim, float, float] = (UNSYNCHRONISED, _LEAST_RATE, 0.0)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> ClaimKeeper:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while True:
            tracking = read_tracking()
            if isinstance(tracking, Tracking):
                self._known = (tracking.claim, max(_LEAST_RATE, tracking.skew_ppm * 1e-6), time.monotonic())
            else:
                self._known = (UNSYNCHRONISED, _LEAST_RATE, time.monotonic())
            if self._stop.wait(_REFRESH_S):
                return

    def current(self) -> Claim:
        """The last claim, aged."""
        claim, rate, at_s = self._known
        if not claim.synchronised:
            return claim
        dispersion_s = claim.root_dispersion_s + rate * (time.monotonic() - at_s)
        return dataclasses.replace(claim, root_dispersion_s=dispersion_s)
