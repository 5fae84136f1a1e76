"""One picture as a scene without depth, for the single-view baseline.

The paper's baseline (Safe-Construct, "Results and Discussion") is a model of single 2D frames with "the same backbone
model and L2-norm-based safety criteria and thresholds". Here a camera's picture becomes a scene that stands upright in
the plane y = 0, and the same judge compares the same distances with the same thresholds: every distance is then one of
the image, and H is the worker's height in pixels, of the same segments as in 3D.
"""

from __future__ import annotations

from math import nan

import numpy as np

from recognition.errors import DatasetError
from recognition.observations import ObjectTrack, Scene, ViewDetections, WorkerTrack
from recognition.rules import Judge, RuleSet
from rigcal.geometry import Floats
from rigcal.rig import Rig

_BODY_M = 1.5
"""From the head to the ankles. It sets how many pixels are called a metre, which matters to no distance in H, only to
how far the judge takes a joint to be at the most that was not detected."""
_PIXELS_PER_M = 200.0
"""Where nobody is seen."""
_CAMERAS = 2
"""How many cameras are said to see what this one sees, since the judge asks for two."""


def require_flat(rules: RuleSet) -> None:
    """Refuse rules that a picture cannot answer.

    Raises:
        DatasetError: where a rule needs the floor or the vertical.
    """
    if rules.needs_floor:
        name, text = rules.needs_floor[0]
        raise DatasetError(
            "the single-view baseline cannot be judged by these rules",
            where=rules.name,
            expected="distances between points of workers and objects, as in equations 6 to 9 of the paper",
            got=f"the rule {name}, which needs the floor: {text}",
            do_next="give the paper's literal rules, paper.rules.toml",
        )


def flat_scene(seen: ViewDetections, *, index: int, t_ns: int) -> Scene:
    """The scene of one camera's picture: x to the right and z up, in the heights of those who are seen.

    Args:
        seen: What the camera saw, in pixels.
        index: Number of the instant.
        t_ns: Its time.

    Returns:
        The scene; its tracks are numbered anew, since nobody is known again from picture to picture.
    """
    people_px = seen.people_px[seen.counted]  # a hint needs another camera
    unit = 1.0 / _pixels_per_m(people_px)
    nothing = np.full(0, -1, dtype=np.int64)
    workers = tuple(
        WorkerTrack(n, _upright(joints, unit), np.where(np.isfinite(joints[:, 0]), _CAMERAS, 0), nothing)
        for n, joints in enumerate(people_px)
    )
    objects = tuple(
        ObjectTrack(
            n,
            name,
            _upright(centre, unit),
            _CAMERAS,
            nothing,
            size_m=(float(xyxy[2] - xyxy[0]) * unit, float(xyxy[3] - xyxy[1]) * unit),
        )
        for n, (name, centre, xyxy) in enumerate(zip(seen.object_class, seen.object_px, seen.object_xyxy, strict=True))
    )
    return Scene(index, t_ns, workers, objects)


def _upright(pixels: Floats, unit: float) -> Floats:
    """(..., 3) of pixels (..., 2)."""
    return np.stack([pixels[..., 0] * unit, np.zeros(pixels.shape[:-1]), -pixels[..., 1] * unit], axis=-1)


def _pixels_per_m(people_px: Floats) -> float:
    y = people_px[..., 1]
    spans = [float(np.ptp(known)) for row in y if len(known := row[np.isfinite(row)]) > 1]
    tallest = max(spans, default=0.0)
    return tallest / _BODY_M if tallest > 0 else _PIXELS_PER_M


def flat_judge(rules: RuleSet, rig: Rig) -> Judge:
    """A judge of pictures: in them nobody is an adult's height, and whose body is not seen has none."""
    return Judge(rules, rig, adult_m=(nan, nan))


def single_frame_truth(judge: Judge, scene: Scene, kinds: tuple[str, ...]) -> list[bool | None]:
    """What a judge that has seen nothing before says of a scene, violation by violation; None: unknown.

    Of several workers or objects the scene's violation is true where one is, else unknown where one is (Kleene's or).
    """
    truths: dict[str, list[bool | None]] = {kind: [] for kind in kinds}
    for verdict in judge.judge(scene).verdicts:
        if verdict.rule in truths:
            truths[verdict.rule].append(verdict.truth)
    return [True if True in found else None if None in found else False for found in truths.values()]
