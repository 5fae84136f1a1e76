"""What a commissioning record is worth to a run: it counts where rules, rig and networks are those it was made with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recognition.commissioning.record import CommissionRecord, Network, read_record
from recognition.errors import CommissionError

ENDING = ".commission.json"
STANDING_KEY = "commissioning"
"""Metadata of a run by rules: the line that says what the record of its site is worth to it."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Whether a site is commissioned, in words."""

    is_commissioned: bool
    """Whether there is a record that counts; rules in it may have failed."""
    line: str


def record_beside(rig: Path) -> Path:
    """Where the record of a rig file ``NAME.rig.json`` lies: ``NAME.commission.json`` beside it."""
    name = rig.name.removesuffix(".json").removesuffix(".rig")
    return rig.with_name(name + ENDING)


def standing_of(
    rig: Path, given: Path | None, *, rules_digest: str, rig_digest: str, networks: Sequence[Network]
) -> Standing:
    """What the record of a site says to a run.

    Args:
        rig: The rig file, beside which the record is looked for.
        given: The record that was asked for; None: the one beside the rig file, if there is one.
        rules_digest: Of the run's rule file.
        rig_digest: The rig file's ``geometry_digest``.
        networks: Of the run.

    Raises:
        CommissionError: where the record cannot be read or was changed; of one that was asked for, also where rules,
            rig or networks are others than it was made with.
    """
    path = given or record_beside(rig)
    if given is None and not path.exists():
        return Standing(False, f"not commissioned: there is no {path.name} beside the rig file")
    record = read_record(path)
    changed = list(_changed(record, rules_digest, rig_digest, networks))
    if not changed:
        return Standing(True, _words(record))
    if given is None:
        return Standing(False, f"not commissioned: {', '.join(changed)} changed since {_day(record)}, see {path.name}")
    raise CommissionError(
        f"this record was made with other {' and '.join(changed)}",
        where=path,
        expected=f"rules {record.rules_digest}, rig {record.rig_digest}, networks {_names(record.networks)}",
        got=f"rules {rules_digest}, rig {rig_digest}, networks {_names(networks)}",
        do_next="walk again with what is used now: recognition commission",
    )


def _words(record: CommissionRecord) -> str:
    on = " on simulated people" if record.people == "simulated" else ""
    results = ", ".join(f"{result.rule} {result.verdict}" for result in record.results)
    return f"commissioned {_day(record)} by {record.author}{on}: {results}"


def _changed(
    record: CommissionRecord, rules_digest: str, rig_digest: str, networks: Sequence[Network]
) -> Iterator[str]:
    if record.rules_digest != rules_digest:
        yield "rules"
    if record.rig_digest != rig_digest:
        yield "rig"
    if {n.sha256 for n in record.networks} != {n.sha256 for n in networks}:
        yield "networks"


def _day(record: CommissionRecord) -> str:
    return record.at_utc[:10]


def _names(networks: Sequence[Network]) -> str:
    return ", ".join(f"{network.name} {network.sha256[:12]}" for network in networks) or "none"
