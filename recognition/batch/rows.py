"""What a batch says of each recording: a row, the same whoever computed it."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from pydantic import TypeAdapter, ValidationError
from pydantic.config import ConfigDict


@dataclass(frozen=True, slots=True)
class Row:
    """A recording of a batch; None: not known of one that failed. It holds no time of computing."""

    recording: str
    """Its path, as the batch was given it."""
    name: str
    """Its events are in ``NAME.events.json``."""
    digest: str | None
    """``sha256:`` and the SHA-256 of the file; of segments, of all one after the other."""
    status: Literal["ok", "failed"]
    error: str | None
    """What is wrong, in one line."""
    seconds: float | None
    """From the first instant to the last."""
    instants: int | None
    """How many instants there are."""
    workers: int | None
    """How many identities workers were given."""
    monitored_share: float | None
    """Share of the instants at which every camera took part."""
    degraded_share: float | None
    """Share of those that some missed, and two or more took part in; at the rest nothing can be told."""
    events: Mapping[str, int] | None
    """How many events there are of each rule; empty where nothing judged."""
    events_digest: str | None
    """``sha256:`` and the SHA-256 of the events file; None where there is none."""
    warnings: tuple[str, ...]
    """Why the result may differ from what the run saw."""
    rules_digest: str | None
    """Of the rule file; None where nothing judged."""
    smooth: bool
    """Whether tracks were smoothed by what came after."""
    version: str
    """Of the program that computed it."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    @property
    def line(self) -> str:
        """The row as one line of JSON, without its end."""
        return json.dumps(asdict(self))


_ROWS = TypeAdapter(Row)


def row_of(line: bytes) -> Row | None:
    """The row of a line; None where the line was cut off, or is none of this version's."""
    try:
        return _ROWS.validate_json(line)
    except ValidationError:
        return None


def table(rows: Sequence[Row]) -> str:
    """Rows as comma-separated values with a head; the events of each rule have a column of their own."""
    rules = list(dict.fromkeys(rule for row in rows for rule in row.events or ()))
    plain = ("recording", "digest", "status", "error", "seconds", "instants", "workers")
    shares = ("monitored_share", "degraded_share")
    origin = ("rules_digest", "smooth", "version")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*plain, *shares, *(f"events.{rule}" for rule in rules), "warnings", *origin])
    for row in rows:
        counts = [(row.events or {}).get(rule) for rule in rules]
        values = [[getattr(row, name) for name in names] for names in (plain, shares, origin)]
        writer.writerow([*values[0], *values[1], *counts, "; ".join(row.warnings), *values[2]])
    return text.getvalue()


def text_digest(text: str) -> str:
    """``sha256:`` and the SHA-256 of a text in UTF-8."""
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
