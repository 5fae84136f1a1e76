"""Where a recording comes from: which rig, by which clocks, and which segment of which run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from recognition.errors import RecordingError
from recognition.recording.container import RIG_ATTACHMENT, RIG_METADATA, RULES_ATTACHMENT, SEGMENT_METADATA
from recognition.recording.findings import Finding, error, warning
from recognition.recording.messages import RIG_FRAME, WORLD_FRAME
from recognition.recording.survey import Survey
from rigcal import __version__
from rigcal.rig import Rig

CLOCK_KEY = "clock."
"""Metadata key of each camera's clock model, before the camera: its JSON, or :data:`NO_CLOCK`."""
NO_CLOCK = "none"
"""Of a camera whose stamps were taken as rig time."""
GEOMETRY_KEY = "geometry_digest"
"""Metadata key of the rig file's ``geometry_digest``."""
RULES_KEY = "rules.digest"
"""Metadata key of the digest of the rule file, where the run was judged by one."""


def describe(rig: Rig, rig_json: bytes, metadata: Mapping[str, str], rules_toml: bytes | None = None) -> dict[str, str]:
    """The metadata record of a run: which rig, clocks and rules, which version, which options.

    Raises:
        RecordingError: where the rig file is not the rig's, or a camera bears the name of a frame.
        ValueError: where ``metadata`` sets what is set here.
    """
    document = json.loads(rig_json)
    if document.get("digest") != rig.digest:
        raise RecordingError(
            "the rig and its file are not the same",
            expected=f"digest {rig.digest}",
            got=f"digest {document.get('digest')}",
            do_next="load the rig from the very bytes that are recorded",
        )
    taken = {RIG_FRAME, WORLD_FRAME} & set(rig.camera_ids)
    if taken:
        raise RecordingError(
            f"a camera is called {min(taken)}",
            expected=f"other names than {RIG_FRAME} and {WORLD_FRAME}, which are frames of the recording",
            got=", ".join(rig.camera_ids),
            do_next="rename the camera in the site file and calibrate again",
        )
    own = {
        "digest": rig.digest,
        GEOMETRY_KEY: str(document.get("geometry_digest", "")),
        "verdict": rig.verdict,
        "site": rig.site,
        "rigcal": __version__,
        **{CLOCK_KEY + c.id: json.dumps(asdict(c.clock)) if c.clock else NO_CLOCK for c in rig.cameras},
        **({} if rules_toml is None else {RULES_KEY: rules_digest(rules_toml)}),
    }
    repeated = sorted(set(own) & set(metadata))
    if repeated:
        raise ValueError(f"metadata must not set {', '.join(repeated)}")
    return {**own, **metadata}


def rig_findings(found: Survey, frames: set[str]) -> Iterator[Finding]:
    """The attached rig file against its own digest, the metadata, and what is recorded of its cameras."""
    attached = [attachment.data for attachment in found.attachments if attachment.name == RIG_ATTACHMENT]
    stated = [record.metadata.get("digest") for record in found.metadata if record.name == RIG_METADATA]
    if len(attached) != 1:
        yield error(f"{len(attached)} attachments are called {RIG_ATTACHMENT}, one was expected")
        return
    try:
        document = json.loads(attached[0])
        camera_ids = [camera["id"] for camera in document["cameras"]]
    except (ValueError, KeyError, TypeError):
        yield error(f"the attachment {RIG_ATTACHMENT} is no rig file")
        return
    digest = rig_digest(document)
    if document.get("digest") != digest:
        yield error(f"the rig file's digest is {digest}, it says {document.get('digest')}: it was changed")
    if stated != [digest]:
        yield error(f"the rig file's digest is {digest}, the metadata says {', '.join(map(str, stated)) or 'nothing'}")
    calibrated = {channel.topic for channel in found.channels.values() if channel.log_ns}
    for camera_id in camera_ids:
        if f"/{camera_id}/calibration" not in calibrated:
            yield error(f"camera {camera_id} has no calibration message")
        if camera_id not in frames:
            yield error(f"/tf does not say where camera {camera_id} stands")
    unsaid = [camera_id for camera_id in camera_ids if CLOCK_KEY + camera_id not in run_metadata(found)]
    if unsaid:
        yield warning(f"it is not said by which clock models the times of {', '.join(unsaid)} are rig time, or by none")


def rules_findings(found: Survey) -> Iterator[Finding]:
    """The attached rule file against the digest that the metadata states, where there is one."""
    attached = [attachment.data for attachment in found.attachments if attachment.name == RULES_ATTACHMENT]
    stated = run_metadata(found).get(RULES_KEY)
    if len(attached) != (stated is not None):
        yield error(f"{len(attached)} attachments are called {RULES_ATTACHMENT}, {int(stated is not None)} expected")
    elif attached and rules_digest(attached[0]) != stated:
        yield error(f"the rule file's digest is {rules_digest(attached[0])}, the metadata says {stated}")


def rules_digest(toml: bytes) -> str:
    """The digest of a rule file: SHA-256 of its bytes."""
    return f"sha256:{hashlib.sha256(toml).hexdigest()}"


def rig_digest(document: dict[str, Any]) -> str:
    """The digest of a rig file: SHA-256 of its UTF-8 JSON without ``digest``, keys sorted, no spaces."""
    rest = {key: value for key, value in document.items() if key != "digest"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def facts(found: Survey) -> Iterator[str]:
    """What the recording says of its origin, in words; what it does not say is left out."""
    metadata = run_metadata(found)
    if "digest" in metadata:
        yield f"rig {metadata['digest']}, verdict {metadata.get('verdict', 'unknown')}"
    if RULES_KEY in metadata:
        yield f"rules {metadata[RULES_KEY]}"
    if "rigcal" in metadata:
        yield f"recorded by version {metadata['rigcal']}"
    clocks = {k.removeprefix(CLOCK_KEY): text for k, text in metadata.items() if k.startswith(CLOCK_KEY)}
    if clocks:
        yield "clocks: " + ", ".join(f"{camera_id} {_clock(text)}" for camera_id, text in clocks.items())
    place = segment_place(found)
    if place is not None:
        yield f"segment {place[1]} of run {place[0]}"


def _clock(text: str) -> str:
    try:
        model = json.loads(text)
        return f"by {model['method']}, within {1e3 * model['bound_s']:.3g} ms at {model['at_utc']}"
    except (ValueError, KeyError, TypeError):
        return text


def run_metadata(found: Survey) -> Mapping[str, str]:
    """The metadata record of the run; empty where there is none."""
    return next((record.metadata for record in found.metadata if record.name == RIG_METADATA), {})


def segment_place(found: Survey) -> tuple[str, int] | None:
    """The run that the file is a segment of, and which one, from 0; None where it is a recording of its own."""
    record = next((record.metadata for record in found.metadata if record.name == SEGMENT_METADATA), {})
    index = record.get("index", "")
    return (record["run"], int(index)) if "run" in record and index.isdecimal() else None


@dataclass(frozen=True, slots=True)
class Edges:
    """What a segment tells of how it joins the others."""

    place: tuple[str, int] | None
    """As :func:`segment_place`."""
    digest: str | None
    """Of the rig."""
    numbers: Mapping[str, tuple[int, int]]
    """By topic, number of its first and of its last message."""

    @classmethod
    def of(cls, found: Survey) -> Edges:
        """From the survey of a file."""
        numbers = {c.topic: (c.sequences[0], c.sequences[-1]) for c in found.channels.values() if c.sequences}
        return cls(segment_place(found), run_metadata(found).get("digest"), numbers)


def sequence_findings(segments: Sequence[Edges]) -> Iterator[Finding]:
    """Whether files are the segments of one run, in order, with nothing lost between them."""
    places = [segment.place for segment in segments if segment.place is not None]
    if len(places) < len(segments) or len({run for run, _ in places}) > 1:
        yield error("the segments are not of one run")
        return
    rigs = {segment.digest for segment in segments}
    if len(rigs) > 1:
        yield error(f"the segments are of {len(rigs)} rigs")
    if places[0][1] > 0:
        yield warning(f"the first {places[0][1]} segments of the run are not there")
    for earlier, later in pairwise(range(len(segments))):
        before, after = places[earlier][1], places[later][1]
        if after != before + 1:
            yield error(f"segments {before + 1} to {after - 1} are missing")
        elif lost := _lost_between(segments[earlier].numbers, segments[later].numbers):
            of_topics = ", ".join(f"{topic} {count}" for topic, count in lost.items())
            yield warning(f"messages are missing between segments {before} and {after}: {of_topics}")


def _lost_between(earlier: Mapping[str, tuple[int, int]], later: Mapping[str, tuple[int, int]]) -> dict[str, int]:
    """By topic, how many numbers are left out from the last message of a segment to the first of the next."""
    gaps = {topic: first - earlier[topic][1] - 1 for topic, (first, _) in later.items() if topic in earlier}
    return {topic: gap for topic, gap in gaps.items() if gap > 0}
