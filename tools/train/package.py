"""From exported networks to what the package ships: ONNX files with their manifests.

``recognition/models/`` gets ``site.onnx``, ``site_int8.onnx``, ``worker.onnx``, ``worker_int8.onnx`` and a ``.toml``
beside each. Thresholds are :func:`preliminary` until ``python -m tools.train thresholds`` has chosen them.
"""

from __future__ import annotations

import json
import shutil
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomli_w

from recognition.detectors.people import PeopleOptions
from tools.train.coco import DataError, DataSet, read_split
from tools.train.facts import NETWORKS, PRECISIONS, digest, read_facts, stem
from tools.train.geometry import WORKER_JOINTS

NOTICE = (
    "not validated on real people: trained and measured on rendered workers only; see MODEL_CARD.md for what it misses "
    "of real ones"
)
LICENCE = "MIT"
HINT_SCORE = 0.15
"""Of people: the rig's other cameras decide on who scores less than the threshold, but this much. Chosen by the workers
told in 3D on the validation sequences and the demo site (0.2 by the former alone: 2 workers fewer, 5 false ones less of
1280; the demo then has 39 fewer of 1200)."""
LIMIT_BYTES = 8_000_000
"""Of all network files together."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What counts as found, of both networks of one precision."""

    classes: Mapping[str, float]
    """Least score of each class of the site network."""
    site_joint: float
    """Least visibility of a joint of the site network."""
    worker_joint: float
    """Least score of a joint of the worker network."""
    hat: float
    """Least score of a hard hat of the worker network."""


def preliminary(classes: tuple[str, ...]) -> Thresholds:
    """One half everywhere, until thresholds are chosen."""
    return Thresholds(dict.fromkeys(classes, 0.5), 0.5, 0.5, 0.5)


def package(exported: Mapping[str, Path], data: Path, models: Path, *, limit: int = LIMIT_BYTES) -> tuple[Path, ...]:
    """Copy exported networks and write their manifests.

    Args:
        exported: folder of each of :data:`tools.train.facts.NETWORKS`, as ``export`` leaves it.
        data: folder of the data that they were trained on.
        models: where they go.
        limit: bytes that the network files may have together.

    Raises:
        DataError: where an export is missing or is not that of its ``export.json``, or the files are too large.
    """
    summaries = {network: _summary(network, exported[network]) for network in NETWORKS}
    sources = {
        stem(network, precision): exported[network] / f"{stem(network, precision)}.onnx"
        for precision in PRECISIONS
        for network in NETWORKS
    }
    size = sum(path.stat().st_size for path in sources.values())
    if size > limit:
        raise DataError(
            "the networks are too large to be shipped", where=models, expected=f"{limit} bytes or fewer together",
            got=", ".join(f"{path.name} {path.stat().st_size}" for path in sources.values()),
            do_next="Make a network narrower and train again.",
        )  # fmt: skip
    train, validation = read_split(data, "train"), read_split(data, "validation")
    recipe = f"{_recipe(train, data, 'training')}; {_recipe(validation, data, 'validation')}; {_commands(train)}"
    models.mkdir(parents=True, exist_ok=True)
    for name, path in sources.items():
        network = name.partition("_")[0]
        shutil.copyfile(path, models / path.name)
        facts = _facts(path, _command(summaries[network], exported[network], data), recipe)
        content = facts | (_site(train) if network == "site" else _worker(summaries[network]))
        (models / f"{name}.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
    for precision in PRECISIONS:
        names = tuple(category.name for category in train.categories)
        write_thresholds(models, precision, preliminary(names))
    return tuple(models / f"{name}.toml" for name in sources)


def write_thresholds(models: Path, precision: str, thresholds: Thresholds, *, to: Path | None = None) -> None:
    """Put thresholds into the two manifests of a precision, in their place or in another folder."""
    site, worker = (read_toml(models / f"{stem(network, precision)}.toml") for network in NETWORKS)
    site |= {"score_thresholds": dict(thresholds.classes), "joint_score": thresholds.site_joint}
    site.pop("hint_score", None)
    if thresholds.classes["person"] > HINT_SCORE:
        site["hint_score"] = HINT_SCORE
    worker |= {"joint_score": thresholds.worker_joint, "hat_score": thresholds.hat}
    for network, content in zip(NETWORKS, (site, worker), strict=True):
        path = (to or models) / f"{stem(network, precision)}.toml"
        path.write_text(tomli_w.dumps(content), encoding="utf-8")


def read_toml(path: Path) -> dict[str, Any]:
    """A manifest as it is written.

    Raises:
        DataError: where it is missing.
    """
    if not path.is_file():
        raise DataError(
            "there is no manifest", where=path, expected="a TOML file", got="no file",
            do_next="Package the networks first: python -m tools.train package --help.",
        )  # fmt: skip
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _summary(network: str, folder: Path) -> dict[str, Any]:
    """``export.json`` of a network, whose files are those that it names."""
    summary = read_facts(folder / "export.json")
    if summary is None or summary["options"]["network"] != network:
        raise DataError(
            f"there is no exported {network} network", where=folder, expected="export.json",
            got="no file" if summary is None else f"that of a {summary['options']['network']} network",
            do_next="Export it first: python -m tools.train export --help.",
        )  # fmt: skip
    for name, facts in summary["files"].items():
        path = folder / name
        if not path.is_file() or digest(path) != facts["sha256"]:
            raise DataError(
                "a network is not the one that was exported", where=path, expected=f"SHA-256 {facts['sha256']}",
                got=digest(path) if path.is_file() else "no file", do_next="Export it again.",
            )  # fmt: skip
    return summary


def _facts(path: Path, command: str, recipe: str) -> dict[str, Any]:
    day = datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%d")
    trained = {"command": command, "data": recipe, "date": day}
    return {"licence": LICENCE, "sha256": digest(path), "notice": NOTICE, "trained": trained}


def _site(train: DataSet) -> dict[str, Any]:
    return {
        "family": "rigcal_site",
        "classes": [category.name for category in train.categories],
        "keypoints": {c.name: len(c.keypoints) for c in train.categories[1:] if c.keypoints},
        "min_joints": PeopleOptions().min_joints,
    }


def _worker(summary: dict[str, Any]) -> dict[str, Any]:
    return {"family": "rigcal_worker", "joints": list(WORKER_JOINTS[summary["options"]["joints"]])}


def _command(summary: dict[str, Any], folder: Path, data: Path) -> str:
    chosen = summary["options"]
    joints = f" --joints {chosen['joints']}" if chosen["network"] == "worker" else ""
    replanned = "".join(f", from epoch {start} on with --epochs {epochs}" for start, epochs in summary["plans"][1:])
    return (
        f"python -m tools.train fit --network {chosen['network']}{joints} --epochs {summary['plans'][0][1]} "
        f"--batch {chosen['batch']} --rate {chosen['rate']:g} --seed {chosen['seed']} --data {data} --out {folder}"
        f"{replanned}; python -m tools.train export --data {data} --out {folder}"
    )


def _recipe(data: DataSet, folder: Path, purpose: str) -> str:
    """What a split consists of: pictures, scenes, rooms, renderers."""
    entries = json.loads(data.source.read_text(encoding="utf-8"))["images"]
    scenes = sorted({entry["scene"] for entry in entries})
    files = [json.loads((folder / "scenes" / f"{scene}.json").read_text(encoding="utf-8")) for scene in scenes]
    rooms = {file["room"]["name"] for file in files}
    share = Counter(entry["renderer"] for entry in entries)
    renderers = ", ".join(f"{100 * count / len(entries):.0f} % {name}" for name, count in share.most_common())
    return f"{len(entries)} images of {len(scenes)} scenes in {len(rooms)} rooms for {purpose} ({renderers})"


def _commands(train: DataSet) -> str:
    """The commands that make the training data, by renderer, from the scenes' seeds."""
    entries = json.loads(train.source.read_text(encoding="utf-8"))["images"]
    parts = []
    for renderer in sorted({entry["renderer"] for entry in entries}):
        seeds = sorted({int(entry["scene"]) for entry in entries if entry["renderer"] == renderer})
        parts.append(f"{renderer} seeds {seeds[0]} to {seeds[-1]}")
    return f"made by python -m tools.sicsg dataset, {', '.join(parts)}"
