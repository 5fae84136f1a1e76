"""From saddles to grids: neighbours along the edges with dark and light exchanged, joined into rows and columns.

Two corners of a checkerboard are neighbours when each is the other's nearest along an edge that both have, and the
light quadrants of one are the dark ones of the other. Grids grow from corner to corner, so that neither perspective nor
a lens that bends the rows disturbs them; places that growth left out are looked for where their neighbours have them.
(A. Geiger et al., "Automatic camera and range sensor calibration using a single shot", ICRA 2012, grows likewise.)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from rigcal.detect.saddles import Saddles
from rigcal.geometry import Floats, Ints

NEIGHBOURS = 24
"""Nearest saddles among which the four neighbours are sought; at a tilt of 70 degrees the fourth is about the 20th."""
ALONG = np.cos(np.deg2rad(22.0))
"""Between an edge and the direction to the next corner; perspective and a lens bend it by a few degrees."""
EXCHANGED = -0.5
"""Cosine of twice the angle between the light bisectors of neighbours: -1 where dark and light are exchanged."""
SNAP = 0.3
"""Distance of a corner from where its neighbours have it, in squares, up to which it is that corner."""
LEAST_LINKED = 0.4
"""Share of a board's corners that must be linked with each other before the others are looked for."""
LEAST_SEEN = 0.7
"""Share of a board's corners among the saddles; the others are set between their neighbours and left to the judge."""
MOST_CELLS = 40_000
"""Of a lattice; a texture may grow to a long thin one that fills a field of millions."""
_STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def find_grids(saddles: Saddles, size: tuple[int, int]) -> list[Floats]:
    """Grids of corners among the saddles of an image.

    Args:
        saddles: The saddles.
        size: Columns and rows of corners of the board.

    Returns:
        Grids (rows, columns, 2) in pixels, the fullest first, either way round.
    """
    needed = LEAST_LINKED * size[0] * size[1]
    if len(saddles.points_px) < max(needed, 2):
        return []
    links = _links(saddles)
    grids: list[tuple[int, Floats]] = []
    for members in _components(links, needed):
        lattice = _grown(members, links, saddles.points_px)
        if lattice[..., 0].size <= MOST_CELLS:
            grids += _windows(_filled(lattice, saddles.points_px), size)
    return [grid for _, grid in sorted(grids, key=lambda seen_and_grid: -seen_and_grid[0])]


def _links(saddles: Saddles) -> Ints:
    """(n, 4) each saddle's neighbour along its edges: first, second, and against them; -1 where there is none."""
    points = saddles.points_px
    count = min(NEIGHBOURS, len(points) - 1)
    distance, other = (np.asarray(found)[:, 1:] for found in cKDTree(points).query(points, k=count + 1))
    towards = (points[other] - points[:, None]) / np.maximum(distance, 1e-9)[..., None]
    own = np.einsum("nkd,ned->nke", towards, saddles.edges)
    theirs = np.abs(np.einsum("nkd,nked->nke", towards, saddles.edges[other])).max(axis=-1)
    exchanged = np.cos(2 * (saddles.light[other] - saddles.light[:, None])) < EXCHANGED
    fits = (exchanged & (theirs > ALONG))[..., None] & (np.concatenate([own, -own], axis=-1) > ALONG)
    nearest = np.where(fits.any(axis=1), np.take_along_axis(other, fits.argmax(axis=1), axis=1), -1)
    mutual = (nearest[nearest] == np.arange(len(points))[:, None, None]).any(axis=-1)
    return np.where(mutual & (nearest >= 0), nearest, -1)


def _components(links: Ints, least: float) -> Iterator[Ints]:
    """Saddles that are linked with each other, the largest set first."""
    one, direction = np.nonzero(links >= 0)
    graph = coo_array((np.ones(len(one)), (one, links[one, direction])), shape=(len(links),) * 2)
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    for name in np.argsort(-sizes, kind="stable"):
        if sizes[name] < least:
            return
        yield np.flatnonzero(label == name)


def _grown(members: Ints, links: Ints, points: Floats) -> Floats:
    """(rows, columns, 2) the lattice that grows from the best linked member; NaN where it has no corner.

    Each saddle's directions are numbered in the same turn. So the direction from which it was reached says how its
    numbers are to be read.
    """
    middle = np.median(points[members], axis=0)
    support = (links[members] >= 0).sum(axis=1) - 1e-6 * np.linalg.norm(points[members] - middle, axis=1)
    seed = int(members[support.argmax()])
    place, turn = {seed: (0, 0)}, {seed: 0}
    taken = {(0, 0)}
    queue = deque([seed])
    while queue:
        one = queue.popleft()
        for local, other in enumerate(links[one].tolist()):
            direction = (local + turn[one]) % 4
            cell = (place[one][0] + int(_STEPS[direction, 0]), place[one][1] + int(_STEPS[direction, 1]))
            if other < 0 or other in place or cell in taken:
                continue
            back = links[other].tolist().index(one)
            place[other], turn[other] = cell, (direction + 2 - back) % 4
            taken.add(cell)
            queue.append(other)
    cells = np.array(list(place.values()))
    cells -= cells.min(axis=0)
    lattice = np.full((*(cells.max(axis=0)[::-1] + 1), 2), np.nan)
    lattice[cells[:, 1], cells[:, 0]] = points[list(place)]
    return lattice


def _filled(lattice: Floats, points: Floats) -> Floats:
    """The same lattice, a row wider all around as long as saddles lie where the next corners are due."""
    tree = cKDTree(points)
    for _ in range(4):
        wider = np.pad(lattice, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        due, step_px = _due(wider)
        empty = np.isnan(wider[..., 0]) & np.isfinite(due[..., 0])
        where = np.flatnonzero(empty)
        distance, nearest = (np.asarray(found) for found in tree.query(due.reshape(-1, 2)[where]))
        used = {tuple(point) for point in wider.reshape(-1, 2)[np.isfinite(wider[..., 0]).ravel()]}
        snapped = [
            (k, points[n])
            for k, d, n in zip(where, distance, nearest, strict=True)
            if d < SNAP * step_px.ravel()[k] and tuple(points[n]) not in used
        ]
        if not snapped:
            return lattice
        for k, point in snapped:
            wider.reshape(-1, 2)[k] = point
        lattice = _cropped(wider)
    return lattice


def _cropped(lattice: Floats) -> Floats:
    seen = np.isfinite(lattice[..., 0])
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    return lattice[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _due(lattice: Floats) -> tuple[Floats, Floats]:
    """Where each corner is due by its neighbours in a line (mean of the guesses), and the shortest step there."""
    guesses, steps = [], []
    padded = np.pad(lattice, ((2, 2), (2, 2), (0, 0)), constant_values=np.nan)
    rows, columns = lattice.shape[:2]

    def at(right: int, down: int) -> Floats:
        return padded[2 + down : 2 + down + rows, 2 + right : 2 + right + columns]

    for right, down in _STEPS.tolist():
        guesses.append(2 * at(right, down) - at(2 * right, 2 * down))
        steps.append(np.linalg.norm(at(right, down) - at(2 * right, 2 * down), axis=-1))
    for right, down in ((1, 0), (0, 1)):
        guesses.append((at(right, down) + at(-right, -down)) / 2)
        steps.append(np.linalg.norm(at(right, down) - at(-right, -down), axis=-1) / 2)
    stacked, known = np.array(guesses), np.isfinite(np.array(guesses)[..., :1])
    mean = np.where(known, stacked, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    due = np.where(known.any(axis=0), mean, np.nan)
    return due, np.nan_to_num(np.array(steps), nan=np.inf).min(axis=0)


def _windows(lattice: Floats, size: tuple[int, int]) -> Iterator[tuple[int, Floats]]:
    """Parts of the lattice of the board's size, either way round, with how many corners were seen in each."""
    for turned, (columns, rows) in ((False, size), (True, size[::-1])):
        if turned and columns == rows:
            return
        short = np.maximum(0, [rows - lattice.shape[0], columns - lattice.shape[1]])
        padded = np.pad(lattice, ((short[0],) * 2, (short[1],) * 2, (0, 0)), constant_values=np.nan)
        seen = np.isfinite(padded[..., 0])
        windows = np.lib.stride_tricks.sliding_window_view(seen, (rows, columns)).sum(axis=(-2, -1))
        best = windows.max()
        if best < LEAST_SEEN * rows * columns:
            continue
        for row, column in np.argwhere(windows == best)[:2]:
            grid = _complete(padded[row : row + rows, column : column + columns])
            if grid is not None:
                yield int(best), grid.transpose(1, 0, 2) if turned else grid


def _complete(grid: Floats) -> Floats | None:
    """The grid with every corner, those not seen where their neighbours have them; None where that never ends."""
    for _ in range(sum(grid.shape[:2])):
        missing = np.isnan(grid[..., 0])
        if not missing.any():
            return grid
        due, _ = _due(grid)
        grid = np.where(missing[..., None], due, grid)
    return None
