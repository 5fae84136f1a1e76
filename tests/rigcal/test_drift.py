"""Drift: cameras moved by known amounts are named and measured, cameras that stayed are not, and nothing is guessed."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.camera import Camera
from rigcal.drift import DriftOptions, find_drift, place_cameras, resolve_drift
from rigcal.drift.consensus import find_stayed
from rigcal.drift.measured import measured_groups
from rigcal.errors import DriftError, OptionError
from rigcal.geometry import Pose
from rigcal.relative import (
    RelativePoses,
    covariance_entry,
    perturbation,
    perturbed,
    poses_given_lenses,
    poses_of,
    solved_covariance_entry,
)
from rigcal.rigdocument import GateEntry, PoseEntry, SigmaEntry
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile
from rigcal.rigviews import held_lenses, of_cameras
from rigcal.synthetic import arc_rig, board_poses_for_camera, board_poses_for_pair, exact_detections, with_noise
from rigcal.uncertainty import RigCovariance

BOARD = Checkerboard(7, 5, 0.1)
NOISE_PX = 0.2
NOW = "2026-11-22T09:30:01Z"


def views(rig, *, seed, per_pair=6, noise_px=NOISE_PX, seen_by=None):
    """Boards shown to neighbouring cameras; every camera that sees one whole takes part."""
    poses = []
    for one, two in zip(rig.camera_ids, rig.camera_ids[1:], strict=False):
        poses += board_poses_for_pair(rig, one, two, BOARD, per_pair, distance_m=(1.5, 5), seed=seed + len(poses))
    seen = [seen_by] * len(poses) if seen_by else None
    return with_noise(exact_detections(rig, BOARD, poses, seen_by=seen), noise_px, seed=seed)


def calibrated(rig, *, seed):
    """The rig file of a calibration with true lenses and noisy views: poses and their covariance as measured."""
    detections = views(rig, seed=seed, per_pair=10)
    exact = document_of_rig(rig, created_utc=NOW, inputs_sha256="", board=BOARD)
    (group,) = measured_groups(detections, held_lenses(detections, exact))
    members = tuple(replace(c, cam_from_rig=group.poses.pose(c.id)) for c in rig.cameras)
    document = document_of_rig(replace(rig, cameras=members), created_utc=NOW, inputs_sha256="", board=BOARD)
    free = rig.camera_ids[1:]
    covariance = group.poses.of(free).covariance
    sigma = SigmaEntry(fx_px=0.5, fy_px=0.5, cx_px=0.5, cy_px=0.5, position_m=0.001, rotation_deg=0.01)
    cameras = tuple(
        entry.model_copy(
            update={"sigma": sigma, "rmse_px": entry.rmse_px.model_copy(update={"intrinsic": 0.28, "refined": 0.28})}
        )
        for entry in document.cameras
    )
    entry = covariance_entry(free, covariance, covariance)
    return document.model_copy(update={"covariance": entry, "cameras": cameras, "digest": "sha256:before"})


def with_moved(rig, moves):
    """The rig after cameras moved by (rotation in degrees, translation in metres) in their own frames."""
    poses = {c.id: c.cam_from_rig for c in rig.cameras}
    for camera_id, (turn_deg, step_m) in moves.items():
        poses[camera_id] = Pose.from_rvec(np.deg2rad(turn_deg), step_m) @ poses[camera_id]
    rig_from_new = poses[rig.reference].inverse()
    return replace(
        rig,
        cameras=tuple(
            replace(c, cam_from_rig=Pose.identity() if c.id == rig.reference else poses[c.id] @ rig_from_new)
            for c in rig.cameras
        ),
    )


def relative(rig, camera_id, anchor):
    return rig.camera(camera_id).cam_from_rig @ rig.camera(anchor).cam_from_rig.inverse()


MOVE = ((0.1, 0.2, 0.0), (0.01, 0.0, 0.01))


@pytest.fixture(scope="module")
def site():
    rig = arc_rig(4, arc_deg=110, seed=1)
    return rig, calibrated(rig, seed=5)


def drift_of(document, rig, *, seed=77, limit_px=0.5, **capture):
    return find_drift(views(rig, seed=seed, **capture), document, DriftOptions(limit_px))


@pytest.mark.parametrize("seed", range(3))
def test_a_rig_that_stayed_gives_no_alarm(site, seed):
    """Largest movement of a camera over 20 seeds: 1.6 sigma (measured); limit 4."""
    rig, document = site
    drift = drift_of(document, rig, seed=200 + seed)
    assert drift.unchanged
    assert drift.with_status("stayed") == rig.camera_ids
    assert max(camera.movement.sigmas for camera in drift.cameras) < 2.5


@pytest.mark.parametrize("moved", [("cam2",), ("cam0",), ("cam3",), ("cam0", "cam2")])
def test_moved_cameras_are_named_and_measured_within_three_sigmas(site, moved):
    rig, document = site
    after = with_moved(rig, dict.fromkeys(moved, MOVE))
    drift = drift_of(document, after)
    assert drift.with_status("moved") == moved
    assert drift.with_status("suspect", "lens changed") == ()
    anchor = drift.groups[0].stayed[0]
    for camera in drift.cameras:
        if camera.camera_id not in moved:
            continue
        new, old = relative(after, camera.camera_id, anchor), relative(rig, camera.camera_id, anchor)
        true_deg = np.rad2deg(np.linalg.norm(perturbation(new, old)[:3]))
        true_m = np.linalg.norm(new.inverse().translation_m - old.inverse().translation_m)
        assert abs(camera.movement.rotation_deg - true_deg) < 3 * camera.movement.rotation_sigma_deg
        assert abs(camera.movement.translation_m - true_m) < 3 * camera.movement.translation_sigma_m
        assert camera.movement.shift_px > 2


def test_shift_in_pixels_is_what_the_image_shows(site):
    """A camera turned by 0.2 degrees sees everything shifted by about 0.2 degrees of its focal length."""
    rig, document = site
    drift = drift_of(document, with_moved(rig, {"cam1": ((0.0, 0.2, 0.0), (0.0, 0.0, 0.0))}))
    expected = np.deg2rad(0.2) * rig.camera("cam1").camera.params[0]
    assert drift.cameras[1].movement.shift_px == pytest.approx(expected, rel=0.15)


def test_a_camera_knocked_far_off_is_found_without_a_guess(site):
    rig, document = site
    drift = drift_of(document, with_moved(rig, {"cam2": ((4.0, 9.0, 3.0), (0.2, 0.1, 0.0))}))
    assert drift.with_status("moved") == ("cam2",)
    assert drift.cameras[2].movement.rotation_deg == pytest.approx(np.linalg.norm([4, 9, 3]), abs=0.1)


def test_a_movement_below_the_limit_is_tolerated(site):
    rig, document = site
    after = with_moved(rig, {"cam2": ((0.0, 0.03, 0.0), (0.0, 0.0, 0.0))})  # 0.7 px
    assert drift_of(document, after).with_status("moved") == ("cam2",)
    tolerated = drift_of(document, after, limit_px=2.0)
    assert tolerated.unchanged
    assert tolerated.cameras[2].movement.sigmas > 4


def test_two_cameras_cannot_tell_which_of_them_moved():
    rig = arc_rig(2, arc_deg=40, seed=3)
    document = calibrated(rig, seed=5)
    assert drift_of(document, rig, per_pair=8).unchanged
    drift = drift_of(document, with_moved(rig, {"cam1": MOVE}), per_pair=8)
    assert drift.with_status("suspect") == ("cam0", "cam1")
    assert "cannot tell whether {cam0} or {cam1} stayed" in drift.cameras[0].reason
    with pytest.raises(DriftError, match="the views cannot tell which camera moved: cam1 or cam0") as error:
        resolve_drift(document, drift, None, named=[], utc=NOW)
    assert "--moved cam1" in error.value.do_next
    by_user = resolve_drift(document, drift, None, named=["cam0"], utc=NOW)
    assert by_user.camera_ids == ("cam0",)


def test_a_bad_view_is_not_a_moved_camera(site):
    """One board of one camera shifted by 30 px, as by a wrong image: the others of its instant outvote it."""
    rig, document = site
    detections = views(rig, seed=77)
    camera = detections.cameras[1]
    bad = (replace(camera.views[0], corners_px=camera.views[0].corners_px + 30.0), *camera.views[1:])
    cameras = (detections.cameras[0], replace(camera, views=bad), *detections.cameras[2:])
    drift = find_drift(replace(detections, cameras=cameras), document, DriftOptions())
    assert drift.unchanged
    assert drift.with_status("stayed") == rig.camera_ids


def test_a_zoomed_lens_is_not_called_a_movement(site):
    rig, document = site

    def zoomed(camera: Camera) -> Camera:
        return camera.with_params(camera.params * np.array([1.01, 1.01, *[1.0] * (len(camera.params) - 2)]))

    after = replace(
        rig, cameras=tuple(replace(c, camera=zoomed(c.camera)) if c.id == "cam1" else c for c in rig.cameras)
    )
    drift = drift_of(document, after)
    assert drift.with_status("lens changed") == ("cam1",)
    assert drift.with_status("stayed") == ("cam0", "cam2", "cam3")
    lens = drift.cameras[1].lens
    assert lens.focal_percent == pytest.approx(1.0, abs=3 * lens.focal_sigma_percent)
    assert lens.focal_sigma_percent < 0.2
    assert "lock zoom and focus" in drift.cameras[1].reason
    with pytest.raises(DriftError, match="cam1 cannot be placed again: the lens changed"):
        resolve_drift(document, drift, None, named=[], utc=NOW)


def test_cameras_without_shared_views_are_not_judged(site):
    rig, document = site
    drift = drift_of(document, rig, seen_by=("cam0", "cam1", "cam2"))
    assert drift.with_status("not judged") == ("cam3",)
    assert drift.cameras[3].reason == "the board was not found in its images"
    captured = of_cameras(views(rig, seed=77), ["cam0", "cam1"])
    drift = find_drift(captured, document, DriftOptions())
    assert drift.with_status("not judged") == ("cam2", "cam3")
    assert drift.cameras[3].reason == "no images of it in the capture"


def test_views_that_judge_no_camera_are_refused(site):
    rig, document = site
    poses = board_poses_for_camera(rig, "cam0", BOARD, 4, distance_m=(1, 2), seed=1)
    alone = exact_detections(rig, BOARD, poses, seen_by=[["cam0"]] * 4)
    with pytest.raises(DriftError, match="these views cannot tell whether a camera moved") as error:
        find_drift(alone, document, DriftOptions())
    assert "cam0: its 4 views share fewer than 2 instants with another usable camera" in str(error.value)
    assert "show the board, held still, to neighbouring cameras together" in error.value.do_next


def test_a_rig_file_without_covariance_is_compared_by_the_views_alone(site):
    rig, document = site
    imported = document.model_copy(update={"covariance": None})
    assert drift_of(imported, rig).unchanged
    assert drift_of(imported, with_moved(rig, {"cam2": MOVE})).with_status("moved") == ("cam2",)


def test_a_limit_must_be_positive():
    with pytest.raises(OptionError, match="limit_px"):
        DriftOptions(0.0)


@pytest.mark.parametrize("moved", ["cam2", "cam0"])
def test_the_moved_camera_is_placed_again_and_the_others_are_held(site, moved):
    """Within 3 sigma and 3 mm of the truth; what stayed keeps its pose (in a rig frame that follows the reference)."""
    rig, document = site
    world = Pose.from_rvec([0.3, -1.2, 0.2], [0.5, 1.0, 2.0])
    document = document.model_copy(update={"world_from_rig": PoseEntry.of(world)})
    after = with_moved(rig, {moved: MOVE})
    resolved = resolve_drift(document, drift_of(document, after, per_pair=8), None, named=[], utc=NOW)
    assert resolved.camera_ids == (moved,)
    new, old = rig_of(resolved.document), rig_of(document)
    held = [camera_id for camera_id in rig.camera_ids if camera_id != moved]
    for one in held[1:]:
        gap = perturbation(relative(new, one, held[0]), relative(old, one, held[0]))
        assert np.abs(gap).max() < (1e-12 if moved == "cam0" else 1e-15)
    gap = perturbation(relative(new, moved, held[0]), relative(after, moved, held[0]))
    assert np.linalg.norm(gap[3:]) < 0.003
    poses = poses_of(resolved.document).seen_from(held[0])
    rows = poses.rows([moved])
    sigmas = np.sqrt(gap @ np.linalg.solve(poses.covariance[np.ix_(rows, rows)], gap) / 6)
    assert sigmas < 2.5
    in_world = [r.world_from_rig.apply(r.camera(held[0]).cam_from_rig.inverse().translation_m) for r in (new, old)]
    np.testing.assert_allclose(*in_world, atol=1e-9)
    history = resolved.document.history[-1]
    assert (history.command, history.utc, history.parent_digest) == ("drift", NOW, "sha256:before")
    assert resolved.document.camera_ids == document.camera_ids


def test_the_gates_of_a_camera_placed_again_are_judged_on_the_new_views(site):
    rig, document = site
    gates = [
        GateEntry(name=name, camera=camera_id, value=value, limit=limit, passed=True)
        for camera_id in rig.camera_ids
        for name, value, limit in (
            ("refined_rmse_px", 0.2, 1.0),
            ("views", 12.0, 6.0),
            ("focal_sigma_percent", 0.1, 1.0),
        )
    ]
    document = document.model_copy(update={"gates": tuple(gates), "verdict": "PASS"})
    after = with_moved(rig, {"cam3": MOVE})
    few = resolve_drift(document, drift_of(document, after, per_pair=3), None, named=[], utc=NOW).document
    judged = {(gate.name, gate.camera): gate for gate in few.gates}
    assert judged["views", "cam3"].value == few.cameras[3].views.used < 6
    assert not judged["views", "cam3"].passed
    assert judged["views", "cam3"].advice.startswith("show cam3 the board")
    assert judged["focal_sigma_percent", "cam3"].value == 0.1
    assert judged["views", "cam1"].value == 12
    assert few.verdict == "RECAPTURE"
    many = resolve_drift(document, drift_of(document, after, per_pair=8), None, named=[], utc=NOW).document
    assert many.verdict == "PASS"
    assert 0.2 < many.cameras[3].rmse_px.refined < 0.35


def test_poses_seen_from_another_camera_carry_their_covariance():
    """Against derivatives by differences; there and back again."""
    rng = np.random.default_rng(0)
    poses = tuple(Pose.from_rvec(rng.normal(size=3), rng.normal(size=3)) for _ in range(3))
    root = rng.normal(size=(18, 18)) * 1e-4
    given = RelativePoses(("a", "b", "c"), poses, root @ root.T)
    seen = given.seen_from("b")
    assert np.abs(seen.covariance[6:12]).max() == 0
    np.testing.assert_allclose(seen.seen_from("a").seen_from("b").covariance, seen.covariance, atol=1e-18)
    steps = np.zeros((18, 18))
    for column, step in enumerate(1e-6 * np.eye(18)):
        moved = [perturbed(pose, step[6 * i : 6 * i + 6]) for i, pose in enumerate(poses)]
        gaps = [
            perturbation(pose @ moved[1].inverse(), old) for pose, old in zip(moved, seen.cam_from_frame, strict=True)
        ]
        steps[:, column] = np.concatenate(gaps) / 1e-6
    np.testing.assert_allclose(steps @ given.covariance @ steps.T, seen.covariance, atol=1e-11)


def test_the_covariance_given_the_lenses_is_that_of_a_solve_with_the_lenses_held(tmp_path):
    """Against the inverse of the poses' own block of the information; written and read back."""
    root = np.random.default_rng(1).normal(size=(8, 8))
    information = root @ root.T + np.eye(8)
    index = (*((1, unknown) for unknown in range(6)), (0, 6), (1, 6))
    entry = solved_covariance_entry(RigCovariance(index, np.linalg.inv(information)), ["cam0", "cam1"])
    np.testing.assert_allclose(entry.given_lenses, np.linalg.inv(information[:6, :6]), atol=1e-12)
    rig = arc_rig(2, arc_deg=40, seed=3)
    document = document_of_rig(rig, created_utc=NOW, inputs_sha256="").model_copy(update={"covariance": entry})
    write_rigfile(document, tmp_path / "a.rig.json")
    read = poses_given_lenses(read_rigfile(tmp_path / "a.rig.json"))
    np.testing.assert_array_equal(read.covariance[6:, 6:], entry.given_lenses)
    assert poses_given_lenses(document_of_rig(rig, created_utc=NOW, inputs_sha256="")) is None


def test_the_most_cameras_that_agree_stayed():
    ids = ("a", "b", "c", "d", "e")
    pairs = {frozenset(pair) for pair in ("ab", "ac", "bc", "de")}
    found = find_stayed(ids, lambda one, two: frozenset((one, two)) in pairs, lambda held: 0.0)
    assert found.best == ("a", "b", "c")
    assert found.as_good == ()
    pairs -= {frozenset("ab")}
    misfits = {"ac": 1.0, "bc": 40.0, "de": 15.0}
    found = find_stayed(ids, lambda one, two: frozenset((one, two)) in pairs, lambda held: misfits["".join(held)])
    assert found.best == ("a", "c")
    assert found.as_good == (("d", "e"),)


def test_held_cameras_correct_the_placed_ones_by_their_correlation():
    """Two cameras measured with a common error of the anchor: holding one tells the other's share of it."""
    eye = Pose.identity()
    old = RelativePoses(("a", "b", "c"), (eye, eye, eye), np.zeros((18, 18)))
    common, own = 1e-2, 1e-4
    covariance = np.zeros((18, 18))
    covariance[6:, 6:] = np.kron(np.array([[1.0, 1.0], [1.0, 1.0]]) * common**2 + np.eye(2) * own**2, np.eye(6))
    off = np.array([0, 0, 0, 0.01, 0, 0])
    new = RelativePoses(("a", "b", "c"), (eye, perturbed(eye, off), perturbed(eye, off)), covariance)
    alone = place_cameras(new, old, ["a"], ["c"])
    both = place_cameras(new, old, ["a", "b"], ["c"])
    assert alone.gap[3] == pytest.approx(0.01)
    assert both.gap[3] == pytest.approx(0.0, abs=2e-6)
    assert np.sqrt(both.gap_covariance[3, 3]) == pytest.approx(own * np.sqrt(2), rel=1e-3)
