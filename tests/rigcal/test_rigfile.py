"""Claims about the rig file: digests, strict reading, atomic writing, the schema, and the way to and from a Rig."""

import copy
import hashlib
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from pydantic import ValidationError

from rigcal.board import parse_board
from rigcal.camera import MODELS, Camera
from rigcal.errors import RigFileDigestError, RigFileError, RigFileSchemaError, RigFileVersionError
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera
from rigcal.rigdocument import CameraEntry, RigDocument
from rigcal.rigfile import (
    SCHEMA_PATH,
    digest,
    document_of_rig,
    geometry_digest,
    read_rigfile,
    readable_json,
    rig_of,
    schema,
    write_rigfile,
    write_schema,
)

UTC = "2026-11-22T09:30:01Z"
ROTATION = [math.cos(0.2), 0.0, math.sin(0.2), 0.0]


def example():
    """The document of the interface description, its dots filled in."""
    camera = {
        "id": "cam0",
        "serial": "7004511",
        "size_wh": [1920, 1080],
        "model": "opencv5",
        "coefficients": {
            "fx": 1398.0, "fy": 1398.2, "cx": 961.0, "cy": 538.8,
            "k1": -0.1, "k2": 0.05, "p1": 0.001, "p2": -0.0005, "k3": 0.0,
        },
        "cam_from_rig": {"quat_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 0]},
        "rmse_px": {
            "intrinsic": 0.20, "pairwise": None, "chained": None, "refined": 0.23, "held_out": 0.24, "all": 0.31,
        },
        "chain": ["cam0"],
        "sigma": {"fx_px": 0.6, "fy_px": 0.6, "cx_px": 0.8, "cy_px": 0.7, "position_m": 0, "rotation_deg": 0},
        "views": {
            "frames": 111, "detected": 46, "used": 45,
            "findings": [{"frame": "000017", "action": "dropped", "reason": "residual 4.1 px, 9 sigma"}],
        },
        "clock": {
            "offset_s": 0.0021, "drift_ppm": 1.0, "at_utc": "2026-11-22T09:28:40Z", "bound_s": 0.00012,
            "drift_bound_ppm": 0.4, "method": "probe",
        },
    }  # fmt: skip
    other = copy.deepcopy(camera) | {
        "id": "cam1",
        "serial": None,
        "cam_from_rig": {"quat_wxyz": ROTATION, "translation_m": [-1.1, 0.02, 0.3]},
        "chain": ["cam0", "cam1"],
        "sigma": None,
        "clock": None,
    }
    return {
        "format": "rigcal.rig",
        "version": 1,
        "site": "hall-3",
        "created_utc": UTC,
        "reference": "cam0",
        "board": {"kind": "checkerboard", "columns": 9, "rows": 6, "square_size_m": 0.06},
        "cameras": [camera, other],
        "pairs": [{"cameras": ["cam0", "cam1"], "views": 38, "rmse_px": 0.58}],
        "covariance": {
            "order": ["cam1.rotation_rad", "cam1.translation_m"],
            "matrix": (np.eye(6) * 1e-6).tolist(),
        },
        "world_from_rig": None,
        "gates": [
            {"name": "intrinsic_rmse_px", "camera": "cam1", "value": 0.21, "limit": 0.5, "passed": True, "advice": None}
        ],
        "verdict": "PASS",
        "history": [{"command": "calibrate", "utc": UTC, "parent_digest": None}],
        "provenance": {"rigcal": "0.1.0", "inputs_sha256": "ab", "options": {"seed": 0}, "packages": {"numpy": "2.2"}},
        "extensions": {"site": {"note": "Halle 3, Südtor"}},
    }


def edited(path, value, data=None):
    """The example with one entry replaced; ``path`` is a tuple of keys."""
    data = example() if data is None else data
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return data


def store(folder: Path, data, *, signed=True) -> Path:
    """Write raw JSON, with right digests where ``signed``."""
    if signed:
        data["geometry_digest"] = geometry_digest(data)
        data["digest"] = digest(data)
    path = folder / "hall.rig.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "hall-3.rig.json"
    return path, write_rigfile(RigDocument.model_validate(example()), path)


def test_what_is_written_is_read_back_equal(written):
    path, document = written
    assert read_rigfile(path) == document
    assert document.model_dump(mode="json", exclude={"digest", "geometry_digest"}) == example()


def test_writing_twice_gives_the_same_bytes_in_the_order_of_the_interface(written, tmp_path):
    path, document = written
    again = tmp_path / "again.rig.json"
    write_rigfile(document, again)
    assert again.read_bytes() == path.read_bytes()
    data = json.loads(path.read_text(encoding="utf-8"))
    assert list(data) == [*example(), "geometry_digest", "digest"]
    assert list(data["cameras"][0]) == list(example()["cameras"][0])


def test_digest_is_the_documented_one():
    data = {"b": 0.1, "a": [1, 2.0, "ü"], "digest": "ignored"}
    assert digest(data) == "sha256:" + hashlib.sha256('{"a":[1,2.0,"ü"],"b":0.1}'.encode()).hexdigest()


def test_geometry_digest_forgets_clocks_history_times_and_provenance_only():
    base = geometry_digest(example())
    same = [
        edited(("created_utc",), "2027-01-01T00:00:00Z"),
        edited(("history",), []),
        edited(("provenance", "options"), {"seed": 7}),
        edited(("cameras", 0, "clock"), None),
        edited(("gates",), [*example()["gates"], {"name": "clock_error_m", "value": 0.001}]),
    ]
    assert [geometry_digest(data) for data in same] == [base] * len(same)
    assert geometry_digest(edited(("cameras", 0, "coefficients", "fx"), 1398.0000000000002)) != base
    assert geometry_digest(edited(("gates", 0, "value"), 0.22)) != base


def test_a_file_of_another_program_verifies_by_its_own_digits(tmp_path):
    data = example()
    assert json.dumps(data["cameras"][0]["cam_from_rig"]["translation_m"]) == "[0, 0, 0]"
    assert read_rigfile(store(tmp_path, data)).cameras[0].cam_from_rig.translation_m == (0.0, 0.0, 0.0)


def test_one_changed_digit_is_refused(written):
    path, document = written
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("1398.2", "1398.3", 1), encoding="utf-8")
    with pytest.raises(RigFileDigestError) as caught:
        read_rigfile(path)
    assert str(caught.value).startswith("the rig file was changed after rigcal wrote it\n")
    assert document.digest in str(caught.value)
    assert "calibrate again with rigcal calibrate" in str(caught.value)


@pytest.mark.parametrize("key", ["digest", "geometry_digest"])
def test_a_file_without_a_digest_is_refused(tmp_path, key):
    data = json.loads(store(tmp_path, example()).read_text(encoding="utf-8"))
    del data[key]
    if key == "geometry_digest":
        data["digest"] = digest(data)
    with pytest.raises(RigFileDigestError, match="there is none in the file"):
        read_rigfile(store(tmp_path, data, signed=False))


def test_reformatting_alone_does_not_break_the_digest(written):
    path, document = written
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")), indent=4), encoding="utf-8")
    assert read_rigfile(path) == document


def test_a_newer_version_is_refused_with_both_numbers_before_anything_else_is_judged(tmp_path):
    data = edited(("version",), 2) | {"new_key": 1, "cameras": "elsewhere"}
    with pytest.raises(RigFileVersionError) as caught:
        read_rigfile(store(tmp_path, data, signed=False))
    assert str(caught.value).startswith("the rig file has format version 2, this rigcal reads version 1\n")


def test_another_format_is_refused_before_its_version(tmp_path):
    data = edited(("format",), "other.rig") | {"version": 9}
    with pytest.raises(RigFileSchemaError, match="not a valid rig file: format\n") as caught:
        read_rigfile(store(tmp_path, data, signed=False))
    assert caught.value.expected == "'rigcal.rig'"
    assert caught.value.got == "'other.rig'"


def test_unreadable_files_are_named(tmp_path):
    absent = tmp_path / "absent.rig.json"
    with pytest.raises(RigFileSchemaError, match=r"not a valid rig file: no such file\n.*absent\.rig\.json"):
        read_rigfile(absent)
    with pytest.raises(RigFileSchemaError, match="it cannot be read"):
        read_rigfile(tmp_path)
    broken = tmp_path / "broken.rig.json"
    for content in (b'{"format": ', b"\xff\xfe", b'{"format": NaN}', b'{"site": "\\ud800"}', b"[" * 100_000):
        broken.write_bytes(content)
        with pytest.raises(RigFileSchemaError, match="not a valid rig file: it is not JSON"):
            read_rigfile(broken)
    with pytest.raises(RigFileSchemaError, match="expected: a JSON object"):
        read_rigfile(store(tmp_path, [1], signed=False))


UNKNOWN_AND_MISTYPED = [
    (("cameras", 0, "foo"), 1, "cameras[0].foo", "one of id, serial, size_wh, model, coefficients"),
    (("color",), 1, "color", "one of format, version, site"),
    (("board", "marker_ratio"), 0.5, "board.marker_ratio", "one of kind, columns, rows, square_size_m"),
    (("cameras", 1, "views", "findings", 0, "kind"), 1, "cameras[1].views.findings[0].kind", "one of frame, action"),
    (("board", "kind"), "circles", "board", "checkerboard"),
    (("cameras", 0, "size_wh"), [1920.5, 1080], "cameras[0].size_wh[0]", "valid integer"),
    (("cameras", 0, "coefficients", "k1"), "-0.1", "cameras[0].coefficients.k1", "valid number"),
    (("cameras", 1, "coefficients", "k1"), True, "cameras[1].coefficients.k1", "valid number"),
    (("gates", 0, "passed"), 1, "gates[0].passed", "valid boolean"),
    (("verdict",), "OK", "verdict", "'pass', 'recapture' or 'imported'"),
    (("cameras",), [], "cameras", "at least 1 item"),
]


@pytest.mark.parametrize(("path", "value", "entry", "expected"), UNKNOWN_AND_MISTYPED)
def test_an_unknown_or_mistyped_entry_is_named_with_what_belongs_there(tmp_path, path, value, entry, expected):
    with pytest.raises(RigFileSchemaError) as caught:
        read_rigfile(store(tmp_path, edited(path, value), signed=False))
    assert str(caught.value).splitlines()[0] == f"not a valid rig file: {entry}"
    assert expected in caught.value.expected
    assert "own entries belong under extensions" in str(caught.value)


def test_the_file_knows_the_lens_models_that_the_code_has():
    assert set(get_args(CameraEntry.model_fields["model"].annotation)) == set(MODELS)


def test_a_missing_entry_is_named(tmp_path):
    data = example()
    del data["cameras"][1]["cam_from_rig"]["translation_m"]
    with pytest.raises(RigFileSchemaError, match=r"cameras\[1\].cam_from_rig.translation_m\n") as caught:
        read_rigfile(store(tmp_path, data, signed=False))
    assert caught.value.got == "nothing"


CONTRADICTIONS = [
    (("reference",), "cam7", "reference", "one of cam0, cam1", "'cam7'"),
    (("cameras", 1, "id"), "cam0", "cameras", "camera ids that differ", "cam0 more than once"),
    (("cameras", 0, "cam_from_rig", "translation_m"), [0, 0, 1e-6], "cameras[0].cam_from_rig", "identity", "another"),
    (
        ("cameras", 1, "cam_from_rig", "quat_wxyz"),
        [1, 0, 0, 0.01],
        "cameras[1].cam_from_rig.quat_wxyz",
        "a quaternion of length 1 within 1e-06",
        "length 1.00005",
    ),
    (("cameras", 1, "model"), "opencv4", "cameras[1].coefficients", "for opencv4", "k3"),
    (("cameras", 0, "coefficients", "fy"), 0, "cameras[0].coefficients.fy", "above 0 px", "0"),
    (("cameras", 1, "chain"), ["cam1"], "cameras[1].chain", "known cameras from cam0 to cam1", "cam1"),
    (("cameras", 1, "chain"), ["cam0", "cam9", "cam1"], "cameras[1].chain", "known cameras", "cam9"),
    (("pairs", 0, "cameras"), ["cam0", "cam9"], "pairs[0].cameras", "two of cam0, cam1", "cam9"),
    (("covariance", "order"), ["cam1.translation_m", "cam1.rotation_rad"], "covariance.order", "CAMERA.rot", "cam1"),
    (("covariance", "order"), ["cam9.rotation_rad", "cam9.translation_m"], "covariance.order", "cam0, cam1", "cam9"),
    (("covariance", "matrix"), np.eye(5).tolist(), "covariance.matrix", "6 rows of 6 values", "5 rows of [5]"),
    (("covariance", "matrix", 0), [1e-6, 1e-9, 0, 0, 0, 0], "covariance.matrix", "symmetric", "differ by 1e-09"),
    (("created_utc",), "2026-11-22T09:30:01", "created_utc", "a time in UTC", "'2026-11-22T09:30:01'"),
    (("cameras", 0, "clock", "at_utc"), "yesterday", "cameras[0].clock.at_utc", "a time in UTC", "'yesterday'"),
    (("cameras", 0, "size_wh"), [0, 1080], "cameras[0].size_wh[0]", "greater than 0", "0"),
]


@pytest.mark.parametrize(("path", "value", "entry", "expected", "got"), CONTRADICTIONS)
def test_entries_that_contradict_are_refused(tmp_path, path, value, entry, expected, got):
    with pytest.raises(RigFileSchemaError) as caught:
        read_rigfile(store(tmp_path, edited(path, value), signed=True))
    assert str(caught.value).splitlines()[0] == f"not a valid rig file: {entry}"
    assert expected in caught.value.expected
    assert got in caught.value.got


def test_a_covariance_with_the_rounding_of_an_inverse_is_accepted():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6)) * [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]
    covariance = np.linalg.inv(np.linalg.inv(root.T @ root))
    assert (covariance != covariance.T).any()
    RigDocument.model_validate(edited(("covariance", "matrix"), covariance.tolist()))


def test_values_that_json_cannot_hold_never_enter_a_document():
    for path in (("extensions", "x"), ("gates", 0, "value")):
        with pytest.raises(ValidationError, match="finite number"):
            RigDocument.model_validate(edited(path, math.nan))


def test_a_document_is_judged_before_the_file_is_touched(written):
    path, document = written
    before = path.read_bytes()
    with pytest.raises(ValidationError):
        write_rigfile(document.model_copy(update={"reference": "cam7"}), path)
    assert path.read_bytes() == before


def test_a_failed_write_leaves_the_old_file_and_no_other(written, monkeypatch):
    path, document = written
    before = path.read_bytes()

    def full_disk(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(RigFileError) as caught:
        write_rigfile(document.model_copy(update={"site": "hall-4"}), path)
    assert str(caught.value).splitlines()[0] == "cannot write this file"
    assert caught.value.got == "No space left on device"
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_writing_into_an_absent_folder_says_what_to_do(written, tmp_path):
    with pytest.raises(RigFileError, match="make the folder, or give another path with -o"):
        write_rigfile(written[1], tmp_path / "absent" / "x.rig.json")


def test_poses_and_rows_stand_on_one_line():
    text = readable_json({"a": {"quat": [1.0, 2.0], "empty": [], "none": {}}, "m": [[1, 2], [3, 4]], "ü": "é"})
    assert json.loads(text) == {"a": {"quat": [1.0, 2.0], "empty": [], "none": {}}, "m": [[1, 2], [3, 4]], "ü": "é"}
    assert '\n  "quat": [1.0, 2.0],\n' in text
    assert '"ü": "é"' in text


def random_rig(*, clock=None):
    rng = np.random.default_rng(11)
    poses = [Pose.identity(), *(Pose.from_rvec(rng.normal(size=3), rng.normal(size=3) * 5) for _ in range(3))]
    params = [[1400, 1401, 960, 540, 0.1, -0.2, 1e-3, 2e-3, 0.05], [700, 701, 640, 360, 0.1, 0.01, -0.02, 0.003]]
    lenses = [Camera("opencv5", (1920, 1080), params[0]), Camera("fisheye4", (1280, 720), params[1])]
    return Rig(
        site="yard",
        cameras=tuple(
            RigCamera(f"c{i}", lenses[i % 2], pose, serial=f"s{i}", clock=clock) for i, pose in enumerate(poses)
        ),
        reference="c0",
        verdict="IMPORTED",
        world_from_rig=Pose.from_rvec([0.3, -2.0, 0.1], [1, 2, 3]),
    )


def test_a_rig_returns_from_its_file(tmp_path):
    rig = random_rig(clock=ClockModel(0.002, 1.5, UTC, 1e-4, 0.2, "video"))
    board = parse_board("charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted")
    document = document_of_rig(rig, created_utc=UTC, inputs_sha256="ab", board=board, extensions={"a": 1})
    path = tmp_path / "yard.rig.json"
    write_rigfile(document, path)
    read = read_rigfile(path)
    back = rig_of(read)
    assert (read.verdict, read.calibration_board, read.extensions, read.gates) == ("IMPORTED", board, {"a": 1}, ())
    assert (back.digest, back.site, back.reference) == (read.digest, rig.site, rig.reference)
    for ours, theirs in zip(back.cameras, rig.cameras, strict=True):
        assert (ours.id, ours.serial, ours.clock) == (theirs.id, theirs.serial, theirs.clock)
        assert (ours.camera.model, ours.camera.size_wh) == (theirs.camera.model, theirs.camera.size_wh)
        np.testing.assert_array_equal(ours.camera.params, theirs.camera.params)
        np.testing.assert_allclose(ours.cam_from_rig.matrix, theirs.cam_from_rig.matrix, atol=1e-14)
    np.testing.assert_allclose(back.world_from_rig.matrix, rig.world_from_rig.matrix, atol=1e-14)


@pytest.mark.parametrize("spec", ["checkerboard:9x6:60mm", "aprilgrid:6x6:88mm:spacing=0.3:family=tag36h11"])
def test_every_kind_of_board_returns(spec):
    document = document_of_rig(random_rig(), created_utc=UTC, inputs_sha256="", board=parse_board(spec))
    assert RigDocument.model_validate(document.model_dump(mode="json")).calibration_board == parse_board(spec)


def test_the_published_schema_is_up_to_date(tmp_path):
    fresh = tmp_path / "rig.schema.json"
    write_schema(fresh)
    renew = "python -c 'from rigcal.rigfile import write_schema; write_schema()'"
    assert SCHEMA_PATH.read_text(encoding="utf-8") == fresh.read_text(encoding="utf-8"), f"renew it with: {renew}"


def test_the_schema_closes_every_object_except_the_free_ones():
    content = schema()
    models = [content, *(part for part in content["$defs"].values() if part.get("type") == "object")]
    assert len(models) > 10
    assert all(model["additionalProperties"] is False for model in models)
    assert content["properties"]["extensions"]["additionalProperties"]


def test_reading_a_rig_file_loads_no_solver():
    code = "import sys, rigcal.rigfile; print([m for m in ('pycolmap', 'av', 'onnxruntime') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
