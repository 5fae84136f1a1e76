"""From verdicts instant by instant to events with a start, an end and what is known about them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from recognition.events.event import Event, Margin
from recognition.observations import ObjectTrack, Scene, Status, WorkerTrack
from recognition.rules import Actor, Judgement, Rule, RuleSet, Verdict
from recognition.rules.cast import WORKER
from rigcal.rig import Rig

_WORST: tuple[Status, ...] = ("MONITORED", "DEGRADED", "NOT MONITORED")
END_NOT_SEEN = "its end was not seen: it was held while it was unknown, as long as the rule allows"


@dataclass(slots=True)
class _Course:
    """What is kept of a violation that lasts, or is about to be raised."""

    rule: Rule
    number: int
    start_ns: int
    margins: list[Margin] = field(default_factory=list)
    cameras: set[int] = field(default_factory=set)
    status: Status = "MONITORED"
    held: int = 0
    actors: tuple[Actor, ...] = ()
    raised_ns: int | None = None
    told: tuple[object, ...] = ()
    """What of it may change, as it was told last."""

    def add(self, t_ns: int, status: Status, verdict: Verdict, cameras: Iterator[int]) -> None:
        """Go on to the next instant."""
        self.margins.append(Margin(t_ns, verdict.margin))
        self.held += verdict.truth is True
        self.status = max(self.status, status, key=_WORST.index)
        self.actors = verdict.actors
        self.cameras.update(cameras)


class EventKeeper:
    """Keeps the events of a run; same judgements and scenes: the same events.

    Args:
        rules: Those that judge.
        rig: The rig.
        rig_digest: The rig file's ``geometry_digest``; without it the digest that the rig has.
        caveats: What every event's word is not worth.
    """

    def __init__(self, rules: RuleSet, rig: Rig, *, rig_digest: str | None = None, caveats: Sequence[str] = ()) -> None:
        self._rules = {rule.name: rule for rule in rules.rules}
        self._digest, self._rig = rules.digest, rig
        self._rig_digest = rig.digest if rig_digest is None else rig_digest
        self._caveats = tuple(caveats)
        self._courses: dict[int, _Course] = {}

    def step(self, judgement: Judgement, scene: Scene) -> tuple[Event, ...]:
        """What was raised at an instant, what of it changed (who takes part, who sees it, the status), what ended."""
        told = []
        going_on: dict[int, _Course] = {}
        for verdict in judgement.verdicts:
            if verdict.since_ns is None and verdict.ended_ns is None:
                continue
            course = self._courses.get(verdict.number)
            if course is None or (verdict.since_ns is not None and not course.raised_ns):
                course = self._begun(course, verdict)
            course.add(judgement.t_ns, judgement.status, verdict, _cameras(scene, verdict.actors))
            event = self._told(course, verdict, judgement.t_ns)
            if event is not None:
                told.append(event)
            if verdict.ended_ns is None:
                going_on[verdict.number] = course
        self._courses = going_on
        return tuple(told)

    def lasting(self) -> tuple[Event, ...]:
        """The events that have not ended, as they are now."""
        return tuple(self._event(course, None) for course in self._courses.values() if course.raised_ns is not None)

    def _begun(self, course: _Course | None, verdict: Verdict) -> _Course:
        """The course of a verdict that was not raised yet; a new one where the condition begins to hold anew."""
        start_ns = verdict.since_ns
        if start_ns is None:
            raise ValueError(
                f"a violation of {verdict.rule} ended that was never seen to begin: a judgement was left out"
            )
        if course is not None and course.start_ns == start_ns:
            return course
        return _Course(self._rules[verdict.rule], verdict.number, start_ns)

    def _told(self, course: _Course, verdict: Verdict, t_ns: int) -> Event | None:
        """The event, where there is something new about it."""
        if verdict.ended_ns is not None:
            return self._event(course, verdict.ended_ns, was_seen=verdict.truth is not None)
        if not verdict.is_active:
            return None
        if course.raised_ns is None:
            course.raised_ns = t_ns
        now = (course.actors, frozenset(course.cameras), course.status)
        if now == course.told:
            return None
        course.told = now
        return self._event(course, None)

    def _event(self, course: _Course, end_ns: int | None, *, was_seen: bool = True) -> Event:
        rule, ids = course.rule, self._rig.camera_ids
        raised_ns = course.start_ns if course.raised_ns is None else course.raised_ns
        name = f"{self._digest} {self._rig_digest} {rule.name} {course.start_ns} {course.number}"
        return Event(
            event_id=f"{rule.name}-{hashlib.sha256(name.encode()).hexdigest()[:16]}",
            rule=rule.name,
            sentence=rule.sentence,
            severity=rule.severity,
            start_ns=course.start_ns,
            raised_ns=raised_ns,
            end_ns=end_ns,
            actors=course.actors,
            margins=tuple(course.margins),
            cameras=tuple(camera_id for index, camera_id in enumerate(ids) if index in course.cameras),
            confidence=course.held / max(len(course.margins), 1),
            status=course.status,
            rules_digest=self._digest,
            rig_digest=self._rig_digest,
            rig_verdict=self._rig.verdict,
            caveats=self._caveats if was_seen else (*self._caveats, END_NOT_SEEN),
        )


def _cameras(scene: Scene, actors: tuple[Actor, ...]) -> Iterator[int]:
    """Indices of the cameras that see any of these now."""
    for actor in actors:
        tracks: Sequence[WorkerTrack | ObjectTrack] = scene.workers if actor.kind == WORKER else scene.objects
        for track in tracks:
            if track.track_id == actor.track_id:
                yield from (index for index, member in enumerate(track.members.tolist()) if member >= 0)
