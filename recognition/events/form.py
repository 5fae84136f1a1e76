"""An event as JSON, the same wherever it is written: in events files, recordings and evidence.

``start_utc`` and its like are for people, and null where a capture knows no date; what is computed with is in ``_ns``.
A margin that is NaN is null.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any

from recognition.events.event import Actor, Event, Margin
from recognition.optics import EPOCH_S


def event_document(event: Event) -> dict[str, Any]:
    """The event as values that JSON has."""
    return {
        "event_id": event.event_id,
        "rule": event.rule,
        "sentence": event.sentence,
        "severity": event.severity,
        "start_utc": utc(event.start_ns),
        "raised_utc": utc(event.raised_ns),
        "end_utc": None if event.end_ns is None else utc(event.end_ns),
        "start_ns": event.start_ns,
        "raised_ns": event.raised_ns,
        "end_ns": event.end_ns,
        "actors": [one._asdict() for one in event.actors],
        "cameras": list(event.cameras),
        "confidence": event.confidence,
        "status": event.status,
        "rules_digest": event.rules_digest,
        "rig_digest": event.rig_digest,
        "rig_verdict": event.rig_verdict,
        "caveats": list(event.caveats),
        "margins": [[one.t_ns, one.value if math.isfinite(one.value) else None] for one in event.margins],
    }


def event_of(document: dict[str, Any]) -> Event:
    """The event of a document.

    Raises:
        ValueError: where it is no such document.
    """
    try:
        end_ns = document["end_ns"]
        return Event(
            event_id=str(document["event_id"]),
            rule=str(document["rule"]),
            sentence=str(document["sentence"]),
            severity=str(document["severity"]),
            start_ns=int(document["start_ns"]),
            raised_ns=int(document["raised_ns"]),
            end_ns=None if end_ns is None else int(end_ns),
            actors=tuple(Actor(str(a["kind"]), int(a["track_id"]), str(a["role"])) for a in document["actors"]),
            margins=tuple(Margin(int(t), math.nan if value is None else float(value)) for t, value in _rows(document)),
            cameras=tuple(map(str, document["cameras"])),
            confidence=float(document["confidence"]),
            status=str(document["status"]),
            rules_digest=str(document["rules_digest"]),
            rig_digest=str(document["rig_digest"]),
            rig_verdict=str(document["rig_verdict"]),
            caveats=tuple(map(str, document["caveats"])),
        )
    except KeyError as error:
        raise ValueError(f"no {error.args[0]}") from error
    except TypeError as error:
        raise ValueError(str(error)) from error


def actors_text(event: Event) -> str:
    """Who takes part, in words: ``worker 3, ladder 2``."""
    return ", ".join(f"{one.kind} {one.track_id}" for one in event.actors) or "the site"


def utc(t_ns: int) -> str | None:
    """A rig time as ``2026-11-22T09:30:01.250Z``; None where it counts from the start of a capture without a date."""
    if t_ns < EPOCH_S * 1e9:
        return None
    whole, rest_ns = divmod(t_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(whole, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}Z"


def _rows(document: dict[str, Any]) -> list[list[Any]]:
    rows = document["margins"]
    if not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise ValueError("margins are no pairs of a time and a value")
    return list(rows)
