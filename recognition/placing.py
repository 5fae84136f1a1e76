"""From what cameras saw to who and what is where: the two methods behind one interface.

``paper`` is the method of the Safe-Construct paper: greedy epipolar association, triangulation, matching with the
instants before. ``tracked`` begins with what is known: tracks claim detections first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from recognition.association import AssociationOptions, associate
from recognition.epipolar import RigGeometry
from recognition.observations import FrameSet, Instant, Scene
from recognition.optics import Optics
from recognition.smoothing import Followed, smoothed
from recognition.tracking import Tracker, TrackerState, TrackingOptions
from recognition.tracking.options import FollowOptions
from recognition.tracking.tracked import Follower, FollowState
from recognition.triangulation import triangulate_objects, triangulate_people
from rigcal.errors import OptionError
from rigcal.geometry import Floats
from rigcal.rig import Rig

Method = Literal["paper", "tracked"]


@dataclass(frozen=True, slots=True)
class PlacingOptions:
    """How instants become scenes."""

    method: Method = "tracked"
    association: AssociationOptions = field(default_factory=AssociationOptions)
    """Of the method ``paper``."""
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    """Of the method ``paper``."""
    follow: FollowOptions = field(default_factory=FollowOptions)
    """Of the method ``tracked``."""


class Placer:
    """Places workers and objects, instant by instant, and remembers their tracks.

    Same rig, options and instants: the same scenes, to the last bit.
    """

    def __init__(self, rig: Rig, options: PlacingOptions | None = None) -> None:
        chosen = options or PlacingOptions()
        self._steps: _Paper | _Tracked = _Paper(rig, chosen) if chosen.method == "paper" else _Tracked(rig, chosen)
        self._last_ns: int | None = None

    @property
    def state(self) -> FollowState | None:
        """All that is known after the last instant, for :mod:`recognition.smoothing`; None of the method ``paper``."""
        return self._steps.state if isinstance(self._steps, _Tracked) else None

    def place(self, instant: Instant) -> Scene | None:
        """The scene of an instant; None where one camera or none took part, or it is not later than the last."""
        frame_set = instant.frame_set
        if frame_set.cameras < 2 or (self._last_ns is not None and frame_set.t_ns <= self._last_ns):
            return None
        self._last_ns = frame_set.t_ns
        return self._steps.scene(instant)


class _Paper:
    def __init__(self, rig: Rig, options: PlacingOptions) -> None:
        self._geometry, self._options = RigGeometry.of(rig), options.association
        self._tracker, self._state = Tracker(rig.world_from_rig, options.tracking), TrackerState()

    def scene(self, instant: Instant) -> Scene:
        frame_set, views = instant.frame_set, instant.common
        association = associate(self._geometry, views, self._options)
        people = triangulate_people(self._geometry, views, association)
        objects = triangulate_objects(self._geometry, views, association)
        self._state, scene = self._tracker.step(
            self._state, people, objects, t_ns=frame_set.t_ns, index=frame_set.index
        )
        return scene


class _Tracked:
    def __init__(self, rig: Rig, options: PlacingOptions) -> None:
        self._follower, self.state = Follower(Optics.of(rig), options.follow), FollowState.start()

    def scene(self, instant: Instant) -> Scene:
        frame_set = instant.frame_set
        moved = instant.common is not instant.views
        age_s = np.zeros(len(instant.views)) if moved else _ages_s(frame_set)
        self.state, scene = self._follower.step(
            self.state, instant.common, age_s, t_ns=frame_set.t_ns, index=frame_set.index
        )
        return scene


def _ages_s(frame_set: FrameSet) -> Floats:
    """(V,) how long before the common time each camera saw what it saw; 0 for those that took no part."""
    times: Sequence[int | None] = frame_set.times_ns
    return np.array([0.0 if t_ns is None else (frame_set.t_ns - t_ns) * 1e-9 for t_ns in times])


def place_smoothed(rig: Rig, instants: Iterable[Instant], options: PlacingOptions | None = None) -> Iterator[Scene]:
    """The scenes of a run that is over, with every track smoothed: a few seconds of instants wait for what follows.

    Identities and the choice of detections are those of :meth:`Placer.place`; instants of which that makes no scene
    are passed over here too.

    Args:
        rig: The rig.
        instants: In order of time.
        options: Of the method ``tracked``.

    Raises:
        OptionError: where the options are of the method ``paper``, which has no covariances to smooth with.
    """
    chosen = options or PlacingOptions()
    if chosen.method == "paper":
        raise OptionError("method", expected="tracked, to smooth tracks", got="paper")
    placer = Placer(rig, chosen)

    def followed() -> Iterator[Followed]:
        for instant in instants:
            scene, state = placer.place(instant), placer.state
            if scene is not None and state is not None:
                yield Followed(scene, state, len(rig.cameras))

    return smoothed(followed(), chosen.follow)
