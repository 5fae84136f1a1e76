"""From a file to a network that is ready to run, and from one or two of them to a detector."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from recognition.detectors.bundled import BundledDetector
from recognition.detectors.composition import OneStagePeople, PeopleAndObjects
from recognition.detectors.families import BOX_FAMILIES, FORMS, PEOPLE_FAMILIES, POSE_FAMILIES
from recognition.detectors.layout import outputs_read, require_layout
from recognition.detectors.manifest import (
    AnyManifest,
    BoxManifest,
    PeopleManifest,
    PoseManifest,
    entries_text,
    manifest_digest,
    read_manifest,
)
from recognition.detectors.network import Network
from recognition.detectors.onnx_boxes import OnnxBoxDetector
from recognition.detectors.onnx_people import OnnxPeopleDetector
from recognition.detectors.onnx_poses import OnnxPoseEstimator
from recognition.detectors.people import PeopleOptions
from recognition.detectors.protocol import Detector, ModelInfo
from recognition.errors import ModelError
from rigcal.errors import OptionError


def load_model(path: Path, *, threads: int = 1) -> OnnxBoxDetector | OnnxPeopleDetector | OnnxPoseEstimator:
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
    network = Network(onnx, onnx_path, manifest.input, outputs=outputs_read(manifest), threads=threads)
    require_layout(network.shapes, manifest, onnx_path)
    info = ModelInfo(
        onnx_path.name, sha256, manifest.family, manifest.licence, manifest_sha256=manifest_digest(manifest)
    )
    if isinstance(manifest, BoxManifest):
        return OnnxBoxDetector(network, BOX_FAMILIES[manifest.family], manifest, info)
    if isinstance(manifest, PeopleManifest):
        return OnnxPeopleDetector(network, PEOPLE_FAMILIES[manifest.family], manifest, info)
    return OnnxPoseEstimator(network, POSE_FAMILIES[manifest.family], manifest, info)


def load_detector(
    object_model: Path | None = None,
    pose_model: Path | None = None,
    *,
    rest: BundledDetector | None = None,
    options: PeopleOptions | None = None,
    threads: int = 1,
) -> Detector:
    """Load one network or two as one detector.

    Args:
        object_model: a box network. Alone, people are objects like any other.
        pose_model: a people network (one-stage), which may stand alone; or a pose network (two-stage), which looks at
            the people that the box network finds.
        rest: beside one network finds what that is not given for: people without a pose model, objects without an
            object model.
        options: what counts as a joint, and what as a person; without it the usual, or those of ``rest``.
        threads: as of :func:`load_model`.

    Raises:
        ModelError: as of :func:`load_model`; or where a file holds another kind of network, nothing finds people
            for a pose network, or there is no network at all.
    """
    joints = None if pose_model is None else _load_joints(pose_model, threads)
    if object_model is not None:
        return _with_boxes(_load_boxes(object_model, threads), joints, rest, options)
    if isinstance(joints, OnnxPeopleDetector):
        return OneStagePeople(joints, rest, options=options)
    if joints is not None and rest is not None:
        return PeopleAndObjects(rest, joints, options=options)
    if joints is None:
        raise ModelError(
            "there is no network to look at the images with",
            where="load_detector",
            expected="an object model, a pose model, or both",
            got="neither",
            do_next="give at least one of them",
        )
    raise ModelError(
        "nothing finds the people whom the pose network looks at one by one",
        where=pose_model,
        expected="a box network that finds people beside it",
        got=f"family {joints.model_info[0].family} alone",
        do_next="give an object model with person_class too, or a pose model that finds people by itself (family "
        f"{_one_of(PEOPLE_FAMILIES)})",
    )


def _with_boxes(
    boxes: OnnxBoxDetector,
    joints: OnnxPeopleDetector | OnnxPoseEstimator | None,
    rest: BundledDetector | None,
    options: PeopleOptions | None,
) -> Detector:
    if isinstance(joints, OnnxPeopleDetector):
        return OneStagePeople(joints, boxes, options=options)
    if joints is None and rest is not None:
        return OneStagePeople(rest, boxes, options=options or rest.people_options)
    return PeopleAndObjects(boxes, joints, options=options)


def _load_boxes(path: Path, threads: int) -> OnnxBoxDetector:
    model = load_model(path, threads=threads)
    if not isinstance(model, OnnxBoxDetector):
        raise ModelError(
            "the object model is no box network",
            where=path,
            expected=f"a network that finds boxes: family {_one_of(BOX_FAMILIES)}",
            got=f"family {model.model_info[0].family}, which finds joints",
            do_next="give it as the pose model",
        )
    return model


def _load_joints(path: Path, threads: int) -> OnnxPeopleDetector | OnnxPoseEstimator:
    model = load_model(path, threads=threads)
    if isinstance(model, OnnxBoxDetector):
        raise ModelError(
            "the pose model finds no joints",
            where=path,
            expected=f"a network that finds joints: family {_one_of([*PEOPLE_FAMILIES, *POSE_FAMILIES])}",
            got=f"family {model.model_info[0].family}, which finds boxes",
            do_next="give it as the object model",
        )
    return model


def _one_of(families: Iterable[str]) -> str:
    *most, last = sorted(families)
    return f"{', '.join(most)} or {last}"


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
    beside = onnx_path.with_suffix(".toml")
    if not beside.exists():
        return _shipped(onnx_path, sha256)
    manifest = read_manifest(beside, FORMS)
    if manifest.sha256 != sha256:
        raise ModelError(
            "the manifest describes another network than the one beside it",
            where=onnx_path,
            expected=f"SHA-256 {manifest.sha256}, as {beside.name} states",
            got=f"SHA-256 {sha256}",
            do_next=f"restore the network that belongs to {beside.name}, or mend the manifest for this one",
        )
    return manifest


def _shipped(onnx_path: Path, sha256: str) -> AnyManifest:
    for entry in (files(__package__) / "manifests").iterdir():
        manifest = read_manifest(entry, FORMS)
        if manifest.sha256 == sha256:
            return manifest
    raise ModelError(
        "this network has no manifest",
        where=onnx_path,
        expected=f"{onnx_path.with_suffix('.toml').name} beside it; no manifest that ships here has SHA-256 {sha256}",
        got="nothing",
        do_next=f"write {onnx_path.with_suffix('.toml').name} with the entries {_entries_by_family()}; entries with a "
        "default may be left out",
    )


def _entries_by_family() -> str:
    kinds = ((BoxManifest, BOX_FAMILIES), (PeopleManifest, PEOPLE_FAMILIES), (PoseManifest, POSE_FAMILIES))
    return ", or ".join(f"{entries_text(form)} (family {', '.join(sorted(families))})" for form, families in kinds)
