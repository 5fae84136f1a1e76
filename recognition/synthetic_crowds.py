"""Crowds that are hard to tell apart: workers who cross each other's paths, before cameras that now and then miss them.

What :mod:`recognition.synthetic_views` leaves out are misses that last: somebody behind a pillar, turned away, or not
recognised by a network for a second. Here a camera loses a worker, or half of it, for a span of time. The truth of
places and of the association comes with it. Same arguments, same crowd.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recognition.metrics import Truth
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.synthetic import Site, semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, LabelledView, observe, with_noise
from rigcal.errors import OptionError
from rigcal.geometry import Bools

CROWD_NOISE = DetectorNoise(pixel_sigma=3.0, missing_joint=0.2)
"""The detector of :func:`crowd`, which adds the false people."""
FALSE_SHARE = 0.05
"""False people among those whom a camera of :func:`crowd` could see."""
_LOST = np.zeros((5, 17), dtype=np.bool_)
"""What a burst takes: everything, the upper half, the lower half, the left side, the right side."""
_LOST[0], _LOST[1, :11], _LOST[2, 11:], _LOST[3, 1::2], _LOST[4, 2::2] = True, True, True, True, True


@dataclass(frozen=True, slots=True)
class Bursts:
    """Spans of time in which one camera loses one worker.

    Raises:
        OptionError: where a value is negative, the share is above 1, or the spans end before they begin.
    """

    per_minute: float = 6.0
    """Mean number of spans for each worker and camera (Poisson); 12.5 % of the time with the lengths below."""
    shortest_s: float = 0.5
    longest_s: float = 2.0
    """Spans are evenly long between the two."""
    whole: float = 0.5
    """Share of the spans in which the whole worker is lost; in the others one of its halves, or one of its sides."""

    def __post_init__(self) -> None:
        for name, least, most in (
            ("per_minute", 0.0, np.inf),
            ("shortest_s", 0.0, np.inf),
            ("longest_s", self.shortest_s, np.inf),
            ("whole", 0.0, 1.0),
        ):
            if not least <= getattr(self, name) <= most:
                raise OptionError(name, expected=f"a number in {least:g}..{most:g}", got=getattr(self, name))


@dataclass(frozen=True, slots=True)
class Crowd:
    """A simulated site, and what imperfect detectors report of it."""

    site: Site
    views: tuple[tuple[LabelledView, ...], ...]
    """(F,) instants of (V,) views."""

    @property
    def truth(self) -> Truth:
        """Where the workers are, in the world."""
        return Truth.of(self.site.joints_in_world_m)

    @property
    def instants(self) -> tuple[Instant, ...]:
        """(F,) what the runtime gets."""
        return self._instants([tuple(view.detections for view in views) for views in self.views])

    def alone(self, worker: int) -> tuple[Instant, ...]:
        """(F,) instants with the people detections of one worker only, and without objects: the association is
        given."""
        return self._instants([tuple(_only(view, worker) for view in views) for views in self.views])

    def _instants(self, detections: list[tuple[ViewDetections, ...]]) -> tuple[Instant, ...]:
        nothing = (None,) * len(self.site.rig.cameras)
        return tuple(
            Instant(FrameSet(index, t_ns, nothing), seen)
            for index, (t_ns, seen) in enumerate(zip(self.site.t_ns.tolist(), detections, strict=True))
        )


def crowd(
    workers: int,
    *,
    seconds: float,
    seed: int,
    cameras: int = 4,
    fps: float = 30.0,
    noise: DetectorNoise = CROWD_NOISE,
    bursts: Bursts | None = None,
) -> Crowd:
    """Workers who cross each other's paths in a room of 6 x 6 m, seen from a semicircle.

    Args:
        workers: How many.
        seconds: How long.
        seed: Of everything.
        cameras: How many.
        fps: Instants per second.
        noise: Of the detectors; false people are added to it so that they are 5 % of the workers in a view.
        bursts: Spans in which cameras lose workers; None for the defaults.
    """
    rig, frames = semicircle_rig(cameras), round(seconds * fps)
    site = simulate(rig, workers=workers, frames=frames, fps=fps, seed=seed, crossing=True)
    lost = lost_joints(site, bursts or Bursts(), seed=(seed, 1))
    detector = replace(noise, false_per_view=noise.false_per_view + FALSE_SHARE * workers)
    views = tuple(
        with_noise(
            tuple(_without(view, lost[frame, v]) for v, view in enumerate(observe(site, frame))),
            rig,
            detector,
            seed=(seed, 2, frame),
        )
        for frame in range(frames)
    )
    return Crowd(site, views)


def lost_joints(site: Site, bursts: Bursts, *, seed: int | tuple[int, ...]) -> Bools:
    """(F, V, W, 17) whether a joint of a worker is within a span in which the camera does not see it."""
    rng = np.random.default_rng(seed)
    frames, workers = site.joints_in_world_m.shape[:2]
    views = len(site.rig.cameras)
    t_s = (site.t_ns - site.t_ns[0]) * 1e-9
    lost = np.zeros((frames, views, workers, 17), dtype=np.bool_)
    begin_s = -bursts.longest_s  # so that spans are as frequent at the first instant as later
    mean = bursts.per_minute / 60 * (t_s[-1] - begin_s)
    for view in range(views):
        for worker in range(workers):
            for start_s in rng.uniform(begin_s, t_s[-1], rng.poisson(mean)):
                during = (t_s >= start_s) & (t_s < start_s + rng.uniform(bursts.shortest_s, bursts.longest_s))
                what = 0 if rng.random() < bursts.whole else rng.integers(1, len(_LOST))
                lost[during, view, worker] |= _LOST[what]
    return lost


def _without(view: LabelledView, lost: Bools) -> LabelledView:
    """The view without the lost joints (W, 17); a worker without a joint is no detection."""
    joints_px, score = view.detections.people_px, view.detections.people_score
    gone = lost[view.worker_idx]
    score = np.where(gone, 0.0, score)
    kept = (score > 0).any(axis=1)
    people_px = np.where(gone[..., None], np.nan, joints_px)[kept]
    seen = replace(view.detections, people_px=people_px, people_score=score[kept])
    return LabelledView(seen, view.worker_idx[kept], view.object_idx)


def _only(view: LabelledView, worker: int) -> ViewDetections:
    own = view.worker_idx == worker
    seen = view.detections
    return ViewDetections(seen.people_px[own], seen.people_score[own], (), np.zeros((0, 4)), np.zeros(0))
