"""Claims about ``rigcal import`` and ``rigcal export``: help, lists, messages and what stands on the disk."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rigcal.camera import Camera
from rigcal.cli import app
from rigcal.errors import ForeignNameError, UnknownFormatError
from rigcal.formats import FORMATS
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

WORLD_FROM_RIG = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 2.0]))


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def rig_file(tmp_path):
    lens = Camera("opencv4", (640, 480), np.array([500.0, 510.0, 320.0, 240.0, 0.1, -0.02, 0.001, 0.002]))
    cameras = [RigCamera(f"cam{i}", lens, Pose(np.eye(3), np.array([-1.0 * i, 0.0, 0.0]))) for i in range(2)]
    rig = Rig("hall", tuple(cameras), "cam0", "IMPORTED", WORLD_FROM_RIG)
    document = document_of_rig(rig, created_utc="2026-11-22T09:30:01Z", inputs_sha256="")
    write_rigfile(document, tmp_path / "hall.rig.json")
    return tmp_path / "hall.rig.json"


@pytest.mark.parametrize("command", ["import", "export"])
@pytest.mark.parametrize("option", ["--help", "--list"])
def test_help_and_list_name_every_format_of_the_registry(command, option):
    result = run(command, option)
    assert result.exit_code == 0
    for form in FORMATS.values():
        line = next(line for line in result.output.splitlines() if line.startswith(f"  {form.name} "))
        assert form.description in line
        assert ("export" in line, "import" in line) == (form.can_export, form.can_import)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_can_be_explained(name):
    result = run("import", "--explain", name)
    assert result.exit_code == 0
    assert len(result.output.splitlines()) >= 4
    assert "`" not in result.output


def test_an_unknown_format_to_explain_lists_those_that_exist():
    error = run("export", "--explain", "vicon").exception
    assert isinstance(error, UnknownFormatError)
    assert error.do_next == "name one of these formats with --explain"


@pytest.mark.parametrize("name", [form.name for form in FORMATS.values() if form.can_export and form.can_import])
def test_export_prints_the_conventions_and_import_reads_them_back(tmp_path, rig_file, name):
    result = run("export", rig_file, "--to", name, "-o", tmp_path / "new" / "out")
    assert result.exit_code == 0, result.output
    assert "  lengths: metres" in result.output
    assert f"{name} {'folder' if FORMATS[name].is_folder else 'file'} " in result.output
    world = ["--world"] if FORMATS[name].has_common_frame else []
    result = run("import", tmp_path / "new" / "out", "-o", tmp_path / "back.rig.json", *world)
    assert result.exit_code == 0, result.output
    back = rig_of(read_rigfile(tmp_path / "back.rig.json"))
    assert [*back.camera_ids] == ["cam0", "cam1"]
    np.testing.assert_allclose(back.cameras[1].cam_from_rig.translation_m, [-1, 0, 0], atol=1e-12)
    if world:
        np.testing.assert_allclose(back.world_from_rig.matrix, WORLD_FROM_RIG.matrix, atol=1e-12)


def test_a_unit_scales_a_file_that_does_not_say_one(tmp_path, rig_file):
    run("export", rig_file, "--to", "colmap", "-o", tmp_path / "rig_config.json")
    result = run("import", tmp_path / "rig_config.json", "-o", tmp_path / "b.rig.json", "--unit", "mm", "--json")
    assert json.loads(result.output)["cameras"][1]["cam_from_rig"]["translation_m"] == [-0.001, 0, 0]


def test_a_refused_export_leaves_nothing(tmp_path, rig_file):
    document = read_rigfile(rig_file)
    cameras = tuple(camera.model_copy(update={"id": f"cam {i}"}) for i, camera in enumerate(document.cameras))
    spaced = document.model_copy(update={"reference": "cam 0", "cameras": cameras})
    spaced = document_of_rig(rig_of(spaced), created_utc="2026-11-22T09:30:01Z", inputs_sha256="")
    write_rigfile(spaced, rig_file)
    assert isinstance(run("export", rig_file, "--to", "ros", "-o", tmp_path / "ros").exception, ForeignNameError)
    assert [entry.name for entry in tmp_path.iterdir()] == ["hall.rig.json"]
