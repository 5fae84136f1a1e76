"""A check finds what is wrong with a recording; each fault is made on purpose in a copy of a sound one."""

from __future__ import annotations

import hashlib
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.writer import CompressionType, IndexType, Writer

from recognition.errors import RecordingError
from recognition.observations import FrameSet, Scene, ViewFrame
from recognition.recording import Recorder, check_recording, content
from rigcal import __version__
from rigcal.camera import Camera
from rigcal.geometry import Pose
from rigcal.rig import ClockModel, Rig, RigCamera

T0 = 1_800_000_000_000_000_000
PERIOD_NS = 100_000_000
KEY = bytes.fromhex("000000016764000a 0000000168ee3c80 000001658884".replace(" ", ""))
BARE_IDR = bytes.fromhex("00000001658884")
P_SLICE, B_SLICE = bytes.fromhex("00000001419a21"), bytes.fromhex("00000001019e41")
IMAGE = np.zeros((4, 4, 3), np.uint8)


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """3 s of two cameras, one video and one of images, in several chunks."""
    path, random = tmp_path_factory.mktemp("sound") / "run.mcap", np.random.default_rng(5)
    lens = [90, 90, 32, 24, 0, 0, 0, 0]
    poses = {"cam0": Pose.identity(), "cam1": Pose.from_rvec([0, 0.3, 0], [-1, 0, 0])}
    cameras = tuple(RigCamera(name, Camera("opencv4", (64, 48), lens), pose) for name, pose in poses.items())
    document = {"cameras": [{"id": "cam0"}, {"id": "cam1"}], "note": "ä", "scale": 1e-07}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    document["digest"] = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    rig = Rig("hall", cameras, "cam0", "PASS", digest=document["digest"])
    with Recorder(path, rig=rig, rig_json=json.dumps(document).encode(), metadata={}) as recorder:
        for k in range(30):
            t_ns = T0 + k * PERIOD_NS
            noise = random.integers(1, 255, 100_000, dtype=np.uint8).tobytes()
            video = ViewFrame(k, t_ns, IMAGE, (KEY if k % 10 == 0 else P_SLICE) + noise, "h264")
            image = ViewFrame(k, t_ns, IMAGE, b"\xff\xd8" + noise[:1000], "jpeg")
            recorder.write_frames(FrameSet(k, t_ns, (video, image)))
            recorder.write_scene(Scene(k, t_ns, (), ()))
    return path


def rewritten(source: Path, target: Path, change, **options) -> Path:
    """A sound file of the records that ``change(record, topic)`` returns; None leaves one out."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        writer = Writer(out, compression=CompressionType.ZSTD, **options)
        writer.start(library=reader.get_header().library)
        summary = reader.get_summary()
        for attachment in filter(None, (change(a, "") for a in reader.iter_attachments())):
            a: Attachment = attachment
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        for metadata in filter(None, (change(m, "") for m in reader.iter_metadata())):
            m: Metadata = metadata
            writer.add_metadata(m.name, m.metadata)
        schemas = {k: writer.register_schema(s.name, s.encoding, s.data) for k, s in summary.schemas.items()}
        kept = {k: c for k, c in summary.channels.items() if change(c, c.topic)}
        ids = {k: writer.register_channel(c.topic, c.message_encoding, schemas[c.schema_id]) for k, c in kept.items()}
        for _, channel, record in reader.iter_messages(log_time_order=False):
            message: Message | None = change(record, channel.topic) if channel.id in ids else None
            if message:
                writer.add_message(
                    ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence
                )
        writer.finish()
    return target


def findings(path: Path, severity: str = "error") -> list[str]:
    return [finding.text for finding in check_recording(path).findings if finding.severity == severity]


def test_a_sound_recording_has_no_findings_and_is_counted(sound):
    check = check_recording(sound)
    assert (check.findings, check.ok) == ((), True)
    assert check.messages["/cam0/video"] == check.messages["/cam1/image"] == check.messages["/scene"] == 30
    assert check.messages["/tf"] == check.messages["/cam0/calibration"] == 3
    assert check.duration_s == pytest.approx(2.9)
    assert check.bytes == sound.stat().st_size


def test_rewriting_without_a_change_leaves_a_sound_recording(sound, tmp_path):
    assert findings(rewritten(sound, tmp_path / "a.mcap", lambda record, _: record)) == []


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.9999])
def test_a_cut_file_names_the_command_that_recovers_it(sound, tmp_path, share):
    path = tmp_path / "run.mcap.part"
    path.write_bytes(sound.read_bytes()[: int(share * sound.stat().st_size)])
    assert findings(path)[0] == (f"unfinished or damaged: run `recognition recover {path} -o {tmp_path / 'run.mcap'}`")
    assert any("the file does not end as a finished recording does" in text for text in findings(path))


def test_a_whole_file_that_is_still_a_part_is_not_finished(sound, tmp_path):
    path = tmp_path / "run.mcap.part"
    path.write_bytes(sound.read_bytes())
    assert len(findings(path)) == 1
    assert findings(path)[0].startswith("unfinished or damaged")


def test_bytes_after_the_end_are_found(sound, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(sound.read_bytes() + b"more")
    assert any("does not end as a finished recording" in text for text in findings(path))


def test_any_changed_byte_is_found(sound, tmp_path):
    data, path, random = sound.read_bytes(), tmp_path / "run.mcap", np.random.default_rng(1)
    tail = range(len(data) - 4000, len(data))  # the index, the footer and the magic
    for offset in [0, 9, 40, *random.integers(0, len(data), 25).tolist(), *random.choice(tail, 25).tolist()]:
        changed = bytearray(data)
        changed[offset] ^= 1 << int(random.integers(8))
        path.write_bytes(changed)
        assert not check_recording(path).ok, offset


def test_an_index_that_says_something_else_is_found(sound, tmp_path):
    """Checksums off, so that only the comparison with what is there can find it."""
    path = rewritten(sound, tmp_path / "run.mcap", lambda record, _: record, enable_crcs=False)
    assert findings(path) == []
    data = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    second = summary.chunk_indexes[1]
    record = struct.pack("<QQQQ", second.message_start_time, second.message_end_time,
                         second.chunk_start_offset, second.chunk_length)  # fmt: skip
    data[data.rindex(record)] ^= 1
    path.write_bytes(data)
    assert findings(path)[1:] == [
        f"the index of chunks, attachments and metadata differs from what is there in 1 of "
        f"{len(summary.chunk_indexes) + len(summary.attachment_indexes) + len(summary.metadata_indexes)} entries"
    ]
    counts = struct.pack("<QHI", summary.statistics.message_count, summary.statistics.schema_count,
                         summary.statistics.channel_count)  # fmt: skip
    data[data.rindex(counts)] ^= 1
    path.write_bytes(data)
    assert any(text.startswith("the statistics say") for text in findings(path))


def test_a_file_without_an_index_is_found(sound, tmp_path):
    options = {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}
    options |= {"repeat_channels": False, "repeat_schemas": False}
    path = rewritten(sound, tmp_path / "run.mcap", lambda record, _: record, **options)
    assert "the file has no index" in findings(path)


def test_another_rig_than_the_metadata_says_is_found(sound, tmp_path):
    def change(record, _):
        if isinstance(record, Metadata) and record.name == "rigcal":
            return Metadata("rigcal", {**record.metadata, "digest": "sha256:0"})
        return record

    texts = findings(rewritten(sound, tmp_path / "run.mcap", change))
    assert len(texts) == 1
    assert texts[0].endswith("the metadata says sha256:0")


def test_a_rig_file_that_was_edited_is_found(sound, tmp_path):
    def change(record, _):
        return (
            replace(record, data=record.data.replace(b"1e-07", b"2e-07")) if isinstance(record, Attachment) else record
        )

    texts = findings(rewritten(sound, tmp_path / "run.mcap", change))
    assert texts[0].endswith(": it was changed")


def test_a_rig_file_that_is_missing_or_none_is_found(sound, tmp_path):
    path = rewritten(sound, tmp_path / "a.mcap", lambda r, _: None if isinstance(r, Attachment) else r)
    assert findings(path) == ["0 attachments are called rig.json, one was expected"]
    path = rewritten(
        sound, tmp_path / "b.mcap", lambda r, _: replace(r, data=b"[1]") if isinstance(r, Attachment) else r
    )
    assert findings(path) == ["the attachment rig.json is no rig file"]


def test_a_camera_without_calibration_or_place_is_named(sound, tmp_path):
    def change(record, topic):
        return None if topic in ("/cam1/calibration", "/tf") else record

    assert findings(rewritten(sound, tmp_path / "run.mcap", change)) == [
        "/tf does not say where camera cam0 stands",
        "camera cam1 has no calibration message",
        "/tf does not say where camera cam1 stands",
    ]


def with_video(edit):
    """A change of the video's bytes: ``edit(k, data)`` of the frame k."""

    def change(record, topic):
        if isinstance(record, Message) and topic == "/cam0/video":
            video = CompressedVideo.FromString(record.data)
            video.data = edit(record.sequence, video.data)
            return replace(record, data=video.SerializeToString())
        return record

    return change


@pytest.mark.parametrize(
    ("edit", "fault"),
    [
        (lambda k, data: data[4:] if k == 7 else data, "1 frames do not begin with an H.264 start code (Annex B)"),
        (
            lambda k, data: P_SLICE if k == 0 else data,
            "1 frame at the start is no key frame with SPS and PPS: the video cannot be decoded",
        ),
        (lambda k, data: B_SLICE if k in (3, 4) else data, "2 frames are B frames, which viewers cannot show"),
        (
            lambda k, data: BARE_IDR if k in (10, 20) else data,
            "2 key frames are without SPS and PPS: nobody can begin to decode there",
        ),
    ],
)
def test_video_that_viewers_cannot_show_is_found(sound, tmp_path, edit, fault):
    assert findings(rewritten(sound, tmp_path / "run.mcap", with_video(edit))) == [f"/cam0/video: {fault}"]


def test_key_frames_that_are_far_apart_are_a_warning(sound, tmp_path, monkeypatch):
    monkeypatch.setattr(content, "LONG_GOP_S", 1.5)
    path = rewritten(sound, tmp_path / "run.mcap", with_video(lambda k, data: P_SLICE if k == 10 else data))
    assert check_recording(path).ok
    assert findings(path, "warning") == [
        "/cam0/video: up to 2.0 s between key frames: set the camera to one every 1 to 2 s"
    ]


def test_clock_models_are_told_or_their_absence_is(tmp_path):
    clock = ClockModel(0.5, 12.0, "2026-04-12T09:00:00Z", 2e-4, 0.05, "probe")
    poses = {"cam0": Pose.identity(), "cam1": Pose.from_rvec([0, 0.3, 0], [-1, 0, 0])}
    lens = Camera("opencv4", (64, 48), [90, 90, 32, 24, 0, 0, 0, 0])
    cameras = tuple(RigCamera(n, lens, pose, None, clock if n == "cam1" else None) for n, pose in poses.items())
    document: dict = {"cameras": [{"id": "cam0"}, {"id": "cam1"}]}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    document["digest"] = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    rig = Rig("hall", cameras, "cam0", "PASS", digest=document["digest"])
    path = tmp_path / "run.mcap"
    with Recorder(path, rig=rig, rig_json=json.dumps(document).encode(), metadata={}) as recorder:
        recorder.log("info", "x", T0)
    check = check_recording(path)
    assert check.findings == ()
    assert check.facts == (
        f"rig {rig.digest}, verdict PASS",
        f"recorded by version {__version__}",
        "clocks: cam0 none, cam1 by probe, within 0.2 ms at 2026-04-12T09:00:00Z",
    )

    def unsaid(record, _):
        if isinstance(record, Metadata) and record.name == "rigcal":
            return Metadata("rigcal", {k: v for k, v in record.metadata.items() if k != "clock.cam1"})
        return record

    silent = rewritten(path, tmp_path / "silent.mcap", unsaid)
    assert findings(silent, "warning") == [
        "it is not said by which clock models the times of cam1 are rig time, or by none"
    ]


def test_messages_that_are_not_what_their_schema_says_are_found(sound, tmp_path):
    def change(record, topic):
        return replace(record, data=b"\xff") if isinstance(record, Message) and topic == "/cam0/video" else record

    assert findings(rewritten(sound, tmp_path / "run.mcap", change)) == [
        "/cam0/video: 30 messages are no foxglove.CompressedVideo"
    ]


def test_times_that_run_backwards_are_found(sound, tmp_path):
    def change(record, topic):
        is_late = isinstance(record, Message) and topic == "/scene" and record.sequence >= 20
        return replace(record, log_time=record.log_time - 5 * PERIOD_NS) if is_late else record

    assert findings(rewritten(sound, tmp_path / "run.mcap", change)) == [
        "/scene: times run backwards 1 times, by 0.400 s"
    ]


def test_gaps_and_missing_messages_are_warnings(sound, tmp_path):
    def change(record, topic):
        is_dropped = isinstance(record, Message) and topic == "/cam1/image" and 10 <= record.sequence < 16
        return None if is_dropped else record

    path = rewritten(sound, tmp_path / "run.mcap", change)
    assert check_recording(path).ok
    assert findings(path, "warning") == [
        "/cam1/image: 6 messages are missing",
        "/cam1/image: 1 gaps, the longest 0.700 s where the median spacing is 0.100 s",
    ]


def test_a_recording_without_messages_is_a_warning(sound, tmp_path):
    path = rewritten(sound, tmp_path / "run.mcap", lambda r, _: None if isinstance(r, Message | Channel) else r)
    assert "the recording holds no messages" in findings(path, "warning")


def test_other_files_are_refused_in_words(tmp_path):
    path = tmp_path / "photo.mcap"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(500))
    with pytest.raises(RecordingError) as caught:
        check_recording(path)
    assert str(caught.value) == (
        "not an MCAP file\n"
        f"  where:    {path}\n"
        "  expected: a recording that begins with the MCAP magic\n"
        "  got:      508 bytes that begin with b'\\x89PNG\\r\\n\\x1a\\n'\n"
        "  do next:  give a file that recognition run wrote; if it was one, nothing in it can be read any more"
    )
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match="an empty file"):
        check_recording(path)
    with pytest.raises(RecordingError, match="cannot open the recording"):
        check_recording(tmp_path / "absent.mcap")
    with pytest.raises(RecordingError, match="cannot open the recording"):
        check_recording(tmp_path)
