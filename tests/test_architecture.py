"""The house keeps its plan: imports point one way, engines sit in their rooms, the public surface is what it says."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ORDER = {
    "rigcal": [
        "errors",
        "cores",
        "geometry",
        "camera",
        "board",
        "detections",
        "rig",
        "measured",
        "site",
        "synthetic",
        "target",
        "captures",
        "stamps",
        "pace",
        "instants",
        "cache",
        "detect",
        "diagnose",
        "selection",
        "boardpose",
        "corners",
        "bundle",
        "agreement",
        "outliers",
        "robust",
        "intrinsics",
        "order",
        "motion",
        "pairwise",
        "graph",
        "_colmap",
        "placing",
        "sisters",
        "refine",
        "residuals",
        "uncertainty",
        "halves",
        "scene",
        "coverage",
        "scale",
        "quality",
        "advice",
        "figures",
        "gates",
        "rigdocument",
        "rigfile",
        "lensfile",
        "evidence",
        "pictures",
        "relative",
        "amend",
        "rigviews",
        "drift",
        "world",
        "sync",
        "formats",
        "report",
        "pipeline",
        "outcome",
        "doctor",
        "cli",
    ],
    "recognition": [
        "errors",
        "observations",
        "keypoints",
        "options",
        "h264",
        "detectors",
        "epipolar",
        "optics",
        "observed",
        "association",
        "interpolation",
        "triangulation",
        "tracking",
        "smoothing",
        "placing",
        "rules",
        "events",
        "synthetic",
        "synthetic_views",
        "recording",
        "sources",
        "poses",
        "metrics",
        "synthetic_crowds",
        "grouping",
        "monitoring",
        "status",
        "feeds",
        "live",
        "alarms",
        "retention",
        "judging",
        "runtime",
        "replay",
        "commissioning",
        "crews",
        "batch",
        "viewing",
        "evidence",
        "evaluation",
        "cli",
    ],
}
SEEN_BY_RECOGNITION = {
    "errors",
    "cores",
    "geometry",
    "camera",
    "rig",
    "site",
    "captures",
    "stamps",
    "pace",
    "instants",
    "rigfile",
    "rigdocument",
}
ENGINES = {
    "pycolmap": {"rigcal._colmap"},
    "onnxruntime": {"recognition.detectors"},
    "mcap": {"recognition.recording", "rigcal.sync"},
    "mcap_protobuf": {"recognition.recording"},
    "foxglove_schemas_protobuf": {"recognition.recording"},
    "google": {"recognition.recording"},  # protobuf
    "zstandard": {"recognition.recording", "rigcal.sync"},
    "typer": {"rigcal.cli", "recognition.cli"},
    "reportlab": {"rigcal.target"},
    "distributed": {"recognition.crews"},
    "paho": {"recognition.alarms"},
    "av": {"rigcal.captures", "rigcal.sync", "recognition.sources", "recognition.viewing"},  # viewing: writes mp4
}


def rooms(path: Path) -> tuple[str, str]:
    """Package and room (module or subpackage) of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0], parts[1]


def imported(source: str) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def violations(package: str, room: str, source: str) -> list[str]:
    """Imports of a module that point the wrong way."""
    found = []
    order = ORDER[package]
    for name in imported(source):
        parts = name.split(".")
        if parts[0] == package and len(parts) > 1 and parts[1] in order:
            if parts[1] != room and order.index(parts[1]) >= order.index(room):
                found.append(f"{package}.{room} imports {name}, which stands below it")
        elif parts[0] == "recognition" and package == "rigcal":
            found.append(f"{package}.{room} imports {name}")
        elif parts[0] == "rigcal" and package == "recognition" and len(parts) > 1:
            simulated = (room, parts[1]) == ("synthetic", "synthetic")  # never on the runtime's path
            if parts[1] not in SEEN_BY_RECOGNITION and parts[1] != "__version__" and not simulated:
                found.append(f"{package}.{room} imports {name}")
        elif parts[0] in ENGINES and f"{package}.{room}" not in ENGINES[parts[0]]:
            found.append(f"{package}.{room} imports the engine {name}")
    return found


def modules():
    for package in ORDER:
        for path in sorted((ROOT / package).rglob("*.py")):
            if path.name != "__init__.py" or path.parent != ROOT / package:
                yield path


def test_the_guard_can_fail():
    assert violations("rigcal", "camera", "from rigcal.rig import Rig")
    assert violations("rigcal", "refine", "import recognition.tracking")
    assert violations("rigcal", "refine", "import pycolmap")
    assert violations("recognition", "runtime", "from rigcal.refine import refine_rig")
    assert violations("recognition", "tracking", "from mcap.writer import Writer")
    assert not violations("rigcal", "rig", "from rigcal.camera import Camera")


@pytest.mark.parametrize("package", ORDER)
def test_every_place_in_the_order_is_a_room_and_has_one_place(package):
    there = {path.stem for path in (ROOT / package).iterdir() if path.is_dir() or path.suffix == ".py"}
    assert set(ORDER[package]) <= there
    assert len(set(ORDER[package])) == len(ORDER[package])


@pytest.mark.parametrize("path", list(modules()), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path):
    package, room = rooms(path)
    assert room in ORDER[package], f"{room} has no place in the order of {package}"
    assert violations(package, room, path.read_text(encoding="utf-8")) == []


def test_recognition_loads_without_pycolmap_and_onnxruntime():
    code = (
        "import sys, recognition.cli; print(sorted({'pycolmap', 'onnxruntime', 'cv2', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_help_loads_no_heavy_library():
    code = "import sys, rigcal.cli; print(sorted({'pycolmap', 'numpy', 'cv2', 'scipy', 'pydantic'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
