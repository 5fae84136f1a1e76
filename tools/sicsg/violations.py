"""Which violations a scene holds and when: from what workers touch and wear, before anything is rendered.

Nothing here looks at pixels or at thresholds of recognition: motion tells what each foot stands on and what
each hand holds, the scene tells who wears which hat. The four violations are the paper's (Safe-Construct, "Safety
Violation Scenarios"), read as what is meant:

    no_hat    somebody wears no hat
    ladder    somebody has left the floor on a ladder or step ladder that nobody else, standing on the floor, holds
    window    a large window off the floor is in the hands of one worker alone
    platform  two workers or more stand on the deck of a platform
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from tools.sicsg.catalog import item
from tools.sicsg.scene import Scene, Thing, Violation, ViolationKind
from tools.sicsg.skeleton import JOINTS
from tools.sicsg.workers.motion import WorkerState, worker_state

_STEP_S, _RESOLUTION_S = 0.05, 0.001
_LIFTED_M = 0.03
_ANKLES = [JOINTS.index("left_ankle"), JOINTS.index("right_ankle")]
Key = tuple[ViolationKind, tuple[str, ...], tuple[str, ...]]
"""Kind, workers, things of a violation."""


def violations_at(scene: Scene, t_s: float) -> frozenset[Key]:
    """The violations of one instant."""
    states = {worker.id: worker_state(scene, worker, t_s) for worker in scene.workers}
    found = {("no_hat", (name,), ()) for name in states if name not in set(_wearers(scene, t_s))}
    for thing in scene.things:
        if thing.category in ("ladder", "step_ladder"):
            climbers = [name for name, state in states.items() if _off_floor_on(state, thing)]
            held = any(_holds_from_floor(state, thing) for name, state in states.items() if name not in climbers)
            if climbers and not held:
                found.add(("ladder", tuple(climbers), (thing.id,)))
        elif thing.category == "large_window":
            carriers = [name for name, state in states.items() if thing.id in state.hands_on]
            if len(carriers) == 1 and thing.pose(t_s)[2, 3] > _LIFTED_M:
                found.add(("window", tuple(carriers), (thing.id,)))
        elif thing.category == "platform":
            standing = [name for name, state in states.items() if _on_deck(state, thing)]
            if len(standing) >= 2:
                found.add(("platform", tuple(standing), (thing.id,)))
    return frozenset(found)


def _wearers(scene: Scene, t_s: float) -> Iterable[str]:
    for thing in scene.things:
        holder = thing.holder(t_s) if thing.category == "hard_hat" else None
        if holder is not None and holder.bone == "head":
            yield holder.worker


def _off_floor_on(state: WorkerState, thing: Thing) -> bool:
    return "floor" not in state.feet_on and thing.id in state.feet_on


def _on_deck(state: WorkerState, thing: Thing) -> bool:
    """Off the floor on it, and no ankle is still below its deck on the steps."""
    top = float((item(thing.category, thing.variant).deck_m[:, 2] + thing.path[0].position_m[2]).max())
    return _off_floor_on(state, thing) and bool((state.joints_m[_ANKLES, 2] > top).all())


def _holds_from_floor(state: WorkerState, thing: Thing) -> bool:
    return thing.id in state.hands_on and "floor" in state.feet_on


def timeline(scene: Scene) -> tuple[Violation, ...]:
    """Every violation from its start to its end, by start; borders to a millisecond."""
    times = np.append(np.arange(0.0, scene.duration_s, _STEP_S), scene.duration_s)
    states = [violations_at(scene, float(t)) for t in times]
    open_since = dict.fromkeys(states[0], 0.0)
    closed = []
    for before, after, was, now in zip(times[:-1], times[1:], states[:-1], states[1:], strict=True):
        for key in was ^ now:
            border = _border(lambda t, key=key: key in violations_at(scene, t), float(before), float(after))
            if key in now:
                open_since[key] = border
            else:
                closed.append(_violation(key, open_since.pop(key), border))
    closed += [_violation(key, start, scene.duration_s) for key, start in open_since.items()]
    return tuple(sorted(closed, key=lambda v: (v.start_s, v.kind, v.workers)))


def _violation(key: Key, start_s: float, end_s: float) -> Violation:
    kind, workers, things = key
    return Violation(kind=kind, start_s=round(start_s, 3), end_s=round(end_s, 3), workers=workers, things=things)


def _border(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Where a condition changes between two times, by bisection."""
    first = holds(low)
    while high - low > _RESOLUTION_S:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) == first else (low, middle)
    return high
