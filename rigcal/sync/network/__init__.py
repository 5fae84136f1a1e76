"""Probing the clocks of camera hosts over the network, in the packets of NTP."""

from __future__ import annotations

from rigcal.sync.network.chrony import NoTracking, Tracking, parse_tracking, read_tracking
from rigcal.sync.network.clocks import SYSTEM, Clock, SimulatedClock, SystemClock
from rigcal.sync.network.hostprobe import HostProbe
from rigcal.sync.network.hosts import SiteTargets, Target, targets_of, targets_of_site
from rigcal.sync.network.packet import NTP_PORT, RIGCAL_PORT, Claim
from rigcal.sync.network.probe import probe
from rigcal.sync.network.serve import Served, serve
from rigcal.sync.network.timescales import tai_confusion

__all__ = [
    "NTP_PORT",
    "RIGCAL_PORT",
    "SYSTEM",
    "Claim",
    "Clock",
    "HostProbe",
    "NoTracking",
    "Served",
    "SimulatedClock",
    "SiteTargets",
    "SystemClock",
    "Target",
    "Tracking",
    "parse_tracking",
    "probe",
    "read_tracking",
    "serve",
    "tai_confusion",
    "targets_of",
    "targets_of_site",
]
