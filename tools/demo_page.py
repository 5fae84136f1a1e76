"""The demo's page: one HTML file that works offline, in a technician's words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import ChoiceLoader, FileSystemLoader

from recognition.evaluation.found import Findings
from recognition.events import Event
from rigcal.geometry import Floats
from rigcal.report import numbers
from rigcal.report.templates import page_environment
from rigcal.rigdocument import RigDocument
from tools.demo_pictures import ViewPicture
from tools.demo_truth import CameraError, ClockError, FloorError, Found, Truth

KINDS = {
    "window": "a large window carried by one person alone",
    "ladder": "somebody on a ladder that nobody holds",
    "no_hat": "somebody without a hard hat",
    "platform": "two people on a platform at once",
}
_GAP_S = 0.35
_BRIEF_S = 0.5
"""Shorter stretches of the truth are drawn, but have no picture."""


@dataclass(frozen=True, slots=True)
class Step:
    """A command that the demo ran."""

    command: str
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What the page tells."""

    document: RigDocument
    truth: Truth
    cameras: Sequence[CameraError]
    floor: FloorError
    clocks: Sequence[ClockError]
    workers: Found
    objects: Sequence[Found]
    tracks: Sequence[tuple[int, Floats]]
    """Of each worker found: identity and (N, 2) ground points in the world, by time; NaN between parts of the way."""
    probed_s: float
    """How long the cameras' hosts were asked for the time."""
    violations: Findings
    """What the rules found, beside the truth."""
    warnings: Sequence[str]
    """What the recording says of the networks that made it."""
    steps: Sequence[Step]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A violation in the timeline, in percent of its length."""

    start: float
    width: float
    title: str
    is_false: bool = False
    """Found where nothing of the kind was."""


@dataclass(frozen=True, slots=True)
class Lane:
    """One kind of violation."""

    words: str
    truth: Sequence[Stretch]
    found: Sequence[Stretch]


def shown_instants(truth: Truth) -> list[tuple[int, str]]:
    """Instants that are worth a picture: the middle of the longest violation of each kind, by time."""
    chosen = []
    for kind, words in KINDS.items():
        longest = max(
            (one for one in truth.facts["violations"] if one["kind"] == kind),
            key=lambda one: one["end_s"] - one["start_s"],
            default=None,
        )
        if longest is not None and longest["end_s"] - longest["start_s"] >= _BRIEF_S:
            middle = (longest["start_s"] + longest["end_s"]) / 2
            chosen.append((int(np.abs(truth.instants_s - middle).argmin()), words))
    return sorted(chosen)


def ground_tracks(poses: Path) -> list[tuple[int, Floats]]:
    """Where each worker of a poses file was on the ground, by identity, who was seen for long first.

    Returns:
        Identity and (N, 2) points by time, NaN where the worker was not seen for ``_GAP_S``.
    """
    with np.load(poses) as stored:
        ids, times_ns, joints = stored["track_id"], stored["t_ns"], stored["joints_m"].astype(np.float64)
    grounds, tracks = ground_points(joints), []
    for track in np.unique(ids):
        own = np.flatnonzero((ids == track) & np.isfinite(grounds[:, 0]))
        gaps = np.flatnonzero(np.diff(times_ns[own]) > _GAP_S * 1e9) + 1
        tracks.append((int(track), np.insert(grounds[own], gaps, np.nan, axis=0)))
    return sorted(tracks, key=lambda one: -len(one[1]))


def ground_points(joints_m: Floats) -> Floats:
    """(..., 2) below the middle of the hips of joints (..., 17, 3)."""
    return np.asarray(joints_m[..., 11:13, :2].mean(axis=-2))


def write_page(results: Results, pictures: Sequence[Sequence[ViewPicture]], path: Path) -> None:
    """Write the page.

    Args:
        results: the figures.
        pictures: of every instant of :func:`shown_instants`, the picture of each camera.
        path: where to.
    """
    environment = page_environment()
    environment.loader = ChoiceLoader(
        [FileSystemLoader(Path(__file__).parent), environment.loader or FileSystemLoader([])]
    )
    environment.filters |= {"fixed": numbers.fixed, "significant": numbers.significant}
    truth = results.truth
    instants = shown_instants(truth)
    path.write_text(
        environment.get_template("demo_page.html.j2").render(
            results=results,
            kept=sum(one.holds for one in (*results.cameras, *results.clocks)),
            limits=len(results.cameras) + len(results.clocks),
            shown=[(truth.instants_s[at], words, row) for (at, words), row in zip(instants, pictures, strict=True)],
            plan=_plan(results),
            kinds=KINDS,
            timeline=[Lane(KINDS[kind], _stretches(truth, kind), _found(results, kind)) for kind in KINDS],
            seconds=_duration_s(truth),
            total_s=sum(step.seconds for step in results.steps),
        ),
        encoding="utf-8",
    )


def _duration_s(truth: Truth) -> float:
    times = truth.instants_s
    return float(times[-1] + (times[-1] - times[0]) / (len(times) - 1))


def _stretches(truth: Truth, kind: str) -> list[Stretch]:
    whole = _duration_s(truth)
    return [
        Stretch(
            100 * one["start_s"] / whole,
            100 * (one["end_s"] - one["start_s"]) / whole,
            f"{one['start_s']:.1f} to {one['end_s']:.1f} s",
        )
        for one in truth.facts["violations"]
        if one["kind"] == kind
    ]


def _found(results: Results, kind: str) -> list[Stretch]:
    """Events of the kind, each from its start to its end."""
    truth = results.truth
    whole, epoch_ns = _duration_s(truth), round(truth.facts["epoch_s"] * 1e9)

    def stretch(event: Event) -> Stretch:
        start_s = (event.start_ns - epoch_ns) * 1e-9
        end_s = whole if event.end_ns is None else (event.end_ns - epoch_ns) * 1e-9
        words = f"{start_s:.1f} to {end_s:.1f} s: {event.sentence}"
        return Stretch(100 * start_s / whole, 100 * (end_s - start_s) / whole, words, event in results.violations.false)

    return [stretch(event) for event in results.violations.events if event.rule == kind]


@dataclass(frozen=True, slots=True)
class Plan:
    """The site from above, in metres; y grows upwards in the world and downwards in the drawing."""

    box: str
    left: float
    bottom: float
    """Where the scale is drawn."""
    truth: list[str]
    """Path of each worker."""
    tracks: list[tuple[int, str]]
    """Identity and path of each worker that was found."""
    cameras: list[tuple[str, float, float, float, float]]
    """Name, place and where it looks, 0.8 m before it."""


def _plan(results: Results) -> Plan:
    true = ground_points(results.truth.arrays["joints_m"].astype(np.float64))
    world = results.document.world_from_rig
    if world is None:
        raise SystemExit("the rig file has no world")
    cameras = []
    for camera in results.document.cameras:
        world_from_cam = world.pose @ camera.cam_from_rig.pose.inverse()
        x, y, _ = world_from_cam.translation_m
        ahead = world_from_cam.rotation[:2, 2] / np.linalg.norm(world_from_cam.rotation[:2, 2])
        cameras.append((camera.id, float(x), float(-y), float(x + 0.8 * ahead[0]), float(-y - 0.8 * ahead[1])))
    places = np.concatenate([true.reshape(-1, 2) * (1, -1), np.array([camera[1:3] for camera in cameras])])
    low, high = places.min(axis=0) - 0.9, places.max(axis=0) + 0.9
    return Plan(
        box=" ".join(f"{value:.2f}" for value in (*low, *(high - low))),
        left=low[0] + 0.3,
        bottom=high[1] - 0.3,
        truth=[_path(true[:, worker]) for worker in range(true.shape[1])],
        tracks=[(track, _path(points)) for track, points in results.tracks if len(points) > 1],
        cameras=cameras,
    )


def _path(points: Floats) -> str:
    """An SVG path that is interrupted where points are NaN."""
    parts = np.split(points, np.flatnonzero(np.isnan(points[:, 0])))
    whole = (part[np.isfinite(part[:, 0])] for part in parts)
    return "".join("M" + "L".join(f"{x:.2f} {-y:.2f}" for x, y in part) for part in whole if len(part))
