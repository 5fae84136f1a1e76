"""multical 0.4.0 on given corners: its own order of work with its own defaults, lenses free in the joint solve.

It was written for numpy 1 before ``np.bool`` was removed, hence the alias; and it takes only boards with markers, hence
a board whose points are the checkerboard's. Views that all have the same number of corners end in an error of numpy's
object arrays, hence one corner less in every other view. Its lens has a third radial coefficient.
"""

import tempfile

import numpy as np
from exchange import Corners, PeerAnswer, run_peer

np.bool = np.bool_

from multical import tables  # noqa: E402 - after the alias, which it needs when it is imported
from multical.board.charuco import CharucoBoard  # noqa: E402
from multical.config.arguments import CameraOpts, OptimizerOpts, RuntimeOpts  # noqa: E402
from multical.workspace import Workspace  # noqa: E402
from structs.struct import struct  # noqa: E402


class GivenBoard(CharucoBoard):
    """A checkerboard in the place of multical's own board."""

    given: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """(K, 3) corners in metres."""
        return self.given


def calibrate(corners: Corners) -> PeerAnswer:
    """What ``multical calibrate`` does after its detection, with its default options."""
    GivenBoard.given = corners.points
    board = GivenBoard((corners.columns + 1, corners.rows + 1), corners.square_m, corners.square_m * 0.75)
    names = [f"cam{c}" for c in range(len(corners.pixels))]
    frames = range(corners.pixels.shape[1])
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(folder)
        workspace.names = struct(camera=names, image=[str(f) for f in frames], board=["board"])
        workspace.image_size = [tuple(size) for size in corners.size_wh.tolist()]
        workspace.filenames = [[str(f) for f in frames] for _ in names]
        workspace.boards = [board]
        workspace.detected_points = [
            [[_detection(px, leave_out=frame % 2)] for frame, px in enumerate(camera)] for camera in corners.pixels
        ]
        workspace.point_table = tables.make_point_table(workspace.detected_points, workspace.boards)
        camera, optimizer, runtime = CameraOpts(), OptimizerOpts(), RuntimeOpts()
        workspace.calibrate_single(
            camera.distortion_model, camera.intrinsic_error_limit, max_images=camera.limit_intrinsic
        )
        workspace.initialise_poses(
            exclude_bad_poses=runtime.exclude_bad_poses, pose_error_limit=runtime.pose_error_limit
        )
        found = workspace.calibrate(
            "calibration",
            cameras=True,
            loss=optimizer.loss,
            num_adjustments=optimizer.iter,
            quantile=optimizer.outlier_quantile,
            outlier_threshold=optimizer.outlier_threshold,
        ).with_master(0)
    poses = np.asarray(found.camera_poses.poses)
    return PeerAnswer(
        [camera.intrinsic for camera in found.cameras],
        [camera.dist for camera in found.cameras],
        poses[:, :3, :3],
        poses[:, :3, 3],
    )


def _detection(pixels: np.ndarray, *, leave_out: int) -> struct:
    if np.isnan(pixels).any():
        return struct(corners=np.zeros((0, 2)), ids=np.zeros(0, dtype=int))
    return struct(corners=pixels[leave_out:], ids=np.arange(leave_out, len(pixels)))


if __name__ == "__main__":
    run_peer(calibrate)
