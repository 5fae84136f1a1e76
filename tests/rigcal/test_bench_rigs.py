"""Claims about the calibration benchmark: its rigs, the mistakes that it plants, its bound and its scores."""

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rigcal.bundle import Freedom, SolveOptions, solve
from rigcal.detections import Finding
from rigcal.synthetic import _sees_whole

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools" / "bench"))

import calibration
import fisher
import rigs
import scoring
import summary


@pytest.fixture(scope="module")
def four():
    return rigs.ring(4, 0)


def centres(site):
    return np.array([camera.cam_from_rig.inverse().translation_m for camera in site.rig.cameras])


def seen_by(detections):
    seen = {}
    for c, camera in enumerate(detections.cameras):
        for view in camera.views:
            seen.setdefault(view.frame_idx, []).append(c)
    return [tuple(seen[frame]) for frame in sorted(seen)]


@pytest.mark.parametrize(
    ("site", "pairs"),
    [
        (rigs.ring(4, 0), [(0, 1), (0, 3), (1, 2), (2, 3)]),
        (rigs.line(4, 0), [(0, 1), (1, 2), (2, 3)]),
    ],
)
def test_neighbours_share_forty_boards_and_every_camera_sees_twenty_alone(site, pairs):
    groups = seen_by(site.detections)
    assert {group: groups.count(group) for group in set(groups)} == (
        dict.fromkeys(pairs, 40) | {(camera,): 20 for camera in range(4)}
    )
    assert sorted(set(seen_by(site.held_out))) == pairs
    corners = site.detections.board.corners_in_board
    for group, pose in zip(groups, site.rig_from_board, strict=True):
        assert all(_sees_whole(site.rig.cameras[c], pose, corners) for c in group)


def test_corners_are_off_by_the_noise_that_was_asked_for():
    exact, noisy = rigs.ring(4, 3, noise_px=0.0), rigs.ring(4, 3, noise_px=0.3)
    off = [
        v.corners_px - w.corners_px
        for a, b in zip(noisy.detections.cameras, exact.detections.cameras, strict=True)
        for v, w in zip(a.views, b.views, strict=True)
    ]
    assert np.std(off) == pytest.approx(0.3, rel=0.02)
    camera, view = exact.rig.cameras[2], exact.detections.cameras[2].views[7]
    seen = (camera.cam_from_rig @ exact.rig_from_board[view.frame_idx]).apply(exact.detections.board.corners_in_board)
    np.testing.assert_allclose(camera.camera.project(seen), view.corners_px, atol=1e-9)


def test_a_seed_gives_the_same_site_and_another_another(four):
    again, other = rigs.ring(4, 0), rigs.ring(4, 1)
    np.testing.assert_array_equal(centres(four), centres(again))
    np.testing.assert_array_equal(
        four.held_out.cameras[1].views[0].corners_px, again.held_out.cameras[1].views[0].corners_px
    )
    assert np.abs(centres(four) - centres(other)).max() > 0.01


def test_a_ring_keeps_its_radius_or_the_distance_of_neighbours():
    def ring_of(site):
        found = centres(site)
        middle = found.mean(axis=0)
        return (
            np.linalg.norm(found - middle, axis=1).mean(),
            np.linalg.norm(found - np.roll(found, 1, axis=0), axis=1).mean(),
        )

    for cameras in (4, 12):
        assert ring_of(rigs.ring(cameras, 0))[0] == pytest.approx(4.0, abs=0.05)
        assert ring_of(rigs.ring(cameras, 0, spacing=True))[1] == pytest.approx(3.06, abs=0.05)
    np.testing.assert_allclose(np.linalg.norm(np.diff(centres(rigs.line(6, 0)), axis=0), axis=1), 1.5, atol=0.3)


def test_planting_spoils_five_percent_turns_one_percent_and_leaves_the_rest(four):
    bad, planted = rigs.plant(four, 0)
    kinds = [p.kind for p in planted]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"shifted": 10, "thrown": 10, "turned": 3}
    spoilt = {(p.camera_idx, p.frame_idx): p.kind for p in planted}
    for c, (camera, before) in enumerate(zip(bad.cameras, four.detections.cameras, strict=True)):
        for view, was in zip(camera.views, before.views, strict=True):
            off = view.corners_px - was.corners_px
            far = np.linalg.norm(off, axis=1)
            match spoilt.get((c, view.frame_idx)):
                case None:
                    assert not off.any()
                case "turned":
                    np.testing.assert_array_equal(view.corners_px, was.corners_px[::-1])
                case "shifted":
                    np.testing.assert_allclose(off, off[:1].repeat(len(off), axis=0), atol=1e-9)
                    assert 5 <= far[0] <= 20
                case "thrown":
                    assert ((far >= 5) & (far <= 20)).all()
                    assert np.linalg.norm(off.mean(axis=0)) < 5


def test_a_thrown_view_tells_on_itself_and_a_shifted_one_only_where_three_see_the_board(four):
    _, planted = rigs.plant(four, 0)
    assert {p.told_by for p in planted if p.kind == "thrown"} == {"itself"}
    assert {p.told_by for p in planted if p.kind == "turned"} == {"partner"}
    triple = rigs.ring(8, 0, seen_by_three=True)
    told = [p.told_by for p in rigs.plant(triple, 0)[1] if p.kind != "thrown"]
    assert told.count("third view") > len(told) / 2
    assert set(seen_by(triple.detections)[:27]) == {(0, 1, 2)}


def test_the_bound_is_the_covariance_that_the_solver_states_at_the_truth():
    site = rigs.ring(4, 0, noise_px=1e-6)
    cameras = site.rig.cameras
    truth = scoring.Estimate(tuple(c.camera for c in cameras), tuple(c.cam_from_rig for c in cameras))
    observations, state = scoring.placed_boards(site.detections, truth)
    every = tuple(np.ones(8, dtype=bool) for _ in cameras)
    solution = solve(observations, state, Freedom(every, np.array([False, True, True, True])), SolveOptions())
    bound = fisher.position_covariances(site) / site.noise_px**2
    for c, camera in enumerate(cameras[1:], start=1):
        R, t = camera.cam_from_rig.rotation, camera.cam_from_rig.translation_m
        by_pose = np.hstack([-R.T @ np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]), -R.T])
        rows = [solution.index.index((c, unknown)) for unknown in range(6)]
        stated = by_pose @ solution.covariance[np.ix_(rows, rows)] @ by_pose.T
        np.testing.assert_allclose(bound[c - 1], stated, rtol=1e-3, atol=1e-3 * np.trace(stated))


def test_the_bound_grows_with_the_noise_and_along_an_open_line():
    quiet, loud = rigs.line(6, 0, noise_px=0.1), rigs.line(6, 0, noise_px=0.3)
    assert fisher.position_bound_m(loud) == pytest.approx(3 * fisher.position_bound_m(quiet), rel=1e-9)
    by_camera = np.trace(fisher.position_covariances(loud), axis1=1, axis2=2)
    assert (np.diff(by_camera) > 0).all()


def test_the_truth_scores_zero_and_its_held_out_error_is_the_noise(four):
    poses = [camera.cam_from_rig for camera in four.rig.cameras]
    assert scoring.position_errors_m(four, poses).max() < 1e-12
    estimate = scoring.Estimate(tuple(camera.camera for camera in four.rig.cameras), tuple(poses))
    per_corner = 0.2 * np.sqrt(2) * np.sqrt(1 - 6 / (4 * 54))  # two views hold a board's six unknowns
    assert scoring.held_out_rmse_px(four, estimate) == pytest.approx(per_corner, rel=0.02)
    moved = [*poses[:3], replace(poses[3], translation_m=poses[3].translation_m + [0, 0.003, 0])]
    assert scoring.position_errors_m(four, moved) == pytest.approx([0, 0, 0.003], abs=1e-12)
    swung = [pose @ poses[1].inverse() for pose in poses]  # the frame of another camera
    assert scoring.position_errors_m(four, swung).max() > 1
    assert scoring.aligned_rms_m(four, swung) < 1e-9


def test_naming_counts_what_can_be_told_and_leaves_partners_aside(four):
    frames = four.detections.cameras[0].frames
    planted = (
        rigs.Planted(0, 3, "thrown", "itself"),
        rigs.Planted(1, 50, "thrown", "itself"),
        rigs.Planted(0, 5, "shifted", "partner"),
        rigs.Planted(2, 200, "shifted", "nobody"),
    )
    wrong = four.detections.cameras[3].views[0].frame_idx
    findings = (
        (Finding(frames[3], "dropped", ""),),
        (Finding(frames[5], "dropped", ""),),  # the partner of a shifted view: as likely
        (),
        (Finding(frames[wrong], "dropped", ""),),
    )
    found = scoring.naming(SimpleNamespace(detections=four.detections, findings=findings), planted)
    views = sum(len(camera.views) for camera in four.detections.cameras)
    assert (found.told, found.pairs) == (0.5, 1.0)
    assert found.good_dropped == pytest.approx(1 / (views - 5))  # four spoilt and one partner


def test_a_finished_job_is_not_run_again(tmp_path, capsys):
    wanted = calibration.parser().parse_args(
        ["--rigs", "ring", "--cameras", "4", "--seeds", "1", "--methods", "chain", "--data", "clean"]
        + ["--results", str(tmp_path / "out" / "results.jsonl")]
    )
    calibration.run(wanted)
    lines = [json.loads(text) for text in capsys.readouterr().out.splitlines()]
    assert lines[0]["rms_mm"] < 15
    assert lines[0]["held_out_px"] < 0.3
    assert [line.get("summary") for line in lines] == [None, "method"]
    marked = json.loads(wanted.results.read_text()) | {"rms_mm": 1234.0}
    wanted.results.write_text(json.dumps(marked) + "\n")
    calibration.run(wanted)
    assert json.loads(capsys.readouterr().out.splitlines()[0])["rms_mm"] == 1234.0
    assert len(wanted.results.read_text().splitlines()) == 1


def test_a_peer_that_cannot_be_installed_is_skipped_once_and_says_why(tmp_path, capsys, monkeypatch):
    def refuse(peer, detections):
        raise calibration.PeerUnavailableError(f"no matching distribution found for {peer}")

    monkeypatch.setattr(calibration, "ask", refuse)
    chosen = ["--cameras", "4", "--rigs", "ring", "--seeds", "2", "--methods", "multical"]
    calibration.run(calibration.parser().parse_args([*chosen, "--results", str(tmp_path / "results.jsonl")]))
    assert [json.loads(text) for text in capsys.readouterr().out.splitlines()] == [
        {"method": "multical", "skipped": "no matching distribution found for multical"}
    ]


def test_options_refuse_an_unknown_rig(capsys):
    with pytest.raises(SystemExit):
        calibration.parser().parse_args(["--rigs", "ring,spiral"])
    assert "spiral: choose from ring, spaced, line, triple" in capsys.readouterr().err


def test_the_summary_pairs_methods_by_seed():
    def line(method, data, seed, rms_mm):
        job = calibration.Job("ring", 4, 0.2, seed, data, method, "")
        scores = {"rms_mm": rms_mm, "bound_mm": 2.0, "worst_mm": rms_mm, "aligned_mm": 1.0, "held_out_px": 0.28}
        return asdict(job) | scores | {"wall_s": 1.0, "cpu_s": 1.0, "by_camera_mm": [rms_mm]}

    lines = [line("ours", "clean", 0, 1.0), line("ours", "clean", 1, 7.0), line("ours", "bad", 1, 14.0)]
    lines += [line("chain", "clean", seed, rms_mm) for seed, rms_mm in enumerate((2.0, 10.0, 5.0))]
    found = list(
        summary.summaries([*lines, {"failed": "no", **asdict(calibration.Job("ring", 4, 0.2, 9, "bad", "ours", ""))}])
    )
    ours = next(x for x in found if x["summary"] == "method" and x["method"] == "ours" and x["data"] == "clean")
    assert ours["over_bound"] == pytest.approx(2.5)
    beside = next(x for x in found if x["summary"] == "ours over theirs")
    assert (beside["seeds"], beside["median_rms_mm_ratio"]) == (2, pytest.approx(0.6))
    worse = next(x for x in found if x["summary"] == "bad over clean")
    assert (worse["seeds"], worse["rms_ratio"]) == (1, pytest.approx(2.0))
