"""Rooms: their arrangement by name, and the meshes that renderers draw of them.

finish    materials of an asset, from its half of the textures
walls     rectangles on walls, with openings cut out
shell     floor, walls, ceiling, panes and doors
outside   what lies beyond the openings
stacks    props: stored material;   hanging: on walls and under ceilings;   props: all kinds
layout    the arrangement
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tools.sicsg.mesh import Instance
from tools.sicsg.rooms.layout import installation, prop_bounds, prop_footprints, room, world_from_prop
from tools.sicsg.rooms.outside import outside
from tools.sicsg.rooms.props import prop_mesh
from tools.sicsg.rooms.shell import is_door, shell
from tools.sicsg.scene import Room

__all__ = ["installation", "is_door", "prop_bounds", "prop_footprints", "room", "room_instances"]


@lru_cache(maxsize=16)
def room_instances(room: Room) -> list[Instance]:
    """The room as instances of entity 0; the same list for the same room, so do not change it."""
    built = [Instance(shell(room), np.eye(4), 0), Instance(outside(room), np.eye(4), 0)]
    props = [(prop_mesh(prop.kind, prop.variant, room.size_m), world_from_prop(prop)) for prop in room.props]
    return built + [Instance(mesh, matrix, 0) for mesh, matrix in props]
