"""What a rig file means in words: the verdict, the next actions and what is not known yet."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rigcal.report.numbers import beside_limit, fixed, significant
from rigcal.rigdocument import GateEntry, RigDocument, ViewsEntry
from rigcal.site import GateLimits

_UNITS = (("_px", "px"), ("_percent", "%"), ("_m", "m"), ("_deg", "deg"))
LABEL_CHARACTERS = 14
"""Characters of a camera's id that have room in a figure."""
CLOCK_GATE = "clock_error_m"
"""The one gate that needs no new views of the board."""
_RULES_WITHOUT_TIMES = ("frame numbers", "none")

RMSE_MEANINGS = (
    ("intrinsic", "each camera alone: how well its lens model fits its own board views"),
    ("pairwise", "the camera and its neighbour on the chain solved alone (the extrinsic RMSE)"),
    ("chained", "boards placed by the reference camera, seen through the chain: how errors add up along it"),
    ("refined", "after all cameras were solved together, over the corners that the solve used"),
    ("held_out", "board views kept out of the solve: near the refined figure, the rig also fits what it never saw"),
    ("all", "after the joint solve, over every detected corner, rejected ones too"),
)
"""The fields of :class:`rigcal.rigdocument.RmseEntry`, in the order of the tables, and what each measures."""


@dataclass(frozen=True, slots=True)
class GateMeaning:
    """What a gate measures."""

    what: str
    """In words; empty for a gate that this version does not know."""
    bound: str
    """``at most``, ``at least`` or empty."""
    unit: str
    """Unit of its value and limit, or empty."""


@dataclass(frozen=True, slots=True)
class Action:
    """Something to do, and the failed gates that ask for it."""

    advice: str
    gates: tuple[GateEntry, ...]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Per gate its cameras with their values, and the limit: ``views (at least 10): cam2 4, cam3 7``."""
        named: dict[str, list[GateEntry]] = {}
        for gate in self.gates:
            named.setdefault(f"{gate.name} ({gate_limit(gate)})", []).append(gate)
        return tuple(
            f"{name}: " + ", ".join(f"{gate.camera or 'the rig'} {gate_value(gate)}" for gate in gates)
            for name, gates in named.items()
        )


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """``1 camera``, ``4 cameras``; ``plural`` where it is not the noun with an s."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def listed(names: Sequence[str]) -> str:
    """``cam0``, ``cam0 and cam1``, ``cam0, cam1 and cam2``."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def shortened(camera_id: str) -> str:
    """A camera's id as figures show it: cut after :data:`LABEL_CHARACTERS`, with an ellipsis."""
    return camera_id if len(camera_id) <= LABEL_CHARACTERS else camera_id[: LABEL_CHARACTERS - 1] + "…"


def short_digest(digest: str) -> str:
    """The first twelve digits of a digest, enough to tell two files apart; empty where there is none."""
    return digest.removeprefix("sha256:")[:12]


def gate_meaning(name: str) -> GateMeaning:
    """What the gate of that name measures, from the limits' own descriptions."""
    field = GateLimits.model_fields.get(name)
    what, _, bound = (field.description or "").rpartition(", ") if field else ("", "", "")
    return GateMeaning(what, bound, next((unit for suffix, unit in _UNITS if name.endswith(suffix)), ""))


def gate_value(gate: GateEntry) -> str:
    """The gate's value with its unit."""
    unit = gate_meaning(gate.name).unit
    value = "not measured" if gate.value is None else beside_limit(gate.value, gate.limit)
    return f"{value} {unit}" if unit and gate.value is not None else value


def gate_limit(gate: GateEntry) -> str:
    """The gate's limit with its direction and unit: ``at most 0.5 px``."""
    meaning = gate_meaning(gate.name)
    return " ".join(part for part in (meaning.bound, significant(gate.limit, 6), meaning.unit) if part)


def failed_gates(document: RigDocument) -> tuple[GateEntry, ...]:
    """Gates that did not pass, in the file's order."""
    return tuple(gate for gate in document.gates if not gate.passed)


def verdict_sentence(document: RigDocument) -> str:
    """The verdict's meaning in one sentence."""
    cameras, gates = counted(len(document.cameras), "camera"), counted(len(document.gates), "gate")
    if failed := failed_gates(document):
        named = ", ".join(dict.fromkeys(gate.camera or "the whole rig" for gate in failed))
        again = "measure the clocks" if {gate.name for gate in failed} == {CLOCK_GATE} else "calibrate"
        return f"{cameras}, {len(failed)} of {gates} failed ({named}); do the next actions below, then {again} again."
    if document.verdict == "RECAPTURE":
        return f"{cameras}; the file names no failed gate for its verdict; calibrate again."
    if document.verdict == "IMPORTED":
        return f"{cameras} calibrated by another tool; their accuracy was not measured here."
    return f"{cameras}, all {gates} passed; the rig can be used."


def next_actions(document: RigDocument) -> tuple[Action, ...]:
    """The advice of the failed gates, in the order of the gates.

    Each is said once; advice that differs by the gate's own camera alone is said once for all these cameras.
    """
    groups: list[list[GateEntry]] = []
    known: dict[str, list[GateEntry]] = {}
    for gate in failed_gates(document):
        group = known.get(_advice(gate)) or known.get(_without_camera(gate))
        if group is None:
            groups.append(group := [])
        group.append(gate)
        known[_advice(gate)] = known[_without_camera(gate)] = group
    return tuple(Action(_said_for_all(group), tuple(group)) for group in groups)


def _advice(gate: GateEntry) -> str:
    return gate.advice or f"see the gate {gate.name}; the file holds no advice for it"


def _without_camera(gate: GateEntry) -> str:
    """The advice with its camera's name taken out; the same for gates that ask for the same."""
    return _of_cameras(gate, "\0")


def _said_for_all(gates: Sequence[GateEntry]) -> str:
    first = gates[0]
    alike = [gate.camera for gate in gates if gate.camera and _without_camera(gate) == _without_camera(first)]
    return _of_cameras(first, listed(tuple(dict.fromkeys(alike))))


def _of_cameras(gate: GateEntry, names: str) -> str:
    """The advice with other names in the place of its camera's."""
    if gate.camera is None:
        return _advice(gate)
    return re.sub(rf"(?<!\w){re.escape(gate.camera)}(?!\w)", lambda _: names, _advice(gate))


def open_points(document: RigDocument) -> tuple[str, ...]:
    """What the file does not know yet, and which command measures it."""
    points = []
    if document.verdict == "IMPORTED":
        points.append("Nothing judged this rig: calibrate it with rigcal calibrate to learn how accurate it is.")
    if document.world_from_rig is None:
        points.append(f"The floor and the vertical are not known; positions are in the frame of {document.reference}.")
    unknown = [camera.id for camera in document.cameras if camera.clock is None]
    if unknown:
        named = "any camera" if len(unknown) == len(document.cameras) else ", ".join(unknown)
        points.append(f"No clock was measured for {named}; frames are paired by their stamps or numbers alone.")
    return tuple(points)


def instants_sentence(document: RigDocument) -> str | None:
    """How the instants were found, and how far apart the times within them are; None where the file does not say."""
    own = document.extensions.get("rigcal")
    instants = own.get("instants") if isinstance(own, dict) else None
    if not isinstance(instants, dict) or not isinstance(instants.get("rule"), str):
        return None
    rule, spread_s, shared = str(instants["rule"]), instants.get("spread_s"), instants.get("shared")
    parts = ["Views had no common instants" if rule == "none" else f"Instants were found by {rule}"]
    if isinstance(shared, int):
        parts.append(f"{shared} of them seen by two or more cameras")
    if rule in _RULES_WITHOUT_TIMES:
        parts.append("no times were known, so their spread is not either")
    elif isinstance(spread_s, int | float):
        parts.append(f"times within one differ by {fixed(spread_s * 1e3, 1)} ms at most")
    return "; ".join(parts) + "."


def held_sentence(document: RigDocument) -> str | None:
    """Which lenses the joint solve held, and why; None where it held none."""
    own = document.extensions.get("rigcal")
    held = own.get("lenses_held") if isinstance(own, dict) else None
    if not isinstance(held, list) or not held:
        return None
    return (
        "Views of several cameras contradict each other by more than the corners' noise, so the lens of "
        f"{', '.join(map(str, held))} was kept as calibrated alone: expose the cameras together, "
        "or hold the board still."
    )


def drawn(magnification: float) -> str:
    """How large something is drawn."""
    if magnification >= 1:
        return f"drawn {magnification:g} times as large as it is"
    return f"drawn at {magnification:g} of its size"


def findings_counts(views: ViewsEntry) -> str:
    """``3 dropped, 1 unflipped``; empty where every view was used as it was detected."""
    actions = [finding.action for finding in views.findings]
    return ", ".join(f"{actions.count(action)} {action}" for action in dict.fromkeys(actions))


def chain_ends(document: RigDocument) -> tuple[list[int], list[int]]:
    """Places in the rig of both ends of every link of a chain, each link once."""
    place = {camera_id: index for index, camera_id in enumerate(document.camera_ids)}
    links = sorted(sorted(place[camera_id] for camera_id in link) for link in chain_links(document))
    return [first for first, _ in links], [second for _, second in links]


def chain_links(document: RigDocument) -> frozenset[frozenset[str]]:
    """Pairs of cameras that are neighbours on some camera's chain to the reference."""
    return frozenset(
        frozenset(link) for camera in document.cameras for link in zip(camera.chain, camera.chain[1:], strict=False)
    )
