"""Claims about how the demo's captures are made: boards where they should be, free places, clocks in the log."""

import numpy as np
import pytest

from rigcal.camera import MODELS
from rigcal.detect import find_board
from rigcal.geometry import Pose
from rigcal.rig import RigCamera
from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.log import read_exchanges
from rigcal.synthetic import look_at
from tools.sicsg.demo.boards import floor_poses
from tools.sicsg.demo.painting import INK, PAPER, PLATE, BoardPainter, outline_m
from tools.sicsg.demo.places import MOVING, STILL, Seen, between, frames
from tools.sicsg.demo.probes import write_probes
from tools.sicsg.demo.scene import BOARD, CLOCKS, THICKNESS_M
from tools.sicsg.rendering.lens import camera_of
from tools.sicsg.scene import Lamp, Light, SceneCamera
from tools.sicsg.sequences import EPOCH_S, write_stamps

SIZE_WH = (960, 540)
DARK = Light(
    name="0000", kind="indoor", lamps=(), sun_direction=(0, 0, 1), sun=0.0, sky=0.0, ambient=(1.0, 0.8, 0.6),
    exposure_ev=0.0,
)  # fmt: skip


def camera(number=0):
    pose = look_at((0.4, -4.0 + 0.3 * number, 2.0), (0.0, 0.0, 0.9))
    values = (700.0, 702.0, 478.0, 271.0, -0.15, 0.03, 3e-4, -2e-4, 0.0)
    coefficients = dict(zip(MODELS["opencv5"], values, strict=True))
    return SceneCamera(
        id=f"cam{number}", size_wh=SIZE_WH, coefficients=coefficients, quat_wxyz=tuple(pose.quat_wxyz.tolist()),
        translation_m=tuple(pose.translation_m.tolist()), fps=10.0,
        clock_offset_s=CLOCKS[number].stamp_offset_s, clock_drift_ppm=CLOCKS[number].drift_ppm,
    )  # fmt: skip


def facing(one, at, turn=(0.0, 0.0, 0.0)):
    """``world_from_board`` with the board's middle at a point, its front to the camera, then turned."""
    cam_from_world = Pose.from_quat_wxyz(one.quat_wxyz, one.translation_m)
    rotation = cam_from_world.rotation.T @ Pose.from_rvec(turn, np.zeros(3)).rotation
    return Pose(rotation, np.array(at) - rotation @ BOARD.corners_in_board.mean(axis=0))


def grey_room():
    return np.full((*SIZE_WH[::-1], 3), 0.3, np.float32)


@pytest.mark.parametrize("turn", [(0.1, 0.1, 0.15), (0.4, -0.3, 0.2), (-0.3, 0.5, -0.2)])
def test_a_painted_board_is_found_where_it_is(turn):
    one = camera()
    place = facing(one, (0.1, -0.8, 1.0), turn)
    picture = BoardPainter(one, BOARD, DARK).paint(grey_room(), [place])
    grey = np.clip(picture @ [80.0, 80.0, 80.0], 0, 255).astype(np.uint8)
    found = find_board(grey, BOARD)
    cam_from_board = Pose.from_quat_wxyz(one.quat_wxyz, one.translation_m) @ place
    expected = camera_of(one).project(cam_from_board.apply(BOARD.corners_in_board))
    assert found is not None
    assert len(found.corners_px) == len(expected)
    assert np.abs(found.corners_px - expected).max() < 0.06


def test_the_board_reflects_the_light_that_falls_on_it_and_its_back_is_a_plain_plate():
    one = camera()
    painter, place = BoardPainter(one, BOARD, DARK), facing(one, (0.0, -1.0, 1.0))
    front = painter.paint(grey_room(), [place])
    changed = np.abs(front - 0.3).max(axis=2) > 1e-6
    assert front[changed].max(axis=0) == pytest.approx(PAPER * np.array(DARK.ambient), rel=1e-4)
    assert front[changed][:, 0].min() == pytest.approx(INK, rel=1e-3)
    turned = Pose(place.rotation @ np.diag([1.0, -1.0, -1.0]), place.translation_m)
    back = painter.paint(grey_room(), [turned])
    inner = np.abs(back - np.float32(0.3)).max(axis=2) > 0.05
    assert back[inner][:, 0].max() == pytest.approx(PLATE, rel=1e-4)
    lamp = Lamp(position_m=(0.0, -2.0, 3.0), size_m=(1.0, 0.2), power=1.0, colour=(1.0, 1.0, 1.0))
    brighter = BoardPainter(one, BOARD, DARK.model_copy(update={"lamps": (lamp,)})).paint(grey_room(), [place])
    assert brighter.max() > front.max()
    assert np.array_equal(grey_room(), painter.paint(grey_room(), [facing(one, (0.0, -9.0, 1.0))]))


def test_a_moving_board_is_smeared():
    one = camera()
    painter = BoardPainter(one, BOARD, DARK)
    here, there = facing(one, (0.0, -1.0, 1.0)), facing(one, (0.06, -1.0, 1.0))
    still, moving = (
        painter.paint(grey_room(), [here]),
        painter.paint(grey_room(), [here, between(here, there, 0.5), there]),
    )
    edges = [np.abs(np.diff(picture[..., 0], axis=1)).max() for picture in (still, moving)]
    assert edges[1] < 0.8 * edges[0]


def test_every_place_is_held_still_and_then_left():
    one = camera()
    way = [facing(one, (x, -1.0, 1.0)) for x in (-0.5, 0.0, 0.6)]
    film = frames(way, 5.0, 0.008)
    assert len(film) == 3 * STILL + 2 * MOVING
    assert [len(parts) for parts in film] == ([1] * STILL + [5] * MOVING) * 2 + [1] * STILL
    for number, place in enumerate(way):
        held = [parts[0] for parts in film[number * (STILL + MOVING) :][:STILL]]
        assert all(np.linalg.norm(pose.translation_m - place.translation_m) < 0.004 for pose in held)
        assert len({pose.translation_m.tobytes() for pose in held}) == STILL
    again = frames(way, 5.0, 0.008)
    assert all(np.array_equal(a[0].rotation, b[0].rotation) for a, b in zip(film, again, strict=True))


def test_what_hides_a_board_is_noticed():
    one = camera()
    member = RigCamera("cam0", camera_of(one), Pose.from_quat_wxyz(one.quat_wxyz, one.translation_m))
    outline = facing(one, (0.0, -1.0, 1.0)).apply(outline_m(BOARD))
    wall = np.full(SIZE_WH[::-1], 6.0, np.float32)
    assert Seen(member, wall).shows_whole(outline) is True
    assert Seen(member, np.full_like(wall, 2.0)).shows_whole(outline) is False
    assert Seen(member, wall).shows_whole(outline + [30.0, 0.0, 0.0]) is None


def test_the_board_lies_on_the_floor_with_its_first_corner_at_the_origin():
    first, *others = floor_poses()
    corners = first.apply(BOARD.corners_in_board)
    assert corners[0] == pytest.approx((0.0, 0.0, THICKNESS_M))
    assert corners[1] == pytest.approx((BOARD.square_size_m, 0.0, THICKNESS_M))
    for pose in (first, *others):
        assert pose.apply(BOARD.corners_in_board)[:, 2] == pytest.approx(THICKNESS_M)
        assert pose.rotation[2, 2] == -1.0  # its printed side, -z, is up
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


class FourCameras:
    cameras = tuple(camera(number) for number in range(len(CLOCKS)))


def test_the_log_holds_every_hosts_clock(tmp_path):
    path = tmp_path / "clock_probes.csv"
    write_probes(FourCameras, path)
    log = read_exchanges(path)
    assert list(log) == ["cam0", "cam1", "cam2", "cam3"]
    for answers, clock in zip(log.values(), CLOCKS, strict=True):
        model = estimate_clock(answers).model
        at_s = EPOCH_S + 5.0
        told = model.rig_time_s(at_s) - at_s
        truth = clock.host_offset_s + clock.drift_ppm * 1e-6 * 5.0
        assert abs(told - truth) <= model.bound_at_s(at_s) < 0.001
    before = path.read_bytes()
    write_probes(FourCameras, path)
    assert path.read_bytes() == before


def test_stamps_are_the_cameras_own_time(tmp_path):
    path, times = tmp_path / "timestamps.csv", np.array([0.0, 0.1, 20.0])
    write_stamps(path, FourCameras, {one.id: times for one in FourCameras.cameras})
    rows = [line.split(",") for line in path.read_text().splitlines()]
    assert rows[0] == ["cam_id", "frame_time"]
    for (name, stamp), t_s in zip(rows[4:7], times, strict=True):
        assert name == "cam1"
        off = CLOCKS[1].host_offset_s - CLOCKS[1].latency_s + CLOCKS[1].drift_ppm * 1e-6 * t_s
        assert float(stamp) - EPOCH_S + off == pytest.approx(t_s, abs=2e-6)
