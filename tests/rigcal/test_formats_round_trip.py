"""Claims about import and export: a rig comes back with equal projections, or the export names what it cannot hold."""

import json
import tomllib

import cv2
import numpy as np
import pycolmap
import pytest

from rigcal.camera import MODELS, Camera
from rigcal.errors import LossyExportError
from rigcal.formats import FORMATS, export_rig, import_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, rig_of

UTC = "2026-11-22T09:30:01Z"
EXPORTABLE = [form.name for form in FORMATS.values() if form.can_export]
HELD = {
    "kalibr": {"k1", "k2", "p1", "p2"},
    "anipose": {"k1", "k2", "p1", "p2", "k3"},
    "colmap": {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"},
}
"""Coefficients of a lens that is no fisheye that each format has a place for, written down apart from the code."""
SEEDS = range(12)
TOLERANCE_PX = 1e-9


def random_camera(rng, model):
    width, height = (int(v) for v in rng.integers(640, 4000, size=2))
    focal = rng.uniform(0.6, 1.5) * max(width, height)
    scale = {"k1": 0.1, "k2": 0.05, "k3": 0.01, "k4": 0.1, "k5": 0.02, "k6": 0.01, "p1": 1e-3, "p2": 1e-3}
    distortion = [rng.normal() * scale[name] for name in MODELS[model][4:]]
    centre = np.array([width, height]) / 2 + rng.normal(size=2) * 10
    return Camera(model, (width, height), np.array([focal, focal * 1.001, *centre, *distortion]))


def random_rig(seed, models=tuple(MODELS)):
    """Two to five cameras anywhere, any lens; the reference is not always the first; every other rig has a world."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    reference = int(rng.integers(count))
    cameras = []
    for index in range(count):
        pose = Pose.from_rvec(rng.uniform(-1.8, 1.8, size=3), rng.normal(size=3) * 4)
        pose = Pose.identity() if index == reference else pose
        cameras.append(RigCamera(f"view {index}", random_camera(rng, models[int(rng.integers(len(models)))]), pose))
    world_from_rig = Pose.from_rvec(rng.normal(size=3), rng.normal(size=3) * 4) if seed % 2 else None
    return Rig("random", tuple(cameras), cameras[reference].id, "IMPORTED", world_from_rig)


def document(rig):
    return document_of_rig(rig, created_utc=UTC, inputs_sha256="")


def points_in_cam():
    x, y, z = np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(-0.3, 0.3, 5), [1.0, 3.0, 10.0])
    return np.stack([x * z, y * z, z], axis=-1).reshape(-1, 3)


def lost_coefficients(rig, to_format):
    held = HELD[to_format]
    return {
        name
        for camera in rig.cameras
        if not camera.camera.is_fisheye
        for name in camera.camera.names[4:]
        if name not in held and camera.camera.coefficients[name]
    }


def assert_same_geometry(ours, theirs):
    """Every point that a camera sees projects to the same pixel; relative poses are equal."""
    first_from_rig = theirs.cameras[0].cam_from_rig
    for camera, other in zip(ours.cameras, theirs.cameras, strict=True):
        assert camera.camera.size_wh == other.camera.size_wh
        in_rig = other.cam_from_rig.inverse().apply(points_in_cam())
        expected = other.camera.project(points_in_cam())
        got = camera.camera.project(camera.cam_from_rig.apply(first_from_rig.apply(in_rig)))
        assert np.abs(got - expected).max() < TOLERANCE_PX
        relative = other.cam_from_rig @ first_from_rig.inverse()
        np.testing.assert_allclose(camera.cam_from_rig.matrix, relative.matrix, atol=1e-12)


@pytest.mark.parametrize("to_format", EXPORTABLE)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_rig_comes_back_or_the_coefficients_that_would_be_lost_are_named(tmp_path, seed, to_format):
    rig, path = random_rig(seed), tmp_path / "rig.file"
    lost = lost_coefficients(rig, to_format)
    if lost:
        with pytest.raises(LossyExportError) as caught:
            export_rig(document(rig), path, to_format)
        named = {part.partition(" = ")[0] for part in caught.value.got.split(", ")}
        assert named <= lost
        assert named
        assert not path.exists()
        return
    assert export_rig(document(rig), path, to_format)
    back = import_rig(path, from_format=None, created_utc=UTC)
    assert (back.verdict, back.reference, back.world_from_rig) == ("IMPORTED", back.cameras[0].id, None)
    assert_same_geometry(rig_of(back), rig)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("to_format", "models"),
    [
        ("kalibr", ("opencv4", "fisheye4")),
        ("anipose", ("opencv4", "opencv5", "fisheye4")),
        ("colmap", ("opencv5", "opencv8", "fisheye4")),
    ],
)
def test_every_lens_that_a_format_holds_comes_back(tmp_path, seed, to_format, models):
    rig, path = random_rig(seed, models), tmp_path / "rig.file"
    export_rig(document(rig), path, to_format)
    back = rig_of(import_rig(path, from_format=to_format, created_utc=UTC))
    assert_same_geometry(back, rig)
    if to_format == "colmap":
        assert [camera.camera.model for camera in back.cameras] == [camera.camera.model for camera in rig.cameras]


def test_the_same_rig_gives_the_same_bytes(tmp_path):
    rig = document(random_rig(1, ("opencv4", "fisheye4")))
    for to_format in EXPORTABLE:
        for name in ("a", "b"):
            export_rig(rig, tmp_path / name, to_format)
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("seed", SEEDS)
def test_colmap_itself_reads_the_rig_and_projects_to_the_same_pixels(tmp_path, seed):
    rig, path = random_rig(seed), tmp_path / "rig_config.json"
    export_rig(document(rig), path, "colmap")
    (config,) = pycolmap.read_rig_config(path)
    for entry, ours in zip(config.cameras, rig.cameras, strict=True):
        assert entry.image_prefix == f"{ours.id}/"
        assert entry.ref_sensor == (ours.id == rig.reference)
        in_rig = ours.cam_from_rig.inverse().apply(points_in_cam())
        in_cam = in_rig if entry.ref_sensor else entry.cam_from_rig * in_rig
        theirs = entry.camera.img_from_cam(in_cam)
        assert np.abs(theirs - 0.5 - ours.camera.project(points_in_cam())).max() < TOLERANCE_PX


def opencv_pixels(points, rvec, tvec, matrix, distortion, *, fisheye):
    """OpenCV's own projection with its own Rodrigues vector."""
    flat = np.ascontiguousarray(points).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    pixels, _ = project(flat, np.array(rvec), np.array(tvec), np.array(matrix), np.array(distortion))
    return pixels.reshape(-1, 2)


@pytest.mark.parametrize("seed", SEEDS)
def test_opencv_projects_world_points_with_the_numbers_of_an_anipose_file(tmp_path, seed):
    rig, path = random_rig(seed, ("opencv4", "opencv5", "fisheye4")), tmp_path / "calibration.toml"
    export_rig(document(rig), path, "anipose")
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert tables["metadata"]["units"] == "m"
    common_from_rig = rig.world_from_rig or Pose.identity()
    for index, ours in enumerate(rig.cameras):
        table = tables[f"cam_{index}"]
        assert (table["name"], table["size"]) == (ours.id, list(ours.camera.size_wh))
        assert len(table["distortions"]) == (4 if table["fisheye"] else 5)
        points = common_from_rig.apply(ours.cam_from_rig.inverse().apply(points_in_cam()))
        got = opencv_pixels(
            points,
            table["rotation"],
            table["translation"],
            table["matrix"],
            table["distortions"],
            fisheye=table["fisheye"],
        )
        assert np.abs(got - ours.camera.project(points_in_cam())).max() < TOLERANCE_PX


@pytest.mark.parametrize("seed", SEEDS)
def test_the_chain_of_a_kalibr_file_leads_from_camera_to_camera(tmp_path, seed):
    rig, path = random_rig(seed, ("opencv4",)), tmp_path / "camchain.yaml"
    conventions = export_rig(document(rig), path, "kalibr")
    assert conventions[0].startswith("cameras: cam0 is view 0, cam1 is view 1")
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line.removeprefix("  - ")) for line in lines if line.startswith("  - ")]
    transforms = np.array(rows).reshape(-1, 4, 4)
    in_first = points_in_cam()
    in_rig = rig.cameras[0].cam_from_rig.inverse().apply(in_first)
    points = np.concatenate([in_first, np.ones((len(in_first), 1))], axis=1).T
    for transform, camera in zip(transforms, rig.cameras[1:], strict=True):
        points = transform @ points
        np.testing.assert_allclose(points[:3].T, camera.cam_from_rig.apply(in_rig), atol=1e-11)


def test_small_numbers_in_a_kalibr_file_have_a_point_because_yaml_1_1_asks_for_it(tmp_path):
    lens = Camera("opencv4", (640, 480), np.array([500.0, 500.0, 320.0, 240.0, 1e-5, -2e-7, 1.5e-8, 0.0]))
    path = tmp_path / "camchain.yaml"
    export_rig(document(Rig("s", (RigCamera("a", lens, Pose.identity()),), "a", "IMPORTED")), path, "kalibr")
    assert "distortion_coeffs: [1.0e-05, -2.0e-07, 1.5e-08, 0.0]" in path.read_text(encoding="utf-8")
    back = import_rig(path, from_format=None, created_utc=UTC)
    np.testing.assert_array_equal(rig_of(back).cameras[0].camera.params, lens.params)


def test_conventions_name_frame_unit_lens_and_pixel_centre(tmp_path):
    with_world, without = (document(random_rig(seed, ("opencv4",))) for seed in (1, 2))
    for to_format in EXPORTABLE:
        lines = export_rig(with_world, tmp_path / "x", to_format)
        starts = {line.partition(":")[0] for line in lines}
        assert {"poses", "lengths", "lens", "pixels"} <= starts
        assert "lengths: metres" in "\n".join(lines)
    assert "from the world: z up, the floor at 0" in export_rig(with_world, tmp_path / "x", "anipose")[0]
    assert f"from camera {without.reference} (the rig has no" in export_rig(without, tmp_path / "x", "anipose")[0]
    assert "0.5 larger" in "\n".join(export_rig(without, tmp_path / "x", "colmap"))
