"""Rules and events of a run in one step, for whoever has its scenes."""

from __future__ import annotations

from collections.abc import Sequence

from recognition.events.event import Event
from recognition.events.keeper import EventKeeper
from recognition.observations import Scene
from recognition.rules import Judge, Judgement, RuleSet
from rigcal.rig import Rig


class Watch:
    """Judges the scenes of a run and keeps its events.

    Args:
        rules: What must not be.
        rig: The rig of the scenes.
        rig_digest: The rig file's ``geometry_digest``; without it the digest that the rig has.
        caveats: What every event's word is not worth, such as the notice of a network.

    Raises:
        RigRefusedError: where a rule needs the floor or the vertical, and the rig has no world frame.
    """

    def __init__(self, rules: RuleSet, rig: Rig, *, rig_digest: str | None = None, caveats: Sequence[str] = ()) -> None:
        self.judge = Judge(rules, rig)
        self._keeper = EventKeeper(rules, rig, rig_digest=rig_digest, caveats=caveats)
        self._last: Judgement | None = None

    def step(self, scene: Scene) -> tuple[Judgement, tuple[Event, ...]]:
        """What is said of a scene, and the events that were raised, changed or ended at it.

        A scene that is not later than the last one says nothing: the last judgement, and no event.
        """
        if self._last is not None and scene.t_ns <= self._last.t_ns:
            return self._last, ()
        self._last = self.judge.judge(scene)
        return self._last, self._keeper.step(self._last, scene)

    def lasting(self) -> tuple[Event, ...]:
        """The events that have not ended, as they are now: of a run that is over, those that its end cut off."""
        return self._keeper.lasting()
