"""The log of probes of the cameras' hosts before and during work, over networks that delay packets as real ones do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rigcal.sync.estimator.networks import BUSY, LAN, START_NS, WIFI, HostOscillator, simulate_exchanges
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.log import append_exchanges
from tools.sicsg.demo.scene import CLOCKS, SEED
from tools.sicsg.scene import Scene
from tools.sicsg.sequences import EPOCH_S

NETWORKS = (LAN, LAN, BUSY, WIFI)
"""Between the computer that probes and each camera's host."""
STARTS_S, SECONDS, RATE_HZ = -210.0, 240.0, 2.0
"""The probe begins before work and outlasts it."""


def write_probes(scene: Scene, path: Path) -> None:
    """Write the log; what was there is replaced."""
    path.unlink(missing_ok=True)
    append_exchanges(path, {camera.id: _probed(index) for index, camera in enumerate(scene.cameras)})


def _probed(index: int) -> Exchanges:
    clock = CLOCKS[index]
    at_start_s = clock.host_offset_s + clock.drift_ppm * 1e-6 * STARTS_S
    oscillator = HostOscillator(at_start_s, clock.drift_ppm, tells_monotonic=True)
    simulated = simulate_exchanges(
        NETWORKS[index], oscillator, seconds=SECONDS, rate_hz=RATE_HZ, seed=10 * SEED + index
    )
    later_ns = round((EPOCH_S + STARTS_S) * 1e9) - START_NS
    moved = {name: getattr(simulated, name) + later_ns for name in Exchanges.__slots__}
    return replace(simulated, **moved)
