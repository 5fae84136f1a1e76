"""How a live run stands, and what the terminal shows of it.

The state is plain values; :func:`line` makes one line of them for logs and pipes, :func:`table` a table for a terminal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from recognition.observations import Status

if TYPE_CHECKING:
    from rich.console import Group
    from rich.text import Text

STYLES: dict[Status, str] = {"MONITORED": "bold green", "DEGRADED": "bold yellow", "NOT MONITORED": "bold white on red"}
_NOTABLE_BYTES = 8_000_000
"""Of what waits for the disk: two seconds of four cameras at 6 Mb/s, and some."""


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """How one camera does."""

    camera_id: str
    fps: float
    """Frames received per second, lately."""
    lag_s: float | None
    """From capture to arrival of its latest frame; None for files."""
    received: int
    recorded: int
    unrecorded: int
    """Frames that are not in the recording, because the disk was too slow or because they could not be decoded where
    that was needed."""
    undecoded: int
    """Frames that were recorded but not decoded: no time, or no key frame yet."""
    corrupt: int
    """Frames that the decoder refused."""
    late: int
    """Frames that came after their frame set had left."""
    interruptions: int
    fault: str | None
    """What is wrong with it now; None: nothing is."""

    @property
    def drops(self) -> int:
        """Frames that did not come to be looked at, or recorded, though they arrived."""
        return self.unrecorded + self.undecoded + self.corrupt + self.late


@dataclass(frozen=True, slots=True)
class LiveStatus:
    """How a live run stands."""

    elapsed_s: float
    cameras: tuple[CameraStatus, ...]
    """Those in use, in rig order."""
    sets: int
    """Frame sets that there were."""
    looked_at: int
    """Frame sets that the networks looked at."""
    skipped: int
    """Frame sets that were skipped as a whole, because inference was late."""
    alone: int
    """Frames without a partner of another camera."""
    sets_per_s: float
    """Frame sets that were looked at per second, lately."""
    latency_p50_s: float | None
    """From capture to track; None before the first."""
    latency_p95_s: float | None
    waiting_bytes: int
    """What waits to be written to the recording."""
    unrecorded_why: str | None = None
    """Why nothing is recorded any more; None while it is."""

    @property
    def document(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Seen:
    """What the latest result says."""

    status: Status
    reason: str
    workers: int
    objects: int


def line(run: LiveStatus, seen: Seen | None) -> str:
    """One line: everything that an operator must know."""
    parts = [f"{run.elapsed_s:.0f} s"]
    if seen is not None:
        why = f" ({seen.reason})" if seen.reason else ""
        parts += [f"{seen.status}{why}", f"workers {seen.workers}, objects {seen.objects}"]
    if run.unrecorded_why:
        parts.append(f"NOT RECORDED ({run.unrecorded_why})")
    parts.append(f"{run.sets_per_s:.1f} sets/s{_latency(run)}, {run.skipped} of {run.sets} skipped")
    parts += [f"{one.camera_id} {one.fps:.1f} fps{_lag(one)}{_drops(one)}" for one in run.cameras]
    return "; ".join(parts)


def table(run: LiveStatus, seen: Seen | None) -> Group:
    """The same for a terminal: how the whole run stands, then a row for each camera."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    made = Table()
    for name in ("camera", "fps", "lag", "recorded", "dropped", "state"):
        made.add_column(name, justify="left" if name in ("camera", "state") else "right")
    for one in run.cameras:
        lag = "" if one.lag_s is None else f"{1e3 * one.lag_s:.0f} ms"
        drops = Text(str(one.drops), style="red" if one.drops else "")
        state = Text(one.fault, style="bold red") if one.fault else Text("ok", style="green")
        made.add_row(one.camera_id, f"{one.fps:.1f}", lag, str(one.recorded), drops, state)
    whole = f"{run.sets_per_s:.1f} frame sets/s{_latency(run)}; {run.skipped} of {run.sets} skipped"
    waiting = f"; {run.waiting_bytes / 1e6:.0f} MB wait for the disk" if run.waiting_bytes > _NOTABLE_BYTES else ""
    foot = Text(whole + waiting)
    if run.unrecorded_why:
        foot.append("\n").append(" NOT RECORDED ", STYLES["NOT MONITORED"]).append(f"  {run.unrecorded_why}")
    return Group(_headline(run, seen), made, foot)


def summary(run: LiveStatus) -> Iterator[str]:
    """For the end of a run."""
    yield (
        f"{run.looked_at} of {run.sets} frame sets looked at in {run.elapsed_s:.0f} s{_latency(run)}; {run.skipped} "
        "skipped because inference was late"
    )
    for one in run.cameras:
        kinds = ("unrecorded", "undecoded", "corrupt", "late")
        said = [f"{getattr(one, kind)} {kind}" for kind in kinds if getattr(one, kind)]
        said += [f"interrupted {_times(one.interruptions)}"] if one.interruptions else []
        yield f"  {one.camera_id}: {one.recorded} of {one.received} frames recorded{''.join(f', {s}' for s in said)}"


def _times(count: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _headline(run: LiveStatus, seen: Seen | None) -> Text:
    from rich.text import Text

    if seen is None:
        return Text(f"{run.elapsed_s:.0f} s, no result yet")
    counts = f"  {run.elapsed_s:.0f} s, workers {seen.workers}, objects {seen.objects}"
    why = f"\n{seen.reason}" if seen.reason else ""
    return Text.assemble((f" {seen.status} ", STYLES[seen.status]), counts, why, no_wrap=True, overflow="ellipsis")


def _latency(run: LiveStatus) -> str:
    if run.latency_p50_s is None or run.latency_p95_s is None:
        return ""
    return f", capture to track {1e3 * run.latency_p50_s:.0f} ms (95 %: {1e3 * run.latency_p95_s:.0f})"


def _lag(one: CameraStatus) -> str:
    return "" if one.lag_s is None else f" lag {1e3 * one.lag_s:.0f} ms"


def _drops(one: CameraStatus) -> str:
    return f" {one.drops} dropped" if one.drops else ""
