"""Is this machine fit to calibrate? Each check is a value: what was looked at, how it is, and what to do about it.

Unlike a stage, a check looks at the machine. What it judges comes in as arguments where it can, so that every outcome
can be shown; :func:`examine_machine` gathers the arguments. Engines are tried, not only looked up: a library that is
installed may still lack a codec, or fail to load.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from importlib import import_module, metadata
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rigcal.board import Checkerboard
from rigcal.bundle import State
from rigcal.cache import FOLDER_VARIABLE, default_cache
from rigcal.cores import core_count
from rigcal.corners import Observations
from rigcal.sync.network import NoTracking, Tracking, read_tracking
from rigcal.synthetic import arc_rig, board_poses_for_pair, exact_detections

OK, WARNING, FAILED = "ok", "warning", "failed"
PACKAGE = "rigcal"
REINSTALL = "install rigcal again in a fresh virtual environment, with its pinned versions"
GIB = 2**30
LITTLE_DISK_GIB, NO_DISK_GIB = 5.0, 0.2
"""A 4-camera capture of an hour at 2 Mbit/s takes 3.6 GB; a rig file with its report and residuals a few MB."""
LITTLE_MEMORY_GIB = 2.0
"""Four cameras' stills of 2 million pixels take 0.36 GiB at the most, beside the system and whatever else runs."""
LARGE_CACHE_GIB = 5.0
SOLVED_M = 1e-6
"""Error of the small rig that rounding never reaches."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at."""

    name: str
    status: str
    """``ok``, ``warning`` (works, with a limit) or ``failed``."""
    detail: str
    """What was found."""
    do_next: str | None = None
    """What to do about it; None where all is well."""


def examine_machine(working_folder: Path, now: datetime) -> tuple[Check, ...]:
    """Every check of this machine.

    Args:
        working_folder: Where results will be written.
        now: What the system says the time is, with its zone.
    """
    requirements = [text for text in metadata.requires(PACKAGE) or () if "extra ==" not in text]
    return (
        check_python(sys.version_info[:3], metadata.metadata(PACKAGE)["Requires-Python"]),
        *check_packages(requirements, _installed_version),
        check_opencv(cv2, [name for name in _distributions() if name.startswith("opencv-")]),
        _tried("pycolmap", check_pycolmap),
        _tried("onnxruntime", check_onnxruntime),
        _tried("video", check_video),
        check_cache(default_cache().folder),
        check_disk(working_folder, shutil.disk_usage(working_folder).free / GIB),
        check_cores(core_count()),
        check_memory(_memory_gib()),
        check_clock(now, _installed_at(now)),
        check_time_service(read_tracking()),
    )


def healthy(checks: Sequence[Check]) -> bool:
    """Whether nothing failed; warnings may remain."""
    return all(check.status != FAILED for check in checks)


def check_python(version: Sequence[int], needed: str) -> Check:
    """The interpreter against what the package's metadata asks for, such as ``>=3.11``."""
    got = ".".join(map(str, version))
    if _numbers(got) >= _numbers(needed):
        return Check("python", OK, f"{got}, needs {needed}")
    return Check("python", FAILED, f"{got}, needs {needed}", "install that Python and make a new virtual environment")


def check_packages(requirements: Sequence[str], installed: Callable[[str], str | None]) -> tuple[Check, ...]:
    """One check for all packages that are as they should be, and one for each that is not.

    Args:
        requirements: As in package metadata, each ``name>=version``.
        installed: The version of a package, None where it is absent.
    """
    wrong = []
    for requirement in requirements:
        name, needed = requirement.split(">=")
        version = installed(name)
        if version is None:
            wrong.append(Check(f"package {name}", FAILED, f"not installed, needs {needed} or newer", REINSTALL))
        elif _numbers(version) < _numbers(needed):
            wrong.append(Check(f"package {name}", FAILED, f"{version}, needs {needed} or newer", REINSTALL))
    good = len(requirements) - len(wrong)
    return (Check("packages", OK, f"{good} of {len(requirements)} present and new enough"), *wrong)


def check_opencv(module: Any, distributions: Sequence[str]) -> Check:
    """Whether OpenCV has the detectors and lens models in use, and is installed once only."""
    needed = ("findChessboardCornersSB", "fisheye", "aruco.CharucoDetector", "aruco.ArucoDetector", "CALIB_CB_LARGER")
    absent = [name for name in needed if not _has(module, name)]
    detail = f"{module.__version__} of {', '.join(distributions) or 'an unknown package'}"
    only_one = "pip uninstall every opencv package, then install opencv-contrib-python-headless"
    if absent:
        return Check("opencv", FAILED, f"{detail} lacks {', '.join(absent)}", only_one)
    if len(distributions) > 1:
        return Check("opencv", WARNING, f"{detail}: several packages overwrite each other's files", only_one)
    return Check("opencv", OK, f"{detail}, with aruco and fisheye")


def check_pycolmap() -> Check:
    """Solve two cameras and four board positions, one camera 20 mm off at the start.

    Raises:
        ImportError: where pycolmap cannot be loaded.
    """
    from rigcal._colmap import solve_with_colmap

    rig, board = arc_rig(2, arc_deg=40, model="opencv4"), Checkerboard(5, 4, 0.1)
    poses = board_poses_for_pair(rig, "cam0", "cam1", board, 4, distance_m=(2, 4), seed=0)
    cameras = exact_detections(rig, board, poses).cameras
    views = [(index, view.frame_idx, view) for index, camera in enumerate(cameras) for view in camera.views]
    lenses = tuple(camera.camera for camera in rig.cameras)
    true = rig.cameras[1].cam_from_rig
    moved = replace(true, translation_m=true.translation_m + [0.02, 0, 0])
    start = State(lenses, (rig.cameras[0].cam_from_rig, moved), tuple(poses))
    found = solve_with_colmap(
        Observations.of(board.corners_in_board, views), start, free_lenses=[False, False]
    ).cam_from_rig[1]
    off_m = float(np.linalg.norm(found.translation_m - true.translation_m))
    if off_m < SOLVED_M:
        return Check("pycolmap", OK, f"{metadata.version('pycolmap')} solves a small rig to {off_m * 1e9:.2g} nm")
    return Check("pycolmap", FAILED, f"a small rig came out {off_m * 1e3:.3g} mm off", REINSTALL)


def check_onnxruntime() -> Check:
    """Where networks would run; only recognition uses them.

    Raises:
        ImportError: where onnxruntime cannot be loaded.
    """
    runtime = import_module("onnxruntime")
    providers = [name.removesuffix("ExecutionProvider") for name in runtime.get_available_providers()]
    detail = f"{runtime.__version__}, runs on {', '.join(providers)}"
    if "CPU" in providers:
        return Check("onnxruntime", OK, detail)
    return Check("onnxruntime", FAILED, detail + ", not on the CPU", REINSTALL)


def check_video() -> Check:
    """Encode three frames as H.264 and decode them again.

    Raises:
        ImportError: where PyAV cannot be loaded.
    """
    av = import_module("av")
    file = BytesIO()
    try:
        with av.open(file, "w", format="mp4") as output:
            stream = output.add_stream("h264", rate=30)
            stream.width = stream.height = 64
            stream.pix_fmt = "yuv420p"
            for _ in range(3):
                frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 128, np.uint8), format="rgb24")
                output.mux(stream.encode(frame))
            output.mux(stream.encode())
        file.seek(0)
        with av.open(file) as source:
            count = sum(1 for _ in source.decode(video=0))
    except (av.error.FFmpegError, av.codec.codec.UnknownCodecError) as error:
        return Check("video", FAILED, f"PyAV {av.__version__} cannot encode and decode H.264: {error}", REINSTALL)
    if count != 3:
        return Check("video", FAILED, f"PyAV {av.__version__} decoded {count} of 3 H.264 frames", REINSTALL)
    return Check("video", OK, f"PyAV {av.__version__} encodes and decodes H.264")


def check_cache(folder: Path) -> Check:
    """Whether board detections can be kept, and how much room they take."""
    other = f"set {FOLDER_VARIABLE} to a folder that can be written to; without one every run searches all images again"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            size_gib = sum(path.stat().st_size for path in folder.rglob("*.npz")) / GIB
    except OSError as error:
        return Check("cache", WARNING, f"{folder}: {error.strerror or error}", other)
    detail = f"{folder}, {size_gib:.2f} GiB of board detections"
    if size_gib > LARGE_CACHE_GIB:
        return Check("cache", WARNING, detail, "delete that folder when the disk fills up; only time is lost")
    return Check("cache", OK, detail)


def check_disk(folder: Path, free_gib: float) -> Check:
    """Room for results beside the captures."""
    detail = f"{free_gib:.1f} GiB free at {folder.resolve()}"
    if free_gib >= LITTLE_DISK_GIB:
        return Check("disk", OK, detail)
    return Check(
        "disk", WARNING if free_gib >= NO_DISK_GIB else FAILED, detail, "free some space, or work on another disk"
    )


def check_cores(cores: int) -> Check:
    """Cores that this process may use; images are searched side by side."""
    if cores > 1:
        return Check("cores", OK, f"{cores}")
    return Check("cores", WARNING, "1", "expect long runs, or calibrate on a machine with more cores")


def check_memory(total_gib: float | None) -> Check:
    """Memory of the machine; None where the system does not tell."""
    if total_gib is None:
        return Check("memory", OK, "unknown: this system does not tell")
    if total_gib >= LITTLE_MEMORY_GIB:
        return Check("memory", OK, f"{total_gib:.1f} GiB")
    return Check(
        "memory",
        WARNING,
        f"{total_gib:.1f} GiB, large captures may need {LITTLE_MEMORY_GIB:g}",
        "close other programs, or calibrate on a machine with more memory",
    )


def check_clock(now: datetime, not_before: datetime) -> Check:
    """Whether the system's time can be right: it cannot be earlier than the installation of this package."""
    told = f"{now:%Y-%m-%d %H:%M:%S %Z}"
    if now >= not_before:
        return Check("clock", OK, told)
    return Check(
        "clock",
        FAILED,
        f"{told} is before this package was installed, {not_before:%Y-%m-%d %H:%M:%S %Z}",
        "set the system's time, best by turning on network time; dates in rig files would be wrong",
    )


def check_time_service(told: Tracking | NoTracking) -> Check:
    """Whether chronyd keeps this machine's clock, which rig time is, to UTC."""
    name, mend = "time service", "install chrony and give it a time server; rig times are only as right as this clock"
    if isinstance(told, NoTracking):
        return Check(name, WARNING, f"nothing says how far this clock is from UTC: {told.reason}", mend)
    if told.bound_s is None:
        return Check(name, WARNING, "chronyd runs and is not synchronised", "give chrony a time server that answers")
    return Check(name, OK, f"chronyd keeps this clock within {1e3 * told.bound_s:.3g} ms of UTC")


def _tried(name: str, check: Callable[[], Check]) -> Check:
    try:
        return check()
    except ImportError as error:
        return Check(name, FAILED, f"cannot be loaded: {error}", REINSTALL)


def _numbers(version: str) -> tuple[int, ...]:
    """The leading numbers of a version or of a bound on one: (3, 11) of ``>=3.11``."""
    return tuple(int(part) for part in re.findall(r"\d+", version.split("+", maxsplit=1)[0])[:3])


def _has(module: Any, dotted: str) -> bool:
    for name in dotted.split("."):
        if not hasattr(module, name):
            return False
        module = getattr(module, name)
    return True


def _installed_version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _distributions() -> tuple[str, ...]:
    return tuple(sorted({str(found.name).lower() for found in metadata.distributions() if found.name}))


def _memory_gib() -> float | None:
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / GIB


def _installed_at(now: datetime) -> datetime:
    """When the newest file of this package was written, in the zone of ``now``."""
    newest = max(path.stat().st_mtime for path in Path(__file__).parent.rglob("*.py"))
    return datetime.fromtimestamp(newest, now.tzinfo)
