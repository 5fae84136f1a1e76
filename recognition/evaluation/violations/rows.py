"""The rows of the evaluation: who decides, from which cameras, by which rules.

Every row sees the same detections of the same networks. ``frame`` and ``filtered`` are one camera; ``frame`` is the
paper's baseline, ``filtered`` the same with our durations and our holding of what is unknown. ``tracked`` is ours.
``paper`` is the paper's method reimplemented: greedy association, its tracking, its literal rules.

Decision: a decision at an instant is what the system had said by then, so that the time that a rule waits before it
raises counts against it. Dating events back to their first sign would flatter it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from recognition.errors import DatasetError
from recognition.evaluation.violations.flat import flat_judge, flat_scene, require_flat, single_frame_truth
from recognition.evaluation.violations.recorded import ObservedSequence
from recognition.evaluation.violations.truth import KINDS, SceneTruth
from recognition.monitoring import judged
from recognition.observations import FrameSet, Instant, Scene, ViewDetections
from recognition.placing import Placer, PlacingOptions
from recognition.rules import Judge, RuleSet
from recognition.rules.timing import Course, Durations
from rigcal.geometry import Bools, Pose
from rigcal.rig import Rig

Method = Literal["frame", "filtered", "tracked", "paper"]
Use = tuple[bool, ...]
"""(V,) which cameras are used."""


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules that are compared."""

    ours: RuleSet
    """What is meant."""
    paper: RuleSet
    """Equations 6 to 9 of the paper, literally."""

    def __post_init__(self) -> None:
        for rules in (self.ours, self.paper):
            lacking = [kind for kind in KINDS if kind not in {rule.name for rule in rules.rules}]
            if lacking:
                raise DatasetError(
                    "these rules do not say what the data set's truth is about",
                    where=rules.name,
                    expected=f"rules named {', '.join(KINDS)}",
                    got=f"none named {', '.join(lacking)}",
                    do_next="give a rule file with all four, such as site.rules.toml",
                )
        require_flat(self.paper)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    name: str
    """For JSON."""
    title: str
    method: Method
    uses: tuple[Use, ...]
    """Choices of cameras that are each judged on their own; all count."""


def rows_of(use: Use) -> tuple[Row, ...]:
    """The rows for these cameras: the first of them is the front view.

    Of two cameras or fewer the row of all pairs is left out, and of one camera all that need two.
    """
    used = [view for view, is_used in enumerate(use) if is_used]

    def only(*views: int) -> Use:
        return tuple(view in views for view in range(len(use)))

    rows = [
        Row("baseline", "baseline: front view, single frame", "frame", (only(used[0]),)),
        Row("one_view", "front view, our temporal filter", "filtered", (only(used[0]),)),
    ]
    pairs = tuple(only(*pair) for pair in combinations(used, 2))
    everything = (only(*used),)
    several = [("two_views", f"two views, all {len(pairs)} pairs", pairs)] if len(used) > 2 else []
    several += [("all_views", f"{len(used)} views", everything)] if len(used) > 1 else []
    rows += [Row(name, f"ours, {title}", "tracked", uses) for name, title, uses in several]
    rows += [Row(f"paper_{name}", f"paper's method, {title}", "paper", uses) for name, title, uses in several]
    return tuple(rows)


def decisions(row: Row, sequence: ObservedSequence, rules: Rules) -> Bools:
    """(U, F, K) what the row decides at each instant, for each choice of cameras."""
    method = {"frame": _single, "filtered": _single, "tracked": _placed, "paper": _placed}[row.method]
    return np.array([held(sequence.truth, method(row.method, sequence, rules, use)) for use in row.uses])


def held(truth: SceneTruth, said: Iterator[tuple[int, Sequence[bool]]]) -> Bools:
    """(F, K) the newest of what was said at times, at each instant: not later than half a period after it.

    Before anything was said nothing is violated.
    """
    times, values = [], [[False] * len(KINDS)]
    for t_ns, value in said:
        times.append(t_ns)
        values.append(list(value))
    until_ns = truth.t_ns + round(truth.period_s * 0.5e9)
    return np.array(values)[np.searchsorted(np.array(times, dtype=np.int64), until_ns, side="right")]


def seen_with(instants: Sequence[Instant], use: Use) -> Iterator[Instant]:
    """The instants as these cameras alone have them; without those in which none of them took part."""
    nothing = ViewDetections.empty()
    for instant in instants:
        times = tuple(t if used else None for t, used in zip(instant.frame_set.times_ns, use, strict=True))
        known = [t for t in times if t is not None]
        if not known:
            continue
        t_ns = known[0] + round(sum(t - known[0] for t in known) / len(known))
        frame_set = FrameSet(instant.frame_set.index, t_ns, (None,) * len(use), times)
        views, common = (
            tuple(view if used else nothing for view, used in zip(views, use, strict=True))
            for views in (instant.views, instant.common)
        )
        yield Instant(frame_set, views, () if instant.common is instant.views else common)


def scenes(instants: Iterator[Instant], rig: Rig, use: Use, method: Literal["tracked", "paper"]) -> Iterator[Scene]:
    """What a method places, with what is to be said of how well it is monitored."""
    placer = Placer(rig, PlacingOptions(method=method))
    for instant in instants:
        scene = placer.place(instant)
        if scene is not None:
            verdict = judged(rig.camera_ids, use, instant.frame_set)
            yield replace(scene, status=verdict.status, reason=verdict.reason, cameras=verdict.cameras)


def said(scenes: Iterator[Scene], rules: RuleSet, rig: Rig) -> Iterator[tuple[int, list[bool]]]:
    """The scene's violations by rules, at the time of each scene."""
    judge = Judge(rules, rig)
    for scene in scenes:
        active = {verdict.rule for verdict in judge.judge(scene).verdicts if verdict.is_active}
        yield scene.t_ns, [kind in active for kind in KINDS]


def _placed(method: Method, sequence: ObservedSequence, rules: Rules, use: Use) -> Iterator[tuple[int, list[bool]]]:
    ours = method == "tracked"
    placed = scenes(seen_with(sequence.instants, use), sequence.rig, use, "tracked" if ours else "paper")
    return said(placed, rules.ours if ours else rules.paper, sequence.rig)


def _single(method: Method, sequence: ObservedSequence, rules: Rules, use: Use) -> Iterator[tuple[int, list[bool]]]:
    rig, view = replace(sequence.rig, world_from_rig=Pose.identity()), use.index(True)
    courses = [Course(_durations(rules.ours, kind)) for kind in KINDS]
    for instant in seen_with(sequence.instants, use):
        t_ns = instant.frame_set.t_ns
        scene = flat_scene(instant.common[view], index=instant.frame_set.index, t_ns=t_ns)
        truths = single_frame_truth(flat_judge(rules.paper, rig), scene, KINDS)
        for course, truth in zip(courses, truths, strict=True):
            course.step(t_ns, truth)
        filtered = [course.is_active for course in courses]
        yield t_ns, filtered if method == "filtered" else [truth is True for truth in truths]


def _durations(rules: RuleSet, kind: str) -> Durations:
    rule = rules.rule(kind)
    raise_ns, clear_ns, hold_ns = (round(seconds * 1e9) for seconds in (rule.for_s, rule.clear_s, rule.max_hold_s))
    return Durations(raise_ns, clear_ns, hold_ns, rule.on_unknown == "hold")
