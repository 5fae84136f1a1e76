"""What the networks saw of a sequence, computed once: a recording in a folder that is nobody's but this module's.

A recording's name ends with a digest of everything that it depends on: the sequence's own files, the networks and the
version of this package. Rows and rules are then judged by replaying it, and clips are made of its frames.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from recognition import __version__
from recognition.detectors import Detector
from recognition.errors import DatasetError
from recognition.evaluation.violations.truth import SceneTruth, read_scene_truth
from recognition.feeds import FeedOptions, open_feed
from recognition.observations import Instant
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY
from recognition.runtime import RunOptions, run
from recognition.sources.recording import open_recording
from rigcal.rig import Rig
from rigcal.rigfile import read_rigfile, rig_of

_DIGITS = 16
_FPS = 30.0
"""Of a sequence without times, which there is none of: they hold ``timestamps.csv``."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedSequence:
    """A sequence with what the networks saw in it."""

    truth: SceneTruth
    rig: Rig
    instants: tuple[Instant, ...]
    recording: Path
    """The recording that the instants come from, with the frames."""


def find_sequences(dataset: Path, split: str) -> tuple[Path, ...]:
    """Folders of the sequences of a half, by name.

    Args:
        dataset: One sequence, a folder of sequences, or a folder with a folder of sequences for each half.
        split: ``validation`` or ``test``; sequences of the other half are never looked into.

    Raises:
        DatasetError: where there are none.
    """
    if (dataset / "truth.json").exists():
        return (dataset,)
    folder = dataset / split if (dataset / split).is_dir() else dataset
    found = tuple(sorted(path.parent for path in folder.glob("*/truth.json")))
    if not found:
        raise DatasetError(
            "there is no sequence",
            where=folder,
            expected="NAME/truth.json",
            got="none",
            do_next=f"name a sequence, a folder of them, or one that holds {split}/NAME; render them with "
            "python -m tools.sicsg sequences",
        )
    return found


def observe(folder: Path, split: str, detector: Detector, cache: Path) -> ObservedSequence:
    """Read a sequence; its networks' part from the cache, where it is looked at for the first time otherwise.

    Args:
        folder: Of the sequence.
        split: The half that it must be of.
        detector: The networks.
        cache: Folder of recordings; made where it is not there.

    Raises:
        DatasetError: where the sequence is of the other half, has no truth or no rig file.
    """
    truth = read_scene_truth(folder)
    if truth.split != split:
        raise DatasetError(
            f"this sequence is of the half {truth.split}",
            where=folder,
            expected=f"a sequence of the half {split}",
            got=truth.split,
            do_next=f"give --split {truth.split}; what is fitted must never have seen the sealed half, test",
        )
    rigs = sorted(folder.glob("*.rig.json"))
    if len(rigs) != 1:
        got = ", ".join(path.name for path in rigs) or "none"
        raise DatasetError(
            "which rig saw this sequence is not clear",
            where=folder,
            expected="one NAME.rig.json",
            got=got,
            do_next="leave only the rig file that the sequence was rendered with",
        )
    recording = cache / f"{folder.name}-{_digest(folder, detector)}.mcap"
    if not recording.exists():
        _record(folder, rigs[0], detector, recording)
    opened = open_recording(recording)
    return ObservedSequence(truth, opened.rig, tuple(opened.instants()), recording)


def _digest(folder: Path, detector: Detector) -> str:
    """Of all that the detections depend on."""
    total = hashlib.sha256(__version__.encode())
    for network in detector.model_info:
        total.update(f"{network.sha256} {network.manifest_sha256}".encode())
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("truth.")):
        name, content = path.relative_to(folder).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest()
        total.update(f"\n{name} {content}".encode())
    return total.hexdigest()[:_DIGITS]


def _record(folder: Path, rig_path: Path, detector: Detector, recording: Path) -> None:
    rig = rig_of(read_rigfile(rig_path))
    use = (True,) * len(rig.cameras)
    feed = open_feed(rig, folder, None, detector, FeedOptions(use, _FPS))
    options = RunOptions(keep_scenes=False)
    recording.parent.mkdir(parents=True, exist_ok=True)
    recording.with_name(f"{recording.name}.part").unlink(missing_ok=True)
    networks = {f"model.{m.family}": f"{m.name} {m.sha256}" for m in detector.model_info}
    metadata = {PLACING_KEY: options_text(PlacingOptions()), **feed.facts, **networks}
    with Recorder(recording, rig=rig, rig_json=rig_path.read_bytes(), metadata=metadata) as recorder:
        run(rig, feed.instants, recorder, options)
