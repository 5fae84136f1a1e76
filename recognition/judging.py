"""The rules in a run: every scene is judged, and what comes of it goes into the recording and to whoever listens.

A recording holds the rule file, so that it can be judged again as it was; by other rules it can be judged too, and
nothing needs to be seen anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from recognition.detectors import ModelInfo
from recognition.events import NO_MARKS, Event, Marks, Watch, by_start, marks_of
from recognition.monitoring import Verdict
from recognition.observations import FrameSet, Scene
from recognition.recording import Phase, Recorder, read_rules_attachment
from recognition.rules import RuleSet, load_rules, parse_rules
from recognition.sources.recording import RecordedRun
from rigcal.rig import Rig

OnEvent = Callable[[Event, Phase], None]
NAME_KEY = "rules"
"""Metadata of a run: the name of its rules."""
NOTICE_KEY, MODEL_KEY = "notice.", "model."
"""Metadata of a run, before each network's family: its notice, and its name and digest."""
UNKNOWN_NETWORKS = "made of detections from a file: it is not known what saw them"


@dataclass(frozen=True, slots=True)
class Rulebook:
    """A rule file, as it is kept in a recording."""

    rules: RuleSet
    toml: bytes
    """Its very bytes."""


def read_rulebook(path: Path) -> Rulebook:
    """Read a rule file.

    Raises:
        RulesError: where it cannot be read, or has a mistake.
    """
    return Rulebook(load_rules(path), path.read_bytes())


def recorded_rulebook(recording: RecordedRun) -> Rulebook | None:
    """The rules that a run was judged by; None where it was judged by none.

    Raises:
        RecordingError: where the recording is damaged.
        RulesError: where this version does not understand them.
    """
    toml = read_rules_attachment(recording.files[0])
    if toml is None:
        return None
    rules = parse_rules(toml.decode("utf-8"), f"{recording.files[0].name}/rules.toml")
    return Rulebook(replace(rules, name=recording.metadata.get(NAME_KEY, rules.name)), toml)


def watch_of(rules: RuleSet, rig: Rig, metadata: Mapping[str, str], geometry_digest: str) -> Watch:
    """The watch of a run, or of its replay: the same events of both.

    Args:
        rules: What must not be.
        rig: Of the run.
        metadata: Of the run, which says what its networks are not worth.
        geometry_digest: The rig file's.

    Raises:
        RigRefusedError: where a rule needs the floor or the vertical, and the rig has no world frame.
    """
    return Watch(rules, rig, rig_digest=geometry_digest, caveats=caveats_of(metadata))


def network_metadata(networks: Sequence[ModelInfo]) -> dict[str, str]:
    """What the metadata of a run says of its networks."""
    return {f"{MODEL_KEY}{network.family}": f"{network.name} {network.sha256}" for network in networks} | {
        f"{NOTICE_KEY}{network.family}": network.notice for network in networks if network.notice
    }


def caveats_of(metadata: Mapping[str, str]) -> tuple[str, ...]:
    """What the word of every event is not worth, because of the networks that saw."""
    if not any(key.startswith(MODEL_KEY) for key in metadata):
        return (UNKNOWN_NETWORKS,)
    return tuple(dict.fromkeys(text for key, text in sorted(metadata.items()) if key.startswith(NOTICE_KEY)))


def blind_scene(frame_set: FrameSet, verdict: Verdict) -> Scene:
    """What is to be judged of an instant that could not be placed: nothing is known of it."""
    return Scene(frame_set.index, frame_set.t_ns, (), (), "NOT MONITORED", verdict.reason, verdict.cameras)


class EventBook:
    """The newest word on every event of a run, and in which phase it is.

    It keeps all events, with a margin for each instant of a violation: 0.14 kB, 5 MB for an hour of one at 10 Hz.
    """

    def __init__(self) -> None:
        self._events: dict[str, Event] = {}

    def add(self, event: Event) -> Phase:
        """Take a word; what has happened to the event with it."""
        is_known = event.event_id in self._events
        self._events[event.event_id] = event
        if event.end_ns is not None:
            return "ended"
        return "changed" if is_known else "raised"

    @property
    def events(self) -> tuple[Event, ...]:
        """In order of their start."""
        return by_start(self._events.values())


class Judging:
    """Judges the scenes of a run; without a watch nothing is violated, and nothing is said.

    Args:
        watch: The rules; None where the run has none.
        recorder: Takes the events.
        on_event: Told of every word on an event, after it was recorded.
    """

    def __init__(self, watch: Watch | None, recorder: Recorder, on_event: OnEvent | None) -> None:
        self._watch, self._recorder, self._on_event = watch, recorder, on_event
        self._book = EventBook()
        self._told: tuple[Event, ...] = ()
        self._last: tuple[int, int | None] = (0, None)

    @property
    def events(self) -> tuple[Event, ...]:
        """All so far, in order of their start."""
        return self._book.events

    def judge(self, scene: Scene) -> Marks:
        """Who violates what in a scene; :meth:`tell` says what follows from it, once the scene is recorded."""
        if self._watch is None:
            return NO_MARKS
        judgement, self._told = self._watch.step(scene)
        return marks_of(judgement)

    def tell(self, t_ns: int, receive_ns: int | None) -> None:
        """Record what was raised, changed or ended with the last scene, and pass it on."""
        self._last = t_ns, receive_ns
        for event in self._told:
            self._say(event, self._book.add(event))
        self._told = ()

    def close(self) -> None:
        """The run is over: record as they are the events that its end cuts off."""
        for event in self._watch.lasting() if self._watch is not None else ():
            self._book.add(event)
            self._say(event, "lasting")

    def _say(self, event: Event, phase: Phase) -> None:
        t_ns, receive_ns = self._last
        self._recorder.write_event(event, phase, t_ns, receive_ns=receive_ns)
        if self._on_event is not None:
            self._on_event(event, phase)
