"""What is said to others: an event when it is raised and when it ends, and heartbeats, as JSON.

Both name the site and the run. Workers have their names of the shift and no track number. ``message_id`` is the same
whenever the same thing is said again, so that a receiver that got it twice can tell: events are sent at least once,
until the target has taken them, and never twice knowingly.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

from recognition.alarms.identities import ShiftNames
from recognition.events import Event

if TYPE_CHECKING:
    from recognition.observations import Status

Phase = Literal["raised", "ended"]


@dataclass(frozen=True, slots=True)
class Message:
    """Something to be delivered."""

    message_id: str
    body: str
    """A JSON object."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Who says it."""

    site: str
    run: str
    """Names the run among others; nothing can be told from it."""


@dataclass(frozen=True, slots=True)
class Health:
    """Whether the site is monitored, as the run last said or failed to say."""

    status: Status
    reason: str
    """In words; empty where it is MONITORED."""


def utc(t_ns: int) -> str:
    """A time as text, ``2026-11-22T09:30:01.250Z``."""
    whole, rest_ns = divmod(t_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(whole, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}Z"


def event_message(event: Event, phase: Phase, origin: Origin, names: ShiftNames) -> Message:
    """An event that is raised or has ended."""
    message_id = f"{event.event_id}/{phase}"
    return Message(
        message_id,
        _json(
            {
                "format": "recognition.alarm",
                "version": 1,
                "message_id": message_id,
                "event_id": event.event_id,
                "phase": phase,
                "site": origin.site,
                "run": origin.run,
                "severity": event.severity,
                "rule": event.rule,
                "sentence": event.sentence,
                "actors": [{"name": names.name(one, event.start_ns), "role": one.role} for one in event.actors],
                "shift": names.shift(event.start_ns),
                "start_utc": utc(event.start_ns),
                "raised_utc": utc(event.raised_ns),
                "end_utc": None if event.end_ns is None else utc(event.end_ns),
                "worst_margin": _worst_margin(event),
                "cameras": list(event.cameras),
                "confidence": event.confidence if math.isfinite(event.confidence) else None,
                "status": event.status,
                "caveats": list(event.caveats),
                "rules_digest": event.rules_digest,
                "rig_digest": event.rig_digest,
                "rig_verdict": event.rig_verdict,
            }
        ),
    )


def heartbeat(
    health: Health, origin: Origin, *, at_ns: int, next_within_s: float, waiting: int = 0, lost: int = 0
) -> str:
    """Whether the site is monitored now.

    Args:
        health: What to say.
        origin: Who says it.
        at_ns: The time, in nanoseconds since 1970.
        next_within_s: A receiver that hears nothing for so long must take the site as NOT MONITORED.
        waiting: Messages that the receiver has still to get.
        lost: Messages that it will never get.
    """
    return _json(
        {
            "format": "recognition.heartbeat",
            "version": 1,
            "site": origin.site,
            "run": origin.run,
            "status": health.status,
            "reason": health.reason,
            "at_utc": utc(at_ns),
            "next_within_s": next_within_s,
            "waiting": waiting,
            "lost": lost,
        }
    )


def _worst_margin(event: Event) -> float | None:
    return max((margin.value for margin in event.margins if math.isfinite(margin.value)), default=None)


def _json(document: dict[str, Any]) -> str:
    return json.dumps(document, ensure_ascii=False, allow_nan=False)
