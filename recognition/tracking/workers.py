"""Workers: how they move, which detections are theirs, and what is known of them afterwards."""

from __future__ import annotations

import numpy as np

from recognition.association.claims import claim
from recognition.association.leftovers import group
from recognition.observed import Detected
from recognition.optics import Optics
from recognition.tracking.body import TORSO, Limbs, carry, hold
from recognition.tracking.meeting import Search, met
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import Population
from recognition.triangulation.fusion import Fused
from rigcal.geometry import Bools, Floats, Ints

MIN_SHARED = 3
"""Joints that two sights of a worker must share."""
DENSITY = np.array([1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 5, 5, 12, 12, 1.5, 1.5, 4, 4, 8, 8], dtype=np.float64)
"""(17,) of the white acceleration of joints, m^2/s^3: in a second the trunk's velocity changes by 1.2 m/s, a wrist's by
3.5 m/s. With half of these, parts right of six simulated rigs from 5 to 60 instants a second differ by 0.2 %."""
UNKNOWN_M, UNKNOWN_M_PER_S = 0.5, 1.0
"""Standard deviations of a joint that was never seen: of its place around the middle of the others, and its speed."""
MAX_PAIR_VAR = 1.0
"""m^2; rays that place a joint with a larger variance do not pair two sights of a worker."""
SURE_VAR = 0.08**2
"""m^2; where all workers are better known, it does not matter along which direction they are known worse."""
_TRUNK = np.where(np.isin(np.arange(17), TORSO), 1.0, 1e-3)


def velocities(workers: Population) -> Floats:
    """(T, 3) of the trunks; of whatever is known where no joint of the trunk is."""
    weight: Floats = np.multiply(workers.known, _TRUNK)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-9)
    return np.asarray((weight[:, None] @ workers.motion.state.reshape(-1, 17, 6))[:, 0, 3:])


def find(
    optics: Optics, workers: Population, people: Detected, options: FollowOptions, t_ns: int
) -> tuple[Population, Ints]:
    """Predicted workers with the new ones, and the rows of the people (T, V) who are theirs."""
    variance, place = workers.variance, workers.place_m
    middle = _median(variance, workers.known)
    sure = middle < options.confident_m**2
    (named,) = workers.track_id.nonzero()
    across = None
    if (middle[named] > SURE_VAR).any():
        across = _across(optics, workers, named)
        across = np.where(across * middle[named] < options.confident_m**2, np.maximum(across, 1e-3), 0.0)
    claims = claim(
        optics, people, place[named], variance[named], workers.known[named], workers.label[named], across=across,
        min_shared=MIN_SHARED, max_sigmas=options.claim_sigmas,
    )  # fmt: skip
    doubtful = claims.beyond(options.group_sigmas)
    rows = np.where(doubtful & people.hint[claims.rows], -1, claims.rows)
    own = sure[named, None] & ~doubtful
    members, held = np.full((2, len(sure), optics.views), -1)
    members[named], held[named] = np.where(own, rows, -1), np.where(own, -1, rows)
    free = np.ones(people.count + 1, dtype=np.bool_)
    free[members] = False
    groups = group(
        optics, people, np.flatnonzero(free[:-1]), min_shared=MIN_SHARED, max_sigmas=options.group_sigmas,
        max_parallax_var=MAX_PAIR_VAR,
    )  # fmt: skip
    search = Search(options.worker_jump_m, options.search_m_per_s, options.search_most_m, options.apart_m)
    label = np.zeros(len(groups.members), dtype=np.int64)
    return met(workers, members, held, groups, label, ~sure, search, t_ns)


def _across(optics: Optics, workers: Population, rows: Ints) -> Floats:
    """(V, T) variance of workers' places across the rays of each camera, over the mean of all directions."""
    weight = workers.known[rows] / np.maximum(workers.known[rows].sum(axis=1, keepdims=True), 1)
    covariance = workers.motion.covariance.reshape(-1, 17, 36)[rows]
    mean = (weight[:, None] @ covariance).reshape(-1, 6, 6)[:, :3, :3]
    ray = (weight[:, None] @ workers.place_m[rows])[:, 0] - optics.centre_m[:, None]
    along = ((ray[..., None, :] @ mean)[..., 0, :] * ray).sum(axis=-1) / np.maximum((ray * ray).sum(axis=-1), 1e-9)
    whole = np.maximum(mean[:, 0, 0] + mean[:, 1, 1] + mean[:, 2, 2], 1e-12)
    return np.asarray(1.5 * (1.0 - along / whole))


def _median(variance: Floats, known: Bools) -> Floats:
    """(T,) of the variances of the known joints."""
    ordered = np.sort(np.where(known, variance, np.inf), axis=1)
    return np.asarray(ordered[np.arange(len(known)), np.maximum(known.sum(axis=1) - 1, 0) // 2])


def settled(before: Population, fused: Fused, limbs: Limbs, firm: Bools, t_ns: int) -> tuple[Population, Limbs]:
    """Workers and lengths after the update; ``firm`` (T,) says whom a camera sees for sure.

    What hints alone show does not count as placed: a raised arm that a network takes for somebody was told for twelve
    instants where it did, and for five since.
    """
    shape = before.known.shape
    views = fused.views.reshape(shape)
    seen, sure = views > 0, views >= 2
    known = before.known | sure
    carry(fused.motion.state.reshape(*shape, 6), before.place_m, seen, before.known)
    limbs = hold(fused.motion, known, sure, limbs.extended(len(known)))
    evidence = before.evidence
    if not before.track_id.all():
        evidence = evidence + np.where(before.track_id == 0, np.maximum(views - 1, 0).sum(axis=1), 0)
    after = Population(
        before.track_id, before.label, evidence,
        np.where(firm & (sure.sum(axis=1) >= MIN_SHARED), t_ns, before.placed_ns),
        np.where(seen, t_ns, before.seen_ns), known, fused.motion,
    )  # fmt: skip
    return after, limbs
