"""Figures that one command measures and another reads: JSON without NaN, and which network files they are of."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tools.train.coco import DataError

MODELS = Path(__file__).parents[2] / "recognition" / "models"
"""Where the networks lie that come with the package."""
FIGURES = Path("out/train")
"""Where figures lie unless a command is told otherwise, from the repository's root."""
REAL = Path(__file__).parents[3] / "shared" / "data" / "recognition" / "pose2sim_multi"
"""A capture of real people, where there is one beside the repository."""
NETWORKS = ("site", "worker")
PRECISIONS = ("fp32", "int8")
_DIGITS = 5


def stem(network: str, precision: str) -> str:
    """File name of a network without its ending."""
    return network if precision == "fp32" else f"{network}_{precision}"


def digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def digests(models: Path, precisions: Iterable[str] = PRECISIONS) -> dict[str, str]:
    """SHA-256 of each network file of a folder, by file name.

    Raises:
        DataError: where one is missing.
    """
    paths = [models / f"{stem(network, precision)}.onnx" for precision in precisions for network in NETWORKS]
    for path in paths:
        if not path.is_file():
            raise DataError(
                "there is no network", where=path, expected="an ONNX file", got="no file",
                do_next="Package them first: python -m tools.train package --help.",
            )  # fmt: skip
    return {path.name: digest(path) for path in paths}


def write_facts(facts: Mapping[str, Any], path: Path) -> None:
    """Write figures, rounded to five decimals; what is not a number is null."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(_plain(facts), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_facts(path: Path) -> dict[str, Any] | None:
    """Figures of a file; None where there is none."""
    if not path.is_file():
        return None
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return round(float(value), _DIGITS) if math.isfinite(value) else None
    return value
