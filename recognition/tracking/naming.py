"""Which keypoint of an object is which in every view, where each view names them as they lie in its own image.

Any two views, each name of the one matched with each order of the other, place the keypoints in 3D: guesses, to which
the keypoints of the track are added. Every view takes the order of its names in which it sees a guess best, and the
guess that all views together see best wins. Its names are then brought to those of the track, which so never change.

Views are compared by angles, robustly (Geman and McClure): a view that is far off agrees with nothing and decides
nothing, and a keypoint that is not seen takes no part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from recognition.keypoints import KEYPOINTS_OF
from recognition.observed import KEYPOINTS, Detected
from recognition.optics import MIN_PARALLAX_RAD, NEAREST_M, Optics, midpoints, pairs
from recognition.tracking.population import Population
from rigcal.geometry import Bools, Floats, Ints

ORDERS = 4
"""In the largest group of symmetries; a smaller one repeats its first."""
GUESSING = 4
"""So many views make guesses, those that see most keypoints; all of them judge."""
COARSE = 4.0
"""A keypoint whose squared distance is this many times the variance of its box's middle agrees by half."""
SURE = 0.5
"""Where views agree with the keypoints of the track by this share of what they see, nothing else is considered; from
0.35 to 0.6 the keypoints of three rendered runs are alike."""
KEPT = 1.25
"""By what the agreement with the track counts more than that with other guesses."""
NEAR_M = 0.3
"""Keypoints this far from the track's agree with their names by half."""


def named(optics: Optics, boxes: Detected, rows: Ints, things: Population, classes: Sequence[str]) -> Detected:
    """The same boxes, the keypoints of those that belong to an object in the order of that object.

    Args:
        optics: Of the rig.
        boxes: Of all views, with keypoints or without.
        rows: (K, V) which of them are each object's, -1 where none.
        things: K objects, predicted; with keypoints where the boxes have them.
        classes: Names of the classes, by number.
    """
    if boxes.seen.shape[1] == 1:
        return boxes
    orders, symmetric = _orders(tuple(classes))
    (several,) = (symmetric[things.label] & boxes.seen[rows, 1:].any(axis=(1, 2))).nonzero()
    if not len(several):
        return boxes
    rows, orders = rows[several], orders[things.label[several]]
    own_m, known = things.place_m[several, 1:], things.known[several, 1:]
    views = _Views.of(boxes, rows, orders)
    agreement = views.agreement(optics, own_m[:, None], known[:, None])[:, :, 0]
    index = orders[np.arange(len(several))[:, None], agreement.argmax(axis=2).T]
    doubtful = agreement.max(axis=2).sum(axis=0) < SURE * views.seen[:, :, 0].sum(axis=(0, 2))
    if doubtful.any():
        index[doubtful] = _guessed(optics, views.only(doubtful), own_m[doubtful], known[doubtful], orders[doubtful])
    return _reordered(boxes, rows, index)


def _guessed(optics: Optics, views: _Views, own_m: Floats, known: Bools, orders: Ints) -> Ints:
    """(K, V, 4) which keypoint of each view is which of the track's, by the guess that the views see best."""
    guess_m, given = views.guesses(optics)
    guess_m, given = np.concatenate([own_m[:, None], guess_m], axis=1), np.concatenate([known[:, None], given], axis=1)
    agreement = views.agreement(optics, guess_m, given)
    whole = agreement.max(axis=3).sum(axis=0)
    whole[:, 0] *= KEPT
    each, best = np.arange(len(orders)), whole.argmax(axis=1)
    order = _brought(guess_m[each, best], given[each, best], own_m, known, orders)
    chosen = agreement[:, each, best].argmax(axis=2).T
    return np.asarray(orders[each[:, None, None], chosen[..., None], order[:, None]])


@dataclass(frozen=True, slots=True, eq=False)
class _Views:
    """What V views saw of K objects in G orders of their keypoints."""

    xy: Floats
    """(2, V, K, G, 4) normalised."""
    seen: Bools
    """(V, K, G, 4)"""
    variance: Floats
    """(V, K) rad^2, of every keypoint alike."""

    @classmethod
    def of(cls, boxes: Detected, rows: Ints, orders: Ints) -> _Views:
        at = rows.T[..., None, None], 1 + orders[None]
        return cls(boxes.factors[1:3, *at], boxes.seen[at], boxes.angle_var[rows.T, 1])

    def only(self, chosen: Bools) -> _Views:
        """Of some of the objects."""
        return _Views(self.xy[:, :, chosen], self.seen[:, chosen], self.variance[:, chosen])

    def guesses(self, optics: Optics) -> tuple[Floats, Bools]:
        """Places (K, H, 4, 3) by two views each, and which of them are any."""
        _, views, count, orders, _ = self.xy.shape
        most = np.argsort(-self.seen[:, :, 0].sum(axis=2), axis=0, kind="stable")[:GUESSING]
        first, second = (most[chosen] for chosen in pairs(len(most)))
        rays = optics.rays(self.xy.reshape(2, views, -1).transpose(1, 2, 0), np.arange(views))
        rays = rays.reshape(*self.seen.shape, 3)
        each, centre_m = np.arange(count), optics.centre_m[:, None, None]
        place, parallax = midpoints(centre_m[first], rays[first, each][:, :, :1], centre_m[second], rays[second, each])
        given = self.seen[first, each][:, :, :1] & self.seen[second, each] & (parallax > MIN_PARALLAX_RAD)
        shape = count, len(first) * orders, KEYPOINTS
        return place.swapaxes(0, 1).reshape(*shape, 3), given.swapaxes(0, 1).reshape(shape)

    def agreement(self, optics: Optics, guess_m: Floats, given: Bools) -> Floats:
        """(V, K, H, G) how many keypoints each view sees where a guess (K, H, 4, 3) has them, in each order."""
        in_cam = optics.in_cameras(guess_m.reshape(-1, 3)).reshape(3, optics.views, *given.shape)[:, :, :, :, None]
        depth = np.maximum(in_cam[2], NEAREST_M)
        away = in_cam[:2] / depth - self.xy[:, :, :, None]
        trust = 1.0 / (1.0 + (away * away).sum(axis=0) / (COARSE * self.variance[..., None, None, None]))
        trust *= self.seen[:, :, None] & given[:, :, None] & (in_cam[2] > NEAREST_M)
        return np.asarray(trust.sum(axis=-1))


def _brought(guess_m: Floats, given: Bools, own_m: Floats, known: Bools, orders: Ints) -> Ints:
    """(K, 4) the order in which the keypoints (K, 4, 3) of a guess are nearest to the track's own."""
    each = np.arange(len(orders))[:, None, None]
    away = guess_m[each, orders] - own_m[:, None]
    near = (given[each, orders] & known[:, None]) / (1.0 + (away * away).sum(axis=-1) / NEAR_M**2)
    return np.asarray(orders[each[:, 0, 0], near.sum(axis=-1).argmax(axis=1)])


def _reordered(boxes: Detected, rows: Ints, index: Ints) -> Detected:
    """Boxes of which rows (K, V) have their keypoints, which are all as uncertain, in the order ``index`` (K, V, 4)."""
    theirs = rows >= 0
    order = np.tile(np.arange(1 + KEYPOINTS), (len(boxes.seen), 1))
    order[rows[theirs], 1:] = 1 + index[theirs]
    row = np.arange(len(order))[:, None]
    return replace(boxes, factors=boxes.factors[:, row, order], seen=boxes.seen[row, order])


@lru_cache(maxsize=32)
def _orders(classes: tuple[str, ...]) -> tuple[Ints, Bools]:
    """(L, G, 4) orders of the keypoints of each class, and (L,) which have several; read-only, since they are kept."""
    orders = np.tile(np.arange(KEYPOINTS), (len(classes), ORDERS, 1))
    for row, name in zip(orders, classes, strict=True):
        if name in KEYPOINTS_OF:
            symmetries = KEYPOINTS_OF[name].symmetries
            row[: len(symmetries), : len(symmetries[0])] = symmetries
    symmetric: Bools = np.asarray((orders != orders[:, :1]).any(axis=(1, 2)))
    orders.setflags(write=False)
    symmetric.setflags(write=False)
    return orders, symmetric
