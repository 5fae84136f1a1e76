"""Claims about the sidecar of a rig file, and about the pictures of the worst views that it carries."""

from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.captures import open_capture, read_frames, read_frames_at
from rigcal.errors import BrokenFileError
from rigcal.evidence import Evidence, ViewPicture, read_evidence, write_evidence
from rigcal.geometry import Pose
from rigcal.outcome import evidence_of
from rigcal.pictures import GREATEST_BYTES, LONGEST_PX, cut_out, with_pictures, worst_views
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_pair, exact_detections, with_noise

LATER = ("board_idx", "rig_from_board", "picture_views", "picture_boxes_px", "picture_sizes", "picture_jpegs")


def evidence(errors_px, *, corners=4, frames=None):
    """One view per entry of ``errors_px`` {(camera, frame): RMSE}, its corners about (50, 40)."""
    views = list(errors_px)
    count = max(camera for camera, _ in views) + 1
    square = np.array([[40, 30], [60, 30], [60, 50], [40, 50]], dtype=float)[:corners]
    return Evidence(
        tuple(f"cam{i}" for i in range(count)),
        frames or tuple(tuple(f"{f:06d}" for f in range(40)) for _ in range(count)),
        np.repeat([camera for camera, _ in views], corners),
        np.repeat([frame for _, frame in views], corners),
        np.tile(np.arange(corners), len(views)),
        np.ones(len(views) * corners, dtype=bool),
        np.tile(square, (len(views), 1)),
        np.repeat(list(errors_px.values()), corners)[:, None] * [0.6, 0.8],
        np.zeros((0, 3)),
    )


def same(one, two):
    for name in Evidence.__slots__:
        a, b = getattr(one, name), getattr(two, name)
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, name


def test_a_sidecar_comes_back_as_it_was_written(tmp_path):
    whole = replace(
        evidence({(0, 3): 0.5, (1, 7): 2.0}),
        board_idx=[0, 0, 0, 0, -1, -1, -1, -1],
        rig_from_board=Pose.from_rvec([0.1, 0.2, 0.3], [1, 2, 3]).matrix[None, :3],
        pictures=(ViewPicture(1, 7, (3, 4, 50, 60), b"one"), ViewPicture(0, 3, (0, 0, 9, 9), b"a second")),
    )
    for kept in (whole, replace(whole, pictures=())):
        write_evidence(kept, tmp_path / "a.npz")
        same(read_evidence(tmp_path / "a.npz"), kept)


def test_a_sidecar_of_an_earlier_rigcal_still_reads(tmp_path):
    write_evidence(evidence({(0, 3): 0.5}), tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        np.savez_compressed(tmp_path / "old.npz", **{name: data[name] for name in data.files if name not in LATER})
    old = read_evidence(tmp_path / "old.npz")
    same(old, evidence({(0, 3): 0.5}))
    assert (len(old.board_idx), len(old.rig_from_board), old.pictures) == (0, 0, ())


def test_pictures_that_do_not_add_up_are_called_a_broken_file(tmp_path):
    one = (ViewPicture(0, 3, (0, 0, 9, 9), b"x"),)
    write_evidence(replace(evidence({(0, 3): 0.5}), pictures=one), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        np.savez_compressed(tmp_path / "b.npz", **dict(data) | {"picture_sizes": np.array([1, 2])})
    with pytest.raises(BrokenFileError, match="residuals that rigcal calibrate wrote"):
        read_evidence(tmp_path / "b.npz")


def test_board_positions_project_to_the_detected_corners_less_their_residuals():
    rig, board = arc_rig(2, arc_deg=50), Checkerboard(9, 6, 0.06)
    poses = board_poses_for_pair(rig, rig.camera_ids[0], rig.camera_ids[1], board, 16, distance_m=(1.5, 4), seed=2)
    detections = with_noise(exact_detections(rig, board, poses), 0.1, seed=1)
    options = CalibrateOptions("opencv4")
    result = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, options), options)
    found = evidence_of(result)
    assert set(found.board_idx[found.used].tolist()) == set(range(len(found.rig_from_board)))
    for camera, (lens, cam_from_rig) in enumerate(zip(result.joint.cameras, result.joint.cam_from_rig, strict=True)):
        rows = np.flatnonzero((found.camera_idx == camera) & (found.board_idx >= 0))
        pose, corners = found.rig_from_board[found.board_idx[rows]], board.corners_in_board[found.corner_ids[rows]]
        in_rig = np.einsum("nij,nj->ni", pose[:, :, :3], corners) + pose[:, :, 3]
        projected = lens.project(cam_from_rig.apply(in_rig))
        np.testing.assert_allclose(projected, found.pixels[rows] - found.residuals_px[rows], atol=1e-9)


def test_every_camera_gives_its_worst_view_before_any_gives_a_second():
    errors = {(0, f): 9.0 + f for f in range(5)} | {(1, 2): 0.1, (1, 3): 0.2} | {(2, 8): 1.0}
    assert worst_views(evidence(errors)) == ((0, 4), (0, 3), (0, 2), (2, 8), (1, 3), (1, 2))
    assert worst_views(evidence(errors), in_all=3) == ((0, 4), (2, 8), (1, 3))
    assert worst_views(evidence(errors), per_camera=1, in_all=2) == ((0, 4), (2, 8))


def test_a_view_is_judged_by_all_its_corners_rejected_ones_too():
    views = evidence({(0, 1): 1.0, (0, 2): 0.9})
    residuals, used = views.residuals_px.copy(), views.used.copy()
    residuals[7], used[7] = (30, 40), False
    assert worst_views(replace(views, residuals_px=residuals, used=used))[0] == (0, 2)


def images(folder, count=5, size_wh=(160, 120)):
    """Images whose colours tell the place and, by their blue, the frame."""
    for camera in ("cam0", "cam1"):
        (folder / camera).mkdir(parents=True)
        for frame in range(count):
            x, y = np.meshgrid(np.arange(size_wh[0]), np.arange(size_wh[1]))
            image = np.stack([np.full_like(x, 20 + 40 * frame), x, 2 * y], axis=2).astype(np.uint8)
            cv2.imwrite(str(folder / camera / f"{frame:04d}.png"), image)
    return open_capture(folder)


def decoded(picture):
    return cv2.imdecode(np.frombuffer(picture.jpeg, dtype=np.uint8), cv2.IMREAD_COLOR).astype(float)


def test_pictures_show_the_board_of_their_frame_at_their_place(tmp_path):
    capture = images(tmp_path)
    names = tuple(tuple(camera.frames) for camera in capture.cameras)
    made = with_pictures(evidence({(0, 3): 5.0, (1, 1): 7.0}, frames=names), capture, [(1, 1), (0, 3)])
    assert [(p.camera_idx, p.frame_idx, p.box_px) for p in made.pictures] == [
        (1, 1, (32, 22, 37, 37)),
        (0, 3, (32, 22, 37, 37)),
    ]
    for picture, frame in zip(made.pictures, (1, 3), strict=True):
        shown = decoded(picture)
        assert shown.shape == (37, 37, 3)
        assert shown[..., 0].mean() == pytest.approx(20 + 40 * frame, abs=3)
        assert shown[10, :, 1] == pytest.approx(np.arange(32, 69), abs=8)  # JPEG keeps half of the colour's resolution
        assert shown[:, 10, 2] == pytest.approx(2 * np.arange(22, 59), abs=8)


def test_frames_are_found_by_name_where_only_some_were_looked_at(tmp_path):
    capture = images(tmp_path)
    made = with_pictures(evidence({(0, 1): 5.0}, frames=(("0000", "0004"),)), capture, [(0, 1)])
    assert decoded(made.pictures[0])[..., 0].mean() == pytest.approx(180, abs=3)


def test_pictures_stay_small_and_within_the_image():
    noise = np.random.default_rng(1).integers(0, 255, (1080, 1920, 3)).astype(np.uint8)
    picture = cut_out(0, 0, noise, np.array([[5.0, 5], [1900, 10], [1900, 1070]]))
    assert picture.box_px == (0, 0, 1920, 1080)
    assert decoded(picture).shape == (LONGEST_PX * 1080 // 1920, LONGEST_PX, 3)
    assert len(picture.jpeg) <= GREATEST_BYTES
    edge = cut_out(0, 0, noise, np.array([[1919.4, 1079.4], [1919.4, 1079.4], [1930, 1090]]))
    assert edge.box_px[0] + edge.box_px[2] == 1920
    assert edge.box_px[1] + edge.box_px[3] == 1080


def video(path, count=40, gap=12):
    """Frames of plain grey, each brighter than the one before; a key frame every ``gap``."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(25), options={"g": str(gap), "bf": "2"})
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 4_000_000
        for index in range(count):
            image = np.full((48, 64, 3), 20 + 5 * index, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


def test_a_few_frames_of_a_video_are_those_that_decoding_it_whole_gives(tmp_path):
    video(tmp_path / "cam0.mp4")
    camera = open_capture(tmp_path).cameras[0]
    whole = dict(read_frames(camera, colour=True))
    some = list(read_frames_at(camera, [31, 0, 39, 13], colour=True))
    assert [index for index, _ in some] == [0, 13, 31, 39]
    for index, image in some:
        assert np.array_equal(image, whole[index])
        assert image.mean() == pytest.approx(20 + 5 * index, abs=4)


def test_a_video_that_cannot_be_sought_is_decoded_from_its_start(tmp_path):
    video(tmp_path / "cam0.mp4")
    stream = tmp_path / "raw" / "cam0.avi"
    stream.parent.mkdir()
    with av.open(str(tmp_path / "cam0.mp4")) as source, av.open(str(stream), "w") as target:
        copied = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = copied
                target.mux(packet)
    camera = open_capture(stream.parent).cameras[0]
    whole = dict(read_frames(camera))
    ((index, image),) = read_frames_at(camera, [17])
    assert index == 17
    assert np.array_equal(image, whole[17])
