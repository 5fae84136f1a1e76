"""aniposelib 0.8.0 on given corners, at its best: with lenses from ``cv2.calibrateCamera``, then its own extrinsics.

Its default, which also fits the lens (one focal length, two coefficients, the centre held), is many times worse.
"""

import cv2
import numpy as np
from aniposelib.boards import Checkerboard
from aniposelib.cameras import Camera, CameraGroup
from exchange import Corners, PeerAnswer, run_peer


def calibrate(corners: Corners) -> PeerAnswer:
    """Lenses one by one, then ``calibrate_rows`` with the extrinsics alone."""
    points = corners.points.astype(np.float32)
    ids = np.arange(len(points))
    cameras, rows = [], []
    for c, size in enumerate(corners.size_wh.tolist()):
        frames = corners.frames(c)
        pixels = [corners.pixels[c, f].astype(np.float32) for f in frames]
        _, K, d, _, _ = cv2.calibrateCamera(
            [points] * len(frames), pixels, tuple(size), None, None, flags=cv2.CALIB_FIX_K3
        )
        cameras.append(Camera(name=str(c), size=size, matrix=K, dist=np.ravel(d)))
        seen = [corners.pixels[c, f][:, None] for f in frames]
        rows.append(
            [{"framenum": int(f), "corners": px, "ids": ids, "filled": px} for f, px in zip(frames, seen, strict=True)]
        )
    group = CameraGroup(cameras)
    board = Checkerboard(corners.columns, corners.rows, square_length=corners.square_m)
    group.calibrate_rows(rows, board, init_intrinsics=False, only_extrinsics=True, verbose=False)
    return PeerAnswer(
        [camera.get_camera_matrix() for camera in group.cameras],
        [camera.get_distortions()[:4] for camera in group.cameras],
        [cv2.Rodrigues(camera.get_rotation())[0] for camera in group.cameras],
        [camera.get_translation() for camera in group.cameras],
    )


if __name__ == "__main__":
    run_peer(calibrate)
