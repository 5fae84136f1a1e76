"""One recording of a batch: judged again by rules, and told of in a row.

It needs nothing but the recording and writes nothing, so that any process on any machine can do it.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from recognition.batch.finding import Found
from recognition.batch.rows import Row, text_digest
from recognition.errors import BatchError
from recognition.events import EventLog, events_text
from recognition.judging import caveats_of, recorded_rulebook, watch_of
from recognition.observations import Status
from recognition.placing import PlacingOptions
from recognition.recording import recording_files
from recognition.replay import ReplayResult, recorded_options, replay
from recognition.rules import RuleSet, parse_rules
from recognition.sources.recording import RecordedRun, open_recording
from rigcal import __version__
from rigcal.errors import RigcalError

_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Orders:
    """What is done with every recording of a batch."""

    rules: str | None = None
    """The text of the rule file; None: each recording is judged by the rules that it holds, if it holds any."""
    rules_name: str = "rules"
    """The name of that file."""
    smooth: bool = False
    """Whether tracks are smoothed by what came after."""
    version: str = __version__
    """Of the program that gives the orders: whoever follows them has the same."""


@dataclass(frozen=True, slots=True)
class Task:
    """A recording to judge."""

    found: Found
    orders: Orders
    earlier: Row | None
    """What an earlier batch said of a recording of this name; it is said again where nothing has changed."""


@dataclass(frozen=True, slots=True)
class Judged:
    """What there is to say of a recording."""

    row: Row
    events: str | None
    """The text of its events file; None where there is none, or an earlier batch has written it."""
    is_earlier: bool = False
    """Whether an earlier batch had computed it."""


def judge_recording(task: Task) -> Judged:
    """Judge a recording; one that cannot be judged is a row that says why."""
    digest: str | None = None
    try:
        if task.orders.version != __version__:
            raise _another_version(task.orders.version)
        digest = _digest(recording_files(task.found.path))
        opened = open_recording(task.found.path)
        rules = _rules(task.orders, opened)
        if (row := _as_before(task, digest, rules)) is not None:
            return Judged(row, None, is_earlier=True)
        return _judged(task, digest, opened, rules)
    except RigcalError as error:
        return Judged(failed(task, digest, "; ".join(" ".join(line.split()) for line in str(error).splitlines())), None)
    except OSError as error:
        return Judged(failed(task, digest, f"the system refuses it: {error}"), None)


def failed(task: Task, digest: str | None, error: str) -> Row:
    """The row of a recording that cannot be judged."""
    return Row(
        recording=str(task.found.path),
        name=task.found.name,
        digest=digest,
        status="failed",
        error=error,
        seconds=None,
        instants=None,
        workers=None,
        monitored_share=None,
        degraded_share=None,
        events=None,
        events_digest=None,
        warnings=(),
        rules_digest=None,
        smooth=task.orders.smooth,
        version=task.orders.version,
    )


def _digest(files: Sequence[Path]) -> str:
    """SHA-256 of the bytes of all, one after the other."""
    total = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK_BYTES):
                total.update(block)
    return f"sha256:{total.hexdigest()}"


def _rules(orders: Orders, opened: RecordedRun) -> RuleSet | None:
    if orders.rules is not None:
        return parse_rules(orders.rules, orders.rules_name)
    own = recorded_rulebook(opened)
    return None if own is None else own.rules


def _as_before(task: Task, digest: str, rules: RuleSet | None) -> Row | None:
    """The row of an earlier batch, where it was made of the same, by the same."""
    row, orders = task.earlier, task.orders
    made_by = (digest, None if rules is None else rules.digest, orders.smooth, orders.version)
    if row is None or (row.digest, row.rules_digest, row.smooth, row.version) != made_by:
        return None
    return replace(row, recording=str(task.found.path))


def _judged(task: Task, digest: str, opened: RecordedRun, rules: RuleSet | None) -> Judged:
    options, smooth = recorded_options(opened), task.orders.smooth
    watch = None if rules is None else watch_of(rules, opened.rig, opened.metadata, opened.geometry_digest)
    result = replay(opened, smooth=smooth, keep_scenes=False, watch=watch)
    warnings = list(opened.warnings)
    if options is None and result.is_placed_again:
        warnings.append("the recording does not say how it was placed: tracks may differ from the run's")
    if result.incomplete:
        warnings.append(f"{result.incomplete} instants are not whole and were left out")
    events = None if rules is None else events_text(_log(task, opened, options or PlacingOptions(), rules, result))
    counts = Counter(event.rule for event in result.events)
    row = Row(
        recording=str(task.found.path),
        name=task.found.name,
        digest=digest,
        status="ok",
        error=None,
        seconds=_seconds(result),
        instants=result.instants,
        workers=len(result.worker_instants),
        monitored_share=_share(result, "MONITORED"),
        degraded_share=_share(result, "DEGRADED"),
        events={rule.name: counts[rule.name] for rule in (rules.rules if rules else ())},
        events_digest=None if events is None else text_digest(events),
        warnings=tuple(warnings),
        rules_digest=None if rules is None else rules.digest,
        smooth=task.orders.smooth,
        version=task.orders.version,
    )
    return Judged(row, events)


def _seconds(result: ReplayResult) -> float:
    if result.start_ns is None or result.end_ns is None:
        return 0.0
    return (result.end_ns - result.start_ns) / 1e9


def _share(result: ReplayResult, status: Status) -> float:
    return result.statuses.get(status, 0) / result.instants


def _log(task: Task, opened: RecordedRun, options: PlacingOptions, rules: RuleSet, result: ReplayResult) -> EventLog:
    return EventLog(
        recording=task.found.path.name,
        rules_name=rules.name,
        rules_digest=rules.digest,
        rig_digest=opened.geometry_digest,
        rig_verdict=opened.rig.verdict,
        association=options.method,
        smoothed=task.orders.smooth,
        monitoring=result.statuses,
        caveats=caveats_of(opened.metadata),
        events=result.events,
    )


def _another_version(wanted: str) -> BatchError:
    return BatchError(
        "the worker has another version of the program than the batch",
        expected=wanted,
        got=__version__,
        do_next="install the same on every machine, and give the same command again",
    )
