"""When the frames of a recording were taken, and with which rig, out of an MCAP file that ``recognition run`` wrote.

Only the index and the headers of messages are read: a recording of gigabytes takes about as long as its disk takes to
deliver it, and no image is decoded. Record layouts: https://mcap.dev/spec.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from pydantic import ValidationError

from rigcal.errors import RecordedClocksError
from rigcal.geometry import Ints, freeze
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import digest

RIG_ATTACHMENT = "rig.json"
RIG_METADATA, SYNC_KEY = "rigcal", "sync"
"""The run's metadata record, and its entry with what the source's timekeeping was like, as JSON."""
FRAME_TOPICS = ("video", "image", "annotations")
"""Below ``/CAMERA/``, in order of preference; a run on detections alone records no images, but annotations of each."""
_MAGIC = b"\x89MCAP0\r\n"
_PART_SUFFIX = ".part"
_RECORD_HEADER = 9
"""Bytes of opcode and length in front of each record."""
_MESSAGE_TIMES = slice(15, 31)
"""Log and publish time within a message record: after its header, channel (2 bytes) and sequence number (4 bytes)."""
_FAULTS = (McapError, ValueError, struct.error, OverflowError, zstandard.ZstdError, OSError, KeyError, IndexError)
"""What the reader raises where a file is cut off or damaged."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrames:
    """When one camera's frames were taken, in the order in which they were recorded."""

    camera_id: str
    captured_ns: Ints
    """(F,) rig time of capture: the message's publish time."""
    logged_ns: Ints
    """(F,) rig time of arrival where the source was live, else of capture: the message's log time."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, captured_ns=(None,), logged_ns=(len(self.captured_ns),))


@dataclass(frozen=True, slots=True)
class Recording:
    """What a recording says of its clocks."""

    path: Path
    document: RigDocument
    """The rig file inside."""
    cameras: tuple[RecordedFrames, ...]
    """Every camera of the rig, in rig order; one that recorded nothing has no frames."""
    warnings: tuple[str, ...]
    """What ``recognition run`` found amiss with the timekeeping of its source."""


def read_recording(path: Path, *, progress: Callable[[int, int], None] | None = None) -> Recording:
    """Read the times of a finished recording's frames, and the rig file inside.

    Args:
        path: the MCAP file.
        progress: told how many of the file's chunks were read, and of how many.

    Raises:
        RecordedClocksError: where the file is absent, no MCAP, unfinished or damaged, or holds no rig file or frames.
    """
    with _reading(path) as (stream, reader, summary):
        document = _rig_document(path, reader)
        warnings = _warnings(reader)
        channels = _frame_channels(summary, document.camera_ids)
        times = _message_times(stream, summary, channels, progress)
    none = np.zeros((0, 2), np.int64)
    cameras = tuple(
        RecordedFrames(camera_id, captured_ns=t_ns[:, 1], logged_ns=t_ns[:, 0])
        for camera_id in document.camera_ids
        for t_ns in [np.concatenate([none, *times.get(camera_id, [])])]
    )
    if not any(len(camera.captured_ns) for camera in cameras):
        raise RecordedClocksError(
            "the recording holds no frames of the rig's cameras",
            where=path,
            expected=f"topics such as /{document.reference}/video",
            got=", ".join(sorted(channel.topic for channel in summary.channels.values())) or "no topics",
            do_next="give a recording that recognition run wrote with --source or --detections",
        )
    return Recording(path, document, cameras, warnings)


def _frame_channels(summary: Summary, camera_ids: tuple[str, ...]) -> dict[int, str]:
    """The camera whose frames a channel holds, by channel; the best of each camera's topics only."""
    topics = {channel.topic: channel.id for channel in summary.channels.values()}
    found = {}
    for camera_id in camera_ids:
        names = (f"/{camera_id}/{kind}" for kind in FRAME_TOPICS)
        topic = next((name for name in names if name in topics), None)
        if topic is not None:
            found[topics[topic]] = camera_id
    return found


def _message_times(
    stream: IO[bytes], summary: Summary, channels: Mapping[int, str], progress: Callable[[int, int], None] | None
) -> dict[str, list[Ints]]:
    """(n, 2) log and publish times of each chunk's messages by camera, in file order."""
    found: dict[str, list[Ints]] = {}
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    for done, chunk in enumerate(chunks, start=1):
        wanted = channels.keys() & chunk.message_index_offsets.keys()
        data = _chunk_bytes(stream, chunk) if wanted else np.zeros(0, np.uint8)
        for channel in wanted:
            at = _message_offsets(stream, chunk.message_index_offsets[channel])
            bytes_of_times = data[at[:, None] + np.arange(_MESSAGE_TIMES.start, _MESSAGE_TIMES.stop)]
            found.setdefault(channels[channel], []).append(bytes_of_times.view("<u8").astype(np.int64))
        if progress:
            progress(done, len(chunks))
    return found


def _chunk_bytes(stream: IO[bytes], chunk: ChunkIndex) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    stream.seek(chunk.chunk_start_offset + _RECORD_HEADER)
    data, size = get_chunk_data_stream(Chunk.read(ReadDataStream(stream)))
    return np.frombuffer(data.read(size), dtype=np.uint8)


def _message_offsets(stream: IO[bytes], offset: int) -> Ints:
    """(n,) places of a channel's messages within the decompressed chunk, from the message index at ``offset``."""
    stream.seek(offset + _RECORD_HEADER)
    _, size = struct.unpack("<HI", stream.read(6))
    entries = np.frombuffer(stream.read(size), dtype="<u8").reshape(-1, 2)
    return np.sort(entries[:, 1].astype(np.int64))


def _rig_document(path: Path, reader: McapReader) -> RigDocument:
    attached = next((a.data for a in reader.iter_attachments() if a.name == RIG_ATTACHMENT), None)
    if attached is None:
        raise RecordedClocksError(
            "the recording does not say which rig it is of",
            where=path,
            expected=f"an attachment {RIG_ATTACHMENT}",
            got="none",
            do_next="give a recording that recognition run wrote",
        )
    try:
        content = json.loads(attached)
        document = RigDocument.model_validate(content)
        problem = "" if document.digest == digest(content) else f"its digest is {digest(content)}"
    except (ValueError, ValidationError, RecursionError) as error:
        problem = str(error).splitlines()[0]
    if problem:
        raise RecordedClocksError(
            "the rig file inside the recording cannot be used",
            where=path,
            expected="the rig file as rigcal wrote it",
            got=problem,
            do_next=f"run `recognition check {path}`, which says what is wrong with it",
        )
    return document


def _warnings(reader: McapReader) -> tuple[str, ...]:
    """The warnings of the run's report on synchrony; none where it wrote none."""
    for record in reader.iter_metadata():
        if record.name == RIG_METADATA and SYNC_KEY in record.metadata:
            report = json.loads(record.metadata[SYNC_KEY])
            return tuple(str(text) for text in report.get("warnings", ()))
    return ()


@contextmanager
def _reading(path: Path) -> Iterator[tuple[IO[bytes], McapReader, Summary]]:
    try:
        with path.open("rb") as stream:
            magic = stream.read(len(_MAGIC))
            if magic != _MAGIC:
                raise _not_mcap(path, magic)
            stream.seek(-len(_MAGIC), os.SEEK_END)
            if stream.read() != _MAGIC or path.suffix == _PART_SUFFIX:
                raise _unfinished(path, "no end mark")
            stream.seek(0)
            reader = make_reader(stream)
            summary = reader.get_summary()
            if summary is None:
                raise _unfinished(path, "no index at its end")
            yield stream, reader, summary
    except FileNotFoundError as error:
        raise RecordedClocksError(
            "there is no such recording",
            where=path,
            expected="a capture folder or an MCAP file",
            got="nothing",
            do_next="check the path",
        ) from error
    except _FAULTS as error:
        raise _unfinished(path, str(error) or type(error).__name__) from error


def _not_mcap(path: Path, magic: bytes) -> RecordedClocksError:
    return RecordedClocksError(
        "not an MCAP file",
        where=path,
        expected="a recording that recognition run wrote, or a capture folder",
        got=f"a file that begins with {magic!r}" if magic else "an empty file",
        do_next="give the .mcap file or the folder of the capture",
    )


def _unfinished(path: Path, got: str) -> RecordedClocksError:
    whole = path.name.removesuffix(_PART_SUFFIX)
    target = whole if whole != path.name else f"{path.stem}-recovered{path.suffix}"
    return RecordedClocksError(
        "the recording is unfinished or damaged",
        where=path,
        expected="a finished MCAP file",
        got=got,
        do_next=f"run `recognition recover {path} -o {path.with_name(target)}`, then report on that file",
    )
