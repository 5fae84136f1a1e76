"""One error, one seed, one sequence: from the world to decisions, through the real placing and the real rules."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi, sqrt

import numpy as np

from recognition.evaluation.violations import KINDS, SceneTruth, alarms_of, confusions, held, outside_transitions
from recognition.observations import FrameSet, Instant, Scene, WorkerTrack
from recognition.placing import Placer
from recognition.rules import Judge, RuleSet
from rigcal.geometry import Bools, Floats, Ints
from rigcal.rig import Rig
from tools.study.detector import Views, open_reports, seen_reports, with_joints
from tools.study.exact import exact_views
from tools.study.faults import Injected, injected
from tools.study.measured import MeasuredDetector
from tools.study.world import World

_MEAN = sqrt(8 / pi)
"""Mean distance of a point that is off along three axes, in standard deviations."""
_NOISE, _FAULT, _JOINTS = range(3)
_KEPT = 32
"""Worlds of which what a detector reports is kept: calibrations that are wrong see what right ones see."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What is tried."""

    axis: str
    level: float
    detector: str
    """``open``, ``seen`` or ``measured``."""
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """What is decided of a sequence."""

    violated: Bools
    """(F, K) of each violation at each instant."""
    unknown: Bools
    """(F, K) whether it is not decided, and unknown of somebody or something."""


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """What was decided of a sequence, counted."""

    counts: Ints
    """(K, 4) confusion matrices outside of transitions."""
    unknown: Ints
    """(K,) instants outside of transitions at which the violation was unknown."""
    false_alarms: Ints
    """(K,)"""
    safe_s: Floats
    """(K,) how long each violation did not last."""


def decided(world: World, trial: Trial, measured: MeasuredDetector, rules: RuleSet) -> Decided:
    """What is decided of a sequence in which something is wrong."""
    wrong = injected(trial.axis, trial.level, world, fault_rng(world, trial))
    reports = _reports(world, trial.detector, trial.seed, tuple(wrong.late_s.tolist()), wrong.pixel, measured)
    if len(wrong.joints) < 17:
        reports = tuple(with_joints(iter(reports), wrong.joints))
    placed = jittered(_placed(world, reports, wrong.rig), wrong, _rng(world, trial.seed, _JOINTS))
    return judged(world.truth, placed, rules, wrong.rig)


def judged(truth: SceneTruth, scenes: Iterator[Scene], rules: RuleSet, rig: Rig) -> Decided:
    """What rules decide of scenes."""
    judge, active, unknown = Judge(rules, rig), [], []
    for scene in scenes:
        verdicts = judge.judge(scene).verdicts
        lasting = {verdict.rule for verdict in verdicts if verdict.is_active}
        open_ones = {verdict.rule for verdict in verdicts if verdict.truth is None} - lasting
        active.append((scene.t_ns, [kind in lasting for kind in KINDS]))
        unknown.append((scene.t_ns, [kind in open_ones for kind in KINDS]))
    return Decided(held(truth, iter(active)), held(truth, iter(unknown)))


def tally(truth: SceneTruth, found: Decided) -> Tally:
    """Count what was decided of a sequence."""
    alarms = [alarms_of([truth], [found.violated[None]], kind) for kind in range(len(KINDS))]
    return Tally(
        confusions([truth], [found.violated[None]], outside_transitions)[0],
        np.asarray((found.unknown & outside_transitions(truth)).sum(axis=0)),
        np.array([own.false_alarms for own in alarms]),
        np.array([own.safe_s for own in alarms]),
    )


def fault_rng(world: World, trial: Trial) -> np.random.Generator:
    """What the direction of an error is drawn from: the same at all levels."""
    return _rng(world, trial.seed, _FAULT)


@lru_cache(maxsize=_KEPT)
def _reports(
    world: World, detector: str, seed: int, late_s: tuple[float, ...], pixel: float, measured: MeasuredDetector
) -> tuple[Views, ...]:
    exact, rng = exact_views(world, late_s), _rng(world, seed, _NOISE)
    if detector == "open":
        return tuple(open_reports(world, exact, rng, pixel))
    if detector == "seen":
        return tuple(seen_reports(world, exact))
    return tuple(measured.reports(world, exact, rng))


def _placed(world: World, reports: Sequence[Views], rig: Rig) -> Iterator[Scene]:
    placer, cameras = Placer(rig), (None,) * len(rig.cameras)
    for frame, (t_ns, views) in enumerate(zip(world.truth.t_ns.tolist(), reports, strict=True)):
        scene = placer.place(Instant(FrameSet(frame, t_ns, cameras), views))
        if scene is not None:
            yield scene


def jittered(scenes: Iterator[Scene], wrong: Injected, rng: np.random.Generator) -> Iterator[Scene]:
    """The scenes with the workers' joints moved by so much, in the mean."""
    kept: dict[int, Floats] = {}
    for scene in scenes:
        if not wrong.joint_m:
            yield scene
            continue
        workers = tuple(_moved(worker, wrong, rng, kept) for worker in scene.workers)
        yield replace(scene, workers=workers)


def _moved(worker: WorkerTrack, wrong: Injected, rng: np.random.Generator, kept: dict[int, Floats]) -> WorkerTrack:
    draw = rng.standard_normal((17, 3)) * wrong.joint_m / _MEAN
    offset = kept.setdefault(worker.track_id, draw) if wrong.joint_held else draw
    return replace(worker, joints_m=worker.joints_m + offset)


def _rng(world: World, seed: int, part: int) -> np.random.Generator:
    """The same for all levels and kinds of a seed and sequence, so that only the error differs."""
    return np.random.default_rng((seed, zlib.crc32(world.truth.name.encode()), part))
