"""Scenes built by hand for rules: in the world frame, x and y on the floor, z up."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from recognition.events import Watch
from recognition.observations import JOINTS, ObjectTrack, Scene, WorkerTrack
from recognition.rules import parse_rules
from recognition.synthetic import HEIGHT_M, semicircle_rig, walking

CONFIGS = Path(__file__).resolve().parents[2] / "rig_configs"
RIG = semicircle_rig(4)
RIG_FROM_WORLD = RIG.world_from_rig.inverse()
CAMERAS = len(RIG.cameras)
EVERYBODY, NOBODY = np.zeros(CAMERAS, dtype=np.int64), np.full(CAMERAS, -1)
WRISTS, ANKLES = [JOINTS.index(f"{side}_wrist") for side in ("left", "right")], [15, 16]
HEAD = JOINTS.index("left_ear"), JOINTS.index("right_ear")
HEADER = 'format = "recognition.rules"\nversion = 1\n'


def standing(x, y, z=0.0):
    """(17, 3) joints of one who stands upright, looks along x, and has the soles at z."""
    joints = walking(np.array([[x, y]]))[0]
    joints[:13, 2] += 0.53 * HEIGHT_M - joints[11, 2]
    joints[13:, 0], joints[13:, 1] = x, [y + side * 0.07 * HEIGHT_M for side in (1, -1, 1, -1)]
    joints[13:, 2] = np.repeat([0.285, 0.039], 2) * HEIGHT_M
    return joints + np.array([0, 0, z])


def worker(track, x, y, z=0.0, *, hands=None, unseen=(), views=4):
    """One who stands at (x, y), with the soles at z; hands at a point; some joints unseen."""
    joints = standing(x, y, z)
    if hands is not None:
        joints[WRISTS] = hands
    joints[list(unseen)] = np.nan
    seen = np.where(np.isfinite(joints[:, 0]), views, 0)
    return WorkerTrack(track, RIG_FROM_WORLD.apply(joints), seen, EVERYBODY)


def head_m(x, y, z=0.0):
    """Where the middle of the ears of :func:`worker` is."""
    return standing(x, y, z)[list(HEAD)].mean(axis=0)


def thing(track, name, at, *, keypoints=None, size=(0.3, 0.3), views=4):
    points = np.full((4, 3), np.nan) if keypoints is None else np.asarray(keypoints, dtype=np.float64)
    return ObjectTrack(
        track, name, RIG_FROM_WORLD.apply(at), views, EVERYBODY if views else NOBODY,
        keypoints_m=RIG_FROM_WORLD.apply(points), size_m=size,
    )  # fmt: skip


def hat(track, x, y, z=0.0, *, worn=True):
    """On the head of a worker at (x, y), or in front of the knees."""
    return thing(track, "hard_hat", head_m(x, y, z) + ([0, 0, 0.075 * HEIGHT_M] if worn else [0.3, 0, -1.1]))


def ladder(track, x, y, *, name="ladder", length=3.0, lean=0.8, known=(0, 1, 2, 3)):
    """Leans towards +y; its feet are at (x, y)."""
    points = np.array([[x - 0.2, y, 0], [x + 0.2, y, 0], [x - 0.2, y + lean, length], [x + 0.2, y + lean, length]])
    shown = np.full((4, 3), np.nan)
    shown[list(known)] = points[list(known)]
    return thing(track, name, points.mean(axis=0), keypoints=shown)


def platform(track, x, y, *, top=0.6, name="platform"):
    corners = np.array([[x + a * 0.8, y + b * 0.35, top] for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    return thing(track, name, [x, y, top / 2], keypoints=corners)


def window(track, x, y, bottom, *, known=(0, 1, 2, 3), box_m=1.6):
    """1.4 m wide along x, 1.6 m high; so high are its boxes."""
    points = np.array(
        [[x - 0.7, y, bottom + 1.6], [x + 0.7, y, bottom + 1.6], [x + 0.7, y, bottom], [x - 0.7, y, bottom]]
    )
    shown = np.full((4, 3), np.nan)
    shown[list(known)] = points[list(known)]
    return thing(track, "large_window", points.mean(axis=0), keypoints=shown, size=(1.4, box_m))


def rule(when, *, definitions="", more="", **times):
    """A rule file with one rule."""
    keys = {"for_s": 0, "clear_s": 0, **times}
    body = "\n".join(f"{key} = {value!r}" for key, value in keys.items())
    sections = f"[definitions]\n{definitions}\n" if definitions else ""
    text = f'{HEADER}{sections}{more}\n[[rules]]\nname = "r"\nsentence = "wrong"\nwhen = "{when}"\n{body}\n'
    return parse_rules(text, "r.rules.toml")


@dataclass
class Film:
    """Scenes at a steady rate, judged as they come."""

    rules: object
    rig: object = RIG
    step_s: float = 0.1
    events: dict = field(default_factory=dict)
    """The newest word on each event, by id."""
    judgements: list = field(default_factory=list)
    index: int = 0

    def __post_init__(self):
        self.watch = Watch(self.rules, self.rig)

    def show(self, workers=(), things=(), seconds=None, status="MONITORED"):
        """The same for a while (one instant without it); workers and things may be functions of the time."""
        for _ in range(1 if seconds is None else round(seconds / self.step_s)):
            t_s = self.index * self.step_s
            who = workers(t_s) if callable(workers) else workers
            what = things(t_s) if callable(things) else things
            scene = Scene(self.index, 10**9 + round(t_s * 1e9), tuple(who), tuple(what), status)
            judgement, events = self.watch.step(scene)
            self.judgements.append(judgement)
            self.events |= {event.event_id: event for event in events}
            self.index += 1
        return self

    @property
    def last(self):
        return self.judgements[-1]

    def truths(self, name="r"):
        return [verdict.truth for verdict in self.last.verdicts if verdict.rule == name]

    def raised(self, name=None):
        """Events by start: (rule, start, end) in seconds."""
        found = sorted(self.events.values(), key=lambda event: event.start_ns)
        return [
            (e.rule, e.start_ns / 1e9 - 1, None if e.end_ns is None else e.end_ns / 1e9 - 1)
            for e in found
            if name in (None, e.rule)
        ]
