"""What a picture says in words: how the site was monitored, when, and of when each view is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from types import MappingProxyType

from recognition.observations import Scene, Status
from recognition.optics import EPOCH_S
from recognition.viewing.drawing import AMBER, GROUND, RED, Color
from recognition.viewing.footage import STALE_S
from rigcal.rig import Rig

APART_S = 0.05
"""A frame or a result that is further than this from the picture's time says so: 0.1 m of a fast walk."""
_COLORS: Mapping[Status, Color] = MappingProxyType({"MONITORED": GROUND, "DEGRADED": AMBER, "NOT MONITORED": RED})


def headline(status: str, color: Color, rig: Rig, t_ns: int, start_ns: int) -> tuple[str, Color]:
    """The band over a picture of time ``t_ns``, of a recording that begins at ``start_ns``; its words and colour."""
    after = f"+{(t_ns - start_ns) * 1e-9:.3f} s"
    when = f"{clock(t_ns)}  {after}" if _is_dated(t_ns) else after
    verdict = "" if rig.verdict == "PASS" else f"  rig {rig.verdict}"
    return f"{status}  |  {when}  {rig.site}{verdict}", color


def of_scene(scene: Scene | None, t_ns: int, violated: Sequence[str] = ()) -> tuple[str, Color]:
    """How the site was monitored, who was there and which rules were violated, in a picture of a time; words and
    colour."""
    if scene is None:
        return f"NOT MONITORED: no result within {STALE_S:g} s of this time", RED
    status = f"{scene.status}: {scene.reason}" if scene.reason else scene.status
    if scene.status != "NOT MONITORED":
        status += f"  |  {_count(len(scene.workers), 'worker')}, {_count(len(scene.objects), 'object')}"
    status += _apart(scene.t_ns - t_ns)
    return (f"VIOLATED: {', '.join(violated)}  |  {status}", RED) if violated else (status, _COLORS[scene.status])


def without_detections(*, show_faces: bool) -> tuple[str, Color]:
    """What stands there instead, where the recording does not say who is there; words and colour."""
    hidden = "" if show_faces else ": views are blurred as a whole"
    return f"NO DETECTIONS in this recording{hidden}", RED


def view_title(camera_id: str, at_ns: int, t_ns: int, *, is_hidden: bool) -> str:
    """The band over a view whose frame is of ``at_ns``, in a picture of ``t_ns``."""
    hidden = "  not looked at: blurred" if is_hidden else ""
    return f"{camera_id}  {clock(at_ns)}{_apart(at_ns - t_ns)}{hidden}"


def clock(t_ns: int) -> str:
    """A rig time in words."""
    if not _is_dated(t_ns):
        return f"{t_ns * 1e-9:.3f} s"
    second, rest = divmod(t_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(second, UTC):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"


def _is_dated(t_ns: int) -> bool:
    """Whether a rig time is UTC, and not seconds from the start of a capture that knows no date."""
    return t_ns >= EPOCH_S * 1e9


def _apart(gap_ns: int) -> str:
    """How far something is from the time of the picture, where that matters."""
    if abs(gap_ns) < APART_S * 1e9:
        return ""
    return f"  ({abs(gap_ns) * 1e-9:.2f} s {'before' if gap_ns < 0 else 'after'})"


def _count(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"
