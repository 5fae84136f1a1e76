"""Claims about the demo's comparison with the truth and its page, on a small made-up site."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recognition.evaluation.found import compare_events
from recognition.evaluation.violations import KINDS as VIOLATIONS
from recognition.evaluation.violations import Stretch, Violations
from recognition.events import Actor, Event
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigdocument import SigmaEntry
from rigcal.rigfile import document_of_rig
from rigcal.synthetic import arc_rig
from tools.demo_page import KINDS, Results, Step, ground_tracks, shown_instants, write_page
from tools.demo_pictures import ViewPicture
from tools.demo_truth import Truth, camera_errors, clock_errors, floor_error, workers_found

EPOCH_S = 1_790_000_000.0
FRAMES, WORKERS = 20, 2
OFFSET_S = 0.02


def rig(offset_s=OFFSET_S, bound_s=0.001, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    simulated = arc_rig(3, seed=1)
    clock = ClockModel(offset_s, 5.0, "2026-09-21T14:13:20Z", bound_s, 0.1, "probe")
    cameras = [
        RigCamera(
            one.id, one.camera, one.cam_from_rig if k == 0 else one.cam_from_rig.perturbed(turn, shift), None, clock
        )
        for k, one in enumerate(simulated.cameras)
    ]
    made = Rig("demo", tuple(cameras), "cam0", "IMPORTED", simulated.world_from_rig)
    return document_of_rig(made, created_utc="2026-11-22T09:00:00Z", inputs_sha256="0" * 64)


def known(document, *, position_m=0.002, rotation_deg=0.02):
    sigma = SigmaEntry(fx_px=1, fy_px=1, cx_px=1, cy_px=1, position_m=position_m, rotation_deg=rotation_deg)
    cameras = [one.model_copy(update={"sigma": sigma}) for one in document.cameras]
    return document.model_copy(update={"cameras": tuple(cameras)})


@pytest.fixture
def truth():
    rng = np.random.default_rng(3)
    joints = rng.normal(0, 0.3, (1, WORKERS, 17, 3)) + np.array([[-1.0, 0, 1], [1.0, 0.5, 1]])[:, None]
    walked = joints + np.linspace(0, 0.4, FRAMES)[:, None, None, None] * [0, 1, 0]
    facts = {
        "epoch_s": EPOCH_S,
        "instants_s": [round(0.1 * k, 6) for k in range(FRAMES)],
        "objects": [],
        "violations": [
            {"kind": "window", "start_s": 0.2, "end_s": 1.2, "workers": ["a"], "things": ["w"]},
            {"kind": "platform", "start_s": 0.1, "end_s": 0.2, "workers": ["a", "b"], "things": ["p"]},
        ],
    }
    arrays = {"joints_m": walked, "worker_pixels": np.full((FRAMES, 3, WORKERS), 900)}
    return Truth(facts, arrays, rig())


def poses_file(path, truth, *, shift_m=0.0, leave_out=0, ghosts=0):
    rows = [(f, w) for f in range(FRAMES) for w in range(WORKERS)][leave_out:]
    joints = np.array([truth.arrays["joints_m"][f, w] + [shift_m, 0, 0] for f, w in rows])
    ghost = np.full((ghosts, 17, 3), 9.0)
    frames = np.array([f for f, _ in rows] + [0] * ghosts)
    np.savez(
        path, frame=frames, t_ns=np.int64(EPOCH_S * 1e9) + frames * 100_000_000,
        track_id=np.array([w + 1 for _, w in rows] + [9] * ghosts), joints_m=np.concatenate([joints, ghost]),
        views=np.full((len(frames), 17), 3),
    )  # fmt: skip


def test_cameras_are_judged_by_the_stricter_of_both_limits():
    exact = camera_errors(known(rig()), rig())
    assert [one.holds for one in exact] == [True] * 3
    moved = camera_errors(known(rig(shift=(0.003, 0, 0))), rig())[1]
    assert (moved.position_mm, moved.position_limit_mm, moved.holds) == (pytest.approx(3.0), pytest.approx(4.0), True)
    assert not camera_errors(known(rig(shift=(0.005, 0, 0))), rig())[1].holds  # above two sigma
    assert not camera_errors(known(rig(shift=(0.009, 0, 0)), position_m=0.02), rig())[1].holds  # above 8 mm
    turned = camera_errors(known(rig(turn=(0, np.deg2rad(0.05), 0)), position_m=1.0), rig())[1]
    assert turned.rotation_deg == pytest.approx(0.05)
    assert not turned.holds


def test_clocks_are_judged_by_their_own_bound_over_the_recording(truth):
    (right, *_) = clock_errors(rig(offset_s=OFFSET_S + 0.0005), truth)
    assert right.error_ms == pytest.approx(0.5, abs=1e-3)
    assert right.holds
    assert not clock_errors(rig(offset_s=OFFSET_S + 0.0012), truth)[0].holds


def test_workers_are_counted_found_missed_and_false(truth, tmp_path):
    poses_file(tmp_path / "poses.npz", truth, shift_m=0.03, leave_out=4, ghosts=3)
    found = workers_found(truth, tmp_path / "poses.npz")
    assert (found.there, found.found, found.false) == (FRAMES * WORKERS, FRAMES * WORKERS - 4, 3)
    assert found.error_mm(50) == pytest.approx(30.0)
    assert found.share == pytest.approx(0.9)


def found(*spans):
    """Events of the window beside a truth in which it is carried by one alone from 0.2 s to 1.2 s."""
    start_ns = round(EPOCH_S * 1e9)
    events = [
        Event(
            f"e{n}", "window", "one alone", "warning", start_ns + round(a * 1e9), start_ns + round(a * 1e9),
            start_ns + round(b * 1e9), (Actor("worker", 1, "w"),), (), ("cam0",), 1.0, "MONITORED", "r", "g", "PASS",
        )
        for n, (a, b) in enumerate(spans)
    ]  # fmt: skip
    stretches = tuple((Stretch(0.2, 1.2),) if kind == "window" else () for kind in VIOLATIONS)
    return compare_events(Violations(start_ns, stretches), events)


def test_the_page_holds_every_section_picture_and_figure(truth, tmp_path):
    poses_file(tmp_path / "poses.npz", truth)
    document = known(rig())
    results = Results(
        document=document,
        truth=truth,
        cameras=camera_errors(document, truth.rig),
        floor=floor_error(document, truth.rig),
        clocks=clock_errors(document, truth),
        workers=workers_found(truth, tmp_path / "poses.npz"),
        objects=(),
        tracks=ground_tracks(tmp_path / "poses.npz"),
        probed_s=240.0,
        violations=found((0.3, 1.1), (1.75, 1.9)),
        warnings=("networks <trained on simulated sites>",),
        steps=(Step("rigcal calibrate", 12.5),),
    )
    assert [at for at, _ in shown_instants(truth)] == [7]  # a tenth of a second of platform has no picture
    pictures = [[ViewPicture(f"cam{k}", "data:image/jpeg;base64,AAAA") for k in range(3)]]
    write_page(results, pictures, tmp_path / "index.html")
    page = (tmp_path / "index.html").read_text()
    for section in ("pictures", "cameras", "clocks", "plan", "found", "violations", "steps"):
        assert f'<section id="{section}">' in page
    assert page.count("<img src=") == 3
    assert page.count('class="found"') == page.count('class="true"') == WORKERS
    assert "6 of 6 limits on cameras and clocks are kept" in page
    assert "networks &lt;trained on simulated sites&gt;" in page
    assert "1 of 1 violations were found within a second of their start; 1 were found where there was none" in page
    assert page.count('<i class="was"') == 2
    assert page.count('<i class="judged"') == page.count('<i class="judged false"') == 1
    assert "left:15.00%;width:40.00%" in page  # 0.3 to 1.1 of 2.0 s
    assert "+0.10" in page
    assert all(words in page for words in KINDS.values())
    assert 'src="http' not in page
    assert 'href="http' not in page
    write_page(results, pictures, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_text() == page


def test_the_demo_needs_neither_the_generator_nor_what_it_renders_and_trains_with():
    asked = "import sys, tools.demo; print(*{name.partition('.')[0] for name in sys.modules}, *sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    ).stdout.split()
    assert "tools.demo_truth" in told
    assert not {"tools.sicsg", "tools.train", "moderngl", "bpy", "torch"} & set(told)
