"""A simulated sequence with a known violation, and truths by hand, for the tests of the evaluation of violations."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from recognition.evaluation.violations import KINDS, ObservedSequence, Rules, SceneTruth, Stretch
from recognition.observations import FrameSet, Instant
from recognition.rules import parse_rules
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe

FPS, FRAMES = 5.0, 30
BARE_S = (1.5, 4.0)
"""When worker 0 wears no hat."""

HEAD = 'format = "recognition.rules"\nversion = 1\n'


def rule(name, when, more=""):
    return f'[[rules]]\nname = "{name}"\nsentence = "x"\nwhen = "{when}"\n{more}\n'


OURS = HEAD + "".join([
    rule("no_hat", "each w: visible(w.head) and not exists hard_hat o of w: dist(w.head, o) < 0.14 H"),
    rule("ladder", "each ladder l: count(w: dist(w.torso, l, xy) < 0.1 m) == 1"),
    rule("window", "each large_window o: count(w: dist(w.torso, o, xy) < 0.1 m) == 1"),
    rule("platform", "each platform p: count(w: dist(w.feet, p) < 0.1 m) >= 2"),
])  # fmt: skip
PAPER = HEAD + '[definitions]\n"wears(w)" = "exists hard_hat o: dist(w.neck, o) < 0.25 H"\n' + "".join([
    rule("no_hat", "each w: not wears(w)", "for_s = 0\nclear_s = 0"),
    rule("ladder", "each ladder l: count(w: dist(w.torso, l) < 0.10 H) == 1", "for_s = 0"),
    rule("window", "each large_window o: count(w: dist(w.torso, o) < 0.10 H) == 1", "for_s = 0"),
    rule("platform", "each platform p: count(w: dist(w.feet, p) < 0.10 H) >= 2", "for_s = 0"),
])  # fmt: skip


def rules():
    return Rules(parse_rules(OURS, "ours.rules.toml"), parse_rules(PAPER, "paper.rules.toml"))


def truth(
    stretches, *, frames=30, period_s=0.2, name="a", light="indoor", hidden=0.0, seen_by=None, split="validation"
):
    """Of violations by name, as lists of (start, end)."""
    t_s = np.arange(frames) * period_s
    own = tuple(tuple(Stretch(*each) for each in stretches.get(kind, ())) for kind in KINDS)
    seen = np.full((frames, len(KINDS)), -1) if seen_by is None else seen_by
    return SceneTruth(name, split, light, np.rint(t_s * 1e9).astype(np.int64), 0, own, np.full(frames, hidden), seen)


def decided(truth, stretches):
    """(1, F, K) decisions that are true within these spans [start, end)."""
    result = np.zeros((1, len(truth.t_ns), len(KINDS)), dtype=bool)
    for kind, spans in stretches.items():
        for start_s, end_s in spans:
            result[0, :, KINDS.index(kind)] |= (truth.t_s >= start_s - 1e-9) & (truth.t_s < end_s - 1e-9)
    return result


def observed_sequence(*, name="a", seed=3, recording=Path("none.mcap")):
    """Three workers with hats, the first of whom takes it off for a while; exact detections of four cameras."""
    rig = semicircle_rig()
    site = simulate(rig, workers=3, frames=FRAMES, fps=FPS, seed=seed)
    instants = []
    for frame, t_ns in enumerate(site.t_ns.tolist()):
        views = tuple(_without_hat(view, t_ns * 1e-9) for view in observe(site, frame))
        instants.append(Instant(FrameSet(frame, t_ns, (None,) * 4), views))
    known = truth({"no_hat": [BARE_S]}, frames=FRAMES, name=name)
    return ObservedSequence(known, rig, tuple(instants), recording)


def _without_hat(view, t_s):
    seen = view.detections
    if not BARE_S[0] <= t_s < BARE_S[1]:
        return seen
    kept = [n for n, label in enumerate(view.object_idx) if label != 0]
    return replace(
        seen,
        object_class=tuple(seen.object_class[n] for n in kept),
        object_xyxy=seen.object_xyxy[kept],
        object_score=seen.object_score[kept],
        object_keypoints_px=seen.object_keypoints_px[kept],
    )


def write_truth(folder, *, violations, frames=10, split="validation", shown=None, **changed):
    """Truth files of two workers, a ladder and two cameras; ``shown`` (F, V, 3) is how much of each is seen."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = np.ones((frames, 2, 3)) if shown is None else shown
    full = np.full(shown.shape, 1000.0)
    pixels = shown * full
    np.savez(
        folder / "truth.npz",
        worker_pixels=pixels[..., :2], worker_full_pixels=full[..., :2],
        object_pixels=pixels[..., 2:], object_full_pixels=full[..., 2:],
    )  # fmt: skip
    facts = {
        "format": "sicsg.sequence", "version": 1, "epoch_s": 100.0, "split": split, "light": "dusk",
        "cameras": ["cam0", "cam1"], "workers": ["w0", "w1"], "objects": [{"id": "ladder-0", "class": "ladder"}],
        "instants_s": [round(0.2 * n, 6) for n in range(frames)], "violations": violations,
    } | changed  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(facts))
    return folder


def violation(kind, start_s, end_s, workers=("w0",), things=()):
    return {"kind": kind, "start_s": start_s, "end_s": end_s, "workers": list(workers), "things": list(things)}
