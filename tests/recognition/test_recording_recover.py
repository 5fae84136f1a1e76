"""Whatever is done to a recording, recover saves what is sound, says what is not, and writes nothing that is broken."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

sys.path.insert(0, str(Path(__file__).parent))
import killed_recorders
from killed_recorders import IMAGE, T0, recorder

from recognition.errors import RecordingError
from recognition.observations import FrameSet, ViewFrame
from recognition.recording import (
    check_recording,
    check_sequence,
    iter_messages,
    read_metadata,
    recording_files,
    recover_recording,
)
from recognition.recording import recover as recover_module
from recognition.recording.container import mapped
from recognition.recording.scan import scan


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """20 frame sets of two cameras in four chunks."""
    path, random = tmp_path_factory.mktemp("sound") / "run.mcap", np.random.default_rng(5)
    with recorder(path) as writing:
        for k in range(20):
            data = [random.integers(0, 256, 90_000, dtype=np.uint8).tobytes() for _ in range(2)]
            t_ns = T0 + k * 40_000_000
            writing.write_frames(FrameSet(k, t_ns, tuple(ViewFrame(k, t_ns, IMAGE, d, "jpeg") for d in data)))
    return path


@pytest.fixture(scope="module")
def chunks(sound) -> list:
    """Index entries of the chunks, by the stock reader."""
    with sound.open("rb") as stream:
        return make_reader(stream).get_summary().chunk_indexes


@pytest.fixture(scope="module")
def data_end(sound) -> int:
    """Where the data section ends and the index begins."""
    with sound.open("rb") as stream:
        footer_bytes = stream.read()[-8 - 20 : -8]
    return int.from_bytes(footer_bytes[:8], "little") - 13


def content(path: Path) -> list[tuple]:
    """Every message of a finished recording, by the stock reader."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [
            (schema.name, channel.topic, message.log_time, message.publish_time, message.sequence, message.data)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]


def recovered(data: bytes, folder: Path):
    source, target = folder / "run.mcap.part", folder / "run.mcap"
    source.write_bytes(data)
    target.unlink(missing_ok=True)
    try:
        return recover_recording(source, target), target
    finally:
        assert source.read_bytes() == data
        assert not list(folder.glob("*.tmp"))


def test_nothing_is_lost_from_a_finished_recording(sound, tmp_path):
    recovery, target = recovered(sound.read_bytes(), tmp_path)
    assert (recovery.lost, recovery.losses, recovery.bytes_discarded, dict(recovery.missing)) == (False, (), 0, {})
    assert content(target) == content(sound)
    assert dict(recovery.messages) == dict(check_recording(sound).messages)
    assert recovery.last_ns == T0 + 19 * 40_000_000
    assert read_metadata(target) == read_metadata(sound)
    with target.open("rb") as a, sound.open("rb") as b:
        reader_a, reader_b = make_reader(a), make_reader(b)
        assert list(reader_a.iter_attachments()) == list(reader_b.iter_attachments())
        assert reader_a.get_header() == reader_b.get_header()
    assert check_recording(target).findings == ()


def cuts(sound: Path) -> list[int]:
    """Record boundaries and the bytes beside them, and random places."""
    with mapped(sound) as data:
        ends = [part.end for part in scan(data)]
        size = len(data)
    near = [end + step for end in ends for step in (-1, 0, 1) if end + step < size]
    random = np.random.default_rng(7)
    return sorted({0, 5, 9, *random.choice(near, 30, replace=False).tolist(), *random.integers(0, size, 10).tolist()})


def test_a_recording_cut_anywhere_is_recovered_or_refused_in_words(sound, tmp_path, chunks, data_end):
    whole, everything = sound.read_bytes(), content(sound)
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in chunks]
    refused = 0
    for size in cuts(sound):
        if size < ends[0]:
            with pytest.raises(RecordingError, match=r"nothing can be recovered|not an MCAP file"):
                recovered(whole[:size], tmp_path)
            refused += 1
            continue
        recovery, target = recovered(whole[:size], tmp_path)
        kept = content(target)
        assert check_recording(target).ok, size
        assert kept == everything[: len(kept)]
        assert recovery.chunks == sum(end <= size for end in ends)
        assert recovery.lost == (size < data_end + 13)
        assert sum(recovery.messages.values()) == len(kept)
        assert recovery.last_ns == max(message[2] for message in kept)
    assert refused >= 5


def test_a_changed_byte_costs_no_more_than_its_chunk(sound, tmp_path, chunks):
    whole, everything, random = sound.read_bytes(), content(sound), np.random.default_rng(11)
    largest = max(len(messages) for messages in by_chunk(sound, chunks))
    structure = [chunk.chunk_start_offset + k for chunk in chunks for k in random.integers(0, 60, 4).tolist()]
    for offset in [*random.integers(0, len(whole), 10).tolist(), *random.integers(0, 4000, 10).tolist(), *structure]:
        data = bytearray(whole)
        data[offset] ^= 1 << int(random.integers(8))
        recovery, target = recovered(bytes(data), tmp_path)
        kept = content(target)
        assert set(kept) <= set(everything), offset
        assert len(everything) - len(kept) <= largest, offset
        assert recovery.lost or kept == everything, offset


def by_chunk(path: Path, chunks) -> list[list[tuple]]:
    """Messages chunk by chunk."""
    everything = content(path)
    data, counts = path.read_bytes(), []
    for chunk in chunks:  # message index records: opcode, length, channel, bytes, then 16 bytes per message
        offset = chunk.chunk_start_offset + chunk.chunk_length
        end, count = offset + chunk.message_index_length, 0
        while offset < end:
            length = int.from_bytes(data[offset + 1 : offset + 9], "little")
            count += int.from_bytes(data[offset + 11 : offset + 15], "little") // 16
            offset += 9 + length
        counts.append(count)
    starts = np.cumsum([0, *counts])
    return [everything[a:b] for a, b in pairwise(starts)]


@pytest.mark.parametrize("where", ["payload", "length", "opcode", "size"])
@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_damaged_chunk_loses_its_messages_and_no_others(sound, tmp_path, chunks, number, where, data_end):
    """Also the first one, with the definition of every channel, and without an index to find them in."""
    data, start = bytearray(sound.read_bytes()[:data_end]), chunks[number].chunk_start_offset
    if where == "payload":
        data[start + 5000] ^= 0xFF
    elif where == "length":
        data[start + 1 : start + 9] = (2**64 - 1).to_bytes(8, "little")
    elif where == "opcode":
        data[start] = 0x7F
    else:
        data[start + 25 : start + 33] = (2**40).to_bytes(8, "little")
    recovery, target = recovered(bytes(data), tmp_path)
    lots = by_chunk(sound, chunks)
    assert content(target) == [message for k, lot in enumerate(lots) if k != number for message in lot]
    lost = [sum(message[1] == f"/cam{i}/image" for message in lots[number]) for i in range(2)]
    assert [recovery.missing[f"/cam{i}/image"] for i in range(2)] == lost
    assert recovery.chunks == len(chunks) - 1
    assert recovery.lost
    assert f"bytes {start} to " in recovery.losses[0]
    assert recovery.bytes_discarded >= chunks[number].chunk_length
    assert f"/cam0/image: {lost[0]} messages are missing" in recovery.losses
    if number > 0:
        assert check_recording(target).ok


def test_messages_whose_channel_is_known_from_nowhere_are_counted_as_lost(sound, tmp_path, chunks, data_end):
    """The chunk that defines the channels is damaged, and so is what repeats one of them."""
    data = bytearray(sound.read_bytes()[:data_end])
    data[chunks[0].chunk_start_offset + 5000] ^= 0xFF
    data[data.index(b"/cam0/image") + 4] ^= 0x01
    recovery, target = recovered(bytes(data), tmp_path)
    rest = [message for lot in by_chunk(sound, chunks)[1:] for message in lot]
    assert content(target) == [message for message in rest if message[1] == "/cam1/image"]
    orphans = sum(message[1] == "/cam0/image" for message in rest)
    assert f"{orphans} messages are of channels whose definition is lost" in recovery.losses


def test_two_damaged_chunks_are_both_passed_over(sound, tmp_path, chunks):
    data = bytearray(sound.read_bytes())
    for number in (1, 2):
        data[chunks[number].chunk_start_offset + 4000] ^= 1
    recovery, target = recovered(bytes(data), tmp_path)
    assert recovery.chunks == len(chunks) - 2
    assert content(target) == [m for k, lot in enumerate(by_chunk(sound, chunks)) if k not in (1, 2) for m in lot]
    assert [finding.severity for finding in check_recording(target).findings] == ["warning"] * 4

    again, _ = recovered(target.read_bytes(), tmp_path)
    assert (again.lost, again.missing) == (False, recovery.missing)


def test_changed_metadata_is_said_though_every_message_is_kept(sound, tmp_path):
    data = sound.read_bytes()
    recovery, target = recovered(data.replace(b"seed\x01\x00\x00\x005", b"seed\x01\x00\x00\x006"), tmp_path)
    assert recovery.losses == ("the header, the metadata or an index was changed: the checksum of the data is wrong",)
    assert content(target) == content(sound)


def test_what_cannot_be_recovered_is_refused_and_nothing_is_written(sound, tmp_path):
    source, target = tmp_path / "run.mcap.part", tmp_path / "run.mcap"
    target.write_bytes(b"earlier")
    source.write_bytes(b"no recording at all" * 1000)
    with pytest.raises(RecordingError, match="not an MCAP file"):
        recover_recording(source, target)
    source.write_bytes(sound.read_bytes()[:3000])
    with pytest.raises(RecordingError) as caught:
        recover_recording(source, target)
    assert str(caught.value) == (
        "nothing can be recovered\n"
        f"  where:    {source}\n"
        "  expected: at least one readable message\n"
        "  got:      none in 3000 bytes\n"
        "  do next:  record again; the run ended, or the file is damaged, before its first message"
    )
    with pytest.raises(RecordingError, match="cannot open the recording"):
        recover_recording(tmp_path / "absent.mcap", target)
    with pytest.raises(RecordingError, match="cannot be recovered onto itself"):
        recover_recording(source, source)
    source.write_bytes(sound.read_bytes())
    with pytest.raises(RecordingError, match="cannot write the recovered recording"):
        recover_recording(source, tmp_path / "absent" / "run.mcap")
    assert target.read_bytes() == b"earlier"
    assert {path.name for path in tmp_path.iterdir()} == {"run.mcap.part", "run.mcap"}


def test_a_copy_that_cannot_be_read_back_is_not_published(sound, tmp_path, monkeypatch):
    write_copy = recover_module._write_copy

    def faulty_disk(data, found, temporary):
        count = write_copy(data, found, temporary)
        temporary.write_bytes(temporary.read_bytes()[:-500])
        return count

    monkeypatch.setattr(recover_module, "_write_copy", faulty_disk)
    with pytest.raises(RecordingError, match="the recovered recording cannot be read back"):
        recover_recording(sound, tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


KILLED = 20


def test_recorders_killed_at_twenty_moments_lose_no_more_than_their_last_second(tmp_path):
    """Every other one records segments; each is killed at a moment of its own, seeded, 0.2 to 2.2 s after it began."""
    random = np.random.default_rng(2026)
    names = [(tmp_path / f"run{seed}.mcap", tmp_path / f"run{seed}.log") for seed in range(KILLED)]
    program = [sys.executable, str(Path(killed_recorders.__file__)), str(tmp_path), str(KILLED)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as recorders:
        pids = [int(word) for word in recorders.stdout.readline().split()]
        deadline_s = time.monotonic() + 30.0
        while not all(log.exists() and log.stat().st_size for _, log in names):
            assert time.monotonic() < deadline_s, sorted(path.name for path in tmp_path.iterdir())
            time.sleep(0.01)
        killed_at, before_s = {}, 0.0
        for after_s, number in sorted(zip(random.uniform(0.2, 2.2, KILLED).tolist(), range(KILLED), strict=True)):
            time.sleep(after_s - before_s)
            before_s = after_s
            os.kill(pids[number], signal.SIGKILL)
            killed_at[number] = time.monotonic()
        assert recorders.stdout.readline().split() == [str(-signal.SIGKILL)] * KILLED
    for number, (path, log) in enumerate(names):
        lines = [re.fullmatch(r"(\d+) (\d+\.\d+)", line) for line in log.read_text().splitlines()]
        due = {int(match[1]) for match in lines if match and float(match[2]) < killed_at[number] - 1.0}
        kept = kept_frames(path)
        assert kept == list(range(len(kept))), "no hole"
        assert due <= set(kept)


def kept_frames(path: Path) -> list[int]:
    """Numbers of the frames of a killed recording, after its recovery; every file of it passes the check."""
    parts = sorted(path.parent.glob(f"{path.stem}.*part"))
    assert parts
    for part in parts:
        if b"/tf" in part.read_bytes():
            assert not check_recording(part).ok
            assert recover_recording(part, part.with_suffix("")).lost
        else:  # killed before its first message was there
            assert part == parts[-1]
    files = [file for file in recording_files(path) if file.exists()]
    assert not files or check_sequence(files).ok
    messages = [m for file in files for m in iter_messages(file, ["/cam0/image"])]
    return [(message.publish_ns - T0) // killed_recorders.FRAME_NS for message in messages]
