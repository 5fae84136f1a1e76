"""Claims about import and export: a rig comes back with equal projections, or the export names what it cannot hold."""

import os
import re

import numpy as np
import pytest

from rigcal.camera import MODELS, Camera
from rigcal.errors import ForeignNameError, FormatError, LossyExportError
from rigcal.formats import FORMATS, export_rig, import_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, rig_of

UTC = "2026-11-22T09:30:01Z"
EXPORTABLE = [form.name for form in FORMATS.values() if form.can_export and form.can_import]
SEEDS = range(12)
TOLERANCE_PX = 1e-9
ODD_NAMES = ("01", "002", "cam 1", "é-日本", "a.b", "x:y", "-dash", "#1", 'quo"te', "it's", "UPPER", "a/b", ".hidden")
PLAIN_NAMES = ("01", "002", "cam2", "cam10", "north_gate", "A-1")

FIVE, EIGHT = {"k1", "k2", "p1", "p2", "k3"}, {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}
HELD = {"kalibr": FIVE - {"k3"}, "anipose": FIVE, "easymocap": FIVE, "nerfstudio": FIVE}
"""Coefficients of a lens that is no fisheye that a format has a place for; all eight where it is not listed."""
NO_FISHEYE = {"easymocap", "mrcal"}
NAMES = {
    "colmap": r"[^/]+",
    "colmap-model": r"[^/ ]+",
    "easymocap": r"[A-Za-z0-9_-]+",
    "mrcal": r"[^/.][^/]*",
    "nerfstudio": r"[^/]+",
    "ros": r"[A-Za-z0-9_][A-Za-z0-9_.-]*",
}
"""Names that a format has a place for; any where it is not listed. Both tables are written apart from the code."""
COMES_BACK_BY_ORDER = {"kalibr"}


@pytest.fixture(autouse=True)
def without_waiting_for_the_disk(monkeypatch):
    """Hundreds of small files are written here; that each is flushed to the disk is not what is claimed."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def random_camera(rng, model):
    width, height = (int(v) for v in rng.integers(640, 4000, size=2))
    focal = rng.uniform(0.6, 1.5) * max(width, height)
    scale = {"k1": 0.1, "k2": 0.05, "k3": 0.01, "k4": 0.1, "k5": 0.02, "k6": 0.01, "p1": 1e-3, "p2": 1e-3}
    distortion = [rng.normal() * scale[name] for name in MODELS[model][4:]]
    centre = np.array([width, height]) / 2 + rng.normal(size=2) * 10
    return Camera(model, (width, height), np.array([focal, focal * 1.001, *centre, *distortion]))


def random_rig(seed, models=tuple(MODELS), names=PLAIN_NAMES, counts=(2, 6)):
    """Cameras anywhere, any lens, portrait or not; the reference is not always the first; every other has a world."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(counts[0], counts[1] + 1))
    reference = int(rng.integers(count))
    cameras = []
    for index, name in enumerate(rng.permutation(np.array(names, dtype=object))[:count]):
        pose = Pose.from_rvec(rng.uniform(-1.8, 1.8, size=3), rng.normal(size=3) * 4)
        pose = Pose.identity() if index == reference else pose
        cameras.append(RigCamera(name, random_camera(rng, models[int(rng.integers(len(models)))]), pose))
    world_from_rig = Pose.from_rvec(rng.normal(size=3), rng.normal(size=3) * 4) if seed % 2 else None
    return Rig("random", tuple(cameras), cameras[reference].id, "IMPORTED", world_from_rig)


def document(rig):
    return document_of_rig(rig, created_utc=UTC, inputs_sha256="")


def points_in_cam(lens):
    """Over the whole image and a little beyond it, at three distances, and behind the camera, which projects to NaN."""
    half = np.array(lens.size_wh) / lens.params[:2] * 0.55
    x, y, z = np.meshgrid(np.linspace(-half[0], half[0], 7), np.linspace(-half[1], half[1], 7), [-2.0, 1.0, 3.0, 10.0])
    return np.stack([x * z, y * z, z], axis=-1).reshape(-1, 3)


def refusals(rig, to_format):
    """What the format cannot hold of this rig: the errors that are right."""
    right = set()
    lost = {
        name
        for camera in rig.cameras
        if not camera.camera.is_fisheye
        for name, value in list(camera.camera.coefficients.items())[4:]
        if value and name not in HELD.get(to_format, EIGHT)
    }
    fisheyes = [camera.camera.is_fisheye for camera in rig.cameras]
    if lost or (any(fisheyes) and to_format in NO_FISHEYE):
        right.add(LossyExportError)
    if not all(re.fullmatch(NAMES.get(to_format, ".+"), name) for name in rig.camera_ids):
        right.add(ForeignNameError)
    if (to_format == "opencv" and len(fisheyes) > 2) or (to_format == "nerfstudio" and len(set(fisheyes)) > 1):
        right.add(FormatError)
    return right


def assert_same_geometry(back, rig, *, by_order=False):
    """Every point projects to the same pixel; relative poses are equal."""
    pairs = [
        (back.cameras[index] if by_order else back.camera(camera.id), camera)
        for index, camera in enumerate(rig.cameras)
    ]
    first = rig.cameras[0] if by_order else rig.camera(back.cameras[0].id)
    for camera, other in pairs:
        assert camera.camera.size_wh == other.camera.size_wh
        points = points_in_cam(other.camera)
        in_first = first.cam_from_rig.apply(other.cam_from_rig.inverse().apply(points))
        got, expected = camera.camera.project(camera.cam_from_rig.apply(in_first)), other.camera.project(points)
        np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
        assert np.isnan(expected).any()
        assert np.nanmax(np.abs(got - expected)) < TOLERANCE_PX
        relative = other.cam_from_rig @ first.cam_from_rig.inverse()
        np.testing.assert_allclose(camera.cam_from_rig.matrix, relative.matrix, atol=1e-12)


@pytest.mark.parametrize("to_format", EXPORTABLE)
@pytest.mark.parametrize("names", [PLAIN_NAMES, ODD_NAMES])
def test_a_rig_comes_back_or_what_would_be_lost_is_named(tmp_path, to_format, names):
    for seed in SEEDS:
        rig, path = random_rig(seed, names=names), tmp_path / str(seed)
        right = refusals(rig, to_format)
        if right:
            with pytest.raises(FormatError) as caught:
                export_rig(document(rig), path, to_format)
            assert type(caught.value) in right
            assert not path.exists()
            continue
        assert export_rig(document(rig), path, to_format)
        back = import_rig(path, from_format=None, created_utc=UTC)
        assert (back.verdict, back.reference, back.world_from_rig) == ("IMPORTED", back.cameras[0].id, None)
        assert_same_geometry(rig_of(back), rig, by_order=to_format in COMES_BACK_BY_ORDER)


LENSES = [
    ("anipose", ("opencv4", "opencv5", "fisheye4"), (2, 6)),
    ("colmap", tuple(MODELS), (2, 6)),
    ("colmap-model", tuple(MODELS), (2, 6)),
    ("easymocap", ("opencv4", "opencv5"), (2, 6)),
    ("foxglove", tuple(MODELS), (2, 6)),
    ("kalibr", ("opencv4", "fisheye4"), (2, 6)),
    ("mrcal", ("opencv4", "opencv5", "opencv8"), (2, 6)),
    ("nerfstudio", ("opencv4", "opencv5"), (2, 6)),
    ("nerfstudio", ("fisheye4",), (2, 6)),
    ("opencv", tuple(MODELS), (1, 2)),
    ("ros", tuple(MODELS), (2, 6)),
]


@pytest.mark.parametrize(("to_format", "models", "counts"), LENSES)
def test_every_lens_that_a_format_holds_comes_back(tmp_path, to_format, models, counts):
    for seed in SEEDS:
        rig, path = random_rig(seed, models, counts=counts), tmp_path / str(seed)
        export_rig(document(rig), path, to_format)
        back = rig_of(import_rig(path, from_format=to_format, created_utc=UTC))
        assert_same_geometry(back, rig, by_order=to_format in COMES_BACK_BY_ORDER)
        if to_format in ("mrcal", "opencv"):
            assert {c.id: c.camera.model for c in back.cameras} == {c.id: c.camera.model for c in rig.cameras}


def test_every_exportable_format_is_in_the_table_of_lenses():
    assert {to_format for to_format, _, _ in LENSES} == set(EXPORTABLE)


@pytest.mark.parametrize("to_format", [name for name in EXPORTABLE if FORMATS[name].has_common_frame])
def test_a_world_comes_back_when_the_import_is_told_of_it(tmp_path, to_format):
    rig = random_rig(1, ("opencv4",))
    export_rig(document(rig), tmp_path / "out", to_format)
    back = rig_of(import_rig(tmp_path / "out", from_format=None, created_utc=UTC, common_is_world=True))
    for camera in back.cameras:
        theirs = rig.camera(camera.id).cam_from_rig @ rig.world_from_rig.inverse()
        ours = camera.cam_from_rig @ back.world_from_rig.inverse()
        np.testing.assert_allclose(ours.matrix, theirs.matrix, atol=1e-12)


@pytest.mark.parametrize("to_format", EXPORTABLE)
def test_one_camera_is_a_rig(tmp_path, to_format):
    rig = random_rig(1, ("opencv4",), counts=(1, 1))
    export_rig(document(rig), tmp_path / "out", to_format)
    back = import_rig(tmp_path / "out", from_format=None, created_utc=UTC)
    assert_same_geometry(rig_of(back), rig, by_order=to_format in COMES_BACK_BY_ORDER)


def content_of(path):
    return {file.name: file.read_bytes() for file in path.iterdir()} if path.is_dir() else path.read_bytes()


def test_the_same_rig_gives_the_same_bytes(tmp_path):
    rig = document(random_rig(1, ("opencv4",), counts=(2, 2)))
    for to_format in EXPORTABLE:
        first, second = tmp_path / f"{to_format}-1", tmp_path / f"{to_format}-2"
        export_rig(rig, first, to_format)
        export_rig(rig, second, to_format)
        assert content_of(first) == content_of(second)


@pytest.mark.parametrize("to_format", EXPORTABLE)
def test_conventions_name_frame_unit_lens_and_pixel_centre(tmp_path, to_format):
    with_world, without = (random_rig(seed, ("opencv4",), counts=(2, 2)) for seed in (1, 2))
    lines = export_rig(document(with_world), tmp_path / "x", to_format)
    assert {"poses", "lengths", "lens", "pixels"} <= {line.partition(":")[0] for line in lines}
    assert "lengths: metres" in "\n".join(lines)
    if FORMATS[to_format].has_common_frame:
        assert "the world: z up, the floor at 0" in "\n".join(lines)
        lines = export_rig(document(without), tmp_path / "y", to_format)
        assert f"camera {without.reference} (the rig has no world yet)" in "\n".join(lines)


def test_small_numbers_in_a_kalibr_file_have_a_point_because_yaml_1_1_asks_for_it(tmp_path):
    lens = Camera("opencv4", (640, 480), np.array([500.0, 500.0, 320.0, 240.0, 1e-5, -2e-7, 1.5e-8, 0.0]))
    path = tmp_path / "camchain.yaml"
    export_rig(document(Rig("s", (RigCamera("a", lens, Pose.identity()),), "a", "IMPORTED")), path, "kalibr")
    assert "distortion_coeffs: [1.0e-05, -2.0e-07, 1.5e-08, 0.0]" in path.read_text(encoding="utf-8")
    back = import_rig(path, from_format=None, created_utc=UTC)
    np.testing.assert_array_equal(rig_of(back).cameras[0].camera.params, lens.params)
