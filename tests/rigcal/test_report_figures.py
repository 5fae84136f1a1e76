"""Claims about the report's figures: each is true to the rig, the boards and the corners that it draws."""

import base64
import re
from itertools import combinations, pairwise

import numpy as np
import pytest

from rigcal.board import Charuco, Checkerboard
from rigcal.camera import Camera
from rigcal.evidence import Evidence, ViewPicture
from rigcal.geometry import Pose
from rigcal.report import html_report
from rigcal.report.aspect import HALF_HEIGHT, HALF_WIDTH, Aspect
from rigcal.report.coverage import CELLS, LONGER, coverage_of
from rigcal.report.overlap import RADIUS as GRAPH_RADIUS
from rigcal.report.overlap import overlap_graph, weakest_link
from rigcal.report.pictures import picture_figures
from rigcal.report.plan import plan_of
from rigcal.report.rays import SIDE_SAMPLES, border_rays
from rigcal.report.residuals import residual_figure
from rigcal.report.scene import scene_of
from rigcal.report.spreads import NEAR_SHARE, histograms_of, near_m
from rigcal.rigdocument import PoseEntry, RigDocument
from rigcal.rigfile import document_of_rig
from rigcal.synthetic import arc_rig

UTC = "2026-11-22T09:30:01Z"
BOARD = Checkerboard(9, 6, 0.06)
BOARD_ENTRY = {"kind": "checkerboard", "columns": 9, "rows": 6, "square_size_m": 0.06}


def document(count=4, *, pairs=(), chains=None, sigma_m=None, **changes) -> RigDocument:
    """A rig on an arc with chosen pairs {(first, second): (views, rmse)} and chains of camera indices."""
    data = document_of_rig(arc_rig(count, arc_deg=150), created_utc=UTC, inputs_sha256="ab").model_dump()
    ids = [camera["id"] for camera in data["cameras"]]
    data["board"] = BOARD_ENTRY
    data["pairs"] = [{"cameras": (ids[a], ids[b]), "views": v, "rmse_px": r} for (a, b), (v, r) in dict(pairs).items()]
    for camera, chain in zip(data["cameras"], chains or [[0]] + [[0, i] for i in range(1, count)], strict=True):
        camera["chain"] = tuple(ids[i] for i in chain)
    if sigma_m is not None:
        order = [f"{i}.{part}" for i in ids[1:] for part in ("rotation_rad", "translation_m")]
        variances = np.tile([1e-18] * 3 + [sigma_m**2] * 3, count - 1)
        data["covariance"] = {"order": order, "matrix": np.diag(variances).tolist()}
    return RigDocument.model_validate(data | changes)


def evidence(rig, rig_from_board=(), pixels=None, residuals_px=None, board=BOARD, **fields) -> Evidence:
    """Every board seen whole by camera 0, or corners of its own choosing in one view."""
    corners = board.corners_in_board
    if pixels is None:
        camera = rig.cameras[0]
        lens = Camera(camera.model, camera.size_wh, list(camera.coefficients.values()))
        pixels = np.concatenate([lens.project(pose.apply(corners)) for pose in rig_from_board])
    count, boards = len(pixels), len(rig_from_board)
    board_idx = np.repeat(np.arange(boards), len(corners)) if boards else np.zeros(0, dtype=int)
    frames = board_idx if boards else np.zeros(count, dtype=int)
    return Evidence(
        **{
            "camera_ids": rig.camera_ids,
            "frames": tuple(tuple(f"{i:06d}" for i in range(max(boards, 1))) for _ in rig.cameras),
            "camera_idx": np.zeros(count, dtype=int),
            "frame_idx": frames,
            "corner_ids": np.arange(count) % len(corners),
            "used": np.ones(count, dtype=bool),
            "pixels": pixels,
            "residuals_px": np.zeros((count, 2)) if residuals_px is None else residuals_px,
            "board_centres_m": np.array([pose.apply(corners.mean(axis=0)) for pose in rig_from_board]).reshape(-1, 3),
            "board_idx": board_idx,
            "rig_from_board": np.array([pose.matrix[:3] for pose in rig_from_board]).reshape(-1, 3, 4),
        }
        | fields
    )


def facing(distance_m, tilt_deg=0.0, board=BOARD) -> Pose:
    """A board whose middle is straight ahead of camera 0, turned about its own middle."""
    turn = Pose.from_rvec([0, np.deg2rad(tilt_deg), 0], [0, 0, 0])
    return Pose(turn.rotation, [0, 0, distance_m] - turn.apply(board.corners_in_board.mean(axis=0)))


def points_of(text):
    return [np.array(line.split(), dtype=float).reshape(-1, 3) for line in text.split(";")]


def scale_of(scene):
    """Units per metre, from the floor's grid."""
    columns = sorted({line[0, 0] for line in points_of(scene.lines[0].points) if line[0, 0] == line[1, 0]})
    return (columns[-1] - columns[0]) / (len(columns) - 1) / scene.grid_m


def drawn(path):
    return [np.array(re.findall(r"-?[\d.]+", line), dtype=float).reshape(-1, 2) for line in path.split("M")[1:]]


def test_seen_from_straight_above_the_scene_is_the_plan():
    rig = document(6)
    scene, plan = scene_of(rig, None), plan_of(rig, None)
    above = Aspect(0.0, 90.0, scene.aspect.rise)
    seen = np.array([above(points_of(mark.point)[0][0]) for mark in scene.marks])
    planned = np.array([[camera.x, camera.y] for camera in plan.cameras])
    scale = np.linalg.norm(np.ptp(planned, axis=0)) / np.linalg.norm(np.ptp(seen, axis=0))
    moved = planned - scale * seen
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], moved.shape), atol=0.5)  # points are whole thousandths


def test_a_higher_point_is_drawn_higher_and_a_farther_one_too():
    aspect = Aspect(0.0, 30.0, 500.0)
    here, up, far, right = aspect(np.array([[0, 0, 0], [0, 0, 100], [0, 100, 0], [100, 0, 0]], dtype=float))
    assert up[1] < here[1]
    assert far[1] < here[1]
    assert right[0] > here[0]


@pytest.mark.parametrize("with_boards", [False, True])
def test_the_scene_stays_within_its_figure_however_it_is_turned(with_boards):
    rig = document(8, sigma_m=0.01)
    boards = [facing(d, t) for d in (2.0, 6.0) for t in (0, 40)] if with_boards else []
    scene = scene_of(rig, evidence(rig, boards) if boards else None)
    points = np.concatenate([p for line in scene.lines for p in points_of(line.points)])
    for turn in range(0, 360, 30):
        for tilt in (2, 26, 60, 89):
            x, y = np.abs(Aspect(turn, tilt, scene.aspect.rise)(points)).max(axis=0)
            assert x <= HALF_WIDTH * 1.1
            assert y <= HALF_HEIGHT * 1.1 + 10


def test_what_is_drawn_is_what_the_script_turns():
    rig = document(3, sigma_m=0.01, pairs={(0, 1): (9, 0.3)})
    scene = scene_of(rig, evidence(rig, [facing(3.0, 20)]))
    assert [line.kind for line in scene.lines] == ["floor", "drop", "board", "sight", "chain", "sigma"]
    for line in scene.lines:
        for points, path in zip(points_of(line.points), drawn(line.path), strict=True):
            np.testing.assert_allclose(path, scene.aspect(points), atol=0.051)
    numbers = [float(v) for v in scene.aspect.turning.split()]
    assert numbers[:2] == pytest.approx(np.deg2rad([scene.aspect.turn_deg, scene.aspect.tilt_deg]), abs=1e-4)
    html = html_report(rig, None)
    assert f'data-turn="{scene_of(rig, None).aspect.turning}"' in html


def test_ellipsoids_are_one_sigma_as_much_larger_as_the_figure_says():
    rig = document(2, sigma_m=0.004)
    scene = scene_of(rig, None)
    circles = points_of(next(line for line in scene.lines if line.kind == "sigma").points)
    centre = points_of(scene.marks[1].point)[0][0]
    units_per_m = scale_of(scene)
    sizes = np.linalg.norm(np.concatenate(circles) - centre, axis=1)
    np.testing.assert_allclose(sizes, 0.004 * scene.magnification * units_per_m, atol=2)


def test_the_grid_lies_on_the_worlds_floor_at_whole_metres_and_cameras_stand_above_it():
    rig = document(4)
    scene = scene_of(rig, None)
    floor = np.concatenate(points_of(scene.lines[0].points))
    assert len(np.unique(floor[:, 2])) == 1
    heights = [points_of(mark.point)[0][0, 2] - floor[0, 2] for mark in scene.marks]
    world_from_rig = rig.world_from_rig.pose
    heights_m = [(world_from_rig @ c.cam_from_rig.pose.inverse()).translation_m[2] for c in rig.cameras]
    np.testing.assert_allclose(np.array(heights) / heights[0], np.array(heights_m) / heights_m[0], atol=0.01)
    assert scene.floor == "on the world's floor"
    assert "for the eye only" in scene_of(document(4, world_from_rig=None), None).floor


def test_borders_of_wide_lenses_are_seen_too():
    fisheye = Camera("fisheye4", (1000, 1000), [330, 330, 499.5, 499.5, 0, 0, 0, 0])
    rays = border_rays(fisheye)
    assert len(rays) == 4 * (SIDE_SAMPLES - 1)
    assert np.isfinite(rays).all()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-12)
    corners = rays[:: SIDE_SAMPLES - 1]
    assert corners[0] @ corners[2] == pytest.approx(np.cos(min(2 * 500 * 2**0.5 / 330, 2 * np.pi)), abs=0.02)


def test_the_weakest_link_has_the_greatest_rmse_over_the_root_of_its_views():
    chains = [[0], [0, 1], [0, 1, 2], [0, 3]]
    pairs = {(0, 1): (4, 0.4), (1, 2): (100, 0.9), (0, 3): (9, 0.7), (2, 3): (1, 5.0)}
    rig = document(4, pairs=pairs, chains=chains)
    assert weakest_link(rig).cameras == ("cam0", "cam3")  # 0.2, 0.09 and 0.233; the last pair is on no chain
    graph = overlap_graph(rig)
    assert graph.weakest == "cam0 and cam3 (9 shared views, RMSE 0.70 px)"
    assert [edge.weakest for edge in graph.edges if edge.on_chain] == [False, False, True]
    assert [edge.label for edge in graph.edges] == ["", "4", "100", "9"]
    widths = [edge.width for edge in graph.edges]
    assert sorted(range(4), key=widths.__getitem__) == [0, 1, 3, 2]
    page = html_report(rig, None)
    assert "Weakest link: cam0 and cam3 (9 shared views, RMSE 0.70 px)." in page


def test_a_rig_without_shared_views_has_no_graph():
    assert overlap_graph(document(2)) is None
    assert weakest_link(document(2)) is None
    assert "Who saw the board together" not in html_report(document(1), None)


@pytest.mark.parametrize("count", [2, 3, 4, 8, 12])
def test_labels_of_the_graph_cover_neither_each_other_nor_a_camera(count):
    pairs = {pair: (20 + sum(pair), 0.3) for pair in combinations(range(count), 2)}
    graph = overlap_graph(document(count, pairs=pairs, chains=[[0]] + [[0, i] for i in range(1, count)]))
    places = [edge.label_at for edge in graph.edges if edge.label] + [(node.x, node.y) for node in graph.nodes]
    assert min(np.linalg.norm(np.subtract(a, b)) for a, b in combinations(places, 2)) > 22
    middle = np.array([graph.width, graph.height]) / 2
    assert all(np.linalg.norm((n.x, n.y) - middle) == pytest.approx(GRAPH_RADIUS) for n in graph.nodes)
    assert all(0 < n.label_x < graph.width and 0 < n.label_y < graph.height for n in graph.nodes)


def test_a_long_chain_is_labelled_link_by_link():
    count = 20
    pairs = dict.fromkeys(pairwise(range(count)), (30, 0.3))
    graph = overlap_graph(document(count, pairs=pairs, chains=[list(range(i + 1)) for i in range(count)]))
    assert sum(bool(edge.label) for edge in graph.edges) == count - 1


def test_coverage_counts_corners_where_they_lie():
    rig = document(1)
    width, height = rig.cameras[0].size_wh
    x, y = np.meshgrid(np.linspace(0, width / 2 - 1, 40), np.linspace(0, height - 1, 40))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    figure = coverage_of(rig.cameras[0], evidence(rig, pixels=pixels))
    assert figure.covered_percent == pytest.approx(50)
    assert max(cell.x + figure.side for cell in figure.cells) == pytest.approx(LONGER / 2)
    assert figure.height == pytest.approx(LONGER * height / width)
    one = coverage_of(rig.cameras[0], evidence(rig, pixels=np.array([[width - 0.5, height - 0.5], [0.0, 0.0]])))
    assert [(round(c.x / one.side), round(c.y / one.side)) for c in one.cells] == [(0, 0), (CELLS - 1, 8)]
    assert (one.most, one.magnification) == (1, None)


def test_an_upright_image_is_drawn_upright():
    rig = document(1)
    upright = rig.cameras[0].model_copy(update={"size_wh": (1080, 1920)})
    corner = evidence(rig, pixels=np.array([[1079.0, 1919.0]]))
    coverage, residuals = coverage_of(upright, corner), residual_figure(upright, corner)
    assert (coverage.width, coverage.height) == (pytest.approx(225), LONGER)
    assert [(round(c.x / coverage.side), round(c.y / coverage.side)) for c in coverage.cells] == [(8, CELLS - 1)]
    assert (residuals.width, residuals.height) == (pytest.approx(562.5), 1000)
    assert residuals.used_marks.corners == "M562.2 999.7h0"


def test_mean_residuals_tell_a_lens_that_does_not_fit_from_noise():
    rig = document(1)
    rng = np.random.default_rng(4)
    side = rig.cameras[0].size_wh[0] / CELLS
    pixels = np.concatenate(
        [[3.5, 2.5] + rng.uniform(-0.4, 0.4, (200, 2)), [8.5, 4.5] + rng.uniform(-0.4, 0.4, (200, 2))]
    )
    residuals = rng.normal(0, 0.2, (400, 2))
    residuals[:200] += (0.3, -0.1)
    figure = coverage_of(rig.cameras[0], evidence(rig, pixels=pixels * side, residuals_px=residuals))
    bent, noise = [np.array(re.findall(r"-?[\d.]+", line), dtype=float) for line in figure.arrows.split("M")[1:]]
    units_per_px = LONGER / rig.cameras[0].size_wh[0] * figure.magnification
    np.testing.assert_allclose(bent[:2], np.array([3.5, 2.5]) * figure.side, atol=0.06)
    np.testing.assert_allclose(bent[2:] / units_per_px, [0.3, -0.1], atol=0.05)
    assert np.linalg.norm(noise[2:]) < np.linalg.norm(bent[2:]) / 5
    assert figure.key_units == pytest.approx(figure.key_px * units_per_px)


def test_histograms_count_tilts_and_distances_of_the_boards_that_were_used():
    rig = document(2)
    poses = [facing(2.0, 22), facing(2.2, -31), facing(3.1, 50), facing(7.9, 3)]
    whole = evidence(rig, poses)
    tilt, distance = histograms_of(rig.cameras[0], BOARD, whole)
    assert [(round(bar.x / tilt.bars[0].width), bar.count) for bar in tilt.bars] == [(0, 1), (4, 1), (6, 1), (10, 1)]
    assert (tilt.within, tilt.views, tilt.wanted_text) == (2, 4, "20 to 45°")
    near = near_m(rig.cameras[0], BOARD)
    inside = sum(near <= d <= 2 * near for d in (2.0, 2.2, 3.1, 7.9))
    assert (distance.within, distance.views) == (inside, 4)
    assert sum(bar.count for bar in distance.bars) == 4
    assert histograms_of(rig.cameras[1], BOARD, whole) == ()
    dropped = evidence(rig, poses, used=whole.board_idx != 3)
    assert histograms_of(rig.cameras[0], BOARD, dropped)[0].views == 3


def test_the_back_of_a_board_is_tilted_as_its_front():
    rig = document(1)
    turned = facing(2.0, 207)
    tilt, _ = histograms_of(rig.cameras[0], BOARD, evidence(rig, [turned], pixels=np.full((54, 2), 9.0)))
    assert [round(bar.x / bar.width) for bar in tilt.bars] == [5]  # 27 degrees


@pytest.mark.parametrize("board", [BOARD, Charuco(5, 7, 0.04)])
def test_the_near_end_of_the_wanted_distances_is_where_the_board_fills_a_quarter_of_the_image(board):
    camera = document(1).cameras[0]
    lens = Camera("opencv4", camera.size_wh, [*list(camera.coefficients.values())[:4], 0, 0, 0, 0])
    corners = board.corners_in_board
    low, high = corners.min(axis=0)[:2] - board.square_size_m / 2, corners.max(axis=0)[:2] + board.square_size_m / 2
    ends = lens.project(np.array([[*low, 0], [*high, 0]]) + [0, 0, near_m(camera, board)])
    assert np.prod(ends[1] - ends[0]) == pytest.approx(NEAR_SHARE * np.prod(camera.size_wh))


def test_residuals_without_board_positions_say_why_there_are_no_histograms():
    rig = document(2)
    old = evidence(rig, pixels=np.full((5, 2), 90.0))
    assert histograms_of(rig.cameras[0], BOARD, old) == ()
    assert "these residuals hold no board positions, as an earlier rigcal wrote them" in html_report(rig, old)


def test_corners_are_drawn_over_the_picture_where_they_lie_in_the_image():
    rig = document(1)
    pixels, residuals = np.array([[100.0, 60.0], [139.5, 79.5]]), np.array([[3.0, -4.0], [0.0, 0.0]])
    picture = ViewPicture(0, 0, (90, 50, 50, 30), b"jpeg")
    whole = evidence(rig, pixels=pixels, residuals_px=residuals, used=[False, True], pictures=(picture,))
    (figure,) = picture_figures(rig, whole)
    assert base64.b64decode(figure.image.removeprefix("data:image/jpeg;base64,")) == b"jpeg"
    assert figure.height == 600
    assert figure.detected == "M210 210h0M1000 600h0"  # 20 units a pixel; (139.5, 79.5) is the picture's last corner
    assert figure.projected.startswith("M150 290m")  # detected less its residual
    assert figure.gaps == "M210 210l-60 80M1000 600l0 0"
    assert (figure.used, figure.corners, figure.worst_px) == (1, 2, 5.0)
    assert figure.rmse_px == pytest.approx(np.sqrt(12.5))


def test_a_picture_says_what_was_done_to_its_view():
    data = document(1).model_dump()
    data["cameras"][0]["views"]["findings"] = [{"frame": "000000", "action": "dropped", "reason": "residual 5.0 px"}]
    rig = RigDocument.model_validate(data)
    picture = ViewPicture(0, 0, (90, 50, 50, 30), b"jpeg")
    page = html_report(rig, evidence(rig, pixels=np.full((4, 2), 99.0), pictures=(picture,)))
    assert (
        "<strong>cam0, 000000</strong>: RMSE 0 px, greatest 0 px; 4 of 4 corners used; dropped: residual 5.0 px."
        in page
    )
    assert "The views that fit worst" not in html_report(rig, evidence(rig, pixels=np.full((4, 2), 99.0)))


def test_a_world_moves_the_floor_and_not_the_boards_from_the_cameras():
    rig = document(2)
    other = document(2, world_from_rig=PoseEntry.of(Pose.from_rvec([0.1, 0.2, 0.3], [5, 6, 7])).model_dump())
    whole = evidence(rig, [facing(3.0, 20)])
    gaps = []
    for scene in (scene_of(rig, whole), scene_of(other, whole)):
        lines = {line.kind: np.concatenate(points_of(line.points)) for line in scene.lines}
        centre = points_of(scene.marks[0].point)[0][0]
        gaps.append(np.linalg.norm(lines["board"][:4].mean(axis=0) - centre) / scale_of(scene))
    np.testing.assert_allclose(gaps, 3.0, rtol=0.01)
