"""Objects: which boxes are theirs, what is known of them afterwards, and hats by the heads of those who wear them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recognition.association.claims import claim
from recognition.association.leftovers import Leftovers, group
from recognition.observed import KEYPOINTS, Detected
from recognition.optics import Optics
from recognition.tracking.body import HEAD, TORSO
from recognition.tracking.meeting import Search, met
from recognition.tracking.options import FollowOptions
from recognition.tracking.population import LONG_AGO_NS, Population
from recognition.triangulation.fusion import Fused, Motion, Sights
from recognition.triangulation.scatter import scatter
from rigcal.geometry import Bools, Floats, Ints

DENSITY = 1.0
"""Of the white acceleration of objects, m^2/s^3."""
HAT_UP_M, HAT_SIGMA_M = 0.12, 0.10
"""How far above the middle of nose, eyes and ears the middle of a hat is, along the body, and the deviation of that."""
WORN_M = 0.3
"""A hat nearer than this to where a worker's hat would be is that worker's."""
WEARING_VIEWS = 2
"""A hat that one camera sees on a head is placed by that head where no more cameras than this see the head with room
for a hat in their images; else the others outvote it, unless it is sure. That one of two sees it is a draw, which
rules can tell by ``visible(o)``. On 12 validation sequences of SICSG no_hat has false alarms in three with 1, in one
with 2, 3 and 4; with 3 and 4 a violation of four seconds is missed, where dark hair passes for a hat in one camera of
three."""
SURE_SCORE = 0.7
"""A hat that one camera sees so surely is placed by the head in any case, and is for rules neither there nor not there.
Of heads whose hat is seen 85 % have one of this score in 17 validation sequences of SICSG, of bare heads 6 %. Without,
somebody behind a window whose frame hides the hat from two cameras of three has none for three seconds of one of 25
sequences; F1 of no_hat is 0.92 with it and 0.90 without, 6 and 19 safe instants are called violations."""
WORN_EVIDENCE = 6
"""What a head says for a hat on it, in the unit of :attr:`~FollowOptions.start_object`: a hat is told at once."""
UNKNOWN_M, UNKNOWN_M_PER_S = 0.7, 0.3
"""Standard deviations of a keypoint that was never seen: of its place around the object's middle, and its speed."""
MAX_PAIR_VAR = 1.0
"""m^2; rays that place a box's middle with a larger variance do not pair two boxes."""
KEYPOINT_SHARE = 3.0
"""The variance of a keypoint that is the same at every instant, over that of the middle of its box: 0.07 of the box's
diagonal along each axis. In three rendered runs before the bundled networks keypoints are 0.1 of it off (the median of
23 views of objects), always to the same side."""
_HEAD_AND_TRUNK = np.array([[float(joint in part) for joint in range(17)] for part in (HEAD, TORSO)])


@dataclass(frozen=True, slots=True, eq=False)
class Heads:
    """Where H workers have their heads, and would have their hats."""

    track_id: Ints
    """(H,)"""
    middle_m: Floats
    """(H, 3) of the known joints of the head."""
    hat_m: Floats
    """(H, 3)"""
    variance: Floats
    """(H,) of each coordinate of the middle, m^2."""
    rows: Ints
    """(H,) of the workers,"""
    share: Floats
    """and (H, 1, 17) of their joints in the middle."""
    views: Ints
    """(H,) how many cameras see it now and would see a hat on it, which their image holds."""

    @classmethod
    def of(cls, optics: Optics, workers: Population, who: Detected, theirs: Ints) -> Heads:
        """Of the workers with an identity whose head is known, and the rows (T, V) of their detections."""
        weight = workers.known[:, None] * _HEAD_AND_TRUNK
        count = weight.sum(axis=2)
        (rows,) = ((workers.track_id > 0) & (count[:, 0] > 0)).nonzero()
        weight = weight[rows] / np.maximum(count[rows], 1.0)[..., None]
        middles = weight @ workers.place_m[rows]
        head = middles[:, 0]
        up = head - middles[:, 1]
        up *= HAT_UP_M / np.maximum(np.sqrt((up * up).sum(axis=1, keepdims=True)), 1e-6)
        share = weight[:, :1]
        variance = (share @ workers.variance[rows][..., None])[:, 0, 0]
        hat = head + up
        views = who.seen[theirs[rows]][:, :, list(HEAD)].any(axis=2) & optics.in_images(hat, HAT_UP_M).T
        return cls(workers.track_id[rows], head, hat, variance, rows, share, views.sum(axis=1))

    def at(self, workers: Population) -> Heads:
        """The same heads where the same workers have them now."""
        middle_m = (self.share @ workers.place_m[self.rows])[:, 0]
        hat_m = middle_m + (self.hat_m - self.middle_m)
        return replace(self, middle_m=middle_m, hat_m=hat_m)


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """K objects, and who wears them."""

    population: Population
    owner: Ints
    """(K,) identifier of the worker who wears it, 0 for none."""
    offset_m: Floats
    """(K, 3) from the middle of that worker's head."""
    scatter_m2: Floats
    """(K, 4) variance of each coordinate of the keypoints that no filter reduces, when views last told; infinite before
    they did, and where they disagreed."""

    @classmethod
    def none(cls) -> Things:
        """No object."""
        return cls.new(Population.none(1))

    @classmethod
    def new(cls, population: Population) -> Things:
        """Objects that nobody wears, and of whose keypoints nothing is known."""
        count = len(population.known)
        owner = np.zeros(count, dtype=np.int64)
        return cls(population, owner, np.zeros((count, 3)), np.full((count, KEYPOINTS), np.inf))

    def rows(self, chosen: Bools) -> Things:
        """Some of the objects."""
        return Things(self.population.rows(chosen), self.owner[chosen], self.offset_m[chosen], self.scatter_m2[chosen])

    def of(self, population: Population) -> Things:
        """The same objects in other places."""
        return Things(population, self.owner, self.offset_m, self.scatter_m2)

    def with_keypoints(self) -> Things:
        """With the keypoints beside the middles, unknown until seen."""
        middle = self.population
        if middle.points > 1:
            return self
        count = len(middle.known)
        place = np.full((count, 1 + KEYPOINTS, 3), np.nan)
        place[:, 0] = middle.motion.state[:, :3]
        wide = Population.at(place, middle.label)
        wide.motion.state[:: 1 + KEYPOINTS] = middle.motion.state
        wide.motion.covariance[:: 1 + KEYPOINTS] = middle.motion.covariance
        seen_ns = np.full((count, 1 + KEYPOINTS), LONG_AGO_NS)
        seen_ns[:, 0] = middle.seen_ns[:, 0]
        return self.of(
            Population(
                middle.track_id, middle.label, middle.evidence, middle.placed_ns, seen_ns, wide.known,
                Motion.of(wide.motion.state, wide.motion.covariance),
            )
        )  # fmt: skip


def wear(things: Things, heads: Heads) -> None:
    """Put predicted objects that are worn where the predicted heads are, and as surely as those, in place."""
    (worn,) = things.owner.nonzero()
    if not (len(worn) and len(heads.track_id)):
        return
    same = things.owner[worn, None] == heads.track_id
    head, there = same.argmax(axis=1), same.any(axis=1)
    rows, head, motion = worn[there] * things.population.points, head[there], things.population.motion
    motion.state[rows, :3] = heads.middle_m[head] + things.offset_m[worn[there]]
    variance = heads.variance[head] + HAT_SIGMA_M**2
    vague = motion.variance[rows] > variance
    rows, variance = rows[vague], variance[vague]
    motion.covariance[rows, :3, :] = motion.covariance[rows, :, :3] = 0.0
    motion.covariance[rows, :3, :3] = variance[:, None, None] * np.eye(3)
    motion.variance[rows] = variance


def find(
    optics: Optics, things: Things, heads: Heads, boxes: Detected, worn: Ints, options: FollowOptions, t_ns: int
) -> tuple[Things, Ints]:
    """Predicted objects with the new ones, and the rows of the boxes (K, V) that are theirs."""
    population, middles = things.population, boxes.points(1)
    variance = population.variance[:, 0]
    (named,) = ((population.track_id > 0) & ~_spare(things)).nonzero()
    place, doubt, label = population.place_m[named, :1], variance[named, None], population.label[named]
    (bare,) = (heads.track_id[:, None] != things.owner[named]).all(axis=1).nonzero()
    hats = np.tile(heads.hat_m[bare], (len(worn), 1))[:, None]
    if len(hats):
        place = np.concatenate([place, hats])
        doubt = np.concatenate([doubt, np.tile(heads.variance[bare] + HAT_SIGMA_M**2, len(worn))[:, None]])
        label = np.concatenate([label, np.repeat(worn, len(bare))])
    claims = claim(
        optics, middles, place, doubt, np.ones(doubt.shape, dtype=np.bool_), label, min_shared=1,
        max_sigmas=options.thing_sigmas,
    ).rows  # fmt: skip
    members = np.full((len(variance), optics.views), -1)
    members[named] = claims[: len(named)]
    by_head = claims[len(named) :]
    (several,) = ((by_head >= 0).sum(axis=1) >= 2).nonzero()
    free = np.ones(boxes.count + 1, dtype=np.bool_)
    free[members] = False
    free[by_head[several]] = False
    groups = group(
        optics, middles, np.flatnonzero(free[:-1]), min_shared=1, max_sigmas=options.thing_sigmas,
        max_parallax_var=MAX_PAIR_VAR,
    )  # fmt: skip
    free[groups.members] = False
    few = np.tile(heads.views[bare] <= WEARING_VIEWS, len(worn)) | (boxes.score[by_head] >= SURE_SCORE).any(axis=1)
    (single,) = (few & ((by_head >= 0).sum(axis=1) == 1) & free[by_head].any(axis=1)).nonzero()
    new_place = np.full((len(several) + len(groups.members) + len(single), population.points, 3), np.nan)
    new_place[:, :1] = np.concatenate([hats[several], groups.place_m, hats[single]])
    found = Leftovers(np.concatenate([by_head[several], groups.members, by_head[single]]), new_place)
    search = Search(options.object_jump_m, options.search_m_per_s, options.search_most_m, options.object_apart_m)
    label = boxes.label[found.members.max(axis=1)]
    lost, nothing = variance > options.confident_m**2, np.full_like(members, -1)
    population, members = met(population, members, nothing, found, label, lost, search, t_ns)
    more = len(population.known) - len(things.owner)
    if more:
        new = Things.new(population.rows(np.arange(-more, 0)))
        things = Things(
            population,
            np.concatenate([things.owner, new.owner]),
            np.concatenate([things.offset_m, new.offset_m]),
            np.concatenate([things.scatter_m2, new.scatter_m2]),
        )
    return things.of(population), members


def _spare(things: Things) -> Bools:
    """(K,) hats of a head that has another hat, which cameras placed later: they go where the head goes, and would
    claim the hats of whoever stands behind it."""
    placed_ns, owner = things.population.placed_ns, things.owner
    later = placed_ns > placed_ns[:, None]
    return np.asarray(((owner == owner[:, None]) & later).any(axis=1) & (owner > 0))


def scattered(optics: Optics, things: Things, fused: Fused, sights: Sights) -> Things:
    """Objects with what their views tell now of how far their keypoints may be from the truth.

    Args:
        optics: Of the rig.
        things: Before the update.
        fused: The update of their points.
        sights: What was seen of them.
    """
    known = things.population.known
    if things.population.points == 1:
        return things
    told = scatter(optics, fused, sights, KEYPOINT_SHARE).reshape(known.shape)[:, 1:]
    return replace(things, scatter_m2=np.where(np.isnan(told), things.scatter_m2, told))


def settled(things: Things, fused: Fused, heads: Heads, worn: Ints, sure: Bools, t_ns: int) -> Things:
    """Objects after the update; ``sure`` (K,) are those of which a camera is."""
    before = things.population
    views = fused.views.reshape(before.known.shape)
    owner, offset_m = _worn(before.moved(fused.motion), things, heads, worn, views[:, 0] > 0)
    on_head = owner[:, None] == heads.track_id
    enough = np.where((on_head & ((heads.views <= WEARING_VIEWS) | sure[:, None])).any(axis=1), 1, 2)
    placed = views[:, 0] >= enough
    seen_now = (views > 0) & (placed | ~on_head.any(axis=1))[:, None]
    evidence = before.evidence
    if not before.track_id.all():
        seen = np.where(placed, views[:, 0] - 1 + WORN_EVIDENCE * on_head.any(axis=1), 0)
        evidence = evidence + np.where(before.track_id == 0, seen, 0)
    after = Population(
        before.track_id, before.label, evidence, np.where(placed, t_ns, before.placed_ns),
        np.where(seen_now, t_ns, before.seen_ns), before.known | (views >= 2), fused.motion,
    )  # fmt: skip
    return Things(after, owner, offset_m, things.scatter_m2)


def _worn(population: Population, things: Things, heads: Heads, worn: Ints, seen: Bools) -> tuple[Ints, Floats]:
    """Who wears each object (K,), and where (K, 3); what is not seen stays with its owner."""
    (rows,) = (seen & (population.label[:, None] == worn).any(axis=1)).nonzero()
    if not (len(heads.track_id) and len(rows)):
        return things.owner, things.offset_m
    place = population.place_m[rows, 0]
    away = place[:, None] - heads.hat_m
    square = (away * away).sum(axis=-1)
    nearest = square.argmin(axis=1)
    on = square[np.arange(len(rows)), nearest] < WORN_M**2
    owner, offset_m = things.owner.copy(), things.offset_m.copy()
    owner[rows] = np.where(on, heads.track_id[nearest], 0)
    offset_m[rows] = place - heads.middle_m[nearest]
    return owner, offset_m
