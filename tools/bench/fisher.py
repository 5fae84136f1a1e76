"""How well a rig can be known at all: the Cramer-Rao bound of its camera positions, at the truth.

The information of every clean corner about all that is unknown (each camera's pose and lens, each board's pose) is
summed, the boards are eliminated (Schur complement), and the inverse bounds the covariance of any unbiased estimate
(Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, equation 3.20).

Written apart from :mod:`rigcal.bundle`, so that each checks the other. A pose changes by a twist ``xi = (w, v)`` of its
target frame, ``x -> x + w x x + v``: one of a board in the rig is one in the camera through the adjoint of
``cam_from_rig`` (Sola et al., A micro Lie theory, 2018, equation 31), and a camera's centre is moved by ``v`` alone.
"""

from __future__ import annotations

import cv2
import numpy as np
from rigs import BenchSite

from rigcal.geometry import Floats, Pose
from rigcal.rig import RigCamera

_TWIST = 6


def position_covariances(site: BenchSite) -> Floats:
    """(C - 1, 3, 3) lower bound in square metres of the covariance of each camera's position but camera 0's."""
    cameras = site.rig.cameras
    unknowns = _TWIST + len(cameras[0].camera.params)
    information = np.zeros((len(cameras) * unknowns,) * 2)
    boards = np.zeros((len(site.rig_from_board), _TWIST, _TWIST))
    mixed = np.zeros((len(site.rig_from_board), len(information), _TWIST))
    for index, (camera, found) in enumerate(zip(cameras, site.detections.cameras, strict=True)):
        rows = slice(index * unknowns, (index + 1) * unknowns)
        for view in found.views:
            board = view.frame_idx
            corners = site.detections.board.corners_in_board[view.corner_ids]
            by_camera, by_board = _jacobians(camera, site.rig_from_board[board], corners)
            information[rows, rows] += by_camera.T @ by_camera
            boards[board] += by_board.T @ by_board
            mixed[board, rows] = by_camera.T @ by_board
    for own, across in zip(boards, mixed, strict=True):
        touched = np.flatnonzero(across.any(axis=1))
        information[np.ix_(touched, touched)] -= across[touched] @ np.linalg.solve(own, across[touched].T)
    free = np.arange(len(information)) >= _TWIST  # camera 0 is the frame: its pose is no unknown
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = _inverse(information[np.ix_(free, free)])
    moved = [slice(c * unknowns + 3, c * unknowns + 6) for c in range(1, len(cameras))]
    turns = [camera.cam_from_rig.rotation for camera in cameras[1:]]
    return site.noise_px**2 * np.stack([R.T @ covariance[v, v] @ R for R, v in zip(turns, moved, strict=True)])


def position_bound_m(site: BenchSite) -> float:
    """The least root-mean-square distance of the cameras from their true positions, camera 0 being the frame."""
    return float(np.sqrt(np.trace(position_covariances(site), axis1=1, axis2=2).mean()))


def _jacobians(camera: RigCamera, rig_from_board: Pose, corners: Floats) -> tuple[Floats, Floats]:
    """Derivatives of a view's pixels (2 n) by the camera's twist and lens (2 n, 6 + P), and by the board's twist."""
    points = camera.cam_from_rig.apply(rig_from_board.apply(corners))
    zero = np.zeros(3)
    jacobian = cv2.projectPoints(points, zero, zero, camera.camera.matrix, camera.camera.distortion)[1]
    by_camera = jacobian[:, : _TWIST + len(camera.camera.params)]
    return by_camera, by_camera[:, :_TWIST] @ _adjoint(camera.cam_from_rig)


def _adjoint(pose: Pose) -> Floats:
    """(6, 6) from a twist of the source frame to the twist of the target frame that does the same."""
    R, (x, y, z) = pose.rotation, pose.translation_m
    adjoint = np.zeros((_TWIST, _TWIST))
    adjoint[:3, :3] = adjoint[3:, 3:] = R
    adjoint[3:, :3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
    return adjoint


def _inverse(information: Floats) -> Floats:
    """Inverse of a positive definite matrix whose unknowns have very different units."""
    scale = 1 / np.sqrt(np.diag(information))
    return np.asarray(scale[:, None] * np.linalg.inv(information * scale[:, None] * scale) * scale)
