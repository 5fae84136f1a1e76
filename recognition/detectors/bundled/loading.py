"""The bundled networks from their files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, TypeVar

from recognition.detectors.bundled.decode import SITE_OUTPUTS, WORKER_OUTPUTS, site_shapes, worker_shapes
from recognition.detectors.bundled.detector import BundledDetector
from recognition.detectors.bundled.geometry import PAD, SITE_WH, WORKER_WH
from recognition.detectors.bundled.manifests import (
    SITE_FAMILY,
    WORKER_FAMILY,
    BundledManifest,
    SiteManifest,
    WorkerManifest,
)
from recognition.detectors.bundled.site import SiteNetwork
from recognition.detectors.bundled.worker import WorkerNetwork
from recognition.detectors.manifest import InputSpec, manifest_digest, read_manifest
from recognition.detectors.network import Network
from recognition.detectors.protocol import ModelInfo
from recognition.errors import ModelError
from rigcal.errors import OptionError

MODELS = Path(__file__).parents[2] / "models"
"""Where the networks lie that come with the package."""
_CROPS = 2
"""Crops in the run by which a worker network is tried: it must take any number."""
ManifestT = TypeVar("ManifestT", bound=BundledManifest)


def load_bundled(
    precision: Literal["int8", "fp32"] = "int8", *, folder: Path = MODELS, threads: int = 1
) -> BundledDetector:
    """Load the site network and the worker network.

    Args:
        precision: ``int8`` or ``fp32``; the first is the faster.
        folder: with ``site.onnx``, ``worker.onnx``, the same with ``_int8``, and a manifest ``.toml`` beside each.
        threads: threads within one operator. One thread costs the least computing time per image; more shorten
            the wait for a single one.

    Raises:
        ModelError: a missing or broken file, a mistake in a manifest, or a network that it does not describe.
        OptionError: where ``threads`` is less than 1.
    """
    if threads < 1:
        raise OptionError("threads", expected="1 or more", got=threads)
    suffix = "_int8" if precision == "int8" else ""
    return BundledDetector(
        _load_site(folder / f"site{suffix}.onnx", threads), _load_worker(folder / f"worker{suffix}.onnx", threads)
    )


def _load_site(path: Path, threads: int) -> SiteNetwork:
    onnx, manifest, info = _read(path, SITE_FAMILY, SiteManifest)
    network = Network(onnx, path, _spec(SITE_WH), outputs=len(SITE_OUTPUTS), threads=threads)
    _require_outputs(network, path, SITE_OUTPUTS, site_shapes(len(manifest.classes)))
    return SiteNetwork(network, manifest, info)


def _load_worker(path: Path, threads: int) -> WorkerNetwork:
    onnx, manifest, info = _read(path, WORKER_FAMILY, WorkerManifest)
    network = Network(onnx, path, _spec(WORKER_WH), outputs=len(WORKER_OUTPUTS), threads=threads, batch=_CROPS)
    _require_outputs(network, path, WORKER_OUTPUTS, worker_shapes(_CROPS, len(manifest.joints)))
    return WorkerNetwork(network, manifest, info)


def _spec(size_wh: tuple[int, int]) -> InputSpec:
    return InputSpec(
        name="image",
        size_wh=size_wh,
        layout="nhwc",
        dtype="uint8",
        colour="bgr",
        resize="letterbox",
        align="centre",
        pad=PAD,
    )


def _read(path: Path, family: str, form: type[ManifestT]) -> tuple[bytes, ManifestT, ModelInfo]:
    try:
        onnx = path.read_bytes()
    except OSError as error:
        raise ModelError(
            "cannot read a network that should come with the package",
            where=path,
            expected="an ONNX file",
            got=error.strerror,
            do_next="install the package again with its model files, or give networks of your own: --object-model FILE "
            "and --pose-model FILE",
        ) from error
    manifest = read_manifest(path.with_suffix(".toml"), {family: form})
    sha256 = hashlib.sha256(onnx).hexdigest()
    if manifest.sha256 != sha256:
        raise ModelError(
            "the manifest describes another network than the one beside it",
            where=path,
            expected=f"SHA-256 {manifest.sha256}, as {path.with_suffix('.toml').name} states",
            got=f"SHA-256 {sha256}",
            do_next="install the package again with its model files",
        )
    return (
        onnx,
        manifest,
        ModelInfo(path.name, sha256, family, manifest.licence, manifest.notice, manifest_digest(manifest)),
    )


def _require_outputs(network: Network, path: Path, names: tuple[str, ...], shapes: tuple[tuple[int, ...], ...]) -> None:
    got = tuple(network.shapes.items())
    if got[: len(names)] != tuple(zip(names, shapes, strict=True)):
        raise ModelError(
            "the network's outputs are not those of its family",
            where=path,
            expected=_text(zip(names, shapes, strict=True)),
            got=_text(got),
            do_next="check classes and joints of the manifest, or export the network again with tools/train",
        )


def _text(outputs: Iterable[tuple[str, tuple[int, ...]]]) -> str:
    return ", ".join(f"{name!r} {'x'.join(map(str, shape))}" for name, shape in outputs)
