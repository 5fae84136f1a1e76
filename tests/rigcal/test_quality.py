"""Measures beyond the RMSE, and the gates: each fails alone on a figure on the wrong side of its limit."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rigcal._colmap import solve_with_colmap
from rigcal.board import Checkerboard
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site
from rigcal.quality import AT_LEAST, CameraFigures, JointQuality, judge, verdict
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_camera, board_poses_for_pair, exact_detections, with_noise

BOARD = Checkerboard(9, 6, 0.06)


@pytest.fixture(scope="module")
def solved():
    rig = arc_rig(3, arc_deg=80)
    poses, seen = [], []
    for one, two in (("cam0", "cam1"), ("cam1", "cam2")):
        poses += board_poses_for_pair(rig, one, two, BOARD, 12, distance_m=(1.5, 5), seed=len(poses))
        seen += [(one, two)] * 12
    for one in rig.camera_ids:
        poses += board_poses_for_camera(rig, one, BOARD, 8, distance_m=(0.7, 2.2), seed=len(poses))
        seen += [(one,)] * 8
    detections = with_noise(exact_detections(rig, BOARD, poses, seen_by=seen), 0.2, seed=1)
    options = CalibrateOptions()
    return rig, calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)


def test_a_good_rig_passes_every_gate(solved):
    _, result = solved
    assert result.verdict == "PASS"
    assert all(gate.passed and gate.advice is None for gate in result.gates)


def test_positions_lie_within_their_sigmas(solved):
    rig, result = solved
    for index, camera in enumerate(rig.cameras):
        found, true = (pose.inverse().translation_m for pose in (result.joint.cam_from_rig[index], camera.cam_from_rig))
        assert np.linalg.norm(found - true) <= 3 * result.quality.position_sigma_m[index]


def test_held_out_error_is_a_little_above_the_refined(solved):
    _, result = solved
    for held, rmse in zip(result.quality.held_out_px, result.rmse, strict=True):
        assert 0.97 < held / rmse.refined < 1.15


def test_halves_agree_within_their_sigmas(solved):
    assert 0.3 < solved[1].quality.split_half < 2.0


@pytest.mark.parametrize("model", ["opencv4", "opencv5", "fisheye4"])
def test_the_second_solver_agrees_from_another_start(model):
    rig = arc_rig(2, arc_deg=50, model=model)
    poses = board_poses_for_pair(rig, "cam0", "cam1", BOARD, 12, distance_m=(1.2, 4), seed=1)
    detections = with_noise(exact_detections(rig, BOARD, poses), 0.2, seed=1)
    options = CalibrateOptions(model)
    result = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)
    assert result.quality.solver_agreement < 0.5
    start = result.joint.start
    moved = replace(
        start, cam_from_rig=(start.cam_from_rig[0], start.cam_from_rig[1].perturbed([0.01] * 3, [0.02] * 3))
    )
    opinion = solve_with_colmap(
        result.joint.observations, replace(moved, cameras=result.joint.cameras), free_lenses=[True, True]
    )
    assert opinion.free_lenses == (model != "opencv5",) * 2
    gap = opinion.cam_from_rig[1] @ result.joint.cam_from_rig[1].inverse()
    assert np.linalg.norm(gap.translation_m) < 0.5 * result.quality.position_sigma_m[1]


GOOD_CAMERAS = (
    CameraFigures("a", None, 0.2, None, 0.25, 20, None),
    CameraFigures("b", "a", 0.2, 0.5, 0.25, 20, 10),
)
GOOD = JointQuality(
    held_out_px=(0.26, 0.26),
    split_half=1.0,
    solver_agreement=0.01,
    lens_sigma=(np.ones(9), np.ones(9)),
    focal_sigma_percent=(0.1, 0.1),
    position_sigma_m=(0.0, 0.004),
    rotation_sigma_deg=(0.0, 0.1),
    scene_centre_m=np.zeros(3),
    scene_sigma_m=0.004,
    image_coverage=(0.5, 0.5),
    tilt_spread_deg=(25.0, 25.0),
)
LIMITS = GateLimits().model_dump()


def test_the_good_figures_pass():
    gates = judge(GOOD_CAMERAS, GOOD, LIMITS)
    assert verdict(gates) == "PASS"
    judged = {gate.name for gate in gates}
    assert judged == set(LIMITS) - {"scale_percent", "clock_error_m"}  # those need a given length, and clocks


def second_camera(**changes):
    return (GOOD_CAMERAS[0], replace(GOOD_CAMERAS[1], **changes)), GOOD


@pytest.mark.parametrize(
    ("name", "spoiled"),
    [
        ("intrinsic_rmse_px", second_camera(intrinsic_rmse_px=0.9)),
        ("pairwise_rmse_px", second_camera(pairwise_rmse_px=3.0)),
        ("refined_rmse_px", second_camera(refined_rmse_px=1.4)),
        ("views", second_camera(views=3)),
        ("chain_overlap_views", second_camera(chain_overlap_views=2)),
        ("held_out_ratio", (GOOD_CAMERAS, replace(GOOD, held_out_px=(0.26, 0.9)))),
        ("held_out_ratio", (GOOD_CAMERAS, replace(GOOD, held_out_px=(0.26, None)))),
        ("focal_sigma_percent", (GOOD_CAMERAS, replace(GOOD, focal_sigma_percent=(0.1, 2.0)))),
        ("position_sigma_m", (GOOD_CAMERAS, replace(GOOD, position_sigma_m=(0.0, 0.2)))),
        ("tilt_spread_deg", (GOOD_CAMERAS, replace(GOOD, tilt_spread_deg=(25.0, 3.0)))),
        ("image_coverage", (GOOD_CAMERAS, replace(GOOD, image_coverage=(0.5, 0.02)))),
        ("scene_sigma_m", (GOOD_CAMERAS, replace(GOOD, scene_sigma_m=0.2))),
        ("split_half", (GOOD_CAMERAS, replace(GOOD, split_half=60.0))),
        ("split_half", (GOOD_CAMERAS, replace(GOOD, split_half=None))),
        ("solver_agreement", (GOOD_CAMERAS, replace(GOOD, solver_agreement=7.0))),
    ],
)
def test_each_gate_fails_alone_and_says_what_to_do(name, spoiled):
    gates = judge(*spoiled, LIMITS)
    failed = [gate for gate in gates if not gate.passed]
    assert [gate.name for gate in failed] == [name]
    assert verdict(gates) == "RECAPTURE"
    (gate,) = failed
    assert len(gate.advice) > 20
    assert "{" not in gate.advice
    if gate.camera:
        assert gate.camera == "b"
        assert re.search(r"\bb\b", gate.advice)
    if gate.value is None:
        assert gate.advice.startswith("too few views to measure this")
    else:
        assert (gate.value < gate.limit) if name in AT_LEAST else (gate.value > gate.limit)
