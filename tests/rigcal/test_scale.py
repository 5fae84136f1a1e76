"""The scale of a rig against lengths measured by hand: how much the board is off, in which direction, what to do."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.board import AprilGrid, Checkerboard
from rigcal.errors import MeasuredLengthError
from rigcal.geometry import Pose
from rigcal.measured import MeasuredDistance, parse_distance, parse_measured_length, require_cameras
from rigcal.pipeline import CalibrateOptions, Known, calibrate_lenses, calibrate_site
from rigcal.scale import check_scale
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_camera, board_poses_for_pair, exact_detections, with_noise
from rigcal.uncertainty import RigCovariance, camera_distance

BOARD = Checkerboard(9, 6, 0.06)
IDS = ("cam0", "cam1", "cam2")


def at(*centres_m):
    return tuple(Pose(np.eye(3), -np.array(centre, dtype=float)) for centre in centres_m)


POSES = at([0, 0, 0], [2, 0, 0], [0, 0, 3])
EXACT = RigCovariance((), np.zeros((0, 0)))


def checked(*distances, square=None, board=BOARD, covariance=EXACT):
    return check_scale(
        board,
        IDS,
        POSES,
        covariance,
        distances=[parse_distance(text) for text in distances],
        square=parse_measured_length(square, "--measured-square") if square else None,
    )


# --- reading ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "length_m", "sigma_m"),
    [
        ("2.41m", 2.41, 0.005),
        ("2.4 m", 2.4, 0.05),
        ("241cm", 2.41, 0.005),
        ("59.60mm", 0.0596, 5e-6),
        ("3m", 3.0, 0.5),
        ("1.5e2cm", 1.5, 0.05),
    ],
)
def test_a_length_is_as_precise_as_it_was_written(text, length_m, sigma_m):
    length = parse_measured_length(text, "--measured-square")
    assert length.length_m == pytest.approx(length_m, rel=1e-12)
    assert length.sigma_m == pytest.approx(sigma_m, rel=1e-9)
    assert length.text == text


def test_a_distance_names_two_cameras():
    distance = parse_distance("cam0, back door:2.41m")
    assert distance.cameras == ("cam0", "back door")
    assert distance.spec == "cam0,back door:2.41m"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("cam0,cam1:2.41", "the size '2.41' has no unit"),
        ("cam0,cam1:2.41ft", "unknown unit 'ft' in '2.41ft'"),
        ("cam0,cam1:-2m", "'-2m' is not a length"),
        ("cam0,cam1:0m", "the size '0m' is not positive"),
        ("cam0,cam1", "'cam0,cam1' is not CAMERA,CAMERA:LENGTH"),
        ("cam0:2m", "'cam0:2m' is not CAMERA,CAMERA:LENGTH"),
        ("cam0,cam1,cam2:2m", "'cam0,cam1,cam2:2m' is not CAMERA,CAMERA:LENGTH"),
        ("cam0,:2m", "'cam0,:2m' is not CAMERA,CAMERA:LENGTH"),
        ("cam0,cam0:2m", "both ends are camera cam0"),
    ],
)
def test_a_malformed_distance_is_told_with_its_form(text, problem):
    with pytest.raises(MeasuredLengthError) as caught:
        parse_distance(text)
    message = str(caught.value)
    assert f"cannot use this measured length: {problem}" in message
    assert "where:    --distance" in message
    assert "such as cam0,cam1:2.41m" in message
    assert "do next:  write it like --distance cam0,cam1:2.41m, in mm, cm or m" in message


def test_a_malformed_square_is_told_with_its_form():
    with pytest.raises(MeasuredLengthError) as caught:
        parse_measured_length("59.6", "--measured-square")
    message = str(caught.value)
    assert "the size '59.6' has no unit" in message
    assert "do next:  write it like --measured-square 59.6mm" in message


def test_an_unknown_camera_is_named_with_those_that_there_are():
    with pytest.raises(MeasuredLengthError) as caught:
        require_cameras([parse_distance("cam0,cam9:2m")], IDS)
    assert "there is no camera cam9; the cameras are cam0, cam1, cam2" in str(caught.value)
    require_cameras([parse_distance("cam0,cam2:2m")], IDS)


# --- judging ----------------------------------------------------------------------------------------------------------


def test_nothing_measured_is_nothing_checked():
    assert checked() is None


def test_a_rig_longer_than_the_tape_means_a_board_entered_too_large():
    check = checked("cam0,cam1:1.961m")
    assert check.percent == pytest.approx(1.99, abs=0.01)
    assert check.advice == (
        "the board was entered 2.0 % too large (one sigma 0.0 %): enter the square as 58.83mm (you gave 60mm), or "
        "measure again (cam0-cam1 is 2.000m here and 1.961m by tape)"
    )


def test_a_rig_shorter_than_the_tape_means_a_board_entered_too_small():
    check = checked("cam1,cam0:2.105m")
    assert check.percent == pytest.approx(-4.99, abs=0.01)
    assert check.advice.startswith("the board was entered 5.0 % too small")
    assert "enter the square as 63.15mm (you gave 60mm)" in check.advice


def test_distances_are_joined_by_their_precision():
    """2.0 m written to 50 mm says little beside 3.000 m written to half a millimetre."""
    check = checked("cam0,cam1:2.1m", "cam0,cam2:3.000m")
    assert abs(check.percent) < 0.01
    assert [item.name for item in check.evidence] == ["cam0-cam1", "cam0-cam2"]
    assert check.sigma_percent < check.evidence[1].sigma_percent


def test_distances_that_contradict_each_other_are_measured_again():
    check = checked("cam0,cam1:2.20m", "cam0,cam2:3.000m")
    assert check.percent == pytest.approx(-9.1, abs=0.1)
    assert check.advice.startswith("the measured distances contradict each other")
    assert check.advice.endswith("measure cam0-cam1 again, then the others")


def test_the_uncertainty_of_the_rig_counts():
    index = [(1, unknown) for unknown in range(6)]
    covariance = RigCovariance(tuple(index), np.diag([0, 0, 0, 0.04, 0.04, 0.04]) ** 2)
    distance, sigma = camera_distance(POSES, covariance, 0, 1)
    assert (distance, sigma) == pytest.approx((2.0, 0.04))
    assert checked("cam0,cam1:2.000m", covariance=covariance).sigma_percent == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize(("board", "part"), [(BOARD, "square"), (AprilGrid(6, 6, 0.06), "tag")])
def test_the_printed_board_is_compared_with_the_one_entered(board, part):
    check = checked(square="58.5mm", board=board)
    assert check.percent == pytest.approx(2.56, abs=0.01)
    assert [item.name for item in check.evidence] == [part]
    assert f"enter the {part} as 58.5mm (you gave 60mm)" in check.advice


def test_a_tape_and_calipers_that_contradict_each_other_are_both_doubted():
    check = checked("cam0,cam1:1.900m", square="61.5mm")
    assert check.percent == pytest.approx(5.26, abs=0.01)
    assert check.advice == (
        "measure again, the tape and the square contradict each other: by the distances the board was entered 5.3 % "
        "too large, by its square 2.4 % too small"
    )


# --- in the pipeline --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def capture():
    rig = arc_rig(2, arc_deg=50)
    poses = board_poses_for_pair(rig, "cam0", "cam1", BOARD, 12, distance_m=(1.5, 5), seed=0)
    seen = [("cam0", "cam1")] * 12
    for one in rig.camera_ids:
        poses += board_poses_for_camera(rig, one, BOARD, 8, distance_m=(0.7, 2.2), seed=len(poses))
        seen += [(one,)] * 8
    detections = with_noise(exact_detections(rig, BOARD, poses, seen_by=seen), 0.2, seed=1)
    options = CalibrateOptions("opencv5")
    return rig, detections, calibrate_lenses(detections, None, options), options


def judged(capture, length_m, board=BOARD):
    _, detections, lenses, options = capture
    detections = replace(detections, board=board)
    distance = MeasuredDistance(("cam0", "cam1"), parse_measured_length(f"{length_m:.3f}m", "--distance"))
    result = calibrate_site(detections, GateLimits(), lenses, options, known=Known((distance,)))
    (gate,) = [gate for gate in result.gates if gate.name == "scale_percent"]
    return result, gate


def true_length_m(rig):
    return float(np.linalg.norm(rig.cameras[1].cam_from_rig.inverse().translation_m))


def test_a_right_board_passes_and_its_figure_is_kept(capture):
    result, gate = judged(capture, true_length_m(capture[0]))
    assert result.verdict == "PASS"
    assert gate.passed
    assert gate.advice is None
    assert gate.value < 0.5
    assert result.scale.sigma_percent < 0.5


def test_a_board_entered_5_percent_too_large_fails_that_gate_alone_and_the_rig_is_not_rescaled(capture):
    true_m = true_length_m(capture[0])
    result, gate = judged(capture, true_m, Checkerboard(9, 6, 0.063))
    assert result.verdict == "RECAPTURE"
    assert [gate.name for gate in result.gates if not gate.passed] == ["scale_percent"]
    assert gate.value == pytest.approx(5.0, abs=0.5)
    assert gate.advice.startswith("the board was entered ")
    assert "% too large" in gate.advice
    assert "(you gave 63mm)" in gate.advice
    found = np.linalg.norm(result.joint.cam_from_rig[1].inverse().translation_m)
    assert found == pytest.approx(1.05 * true_m, rel=0.01)
