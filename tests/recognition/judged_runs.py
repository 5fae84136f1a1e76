"""Runs that are judged by rules: two workers who walk, of whom the second wears no hat."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from recognition.judging import read_rulebook, watch_of
from recognition.observations import FrameSet, Instant, ViewDetections, ViewFrame
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.runtime import RunOptions, run
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

FRAMES, FPS = 24, 10.0
T0 = 1_800_000_000_000_000_000
SIZE_WH = (320, 180)
NOTICE = "not validated on real people"
NO_HAT = """format = "recognition.rules"
version = 1
name = "hats"

[definitions]
"worn(w)" = "exists hard_hat o of w: dist(w.head, o) < 0.10 H"

[[rules]]
name = "no_hat"
sentence = "a worker wears no <hard hat>"
when = "each w: visible(w.head) and not worn(w)"
for_s = 0.3
clear_s = 0.3
severity = "alarm"
"""
QUICKER = NO_HAT.replace("for_s = 0.3", "for_s = 0.1").replace("hats", "quicker")


@dataclass
class Site:
    folder: Path
    rig_path: Path
    rig: object
    views: list
    """Of each frame, what each camera sees."""


def site_in(folder):
    """The files of a site, and what its cameras see."""
    path = folder / "s.rig.json"
    made = document_of_rig(semicircle_rig(size_wh=SIZE_WH), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, path)
    rig = rig_of(read_rigfile(path))
    walk = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1)
    (folder / "hats.rules.toml").write_text(NO_HAT)
    return Site(folder, path, rig, [tuple(bare(v.detections) for v in observe(walk, k)) for k in range(FRAMES)])


def bare(view):
    """What a camera saw, without the hat of the second worker: hats come before all else."""
    hats = [n for n, name in enumerate(view.object_class) if name == "hard_hat"]
    keep = [n for n in range(len(view.object_class)) if n not in hats[1:]]
    return replace(
        view,
        object_class=tuple(view.object_class[n] for n in keep),
        object_xyxy=view.object_xyxy[keep],
        object_score=view.object_score[keep],
        object_keypoints_px=view.object_keypoints_px[keep],
    )


def instants(site, *, absent=(), images=False):
    """The instants; ``absent``: (instant, camera) pairs that took no part; ``images``: grey frames beside them."""
    made = []
    for k, seen in enumerate(site.views):
        t_ns = T0 + round(k * 1e9 / FPS)
        times = tuple(None if (k, v) in absent else t_ns for v in range(len(seen)))
        views = tuple(ViewDetections.empty() if t is None else one for t, one in zip(times, seen, strict=True))
        image = np.full((SIZE_WH[1], SIZE_WH[0], 3), 90, np.uint8)
        frames = tuple(ViewFrame(k, t, image) if images and t is not None else None for t in times)
        made.append(Instant(FrameSet(k, t_ns, frames, times), views))
    return made


def recorder_of(site, path, rulebook, **options):
    metadata = {
        PLACING_KEY: options_text(PlacingOptions()),
        VIEWS_KEY: ",".join(site.rig.camera_ids),
        "model.site": "site.onnx 00",
        "notice.site": NOTICE,
        "rules": rulebook.rules.name,
    }
    rig_json = site.rig_path.read_bytes()
    toml = rulebook.toml
    return Recorder(path, rig=site.rig, rig_json=rig_json, metadata=metadata, rules_toml=toml, **options), metadata


def judged_run(site, name, *, absent=(), images=False, **listeners):
    """A recorded run by the rules of the site; the recording and the result."""
    path, rulebook = site.folder / name, read_rulebook(site.folder / "hats.rules.toml")
    recorder, metadata = recorder_of(site, path, rulebook)
    watch = watch_of(rulebook.rules, site.rig, metadata, read_rigfile(site.rig_path).geometry_digest)
    with recorder:
        of_run = instants(site, absent=absent, images=images)
        result = run(site.rig, of_run, recorder, RunOptions(), watch=watch, **listeners)
    return path, result
