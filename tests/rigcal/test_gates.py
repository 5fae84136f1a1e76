"""The gates: each fails alone on a figure on the wrong side of its limit, and says where to show the board next."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.advice import CameraFigures, RigFigures, Sister
from rigcal.board import Checkerboard
from rigcal.coverage import ImageCoverage, common_parts, named_parts
from rigcal.gates import AT_LEAST, judge, verdict
from rigcal.halves import Movement, SplitHalf
from rigcal.pipeline import CalibrateOptions, Known, calibrate_lenses, calibrate_site
from rigcal.scale import ScaleCheck
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_camera, board_poses_for_pair, exact_detections, with_noise

LIMITS = GateLimits().model_dump()
SEEN = ImageCoverage(0.5, np.full((3, 3), 0.5), np.linspace(0.8, 3.2, 20), np.full(20, 30.0), 25.0, (0.7, 2.1))
FIRST = CameraFigures("a", 0.2, 0.22, 0.23, 0.1, 0.0, SEEN)
SECOND = CameraFigures(
    "b", 0.2, 0.22, 0.23, 0.1, 0.0, SEEN,
    parent_id="a", pairwise_rmse_px=0.5, position_sigma_m=0.004, chain_overlap_views=10,
    weakest=("b", "a"), common_parts="the left edge", lens_agreement=1.0, sister=Sister(("a",), 0.3, 0.5),
)  # fmt: skip
RIG = RigFigures(
    ("a", "b"), 0.004, 12, SplitHalf(1.0, 0.2, (0, 1), None), 0.01, ScaleCheck(0.5, 0.2, (), "measure"), 0.0, ("b", "a")
)


def seen(**changes):
    return replace(SEEN, **changes)


def failing(camera=SECOND, rig=RIG, limits=LIMITS):
    return [gate for gate in judge((FIRST, camera), rig, limits) if not gate.passed]


def advice(**changes):
    (words,) = {gate.advice for gate in failing(replace(SECOND, **changes))}
    return words


def test_the_good_figures_pass():
    gates = judge((FIRST, SECOND), RIG, LIMITS)
    assert verdict(gates) == "PASS"
    assert {gate.name for gate in gates} == set(LIMITS) - {"clock_error_m"}  # judged once clocks are measured
    assert all(gate.advice is None for gate in gates)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("intrinsic_rmse_px", {"intrinsic_rmse_px": 0.9}),
        ("pairwise_rmse_px", {"pairwise_rmse_px": 3.0}),
        ("refined_rmse_px", {"refined_rmse_px": 1.4, "held_out_px": 1.4}),
        ("dropped_share", {"dropped_share": 0.6}),
        ("views", {"coverage": ImageCoverage(0.5, SEEN.parts, SEEN.distances_m[:3], SEEN.tilts_deg[:3], 25.0, (1, 2))}),
        ("chain_overlap_views", {"chain_overlap_views": 2}),
        ("held_out_ratio", {"held_out_px": 0.9}),
        ("held_out_ratio", {"held_out_px": None}),
        ("focal_sigma_percent", {"focal_sigma_percent": 2.0}),
        ("focal_sigma_percent", {"focal_sigma_percent": None}),
        ("position_sigma_m", {"position_sigma_m": 0.2}),
        ("tilt_spread_deg", {"coverage": seen(tilt_spread_deg=3.0)}),
        ("image_coverage", {"coverage": seen(share=0.02)}),
        ("lens_agreement", {"lens_agreement": 9.0}),
        ("sister_percent", {"sister": Sister(("a",), -3.1, -8.0)}),
    ],
)
def test_each_gate_of_a_camera_fails_alone_and_names_it(name, changes):
    (gate,) = failing(replace(SECOND, **changes))
    assert (gate.name, gate.camera) == (name, "b")
    assert gate.advice
    assert "{" not in gate.advice
    assert " b" in gate.advice
    if gate.value is not None:
        assert (gate.value < gate.limit) if name in AT_LEAST else (gate.value > gate.limit)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("scene_sigma_m", {"scene_sigma_m": 0.2}),
        ("scene_sigma_m", {"scene_sigma_m": None}),
        ("split_half", {"split_half": SplitHalf(60.0, 3.0, (0, 1), None)}),
        ("split_half", {"split_half": None}),
        ("solver_agreement", {"solver_agreement": 7.0}),
        ("scale_percent", {"scale": ScaleCheck(-2.6, 0.2, (), "the board was entered 2.6 % too small")}),
    ],
)
def test_each_gate_of_the_rig_fails_alone(name, changes):
    (gate,) = failing(rig=replace(RIG, **changes))
    assert (gate.name, gate.camera) == (name, None)
    assert len(gate.advice) > 20
    if name == "scale_percent":
        assert gate.value == 2.6  # without its sign, which the advice tells


# --- advice -----------------------------------------------------------------------------------------------------------


def test_one_walk_with_the_board_mends_every_gate_that_lacks_views():
    parts = np.full((3, 3), 0.5)
    parts[0, 0] = parts[2, 0] = 0.0
    few = ImageCoverage(0.1, parts, np.array([2.9, 3.2, 3.4, 3.1]), np.full(4, 5.0), 4.0, (0.7, 2.1))
    gates = failing(replace(SECOND, coverage=few, focal_sigma_percent=1.9, held_out_px=0.5))
    assert {g.name for g in gates} == {
        "held_out_ratio", "focal_sigma_percent", "views", "tilt_spread_deg", "image_coverage",
    }  # fmt: skip
    assert {gate.advice for gate in gates} == {
        "show b the board at the top left and the bottom left of its image, near and far (0.70 to 2.10 m; so far 2.9 "
        "to 3.4 m), tilted by 20-45 degrees to all sides, in 11 or more positions"
    }


def test_how_many_views_follows_from_the_sigma():
    """20 views leave 1.5 % of sigma; 1 % takes (1.5/1)^2 = 2.25 times as many, 25 more, of which 20 are asked for."""
    assert "in 20 or more positions" in advice(focal_sigma_percent=1.5)
    assert "in 9 or more positions" in advice(focal_sigma_percent=1.2)
    assert "in 4 or more positions" in advice(focal_sigma_percent=1.01)


def test_shared_views_are_asked_for_where_both_cameras_look():
    assert advice(chain_overlap_views=1, position_sigma_m=0.03) == (
        "show the board to b and a together at the left edge of b's image, as near as both see it whole, tilted by "
        "20-45 degrees, in 4 or more positions"
    )


def test_a_camera_far_down_the_chain_is_mended_at_its_weakest_link():
    assert advice(position_sigma_m=0.04, weakest=("d", "c"), chain_overlap_views=5).startswith(
        "show the board to d and c together"
    )


def test_views_that_contradict_are_not_mended_by_more_of_them():
    camera = replace(SECOND, dropped_share=0.5, position_sigma_m=0.2, chain_overlap_views=1, held_out_px=2.0)
    rig = replace(RIG, split_half=None, scene_sigma_m=0.2, spread_s=0.043)
    (words,) = {gate.advice for gate in failing(camera, rig)}
    assert words == (
        "views of b contradict those of other cameras: fasten every camera, hold the board still at each position "
        "(frames of one instant lie up to 43 ms apart) and capture again; if it stays, see that its images are of the "
        "same time and not mirrored"
    )


def test_a_camera_that_fits_alone_but_not_together_contradicts():
    """No gate on an RMSE fails, but more views of the same kind would not help either."""
    camera = replace(SECOND, refined_rmse_px=0.26, held_out_px=0.9, position_sigma_m=0.05, lens_agreement=None)
    assert {gate.name for gate in failing(camera)} == {"held_out_ratio", "position_sigma_m"}
    assert all(gate.advice.startswith("views of b contradict") for gate in failing(camera))
    (again,) = {gate.advice for gate in failing(replace(camera, refined_rmse_px=0.22, held_out_px=0.3))}
    assert again.startswith("show the board to b and a together")


def test_a_camera_that_moved_is_named():
    (gate,) = failing(rig=replace(RIG, split_half=SplitHalf(9.0, 1.0, (0, 1), Movement(1, 0.31, 0.012))))
    assert gate.advice == (
        "fasten b and capture again: between the earlier and the later views it moved by 0.31 degrees and 12 mm"
    )


def test_halves_that_cannot_be_solved_apart_are_told():
    (gate,) = failing(rig=replace(RIG, split_half=None))
    assert gate.value is None
    assert gate.advice.startswith("the halves of the capture cannot be solved apart: show each camera the board")
    assert gate.advice.endswith("begin with b and a")


def test_an_odd_sister_is_told_with_its_sigmas():
    assert advice(sister=Sister(("a", "c"), 3.13, 8.2)) == (
        "check the zoom and focus of b and show it more views: its focal length is 3.1 % longer than its sisters' "
        "(a, c), 8 sigma"
    )


@pytest.mark.parametrize(
    ("empty", "words"),
    [
        ([], ""),
        ([(0, 0)], "the top left"),
        ([(0, 0), (1, 1)], "the top left and the middle"),
        ([(0, 0), (0, 1), (0, 2), (2, 1)], "the top edge and the bottom"),
        ([(0, 0), (0, 1), (0, 2), (1, 0), (2, 0)], "the top edge and the left edge"),
        ([(r, c) for r in range(3) for c in range(3) if (r, c) != (1, 1)], "every edge and corner"),
        ([(r, c) for r in range(3) for c in range(3)], "every part"),
    ],
)
def test_parts_of_an_image_have_names(empty, words):
    chosen = np.zeros((3, 3), dtype=bool)
    for part in empty:
        chosen[part] = True
    assert named_parts(chosen) == words


# --- from a capture ---------------------------------------------------------------------------------------------------


BOARD = Checkerboard(9, 6, 0.06)


@pytest.fixture(scope="module")
def one_sided():
    """cam1 sees the board in the right half of its image only, and is declared like cam0."""
    rig = arc_rig(2, arc_deg=40)
    shared = board_poses_for_pair(rig, "cam0", "cam1", BOARD, 60, distance_m=(2, 5), seed=1)
    single = board_poses_for_camera(rig, "cam0", BOARD, 8, distance_m=(0.7, 2.2), seed=2)
    centre = BOARD.corners_in_board.mean(axis=0)
    camera = rig.cameras[1]
    right = [p for p in shared if camera.camera.project((camera.cam_from_rig @ p).apply(centre))[0] > 1100][:14]
    poses, seen_by = [*right, *single], [("cam0", "cam1")] * len(right) + [("cam0",)] * 8
    detections = with_noise(exact_detections(rig, BOARD, poses, seen_by=seen_by), 0.1, seed=1)
    options = CalibrateOptions("opencv5")
    lenses = calibrate_lenses(detections, None, options)
    known = Known(sisters=(("cam0", "cam1"),))
    return calibrate_site(detections, GateLimits(image_coverage=0.99), lenses, options, known=known)


def test_the_advice_of_a_capture_names_the_empty_side_and_the_distances(one_sided):
    gate = next(g for g in one_sided.gates if (g.name, g.camera) == ("image_coverage", "cam1"))
    coverage = one_sided.quality.coverage[1]
    assert coverage.parts[:, 0].max() < 0.1 < coverage.parts[1, 2]
    assert "the left edge" in gate.advice
    near, far = coverage.board_distances_m
    assert near == pytest.approx(0.48 * one_sided.joint.cameras[1].params[:2].mean() / 960, rel=1e-6)
    assert far == pytest.approx(3 * near)
    assert f"({near:.2f} to {far:.2f} m; so far " in gate.advice
    assert 2 < coverage.distances_m.min() < coverage.distances_m.max() < 6


def test_where_two_cameras_look_together_but_no_board_was_is_found(one_sided):
    distances = one_sided.quality.coverage[1].distances_m
    words = common_parts(one_sided.joint, 1, 0, distances)
    assert "left" in words
    assert "right" not in words.replace("top right", "").replace("bottom right", "")


def test_sisters_of_a_capture_are_judged(one_sided):
    first, second = (camera.params[:2].mean() for camera in one_sided.joint.cameras)
    values = [gate.value for gate in one_sided.gates if gate.name == "sister_percent"]
    assert values == pytest.approx([100 * abs(first / second - 1), 100 * abs(second / first - 1)], rel=1e-4)
    assert 0.1 < values[0] < 2.0
