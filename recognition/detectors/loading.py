"""From a file to a network that is ready to run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from recognition.detectors.fastestdet import FASTESTDET
from recognition.detectors.manifest import AnyManifest, BoxManifest, PoseManifest, entries_text, read_manifest
from recognition.detectors.movenet import MOVENET
from recognition.detectors.network import Network
from recognition.detectors.onnx_boxes import OnnxBoxDetector
from recognition.detectors.onnx_poses import OnnxPoseEstimator
from recognition.detectors.people import PeopleAndObjects, PeopleOptions
from recognition.detectors.protocol import ModelInfo
from recognition.detectors.yolox import YOLOX
from recognition.errors import ModelError
from rigcal.errors import OptionError

BOX_FAMILIES = {"fastestdet": FASTESTDET, "yolox": YOLOX}
"""Families of box networks, by the name that manifests give."""

POSE_FAMILIES = {"movenet": MOVENET}
"""Families of pose networks, by the name that manifests give."""


def load_model(path: Path, *, threads: int = 1) -> OnnxBoxDetector | OnnxPoseEstimator:
    """Load a network and its manifest.

    Args:
        path: FILE.onnx or FILE.toml. The manifest of FILE.onnx is FILE.toml beside it; where there is none, the one
            among those that ship with the package whose SHA-256 is the file's.
        threads: threads within one operator. One thread costs the least computing time per image; more shorten
            the wait for a single one.

    Raises:
        ModelError: a missing or broken file, no manifest, a mistake in it, or a network that it does not describe.
        OptionError: where ``threads`` is less than 1.
    """
    if threads < 1:
        raise OptionError("threads", expected="1 or more", got=threads)
    if path.suffix not in {".onnx", ".toml"}:
        raise ModelError(
            "not a model file",
            where=path,
            expected="FILE.onnx or FILE.toml",
            got=path.name,
            do_next="give the ONNX file, or its manifest",
        )
    onnx_path = path.with_suffix(".onnx")
    onnx = _content(onnx_path)
    sha256 = hashlib.sha256(onnx).hexdigest()
    manifest = _manifest_of(onnx_path, sha256)
    info = ModelInfo(onnx_path.name, sha256, manifest.family, manifest.licence)
    if isinstance(manifest, BoxManifest):
        boxes = BOX_FAMILIES[manifest.family]
        network = Network(onnx, onnx_path, manifest.input, boxes.output_shape(manifest), threads=threads)
        return OnnxBoxDetector(network, boxes, manifest, info)
    poses = POSE_FAMILIES[manifest.family]
    network = Network(onnx, onnx_path, manifest.input, poses.output_shape(manifest), threads=threads)
    return OnnxPoseEstimator(network, poses, manifest, info)


def load_detector(
    box_model: Path,
    pose_model: Path | None = None,
    *,
    options: PeopleOptions | None = None,
    threads: int = 1,
) -> PeopleAndObjects:
    """Load a box network, and a pose network where there is one, as one detector.

    Raises:
        ModelError: as of :func:`load_model`; or where a file holds the other kind of network, or the box network
            finds no people for the pose network.
    """
    boxes = load_model(box_model, threads=threads)
    if not isinstance(boxes, OnnxBoxDetector):
        raise _other_kind(box_model, wanted="a box network", families=BOX_FAMILIES, got=boxes.model_info)
    if pose_model is None:
        return PeopleAndObjects(boxes, options=options)
    poses = load_model(pose_model, threads=threads)
    if not isinstance(poses, OnnxPoseEstimator):
        raise _other_kind(pose_model, wanted="a pose network", families=POSE_FAMILIES, got=poses.model_info)
    return PeopleAndObjects(boxes, poses, options=options)


def _other_kind(path: Path, *, wanted: str, families: Iterable[str], got: ModelInfo) -> ModelError:
    return ModelError(
        f"this is not {wanted}",
        where=path,
        expected=f"{wanted}: family {' or '.join(sorted(families))}",
        got=f"family {got.family}",
        do_next=f"give {wanted} here",
    )


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ModelError(
            "cannot read the model",
            where=path,
            expected="an ONNX file",
            got=error.strerror,
            do_next="check the path; a manifest FILE.toml needs FILE.onnx beside it",
        ) from error


def _manifest_of(onnx_path: Path, sha256: str) -> AnyManifest:
    forms: dict[str, type[AnyManifest]] = {
        **dict.fromkeys(BOX_FAMILIES, BoxManifest),
        **dict.fromkeys(POSE_FAMILIES, PoseManifest),
    }
    beside = onnx_path.with_suffix(".toml")
    if not beside.exists():
        return _shipped(onnx_path, sha256, forms)
    manifest = read_manifest(beside, forms)
    if manifest.sha256 != sha256:
        raise ModelError(
            "the manifest describes another network than the one beside it",
            where=onnx_path,
            expected=f"SHA-256 {manifest.sha256}, as {beside.name} states",
            got=f"SHA-256 {sha256}",
            do_next=f"restore the network that belongs to {beside.name}, or mend the manifest for this one",
        )
    return manifest


def _shipped(onnx_path: Path, sha256: str, forms: dict[str, type[AnyManifest]]) -> AnyManifest:
    for entry in (files(__package__) / "manifests").iterdir():
        manifest = read_manifest(entry, forms)
        if manifest.sha256 == sha256:
            return manifest
    raise ModelError(
        "this network has no manifest",
        where=onnx_path,
        expected=f"{onnx_path.with_suffix('.toml').name} beside it; no manifest that ships here has SHA-256 {sha256}",
        got="nothing",
        do_next=f"write {onnx_path.with_suffix('.toml').name} with the entries {entries_text(BoxManifest)} "
        f"(family {', '.join(sorted(BOX_FAMILIES))}), or {entries_text(PoseManifest)} "
        f"(family {', '.join(sorted(POSE_FAMILIES))}); entries with a default may be left out",
    )
