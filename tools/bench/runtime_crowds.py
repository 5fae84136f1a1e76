"""What tracks are worth in crowds: workers who cross each other's paths before cameras that now and then miss them.

Beside each method stands the same code given the true association: it gets the detections of one worker at a time, so
that there is nobody to confuse it with. What it loses, the detections did not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from recognition.metrics import Scores, score
from recognition.observations import Instant, Scene
from recognition.placing import Placer, PlacingOptions
from recognition.poses import Poses
from recognition.synthetic_crowds import Crowd, crowd
from rigcal.rig import Rig

Line = Mapping[str, Any]
METHODS = ("tracked", "paper")
SECONDS, FPS = 60.0, 30.0
SEEDS = {4: (0, 1, 2), 8: (5, 6)}
"""For each number of workers; 12 and 16 minutes of a worker."""


def placer_of(rig: Rig, method: str) -> Callable[[Instant], Scene | None]:
    """What turns an instant into a scene, at its beginning."""
    return Placer(rig, PlacingOptions(method=method)).place


def crowds() -> Iterator[Line]:
    """Four and eight workers: joints missing 20 % and bursts of 0.5 to 2 s, 3 px noise, 5 % false people, 4 views."""
    for workers, seeds in SEEDS.items():
        found: dict[str, list[tuple[Scores, Scores]]] = {method: [] for method in METHODS}
        for seed in seeds:
            people = crowd(workers, seconds=SECONDS, seed=seed, fps=FPS)
            for method in METHODS:
                found[method].append((tracked(people, method), given_the_association(people, method)))
        for method in METHODS:
            yield {"name": f"runtime.crowds.{workers}workers.{method}"} | _line(found[method], workers)


def tracked(people: Crowd, method: str) -> Scores:
    """The method on all that the cameras report."""
    return score(people.truth, _poses(people, method, people.instants), period_s=1 / FPS)


def given_the_association(people: Crowd, method: str) -> Scores:
    """The method on each worker's own detections."""
    workers = range(people.site.joints_in_world_m.shape[1])
    own = [_poses(people, method, people.alone(worker)) for worker in workers]
    poses = Poses(
        frame=np.concatenate([each.frame for each in own]),
        t_ns=np.concatenate([each.t_ns for each in own]),
        track_id=np.concatenate([each.track_id * len(own) + worker for worker, each in zip(workers, own, strict=True)]),
        joints_m=np.concatenate([each.joints_m for each in own]),
        views=np.concatenate([each.views for each in own]),
    )
    return score(people.truth, poses, period_s=1 / FPS)


def _poses(people: Crowd, method: str, instants: Sequence[Instant]) -> Poses:
    rig = people.site.rig
    place = placer_of(rig, method)
    return Poses.of([scene for instant in instants if (scene := place(instant))], rig.world_from_rig)


def _line(found: Sequence[tuple[Scores, Scores]], workers: int) -> dict[str, Any]:
    ours, given = [one for one, _ in found], [other for _, other in found]
    minutes = len(found) * workers * SECONDS / 60

    def mean(scores: Sequence[Scores], name: str) -> float:
        return float(np.mean([getattr(one, name) for one in scores]))

    pcp, given_pcp = (100 * mean(scores, "pcp3d") for scores in (ours, given))
    return {
        "worker_minutes": minutes,
        "pcp3d_percent": pcp,
        "given_association_pcp3d_percent": given_pcp,
        "behind_points": given_pcp - pcp,
        "idf1_percent": 100 * mean(ours, "idf1"),
        "switches_per_worker_minute": sum(one.switches for one in ours) / minutes,
        "mpjpe_mm": 1e3 * mean(ours, "mpjpe_m"),
        "given_association_mpjpe_mm": 1e3 * mean(given, "mpjpe_m"),
        "recall_percent": 100 * mean(ours, "recall"),
        "precision_percent": 100 * mean(ours, "precision"),
        "joints_found_percent": 100 * mean(ours, "joints_found"),
    }
