"""Hosts held against each other: one that claims the right time and is alone with it has a wrong time server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.sync.check.findings import Colour, Finding, duration
from rigcal.sync.check.readings import CameraReadings

FEWEST = 3
"""Hosts that are needed to tell which is the stranger."""
ALONE_S = 0.001
"""A host nearer to the others than this is no stranger: time servers on one network differ by less."""


def disagreeing_hosts(readings: Sequence[CameraReadings]) -> Mapping[str, Finding]:
    """Per camera whose host is certain to be away from where most hosts are, what to say of it.

    Every host is measured against the rig's own clock; where all are away from it by the same, it is that clock which
    is wrong, and no host is a stranger.
    """
    hosts = {r.host.name: r.host for r in readings if r.host is not None and r.host.clock is not None}
    offsets = {name: host.clock.model for name, host in hosts.items() if host.clock is not None}
    if len(offsets) < FEWEST:
        return {}
    middle_s = float(np.median([model.offset_s for model in offsets.values()]))
    width_s = float(np.median([model.bound_s for model in offsets.values()]))
    found = {}
    for one in readings:
        if one.host is None or one.host.name not in offsets:
            continue
        model = offsets[one.host.name]
        away_s = model.offset_s - middle_s
        claimed_s = one.host.claimed_bound_s
        if claimed_s is not None and abs(away_s) > model.bound_s + width_s + claimed_s + ALONE_S:
            found[one.camera_id] = Finding(
                "stranger",
                Colour.AMBER,
                f"its host {one.host.name} is {duration(abs(away_s))} from the other hosts, though it claims to be "
                f"within {duration(claimed_s)} of UTC",
                "compare its time server with that of the other hosts (chronyc sources)",
            )
    return found
