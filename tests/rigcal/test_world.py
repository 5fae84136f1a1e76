"""The world frame: exact without noise, within its stated sigmas with it, and a message for each bad measurement."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.amend import amended
from rigcal.board import Checkerboard
from rigcal.errors import BelowFloorError, NotFlatError, TableError, WorldError, WorldPointError
from rigcal.geometry import Pose
from rigcal.relative import covariance_entry
from rigcal.rigdocument import GateEntry
from rigcal.rigfile import document_of_rig
from rigcal.synthetic import arc_rig, exact_detections, with_noise
from rigcal.world import (
    read_pixels,
    read_points,
    world_from_floor_board,
    world_from_plumb_line,
    world_from_points,
)

BOARD = Checkerboard(9, 6, 0.08)
NOW = "2026-11-22T09:30:01Z"
RIG = arc_rig(4, arc_deg=110, height_m=2.5, seed=2)
TRUE = RIG.world_from_rig


def document(rig=RIG):
    return document_of_rig(rig, created_utc=NOW, inputs_sha256="", board=BOARD)


def on_the_floor(*places, thickness_m=0.0, lifted=()):
    """``rig_from_board`` of a board lying printed side up at (x, y, heading in degrees)."""
    poses = []
    for index, (x, y, heading) in enumerate(places):
        turn = Pose.from_rvec([0, 0, np.deg2rad(heading)], [x, y, thickness_m]) @ Pose.from_rvec(
            [np.pi, 0, 0], [0, 0, 0]
        )
        tilt = lifted[index] if index < len(lifted) else (0, 0, 0)
        poses.append(TRUE.inverse() @ turn @ Pose.from_rvec(np.deg2rad(tilt), [0, 0, 0]))
    return poses


def tilt_deg(found, true=TRUE):
    """Angle between two verticals."""
    return np.rad2deg(np.arccos(np.clip((found.rotation @ true.rotation.T)[2, 2], -1, 1)))


def test_a_board_on_the_floor_gives_the_floor_exactly():
    detections = exact_detections(RIG, BOARD, on_the_floor((0.2, -0.1, 30), thickness_m=0.005))
    world = world_from_floor_board(detections, document(), 0.005)
    assert tilt_deg(world.world_from_rig) < 1e-5
    expected = Pose.from_rvec([0, 0, np.deg2rad(30)], [0.2, -0.1, 0]).inverse() @ TRUE
    np.testing.assert_allclose(world.world_from_rig.matrix, expected.matrix, atol=1e-6)
    heights = world.camera_heights_m(RIG)
    assert all(
        abs(h - TRUE.apply(RIG.camera(c).cam_from_rig.inverse().translation_m)[2]) < 1e-6 for c, h in heights.items()
    )


def test_tilt_and_height_lie_within_their_sigmas():
    """Mean squares over 60 draws: 0.87 (tilt) and 0.81 (height) measured; 0.64 m of board from 5 m away."""
    tilts, heights = [], []
    for seed in range(12):
        places = [(0.3, -0.4, 10 * seed), (-0.5, 0.3, 40)][: 1 + seed % 2]
        detections = with_noise(exact_detections(RIG, BOARD, on_the_floor(*places)), 0.2, seed=seed)
        world = world_from_floor_board(detections, document(), 0.0)
        tilts.append(tilt_deg(world.world_from_rig) / world.tilt_sigma_deg)
        origin = world.world_from_rig.inverse().translation_m
        heights.append(TRUE.apply(origin)[2] / world.height_sigma_m)
        assert world.tilt_sigma_deg < 0.3
    assert 0.3 < np.mean(np.square(tilts)) < 2.0
    assert 0.3 < np.mean(np.square(heights)) < 2.2


def test_the_rigs_own_uncertainty_widens_the_floors():
    detections = with_noise(exact_detections(RIG, BOARD, on_the_floor((0, 0, 0))), 0.2, seed=0)
    exact = world_from_floor_board(detections, document(), 0.0)
    free = RIG.camera_ids[1:]
    covariance = np.kron(np.eye(3), np.diag([0.002] * 3 + [0.01] * 3) ** 2)
    loose = document().model_copy(update={"covariance": covariance_entry(free, covariance, None)})
    wider = world_from_floor_board(detections, loose, 0.0)
    assert wider.tilt_sigma_deg > 2 * exact.tilt_sigma_deg
    assert wider.height_sigma_m > 2 * exact.height_sigma_m


def test_one_camera_suffices():
    detections = exact_detections(RIG, BOARD, on_the_floor((0, 0, 0)), seen_by=[["cam1"]])
    assert tilt_deg(world_from_floor_board(detections, document(), 0.0).world_from_rig) < 1e-4


@pytest.mark.parametrize("count", [2, 5])
def test_a_board_that_does_not_lie_flat_is_refused_by_name(count):
    places = [(0.3, -0.4, 0), (-0.5, 0.3, 40), (0.4, 0.5, 80), (-0.4, -0.4, 10), (0, 0, 60)][:count]
    detections = with_noise(
        exact_detections(RIG, BOARD, on_the_floor(*places, lifted=[(0, 0, 0), (4, 0, 0)])), 0.2, seed=1
    )
    with pytest.raises(NotFlatError) as error:
        world_from_floor_board(detections, document(), 0.0)
    assert "the board does not lie flat: frame 00000" in error.value.what
    if count > 2:
        assert "frame 000001 (" in error.value.what
        assert "4.0 degrees off in tilt" in error.value.got or "3.9 degrees off in tilt" in error.value.got
    assert "lay the board flat on the floor there" in error.value.do_next


def test_a_board_on_the_ceiling_or_a_table_top_seen_from_below_is_refused():
    low = replace(
        RIG,
        cameras=(
            *RIG.cameras[:3],
            replace(
                RIG.cameras[3],
                cam_from_rig=RIG.cameras[3].cam_from_rig
                @ TRUE.inverse()
                @ Pose(np.eye(3), np.array([0, 0, 3.0]))
                @ TRUE,
            ),
        ),
    )
    detections = exact_detections(RIG, BOARD, on_the_floor((0, 0, 0)), seen_by=[["cam0", "cam1"]])
    with pytest.raises(BelowFloorError, match="cam3 would lie below the floor") as error:
        world_from_floor_board(detections, document(low), 0.0)
    assert "cam3 at -0." in error.value.got
    assert "lay the board on the floor, below every camera" in error.value.do_next


def test_a_board_that_nobody_sees_is_refused():
    with pytest.raises(WorldError, match="no camera sees the board on the floor well enough"):
        world_from_floor_board(exact_detections(RIG, BOARD, []), document(), 0.0)


POINTS = {
    "door": np.array([0.0, 0.0, 0.0]),
    "pillar": np.array([1.2, 0.1, 0.0]),
    "shelf": np.array([0.2, 1.1, 1.0]),
    "gate": np.array([-0.8, 0.4, 0.3]),
    "crane": np.array([-0.2, -0.6, 1.5]),
}


def pixels_of(points, rig=RIG, noise_px=0.0, seed=0):
    rng = np.random.default_rng(seed)
    found = {}
    for name, point in points.items():
        in_rig = TRUE.inverse().apply(point)
        found[name] = {
            c.id: c.camera.project(c.cam_from_rig.apply(in_rig)) + rng.normal(0, 1, 2) * noise_px for c in rig.cameras
        }
    return found


def test_measured_points_give_the_world_exactly():
    world = world_from_points(RIG, POINTS, pixels_of(POINTS), where="p.csv")
    np.testing.assert_allclose(world.world_from_rig.matrix, TRUE.matrix, atol=1e-9)
    assert world.scale_percent == pytest.approx(0, abs=1e-6)
    assert world.worst.off_m < 1e-8


def test_noisy_points_lie_within_their_sigmas():
    tilts, scales = [], []
    for seed in range(40):
        world = world_from_points(RIG, POINTS, pixels_of(POINTS, noise_px=1.0, seed=seed), where="p.csv")
        tilts.append(tilt_deg(world.world_from_rig) / world.tilt_sigma_deg)
        scales.append(world.scale_percent / world.scale_sigma_percent)
    assert 0.5 < np.median(np.square(tilts)) < 1.6
    assert 0.3 < np.median(np.square(scales)) < 1.0


@pytest.mark.parametrize("scale", [0.98, 1.03])
def test_a_wrong_board_size_is_told_with_its_sign(scale):
    measured = {name: scale * point for name, point in POINTS.items()}
    world = world_from_points(RIG, measured, pixels_of(POINTS), where="p.csv")
    assert world.scale_percent == pytest.approx(100 * (scale - 1), abs=1e-6)


def test_a_point_that_contradicts_the_others_is_named():
    wrong = POINTS | {"shelf": POINTS["shelf"] + [0.0, 0.4, 0.0]}
    with pytest.raises(WorldPointError, match="point shelf contradicts the others") as error:
        world_from_points(RIG, wrong, pixels_of(POINTS), where="p.csv")
    assert "400 mm off; the others agree within 0 mm" in error.value.got


def test_points_that_do_not_fit_at_all_are_refused_with_the_scale():
    wrong = {name: 1.3 * point for name, point in POINTS.items()}
    with pytest.raises(WorldPointError, match="the points do not fit the rig") as error:
        world_from_points(RIG, wrong, pixels_of(POINTS), where="p.csv")
    assert "+30.0 % longer than the rig's" in error.value.got


def test_points_on_a_line_and_too_few_are_refused():
    line = {name: np.array([0.5 * i, 0.0, 0.0]) for i, name in enumerate(POINTS)}
    with pytest.raises(WorldPointError, match="do not determine a world") as error:
        world_from_points(RIG, line, pixels_of(line), where="p.csv")
    assert "on one line" in error.value.got
    two = {name: POINTS[name] for name in ("door", "pillar")}
    with pytest.raises(WorldPointError, match="do not determine a world"):
        world_from_points(RIG, two, pixels_of(two), where="p.csv")


def test_mirrored_points_are_recognised():
    mirrored = {name: point * [1, -1, 1] for name, point in POINTS.items()}
    with pytest.raises(WorldPointError, match="the points are mirrored") as error:
        world_from_points(RIG, mirrored, pixels_of(POINTS), where="p.csv")
    assert "change the sign of y_m" in error.value.do_next


def test_a_pixel_in_the_wrong_place_names_its_point():
    pixels = pixels_of(POINTS)
    pixels["gate"]["cam2"] = pixels["gate"]["cam2"] + [0.0, 150.0]
    with pytest.raises(WorldPointError, match="the pixels of point gate do not belong to one place") as error:
        world_from_points(RIG, POINTS, pixels, where="p.csv")
    assert "cam2" in error.value.got
    pixels["gate"] = {"cam0": pixels["gate"]["cam0"]}
    with pytest.raises(WorldPointError, match="point gate is seen by too few cameras"):
        world_from_points(RIG, POINTS, pixels, where="p.csv")


def test_pixels_of_a_point_without_a_place_are_refused():
    with pytest.raises(WorldPointError, match="point crane has pixels but no place in the world"):
        world_from_points(RIG, {n: p for n, p in POINTS.items() if n != "crane"}, pixels_of(POINTS), where="p.csv")


LINE = {"top": np.array([0.4, 0.3, 2.0]), "middle": np.array([0.4, 0.3, 1.2]), "bottom": np.array([0.4, 0.3, 0.4])}


@pytest.mark.parametrize("floor", ["point", "camera"])
def test_a_plumb_line_gives_the_vertical_and_the_floor(floor):
    points = LINE | ({"floor": np.array([-0.3, 0.5, 0.0])} if floor == "point" else {})
    true_height = TRUE.apply(RIG.camera("cam2").cam_from_rig.inverse().translation_m)[2]
    height = ("cam2", true_height) if floor == "camera" else None
    world = world_from_plumb_line(RIG, pixels_of(points), height, where="p.csv")
    assert tilt_deg(world.world_from_rig) < 1e-6
    centre = TRUE.translation_m  # of the reference, in the true world
    np.testing.assert_allclose(world.world_from_rig.translation_m, [0, 0, centre[2]], atol=1e-7)
    right = world.world_from_rig.rotation[:, 0]
    assert right[0] > 0.99
    assert world.world_from_rig.rotation[1, 2] > 0


def test_a_noisy_plumb_line_lies_within_its_sigma():
    ratios = []
    for seed in range(40):
        points = LINE | {"floor": np.array([-0.3, 0.5, 0.0])}
        world = world_from_plumb_line(RIG, pixels_of(points, noise_px=1.0, seed=seed), None, where="p.csv")
        ratios.append(tilt_deg(world.world_from_rig) / world.tilt_sigma_deg)
    assert 0.4 < np.mean(np.square(ratios)) < 1.6


def test_plumb_lines_that_say_too_little_or_nonsense_are_refused():
    with pytest.raises(WorldPointError, match="nothing says where the floor is") as error:
        world_from_plumb_line(RIG, pixels_of(LINE), None, where="p.csv")
    assert "--height cam0:2.41m" in error.value.do_next
    with pytest.raises(WorldPointError, match="the floor is given twice"):
        world_from_plumb_line(RIG, pixels_of(LINE | {"floor": np.zeros(3)}), ("cam0", 2.5), where="p.csv")
    with pytest.raises(WorldPointError, match="the plumb line has no point top"):
        world_from_plumb_line(RIG, pixels_of({"bottom": LINE["bottom"]}), ("cam0", 2.5), where="p.csv")
    bent = LINE | {"middle": LINE["middle"] + [0.1, 0.0, 0.0]}
    with pytest.raises(WorldPointError, match="the plumb line is not straight") as error:
        world_from_plumb_line(RIG, pixels_of(bent), ("cam0", 2.5), where="p.csv")
    assert error.value.got == "middle is 67 mm off"
    upside_down = {"top": LINE["bottom"], "bottom": LINE["top"]}
    with pytest.raises(BelowFloorError, match="would lie below the floor") as error:
        world_from_plumb_line(RIG, pixels_of(upside_down | {"floor": np.zeros(3)}), None, where="p.csv")
    assert "which point is top and which bottom" in error.value.do_next


def test_tables_are_read_and_their_mistakes_named(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("\ufeffname,x_m,y_m,z_m,note\ndoor, 0.0,1.5,0,left\n\npillar,4,0,0,\n", encoding="utf-8")
    found = read_points(path)
    assert {name: point.tolist() for name, point in found.items()} == {"door": [0, 1.5, 0], "pillar": [4, 0, 0]}

    def error_of(text, reader):
        path.write_text(text)
        with pytest.raises(TableError) as error:
            reader(path)
        return error.value

    assert error_of("name;x_m;y_m;z_m\na;1;2;3\n", read_points).what == "the table has no column name, x_m, y_m, z_m"
    assert "line 2 holds something that is no number" in error_of("name,x_m,y_m,z_m\na,1,2,\n", read_points).what
    assert "line 3 gives point a again" in error_of("name,x_m,y_m,z_m\na,1,2,3\na,1,2,3\n", read_points).what
    pixels = "name,camera,u_px,v_px\n"
    assert (
        error_of(f"{pixels}a,cam9,1,2\n", lambda p: read_pixels(p, ["cam0"])).what
        == "line 2 names a camera that the rig does not have"
    )
    twice = error_of(f"{pixels}a,cam0,1,2\na,cam0,1,2\n", lambda p: read_pixels(p, ["cam0"]))
    assert "line 3 gives point a in camera cam0 again" in twice.what
    path.unlink()
    with pytest.raises(TableError, match="this table cannot be read"):
        read_points(path)


def test_a_rewritten_rig_file_keeps_its_history_and_judges_its_gates():
    gates = (
        GateEntry(name="views", camera="cam0", value=3, limit=6, passed=True),
        GateEntry(name="refined_rmse_px", camera="cam0", value=0.2, limit=1, passed=True),
    )
    judged = document().model_copy(update={"gates": gates, "verdict": "PASS", "digest": "sha256:before"})
    after = amended(judged, {}, command="world", utc=NOW)
    assert [gate.passed for gate in after.gates] == [False, True]
    assert after.verdict == "RECAPTURE"
    assert [entry.command for entry in after.history] == ["import", "world"]
    assert after.history[-1].parent_digest == "sha256:before"
    assert amended(document(), {}, command="world", utc=NOW).verdict == "IMPORTED"
