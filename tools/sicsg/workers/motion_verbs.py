"""How each verb on the floor is laid out: standing, working, crouching, walking, holding, carrying."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.workers.gait import Stance, stance_soles
from tools.sicsg.workers.motion_carry import Carrying, way_of
from tools.sicsg.workers.motion_ladder import Holding, near_and_far, reachable
from tools.sicsg.workers.motion_posture import Reach, Upper, solve
from tools.sicsg.workers.motion_still import Crouching, Standing, Walking
from tools.sicsg.workers.motion_way import walk_of
from tools.sicsg.workers.motion_writer import Writer
from tools.sicsg.workers.stations import carry_stations, hold_grips, hold_station

Floats = NDArray[np.float64]

_LEANS_RAD = (0.04, 0.14, 0.24, 0.34, 0.44, 0.56, 0.68)
"""How far somebody leans to hold a ladder; the first at which both arms reach is taken."""


def stand(writer: Writer) -> None:
    """Stand about."""
    _stand(writer, works=False)


def work(writer: Writer) -> None:
    """Stand and work at a point."""
    writer.need("look_m")
    _stand(writer, works=True)


def _stand(writer: Writer, *, works: bool) -> None:
    stance = _stance(writer)
    soles = stance_soles(writer.rig, stance, writer.style.stance * writer.rig.height, writer.style.toe_out)
    done = writer.assume(soles)
    writer.plan(Standing(writer.rig, writer.style, stance, writer.look(), works), done)


def _stance(writer: Writer) -> Stance:
    x, y, z = writer.need("at_m")
    return Stance(x, y, z, writer.nearest(writer.need("yaw_rad")), "floor")


def crouch(writer: Writer) -> None:
    """Squat or kneel."""
    stance, h = _stance(writer), writer.rig.height
    width, toe_out, stride = (0.11, 0.05, 0.42) if writer.style.kneels else (0.19, 0.3, 0.03)
    done = writer.assume(stance_soles(writer.rig, stance, width * h, toe_out, stride * h))
    point = writer.look()
    if point is None:
        ahead = 0.27 * h * np.array([math.cos(stance.yaw), math.sin(stance.yaw), 0.0])
        point = np.array([stance.x, stance.y, stance.z + 0.12]) + ahead
    writer.plan(Crouching(writer.rig, writer.style, stance, point), done)


def walk(writer: Writer) -> None:
    """Walk along points."""
    path = np.array(writer.need("path_m"))[:, :2]
    if float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) < 0.02:
        raise writer.error("path_m is shorter than 0.02 m; use stand instead")
    if not writer.first:
        writer.check_near(path[0])
    way = walk_of(path, writer.action.start_s, writer.action.end_s, None if writer.first else writer.yaw)
    if writer.first:
        writer.assume(writer.walking_soles(way.place(0.0)))
    briskness = way.speed_m_per_s / 1.2
    writer.stride(way.place, way.time_at, way.length_m, briskness)
    writer.plan(Walking(writer.rig, writer.style, way.place_at, briskness))


def hold(writer: Writer) -> None:
    """Hold a ladder with both hands."""
    thing, what, pose = writer.thing()
    at, yaw = hold_station(what, pose, writer.need("side"))
    stance = Stance(float(at[0]), float(at[1]), 0.0, writer.nearest(yaw), "floor")
    h = writer.rig.height
    done = writer.assume(stance_soles(writer.rig, stance, 0.15 * h, 0.1, 0.06 * h))
    grips = hold_grips(what, pose)
    look = writer.look()
    if look is None:
        look = grips.mean(axis=0) + np.array([0.0, 0.0, 0.35])
    points = near_and_far(grips, stance)
    ways = [Holding(writer.rig, writer.style, stance, points, thing.id, lean, look) for lean in _LEANS_RAD]
    writer.plan(next((part for part in ways if _reaches(writer, part)), ways[-1]), done)


def _reaches(writer: Writer, part: Holding) -> bool:
    """Whether the arms of somebody who holds reach the rails, with room for the sway."""
    now = writer.feet.at(math.inf)
    found: list[bool] = []

    def hands(upper: Upper) -> tuple[Reach, Reach]:
        found.append(reachable(upper, part.points))
        return part.hands(upper)

    solve(writer.rig, part.trunk(now._replace(t_s=0.0)), now, hands)
    return found[0]


def carry(writer: Writer) -> None:
    """Carry a window: the feet follow where it goes."""
    thing, what, pose = writer.thing()
    side = writer.need("side")
    at, yaw = carry_stations(what, pose, side)
    done = writer.assume(writer.walking_soles(Stance(float(at[0]), float(at[1]), 0.0, yaw, "floor")), 0.4)
    way = way_of(thing, what, side, (writer.action.start_s, writer.action.end_s), writer.nearest(yaw))
    for first, last in way.stretches():
        times, places = way.times_s[first : last + 1], way.places[first : last + 1]
        lengths = way.lengths_m[first : last + 1] - way.lengths_m[first]
        length = float(lengths[-1])
        briskness = length / float(times[-1] - times[0]) / 1.2
        writer.stride(partial(_place, lengths, places), partial(_at, lengths, times), length, 0.7 * briskness)
    writer.plan(Carrying.of(writer.rig, writer.style, way, thing, what, side), done)


def _place(lengths_m: Floats, places: Floats, distance_m: float) -> Stance:
    x, y, yaw = (float(np.interp(distance_m, lengths_m, places[:, axis])) for axis in range(3))
    return Stance(x, y, 0.0, yaw, "floor")


def _at(lengths_m: Floats, times_s: Floats, distance_m: float) -> float:
    return float(np.interp(distance_m, lengths_m, times_s))
