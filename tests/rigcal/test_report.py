"""Claims about the calibration report: what it says, that it says all of it, and that it is one harmless page."""

import base64
import hashlib
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest
from rich.console import Console

from rigcal.camera import Camera
from rigcal.errors import EvidenceError
from rigcal.evidence import Evidence, ViewPicture
from rigcal.geometry import Pose
from rigcal.pictures import GREATEST_BYTES
from rigcal.report import html_report, lens_report, text_report
from rigcal.report.numbers import beside_limit, fixed, round_down, round_up, signed, with_sigma
from rigcal.report.plan import plan_of
from rigcal.report.rays import horizontal_fov_deg
from rigcal.report.residuals import SHOWN_CORNERS, residual_figure, spread
from rigcal.report.svgpath import short
from rigcal.report.words import gate_meaning, next_actions
from rigcal.rig import RigCamera
from rigcal.rigdocument import PoseEntry, RigDocument
from rigcal.rigfile import document_of_rig
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig

UTC = "2026-11-22T09:30:01Z"
PIXELS = 0.3
"""RMSE that the made-up residuals have in every camera, px."""


def camera_entry(camera: RigCamera, index: int, ids):
    """A camera with figures that no other camera has, so that a test finds each of them in the report."""
    alone = index == 0
    return {
        "id": camera.id,
        "serial": camera.serial,
        "size_wh": camera.camera.size_wh,
        "model": camera.camera.model,
        "coefficients": camera.camera.coefficients,
        "cam_from_rig": PoseEntry.of(camera.cam_from_rig).model_dump(),
        "rmse_px": {
            "intrinsic": 0.11 + index / 1000,
            "pairwise": None if alone else 0.61 + index / 50,
            "chained": None if alone else 1.57 + index / 10,
            "refined": PIXELS,
            "held_out": 0.41 + index / 50,
            "all": 2.33 + index / 10,
        },
        "chain": ids[: index + 1],
        "sigma": {
            "fx_px": 1.13 + index, "fy_px": 1.17 + index, "cx_px": 2.19 + index, "cy_px": 2.23 + index,
            "position_m": index * 0.0041, "rotation_deg": index * 0.031,
        },
        "views": {"frames": 100 + index, "detected": 60 + index, "used": 40 + index, "findings": []},
        "clock": None,
    }  # fmt: skip


def gate(name, camera, value, limit, passed=True, advice=None):
    return {"name": name, "camera": camera, "value": value, "limit": limit, "passed": passed, "advice": advice}


def content(count=4, *, rename=lambda camera_id: camera_id):
    """The content of a rig file with ``count`` cameras that passed."""
    rig = arc_rig(count, arc_deg=360.0 if count > 8 else 150.0)
    cameras = [replace(camera, id=rename(camera.id)) for camera in rig.cameras]
    ids = [camera.id for camera in cameras]
    free = [f"{camera_id}.{part}" for camera_id in ids[1:] for part in ("rotation_rad", "translation_m")]
    return {
        "site": "hall-3",
        "created_utc": UTC,
        "reference": ids[0],
        "board": {"kind": "checkerboard", "columns": 9, "rows": 6, "square_size_m": 0.06},
        "cameras": [camera_entry(camera, index, ids) for index, camera in enumerate(cameras)],
        "pairs": [
            {"cameras": [one, two], "views": 70 + i, "rmse_px": 0.71 + i / 50}
            for i, (one, two) in enumerate(pairwise(ids))
        ],
        "covariance": {"order": free, "matrix": (np.eye(3 * len(free)) * 1e-6).tolist()} if free else None,
        "world_from_rig": PoseEntry.of(rig.world_from_rig).model_dump(),
        "gates": [
            gate("intrinsic_rmse_px", camera_id, 0.1234 + i / 1000, 0.5) for i, camera_id in enumerate(ids)
        ] + [gate("scene_sigma_m", None, 0.00567, 0.02)],
        "verdict": "PASS",
        "history": [{"command": "calibrate", "utc": UTC, "parent_digest": None}],
        "provenance": {
            "rigcal": "0.1.0", "inputs_sha256": "ab" * 32, "options": {"model": "opencv5"},
            "packages": {"numpy": "2.2"},
        },
        "extensions": {"rigcal": {"instants": {"rule": "timestamps.csv", "spread_s": 0.0131, "shared": 36}}},
        "geometry_digest": "sha256:" + "cd" * 32,
        "digest": "sha256:" + "ef" * 32,
    }  # fmt: skip


def document(count=4, **changes) -> RigDocument:
    return RigDocument.model_validate(content(count) | changes)


def evidence_for(rig: RigDocument, corners=300, rejected=0) -> Evidence:
    """Residuals of RMSE :data:`PIXELS` over the used corners of every camera, board centres about the scene."""
    rng = np.random.default_rng(3)
    count = len(rig.cameras)
    residuals = rng.normal(0, 1, (count, corners, 2))
    used = np.arange(corners) >= rejected
    residuals *= PIXELS / np.sqrt((residuals[:, used] ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    residuals[:, ~used] += 40
    sizes = np.array([camera.size_wh for camera in rig.cameras])
    return Evidence(
        rig.camera_ids,
        tuple(tuple(f"{i:06d}" for i in range(-(-corners // 50))) for _ in rig.cameras),
        np.repeat(np.arange(count), corners),
        np.tile(np.arange(corners) // 50, count),
        np.tile(np.arange(corners), count),
        np.tile(used, count),
        (rng.uniform(0, 1, (count, corners, 2)) * sizes[:, None]).reshape(-1, 2),
        residuals.reshape(-1, 2),
        rng.normal([0, 1, 5], 0.7, (24, 3)),
    )


def failing(count=4) -> RigDocument:
    """Two cameras fail one gate with the same advice, the rig fails another that was not measured."""
    data = content(count) | {"verdict": "RECAPTURE"}
    advice = "show the board to cam2 and cam3 together, nearer and tilted"
    data["gates"] += [
        gate("position_sigma_m", "cam2", 0.0312, 0.02, False, advice),
        gate("position_sigma_m", "cam3", 0.0467, 0.02, False, advice),
        gate("split_half", None, None, 5.0, False, "too few views to measure this: add shared views"),
        gate("intrinsic_rmse_px", "cam1", 0.5004, 0.5, False, "show cam1 a sharp, still board again"),
    ]
    data["cameras"][1]["views"]["findings"] = [
        {"frame": f"{i:06d}", "action": "dropped" if i else "unflipped", "reason": f"residual {4 + i / 10:.1f} px"}
        for i in range(9)
    ]
    data["cameras"][1]["clock"] = {
        "offset_s": 0.00217, "drift_ppm": 1.31, "at_utc": UTC, "bound_s": 0.000123, "drift_bound_ppm": 0.43,
        "method": "probe",
    }  # fmt: skip
    return RigDocument.model_validate(data)


def terminal(rig: RigDocument, *, width=80, **settings) -> str:
    """The text report as a console prints it."""
    return printed(text_report(rig, file_name="hall-3.rig.json"), width=width, **settings)


def printed(what, **settings) -> str:
    console = Console(**settings)
    with console.capture() as capture:
        console.print(what)
    return capture.get()


class Page(HTMLParser):
    """A page's visible text, and whether its tags are balanced."""

    VOID = ("meta", "br", "hr", "img", "input", "link", "wbr")

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open, self.parts, self.tags, self.folded = [], [], [], []
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            (self.folded if "details" in self.open else self.parts).append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.parts + self.folded).split())

    @property
    def unfolded(self):
        return " ".join(" ".join(self.parts).split())


def shared_figures(rig: RigDocument) -> list[str]:
    """Every figure that both reports show, as it is written there."""
    figures = []
    for camera in rig.cameras:
        figures += [fixed(value) for value in camera.rmse_px.model_dump().values() if value is not None]
        figures += [fixed(camera.sigma.fx_px), fixed(camera.sigma.fy_px), fixed(camera.sigma.position_m * 1e3, 1)]
        figures += [str(camera.views.frames), str(camera.views.detected), str(camera.views.used)]
        if camera.clock:
            figures += ["2.170", "0.123", "1.31", "0.43", "probe", UTC]
    figures += [str(pair.views) for pair in rig.pairs]
    figures += [part for g in rig.gates if not g.passed for part in (g.name, beside_limit(g.value, g.limit)) if g.value]
    return [*figures, "13.1 ms", "36", rig.site, rig.digest[7:19], rig.geometry_digest[7:19], "checkerboard:9x6:60mm"]


@pytest.mark.parametrize("rig", [document(), failing()], ids=["passed", "failing"])
def test_every_figure_of_the_rig_file_is_in_the_terminal_report(rig):
    words = terminal(rig)
    assert [figure for figure in shared_figures(rig) if figure not in words] == []


@pytest.mark.parametrize("rig", [document(), failing()], ids=["passed", "failing"])
def test_every_figure_of_the_rig_file_is_on_the_page(rig):
    text = Page(html_report(rig, evidence_for(rig))).text
    figures = shared_figures(rig)
    for camera in rig.cameras:
        named = camera.coefficients.items()
        figures += [f"{name} {value:.6f}" for name, value in named if name not in ("fx", "fy", "cx", "cy")]
        figures += [
            with_sigma(camera.coefficients[k], getattr(camera.sigma, f"{k}_px")) for k in ("fx", "fy", "cx", "cy")
        ]
        figures += [", ".join(f"{v:.7f}" for v in camera.cam_from_rig.quat_wxyz), fixed(camera.sigma.rotation_deg, 3)]
        figures += [", ".join(f"{v:.6f}" for v in camera.cam_from_rig.translation_m), camera.serial]
        figures += [f.frame + " " + f.action + " " + f.reason for f in camera.views.findings]
    figures += [beside_limit(g.value, g.limit) for g in rig.gates if g.value]
    figures += [f"{pair.views} {fixed(pair.rmse_px)}" for pair in rig.pairs]
    figures += [g.advice for g in rig.gates if g.advice]
    figures += [rig.digest, rig.geometry_digest, "ab" * 32, "numpy 2.2", '"model": "opencv5"', "rigcal 0.1.0"]
    figures += [", ".join(f"{v:.7f}" for v in rig.world_from_rig.quat_wxyz)]
    assert [figure for figure in figures if figure not in text] == []


def test_the_first_line_is_the_verdict_and_what_it_means():
    assert terminal(document()).splitlines()[0] == "PASS hall-3: 4 cameras, all 5 gates passed; the rig can be used."
    first = " ".join(terminal(failing()).split("\n\n")[0].split())
    assert first.startswith(
        "RECAPTURE hall-3: 4 cameras, 4 of 9 gates failed (cam2, cam3, the whole rig, cam1); "
        "do the next actions below, then calibrate again."
    )
    lines = terminal(failing()).splitlines()
    assert lines.index("Next actions") < lines.index("RMSE, px") < lines.index("Not known yet")
    assert terminal(failing()).split("\n\n")[-1].startswith("hall-3.rig.json; ")


def test_failed_clocks_ask_for_clocks_and_not_for_boards():
    late = gate("clock_error_m", "cam1", 0.05, 0.02, False, "probe cam1 again")
    assert "then measure the clocks again." in " ".join(terminal(document(gates=[late], verdict="RECAPTURE")).split())


def test_a_recapture_without_a_failed_gate_is_not_called_usable():
    first = terminal(document(verdict="RECAPTURE")).splitlines()[0]
    assert first.startswith("RECAPTURE hall-3: 4 cameras; the file names no failed gate")


def test_next_actions_are_numbered_and_each_is_named_once():
    rig = failing()
    assert [len(action.gates) for action in next_actions(rig)] == [2, 1, 1]
    words = " ".join(terminal(rig).split())
    assert (
        "Next actions 1. show the board to cam2 and cam3 together, nearer and tilted "
        "position_sigma_m (at most 0.02 m): cam2 0.0312 m, cam3 0.0467 m "
        "2. too few views to measure this: add shared views split_half (at most 5): the rig not measured "
        "3. show cam1" in words
    )
    page = Page(html_report(rig, None)).unfolded
    top = page[: page.index("The rig From above")]
    assert top.count("show the board to cam2 and cam3 together, nearer and tilted") == 1
    assert "position_sigma_m (at most 0.02 m): cam2 0.0312 m, cam3 0.0467 m" in top
    assert top.index("RECAPTURE") < top.index("Next actions")


def test_advice_that_differs_by_the_camera_alone_is_said_once():
    def asking(camera, advice, name="views"):
        return gate(name, camera, 3.0, 10.0, False, advice)

    gates = [asking(c, f"show the board to {c} in more positions") for c in ("cam0", "cam1", "cam3")]
    gates.insert(1, asking("cam2", "tilt it to cam2 and cam1 together"))
    gates.append(asking("cam1", "tilt it to cam2 and cam1 together"))
    gates.append(asking("cam10", "aim cam10, not cam1, at cam10's board", "image_coverage"))
    rig = RigDocument.model_validate(content(11) | {"gates": gates, "verdict": "RECAPTURE"})
    assert [action.advice for action in next_actions(rig)] == [
        "show the board to cam0, cam1 and cam3 in more positions",
        "tilt it to cam2 and cam1 together",
        "aim cam10, not cam1, at cam10's board",
    ]
    assert [len(action.gates) for action in next_actions(rig)] == [3, 2, 1]


def test_a_rig_that_passed_has_no_next_actions():
    assert "Next actions" not in terminal(document()) + html_report(document(), None)


def test_a_failed_gate_without_advice_still_has_an_action():
    rig = document(gates=[gate("refined_rmse_px", "cam1", 3.0, 1.0, False)], verdict="RECAPTURE")
    assert next_actions(rig)[0].advice == "see the gate refined_rmse_px; the file holds no advice for it"


def test_every_gate_has_its_value_limit_and_meaning_and_a_failed_one_its_next_action():
    page = Page(html_report(failing(), None)).unfolded
    assert (
        "position_sigma_m one sigma of a camera's position relative to the reference "
        "cam2 0.0312 m at most 0.02 m ✗ fail show the board to cam2 and cam3 together, nearer and tilted"
    ) in page
    assert "intrinsic_rmse_px RMSE of each camera calibrated alone cam0 0.123 px at most 0.5 px pass" in page
    assert page.index("Failed gates") < page.index("Passed gates")


def test_an_rmse_whose_gate_failed_is_marked_with_more_than_colour():
    data = content() | {"gates": [gate("intrinsic_rmse_px", "cam1", 0.61, 0.5, False, "again")], "verdict": "RECAPTURE"}
    data["cameras"][1]["rmse_px"]["intrinsic"] = 0.61
    assert "cam1 ✗ 0.61 0.63" in Page(html_report(RigDocument.model_validate(data), None)).text


def test_a_value_just_beyond_its_limit_never_reads_as_the_limit():
    assert beside_limit(0.5004, 0.5) == "0.5004"
    assert "intrinsic_rmse_px (at most 0.5 px): cam1 0.5004 px" in Page(html_report(failing(), None)).text


def test_every_gate_says_what_it_measures_and_which_way_its_limit_points():
    for name in GateLimits.model_fields:
        meaning = gate_meaning(name)
        assert meaning.what
        assert meaning.bound in ("at most", "at least"), name
    assert gate_meaning("a_gate_of_the_future") == gate_meaning("") == type(meaning)("", "", "")


def test_findings_name_the_first_few_then_how_many_and_where_all_are():
    words = " ".join(terminal(failing()).split())
    assert "cam1: 1 unflipped, 8 dropped 000000 unflipped: residual 4.0 px" in words
    assert "000002 dropped: residual 4.2 px and 6 more All of them are in the HTML report, and in the rig file" in words
    assert "000003" not in words


@pytest.mark.parametrize(
    ("instants", "sentence"),
    [
        (
            {"rule": "frame numbers", "spread_s": 0.0, "shared": 8},
            "Instants were found by frame numbers; 8 of them seen",
        ),
        ({"rule": "frame numbers", "spread_s": 0.0}, "no times were known, so their spread is not either."),
        ({"rule": "file times", "spread_s": 0.0}, "Instants were found by file times; times within one differ by 0 ms"),
        ({"rule": "none", "spread_s": 0.0, "shared": 0}, "Views had no common instants; 0 of them"),
    ],
)
def test_the_rule_of_the_instants_is_said_with_what_it_knows_of_times(instants, sentence):
    rig = document(extensions={"rigcal": {"instants": instants}})
    assert sentence in " ".join(terminal(rig).split())
    assert sentence in Page(html_report(rig, None)).text


@pytest.mark.parametrize("extensions", [{}, {"rigcal": 3}, {"rigcal": {"instants": "?"}}, {"rigcal": {"instants": {}}}])
def test_extensions_of_another_form_are_passed_over(extensions):
    assert "Instants" not in terminal(document(extensions=extensions))


def test_missing_residuals_are_said():
    text = Page(html_report(document(), None)).text
    assert "There are no residuals beside this file, so the corners cannot be drawn." in text
    assert "Board positions are not drawn: there are no residuals beside this file." in text
    assert "no residuals beside this file" not in Page(html_report(document(), evidence_for(document()))).text


def test_a_camera_without_corners_in_the_residuals_is_said():
    rig = document(2)
    whole = evidence_for(rig)
    first = whole.camera_idx == 0
    names = ("camera_idx", "frame_idx", "corner_ids", "used", "pixels", "residuals_px")
    part = replace(whole, **{name: getattr(whole, name)[first] for name in names})
    assert "No corner of cam1 is in the residuals." in Page(html_report(rig, part)).text


def test_residuals_of_other_cameras_are_refused():
    with pytest.raises(EvidenceError) as caught:
        html_report(document(2), evidence_for(document(3)))
    assert str(caught.value) == (
        "the residuals beside the rig file belong to another rig\n"
        "  where:    the .residuals.npz of the same name\n"
        "  expected: residuals of cam0, cam1\n"
        "  got:      residuals of cam0, cam1, cam2\n"
        "  do next:  move that file away, or calibrate again with rigcal calibrate, which writes both"
    )


def test_residuals_of_another_calibration_are_called_so():
    rig = document(2)
    own = evidence_for(rig)
    other = replace(own, residuals_px=own.residuals_px * 1.2)
    claim = "cam0: these residuals have an RMSE of 0.360 px, the rig file states 0.300 px"
    assert claim in Page(html_report(rig, other)).text
    assert "these residuals have" not in Page(html_report(rig, own)).text


def test_the_page_loads_nothing_and_allows_its_own_script_alone():
    rig = failing()
    picture = ViewPicture(0, 0, (0, 0, 640, 480), b"\xff\xd8 no picture \xff\xd9")
    html = html_report(rig, replace(evidence_for(rig), pictures=(picture,)))
    assert re.search(r"https?:|@import|url\((?!#hatch)|<link|<iframe|<img|<script ", html) is None
    tags = Page(html).tags
    assert not {name for _, attrs in tags for name in attrs if name.startswith("on") or name in ("src", "srcset")}
    hrefs = [attrs["href"] for _, attrs in tags if "href" in attrs]
    assert all(href.startswith(("#", "data:image/jpeg;base64,")) for href in hrefs)
    script = re.search(r"<script>(.*?)</script>", html, re.DOTALL)[1]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = next(attrs["content"] for tag, attrs in tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy == f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"


@pytest.mark.parametrize("rig", [document(1), document(3)], ids=["no pair", "pairs"])
def test_every_link_within_the_page_has_its_target(rig):
    tags = Page(html_report(rig, None)).tags
    ids = [attrs["id"] for _, attrs in tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    assert {attrs["href"][1:] for _, attrs in tags if "href" in attrs} <= set(ids)


def test_every_figure_has_a_text_and_every_table_a_caption_and_headers():
    rig = failing()
    html = html_report(rig, evidence_for(rig))
    for tag, attrs in Page(html).tags:
        if tag == "svg" and "viewBox" in attrs:
            assert attrs.get("aria-hidden") == "true" or attrs["aria-label"]
        assert tag != "th" or attrs.get("scope") in ("col", "row", "colgroup", "rowgroup")
    assert html.count("<table") == html.count("<caption>")


def test_each_part_of_the_page_stands_where_a_reader_expects_it():
    page = Page(html_report(failing(), evidence_for(failing()))).text
    parts = [
        "Next actions",
        "The rig From above",
        "Who saw the board together",
        "Reprojection errors Root",
        "Camera by camera",
        "Positions and uncertainty",
        "Failed gates",
        "Beside the paper",
        "Provenance",
    ]
    places = [page.rindex(part) for part in parts]
    assert places == sorted(places)


def test_the_papers_figures_stand_beside_ours():
    page = Page(html_report(document(5), None)).text
    assert "Camera 0 0.2567 - cam0 0.1100 - - 0.3000 Camera 1 0.1823 0.8098 cam1 0.1110 0.6300 1.6700 0.3000" in page
    assert "Camera 3 0.1623 1.1369 cam3 0.1130 0.6700 1.8700 0.3000 - - - cam4 0.1140" in page
    assert "Camera 2 0.2092 0.5806 - - - - - Camera 3" in Page(html_report(document(2), None)).text


@pytest.mark.parametrize("evil", ["<b>", "</style><script>", "\"'&amp;", "{{ 7 * 7 }}", "Südtor 北"])
def test_names_from_the_file_cannot_break_the_page(evil):
    data = content(3, rename=lambda camera_id: evil + camera_id) | {"site": evil}
    data["gates"] += [gate(evil, evil, 2.0, 1.0, False, evil)]
    data["cameras"][0]["views"]["findings"] = [{"frame": evil, "action": "dropped", "reason": evil}]
    data |= {"verdict": "RECAPTURE", "extensions": {evil: 1}}
    data["provenance"] |= {"options": {evil: evil}, "packages": {evil: evil}}
    rig = RigDocument.model_validate(data)
    page = Page(html_report(rig, evidence_for(rig)))
    tags = [tag for tag, _ in page.tags]
    assert "b" not in tags
    assert (tags.count("style"), tags.count("script")) == (1, 1)
    assert page.text.count(evil) > 20


def test_names_from_the_file_cannot_command_the_terminal():
    data = content(2, rename=lambda camera_id: "[bold]\x1b[31m" + camera_id) | {"site": "[/red]\a"}
    words = terminal(RigDocument.model_validate(data), force_terminal=True, color_system=None)
    assert "[bold]\N{REPLACEMENT CHARACTER}[31mcam1" in re.sub(r"\s", "", words)
    assert "\x1b[31m" not in words
    assert "\a" not in words


@pytest.mark.parametrize("rig", [document(), failing(), document(20)], ids=["passed", "failing", "20 cameras"])
def test_the_terminal_report_fits_80_columns_and_is_plain_where_colour_is_unwanted(rig, monkeypatch):
    assert max(len(line.rstrip()) for line in terminal(rig).splitlines()) <= 80
    assert "…" not in terminal(rig)
    assert "\x1b" not in terminal(rig)
    monkeypatch.setenv("NO_COLOR", "1")
    in_colour_unwanted = terminal(rig, force_terminal=True)
    assert re.sub(r"\x1b\[[012]?m", "", in_colour_unwanted) == terminal(rig)


@pytest.mark.parametrize("width", [80, 64])
def test_long_names_fold_and_figures_stay_whole(width):
    rig = RigDocument.model_validate(content(3, rename=lambda camera_id: "north_entrance_loading_bay_" + camera_id))
    words = terminal(rig, width=width)
    assert "…" not in words
    assert [name for name in ("intrinsic", "held-out", "position, mm", "RMSE, px") if name not in words] == []
    assert max(len(line.rstrip()) for line in words.splitlines()) <= width
    assert [figure for figure in shared_figures(rig) if figure not in words] == []


def test_twelve_cameras_take_two_tables_of_twelve_lines():
    lines = terminal(document(12)).splitlines()
    assert sum(bool(re.match(r"cam\d+ ", line)) for line in lines) == 24
    assert lines.count("") <= 6
    assert [line.split()[-1] for line in lines if line.startswith("cam11 ")] == ["3.43", "weakest"]


def test_the_same_rig_gives_the_same_bytes():
    rig = failing()
    assert html_report(rig, evidence_for(rig)) == html_report(rig, evidence_for(rig))
    assert terminal(rig) == terminal(rig)


@pytest.mark.parametrize("count", [1, 2, 20])
def test_any_number_of_cameras_is_reported(count):
    rig = document(count)
    page = Page(html_report(rig, evidence_for(rig, corners=40)))
    assert [camera.id for camera in rig.cameras if camera.id not in page.text] == []
    assert sum(attrs.get("class") == "camera" for _, attrs in page.tags) == count
    assert f"{count} camera" in terminal(rig)


def test_eight_cameras_with_the_greatest_pictures_make_less_than_two_megabytes():
    """Measured: 0.90 MB without pictures, 1.79 MB with twelve of the greatest size."""
    rig = document(8)
    evidence = evidence_for(rig, corners=6000, rejected=700)
    pictures = [ViewPicture(c, 0, (0, 0, 600, 400), bytes(GREATEST_BYTES)) for c in (*range(8), *range(4))]
    assert len(html_report(rig, replace(evidence, pictures=tuple(pictures))).encode()) < 2e6


def test_an_imported_rig_reads_well_without_figures():
    rig = document_of_rig(arc_rig(3), created_utc=UTC, inputs_sha256="ab" * 32)
    words, page = terminal(rig), Page(html_report(rig, None)).text
    assert " ".join(words.split()).startswith(
        "IMPORTED simulated: 3 cameras calibrated by another tool; their accuracy was not measured here."
    )
    assert re.search(r"^cam1 +-( +-){5}$", words, re.MULTILINE)
    assert re.search(r"^cam1 +-( +-){3} +cam0 *$", words, re.MULTILINE)
    assert "No gate was measured" in page
    assert "An imported rig has none." in page
    assert "cam1 - - - - - - cam0 > cam1" in page
    assert "None" not in words + page


def test_what_is_not_known_yet_is_said():
    words = " ".join(terminal(document(world_from_rig=None)).split())
    assert "The floor and the vertical are not known; positions are in the frame of" in words
    assert "No clock was measured for cam0, cam2, cam3; frames are paired" in Page(html_report(failing(), None)).text


def test_title_replaces_the_heading():
    assert "<h1>Night shift</h1>" in html_report(document(), None, title="Night shift")


def test_residual_lines_start_at_their_corner_and_are_magnified_as_stated():
    rig = document(1)
    pixels, residuals = np.array([[959.5, 539.5], [0.0, 0.0]]), np.array([[0.3, -0.4], [0.3, -0.4]])
    figure = residual_figure(rig.cameras[0], two_corners(rig, pixels, residuals, used=[True, True]))
    assert figure.magnification == 100  # 0.5 px, at most 45 of 1000 units, of 1920 px: 173 times
    step = f"{0.3 * 100 / 1.92:.1f} -{0.4 * 100 / 1.92:.1f}"
    assert figure.used_marks.lines == f"M500 281.2l{step}M0.3 0.3l{step}".replace("281.2", figure_y(540))
    assert figure.key_units == pytest.approx(figure.key_px * 100 / 1.92)
    assert figure.rmse_px == pytest.approx(0.5)
    assert figure.sigma_px == pytest.approx(math.sqrt(0.125))
    assert figure.mean_px == pytest.approx((0.3, -0.4))


def figure_y(pixel):
    return f"{pixel / 1.92:.1f}"


def two_corners(rig, pixels, residuals, *, used):
    zeros = np.zeros(2, dtype=int)
    return Evidence(rig.camera_ids, (("0",),), zeros, zeros, np.arange(2), used, pixels, residuals, np.zeros((0, 3)))


def test_rejected_corners_are_crosses_outside_the_figures_of_the_used_ones():
    rig = document(1)
    residuals = np.array([[0.3, -0.4], [300.0, 400.0]])
    figure = residual_figure(rig.cameras[0], two_corners(rig, np.full((2, 2), 959.5), residuals, used=[True, False]))
    assert (figure.used, figure.rejected, figure.beyond) == (1, 1, 1)
    assert figure.rmse_px == pytest.approx(0.5)
    assert figure.rejected_marks.corners == "M500 500m-6-6l12 12m0-12l-12 12"
    assert figure.rejected_marks.lines == "M500 500l54 72"  # cut to 90 units
    assert figure.rejected_marks.cloud == "M100 100m-2.5-2.5l5 5m0-5l-5 5"  # on the frame


def test_a_camera_whose_corners_were_all_rejected_is_still_drawn():
    rig = document(1)
    residuals = np.array([[3.0, 4.0], [3.0, -4.0]])
    evidence = two_corners(rig, np.full((2, 2), 99.5), residuals, used=[False, False])
    figure = residual_figure(rig.cameras[0], evidence)
    assert (figure.used, figure.rejected, figure.rmse_px) == (0, 2, None)
    assert "0 corners used, 2 rejected" in Page(html_report(rig, evidence)).text


def test_exact_residuals_can_be_drawn():
    rig = document(1)
    figure = residual_figure(rig.cameras[0], two_corners(rig, np.full((2, 2), 99.5), np.zeros((2, 2)), used=[True] * 2))
    assert figure.rmse_px == 0
    assert np.isfinite([figure.magnification, figure.cloud_px, figure.sigma_units]).all()


def test_a_subsample_is_said_and_favours_no_corner_of_the_board():
    rows = spread(np.arange(6000), SHOWN_CORNERS)
    assert len(np.unique(rows)) == SHOWN_CORNERS
    per_corner = np.bincount(rows % 40, minlength=40)
    assert per_corner.min() >= 23  # 25 each; every sixth row would take 50 of twenty corners and none of twenty
    rig = document(1)
    text = Page(html_report(rig, evidence_for(rig, corners=6000))).text
    assert "6000 corners used, 0 rejected (1000 and 0 drawn, spread evenly over all of them)" in text


def test_cameras_stand_in_the_plan_where_they_stand_in_the_world():
    rig = document(6)
    plan = plan_of(rig, None)
    world_from_rig = rig.world_from_rig.pose
    truth_m = [(world_from_rig @ c.cam_from_rig.pose.inverse()).translation_m[:2] for c in rig.cameras]
    units_per_m = plan.bar_units / plan.bar_m
    drawn_m = np.array([[camera.x, -camera.y] for camera in plan.cameras]) / units_per_m
    offset_m = drawn_m - truth_m
    np.testing.assert_allclose(offset_m, np.broadcast_to(offset_m[0], offset_m.shape), atol=1e-9)
    assert all(0 < camera.x < plan.width and 0 < camera.y < plan.height for camera in plan.cameras)
    assert plan.above.startswith("along the world's z axis")
    origin_m = np.array([plan.origin[0], -plan.origin[1]]) / units_per_m
    np.testing.assert_allclose(origin_m, offset_m[0], atol=1e-9)


def test_without_a_world_the_plan_looks_along_the_cameras_and_the_reference_looks_up_the_page():
    rig = document(4, world_from_rig=None)
    plan = plan_of(rig, None)
    assert plan.above.startswith("along the mean down axis of the cameras")
    tip = np.array(re.findall(r"-?[\d.]+", plan.cameras[0].wedge), dtype=float).reshape(-1, 2)[1:].mean(axis=0)
    assert tip[0] == pytest.approx(plan.cameras[0].x, abs=2)
    assert tip[1] < plan.cameras[0].y - 20
    assert plan.cameras[1].x > plan.cameras[0].x  # cam1 is to the right of cam0
    assert plan.origin is None


def test_cameras_without_a_common_vertical_are_seen_along_the_reference_and_it_is_said():
    turned = [Pose.from_rvec([0, 0, math.pi * i], [0.1 * i, 0, 0]) for i in range(2)]
    data = content(2) | {"world_from_rig": None}
    for camera, pose in zip(data["cameras"], turned, strict=True):
        camera["cam_from_rig"] = PoseEntry.of(pose).model_dump()
    assert plan_of(RigDocument.model_validate(data), None).above.startswith("along the down axis of cam0")


def test_ellipses_are_one_sigma_of_the_position_that_the_covariance_means():
    """Against 4000 rigs drawn from the covariance; the axes' sampling error is 1.1 %, the tolerance 4 %."""
    rng = np.random.default_rng(5)
    data = content(2)
    root = rng.normal(0, 1, (6, 6)) * np.repeat([1e-3, 4e-3], 3)[:, None]
    data["covariance"]["matrix"] = (root @ root.T).tolist()
    rig = RigDocument.model_validate(data)
    plan = plan_of(rig, None)
    pose, world_from_rig = rig.cameras[1].cam_from_rig.pose, rig.world_from_rig.pose
    drawn = [pose.perturbed(d[:3], d[3:]) for d in rng.normal(size=(4000, 6)) @ root.T]
    places = np.array([(world_from_rig @ p.inverse()).translation_m[:2] for p in drawn])
    values, vectors = np.linalg.eigh(np.cov(places.T))
    units = plan.bar_units / plan.bar_m * plan.magnification
    major, minor, angle_deg = plan.cameras[1].ellipse
    np.testing.assert_allclose([minor / units, major / units], np.sqrt(values), rtol=0.04)
    along = np.array([math.cos(math.radians(angle_deg)), -math.sin(math.radians(angle_deg))])  # y of the page is down
    assert abs(along @ vectors[:, 1]) > 0.999
    assert plan.cameras[0].ellipse is None


def test_the_chain_is_drawn_in_the_plan_and_every_pair_is_in_the_table():
    data = content(3)
    data["pairs"].append({"cameras": ["cam2", "cam0"], "views": 5, "rmse_px": None})
    rig = RigDocument.model_validate(data)
    plan = plan_of(rig, None)
    starts = re.findall(r"M(\S+) (\S+)l", plan.chain)
    assert starts == [(short(camera.x), short(camera.y)) for camera in plan.cameras[:2]]
    assert "cam0 70 0.71 5 - cam1 71 0.73" in Page(html_report(rig, None)).text


def test_long_ids_are_shortened_in_the_plan_only():
    rig = RigDocument.model_validate(content(2, rename=lambda camera_id: "north-entrance-" + camera_id))
    assert [camera.label for camera in plan_of(rig, None).cameras] == ["north-entranc…"] * 2
    assert "north-entrance-cam1" in Page(html_report(rig, None)).text


def test_the_field_of_view_is_that_of_the_real_lens():
    pinhole = Camera("opencv4", (1920, 1080), [1000, 1000, 959.5, 539.5, 0, 0, 0, 0])
    assert horizontal_fov_deg(pinhole) == pytest.approx(2 * math.degrees(math.atan(0.96)))
    barrel = Camera("opencv4", (1920, 1080), [1000, 1000, 959.5, 539.5, -0.1, 0, 0, 0])
    edge = barrel.rays([-0.5, 539.5])
    assert horizontal_fov_deg(barrel) == pytest.approx(2 * math.degrees(math.atan2(-edge[0], edge[2])))
    assert horizontal_fov_deg(barrel) > horizontal_fov_deg(pinhole) + 2
    fisheye = Camera("fisheye4", (2000, 1000), [500, 500, 999.5, 499.5, 0, 0, 0, 0])  # 2 radians to each side
    assert horizontal_fov_deg(fisheye) == pytest.approx(math.degrees(4))


def test_a_lens_model_that_turns_back_still_has_a_wedge():
    folding = Camera("opencv4", (1920, 1080), [700, 700, 959.5, 539.5, -0.6, 0, 0, 0])
    assert 60 < horizontal_fov_deg(folding) < 180


def test_figures_have_the_digits_that_they_are_worth():
    assert [fixed(v) for v in (0.2749, 12.3456, 0.0312, 2.2e-9, 0, None)] == [
        "0.27",
        "12.35",
        "0.031",
        "2.2e-09",
        "0",
        "-",
    ]
    assert [with_sigma(1413.693, s) for s in (0.66, 12.0, 0.0312, None)] == [
        "1413.69 ± 0.66", "1414 ± 12", "1413.693 ± 0.031", "1413.69",
    ]  # fmt: skip
    assert [signed(v) for v in (-1e-9, 0.0123, -0.5)] == ["+0.000", "+0.012", "-0.500"]
    assert [round_down(v) for v in (1, 1.9, 2, 4.99, 7, 0.03)] == pytest.approx([1, 1, 2, 2, 5, 0.02])
    assert [round_up(v) for v in (1, 1.1, 2, 2.1, 7, 0.03)] == pytest.approx([1, 2, 2, 5, 10, 0.05])


def test_the_lens_report_says_every_lens_with_its_sigmas():
    lens = {
        "id": "[b]left", "size_wh": [640, 480], "model": "opencv4",
        "coefficients": {
            "fx": 533.1, "fy": 532.9, "cx": 343.1, "cy": 233.7, "k1": -0.3077, "k2": 0.1651, "p1": 0, "p2": 0,
        },
        "sigma": {"fx": 0.42, "fy": 0.43, "cx": 0.59, "cy": 0.6, "k1": 0.0021, "k2": 0.011, "p1": 0.0, "p2": 0.0},
        "rmse_px": {"intrinsic": 0.2213},
        "views": {"frames": 13, "detected": 11, "used": 10, "findings": [
            {"frame": f"left{i:02d}", "action": "dropped", "reason": "residual 2.0 px"} for i in range(5)
        ]},
    }  # fmt: skip
    words = printed(lens_report({"board": "checkerboard:9x6:25mm", "cameras": [lens]}), width=80)
    assert words.startswith("1 lens calibrated, board checkerboard:9x6:25mm")
    for part in (
        "[b]left",
        "opencv4",
        "640x480",
        "10/11/13",
        "0.22",
        "fx 533.10 ± 0.42",
        "k1 -0.3077 ± 0.0021",
        "p2 0",
    ):
        assert part in words
    assert "and 2 more" in words
    assert "in the lens file" in words


def test_lenses_that_were_held_are_named_with_what_to_do():
    held = document(extensions={"rigcal": {"lenses_held": ["cam2", "cam3"]}})
    for words in (" ".join(terminal(held).split()), Page(html_report(held, None)).text):
        assert "the lens of cam2, cam3 was kept as calibrated alone: expose the cameras together" in words
