"""The simulated site is what it says: its images show boards where its detections say they are."""

import cv2
import numpy as np
import pytest

from rigcal.board import AprilGrid, Charuco, Checkerboard
from rigcal.geometry import Pose
from rigcal.synthetic import (
    BoardRenderer,
    arc_rig,
    board_poses_for_pair,
    draw_board,
    exact_detections,
    opencv_charuco,
    room_background,
    with_noise,
)

RIG = arc_rig(2, arc_deg=50, size_wh=(1280, 720))


def rendered(board, count=3):
    poses = board_poses_for_pair(RIG, "cam0", "cam1", board, count, distance_m=(2.0, 5.0), seed=1)
    detections = exact_detections(RIG, board, poses)
    renderer, rng = BoardRenderer(RIG.cameras[0].camera), np.random.default_rng(0)
    background = room_background((1280, 720), seed=2)
    images = [
        renderer.render(draw_board(board), RIG.cameras[0].cam_from_rig @ pose, rng=rng, background=background)
        for pose in poses
    ]
    return images, detections.cameras[0].views


def test_rendered_checkerboards_have_their_corners_where_the_truth_says():
    """Corners refined around the truth stay within 0.1 px of it (measured 0.04 px), with no bias."""
    images, views = rendered(Checkerboard(9, 6, 0.1))
    for image, view in zip(images, views, strict=True):
        start = view.corners_px.astype(np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(image, start.copy(), (4, 4), (-1, -1), (3, 50, 1e-4)).reshape(-1, 2)
        gap = found - view.corners_px
        assert np.sqrt((gap**2).sum(axis=1).mean()) < 0.1
        assert np.abs(gap.mean(axis=0)).max() < 0.03


@pytest.mark.parametrize("inverted", [False, True])
def test_rendered_charuco_boards_are_found_by_opencv_with_the_right_ids(inverted):
    board = Charuco(7, 5, 0.18, inverted=inverted)
    images, views = rendered(board)
    detector = cv2.aruco.CharucoDetector(opencv_charuco(board))
    for image, view in zip(images, views, strict=True):
        corners, ids, _, _ = detector.detectBoard(255 - image if inverted else image)
        expected = dict(zip(view.corner_ids.tolist(), view.corners_px, strict=True))
        gaps = [np.linalg.norm(c - expected[int(i)]) for c, i in zip(corners.reshape(-1, 2), ids.ravel(), strict=True)]
        assert len(gaps) >= 20
        assert np.median(gaps) < 0.3


def test_rendered_aprilgrids_are_found_by_opencv_with_the_right_ids():
    board = AprilGrid(4, 3, 0.25)
    images, views = rendered(board)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    for image, view in zip(images, views, strict=True):
        tags, ids, _ = detector.detectMarkers(image)
        assert sorted(ids.ravel().tolist()) == list(range(12))
        for tag, tag_id in zip(tags, ids.ravel(), strict=True):
            centre = view.corners_px[4 * tag_id : 4 * tag_id + 4].mean(axis=0)
            assert np.linalg.norm(tag.reshape(4, 2).mean(axis=0) - centre) < 1.0


def test_noise_is_added_apart_from_the_truth():
    board = Checkerboard(9, 6, 0.1)
    poses = board_poses_for_pair(RIG, "cam0", "cam1", board, 5, distance_m=(2.0, 5.0), seed=1)
    exact = exact_detections(RIG, board, poses)
    noisy = with_noise(exact, 0.3, seed=4)
    gaps = np.concatenate(
        [n.corners_px - e.corners_px for n, e in zip(noisy.cameras[0].views, exact.cameras[0].views, strict=True)]
    )
    assert abs(gaps.std() - 0.3) < 0.02
    again = with_noise(exact, 0.3, seed=4)
    assert np.array_equal(again.cameras[0].views[0].corners_px, noisy.cameras[0].views[0].corners_px)


def test_cameras_look_at_the_scene_from_the_arc():
    rig = arc_rig(4)
    for camera in rig.cameras:
        world_from_cam = rig.world_from_rig @ camera.cam_from_rig.inverse()
        assert world_from_cam.translation_m[2] == pytest.approx(2.0, abs=0.11)
        pixel = camera.camera.project(camera.cam_from_rig.apply(rig.world_from_rig.inverse().apply([0, 0, 1.0])))
        assert np.abs(pixel - [960, 540]).max() < 200


def test_poses_that_cannot_be_seen_are_refused():
    with pytest.raises(ValueError, match="found 0 of 1 board poses"):
        board_poses_for_pair(RIG, "cam0", "cam1", Checkerboard(9, 6, 3.0), 1, distance_m=(1.0, 1.1), seed=1)


def test_the_back_of_a_board_shows_no_pattern():
    board = Checkerboard(9, 6, 0.1)
    pose = board_poses_for_pair(RIG, "cam0", "cam1", board, 1, distance_m=(2.0, 5.0), seed=1)[0]
    camera = RIG.cameras[0]
    turned = camera.cam_from_rig @ pose @ Pose(np.diag([-1.0, 1.0, -1.0]), np.array([0.8, 0, 0]))
    renderer = BoardRenderer(camera.camera)
    front, back = (
        renderer.render(draw_board(board), seen, noise_dn=0, rng=np.random.default_rng(0))
        for seen in (camera.cam_from_rig @ pose, turned)
    )
    plate = back != 110
    assert plate.sum() > 5000
    assert front[plate].std() > 30 > 20 > back[plate].std()
