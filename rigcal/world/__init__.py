"""The world frame of a rig: z up and the floor at 0, from a board on the floor, measured points or a plumb line."""

from rigcal.world.floor import world_from_floor_board
from rigcal.world.frame import Residual, World
from rigcal.world.plumb import world_from_plumb_line
from rigcal.world.points import world_from_points
from rigcal.world.tables import read_pixels, read_points

__all__ = [
    "Residual",
    "World",
    "read_pixels",
    "read_points",
    "world_from_floor_board",
    "world_from_plumb_line",
    "world_from_points",
]
