"""What a recorder writes is what the stock readers of Python and JavaScript read."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import subprocess
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from recognition.errors import RecordingError
from recognition.h264 import has_b_slice, is_key_frame
from recognition.observations import FrameSet, ObjectTrack, Scene, ViewDetections, ViewFrame, WorkerTrack
from recognition.recording import (
    Recorder,
    ViewTracks,
    check_recording,
    iter_messages,
    read_metadata,
    read_rig_attachment,
    recover_recording,
)
from recognition.recording.annotations import image_annotations
from recognition.recording.messages import calibration
from recognition.recording.scene import SceneDrawer
from rigcal.camera import Camera
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

REPOSITORY = Path(__file__).resolve().parents[2]
T0 = 1_800_000_000_000_000_123
IMAGE = np.full((48, 64, 3), (30, 120, 210), np.uint8)
WORLD_FROM_RIG = Pose.from_rvec([math.pi / 2, 0, 0], [0.5, -1.0, 2.0])
LENS = [90.0, 91.0, 31.5, 23.5, -0.1, 0.02, 0.001, -0.002, 0.003]


def rig_and_json(world_from_rig: Pose | None = WORLD_FROM_RIG, ids: tuple[str, ...] = ("cam0", "cam1")):
    poses = [Pose.identity(), Pose.from_rvec([0.0, 0.4, 0.1], [-1.1, 0.02, 0.3]), Pose.from_rvec([1, 0, 0], [0, 1, 2])]
    cameras = tuple(
        RigCamera(camera_id, Camera("opencv5", (64, 48), LENS), pose)
        for camera_id, pose in zip(ids, poses, strict=False)
    )
    document = {"site": "Halle Süd", "cameras": [{"id": camera_id} for camera_id in ids], "geometry_digest": "sha256:g"}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    document["digest"] = "sha256:" + hashlib.sha256(text.encode()).hexdigest()
    rig = Rig("Halle Süd", cameras, ids[0], "PASS", world_from_rig, document["digest"])
    return rig, json.dumps(document, indent=1).encode()


def recorder(path: Path, **options) -> Recorder:
    rig, rig_json = rig_and_json()
    return Recorder(path, rig=rig, rig_json=rig_json, metadata={"command": "run"}, **options)


def frames(index: int, t_ns: int, *views: tuple[bytes | None, str] | None) -> FrameSet:
    made = [None if view is None else ViewFrame(index, t_ns + i, IMAGE, *view) for i, view in enumerate(views)]
    return FrameSet(index, t_ns, tuple(made))


def people(*joints: np.ndarray) -> ViewDetections:
    px = np.stack(joints)
    return ViewDetections(px, np.isfinite(px).all(axis=2).astype(float), (), np.zeros((0, 4)), np.zeros(0))


def stock_messages(path: Path) -> dict[str, list]:
    """Every message by topic, with the stock reader and decoder."""
    messages: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((message, decoded))
    return messages


def stamp_ns(timestamp) -> int:
    return timestamp.seconds * 1_000_000_000 + timestamp.nanos


def h264(count: int, *, b_frames: int = 0, key_every: int = 6) -> list[bytes]:
    codec = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt, codec.time_base = 64, 48, "yuv420p", Fraction(1, 30)
    codec.options = {
        "bf": str(b_frames),
        "x264-params": "scenecut=0:b-adapt=0",
        "g": str(key_every),
        "preset": "veryfast",
    }
    packets = []
    for i in range(count):
        image = np.roll(np.tile(np.arange(64, dtype=np.uint8)[:, None] * 3, (48, 1, 3)), 2 * i, axis=1)
        frame = av.VideoFrame.from_ndarray(image, format="bgr24")
        frame.pts = i
        packets += [bytes(packet) for packet in codec.encode(frame)]
    return packets + [bytes(packet) for packet in codec.encode(None)]


def decoded(packets: list[bytes]) -> list[av.VideoFrame]:
    codec = av.CodecContext.create("h264", "r")
    return [frame for data in [*packets, None] for frame in codec.decode(av.Packet(data) if data else None)]


def test_everything_handed_over_is_read_back_by_the_stock_reader(tmp_path):
    path, (_, rig_json) = tmp_path / "run.mcap", rig_and_json()
    png = cv2.imencode(".png", IMAGE)[1].tobytes()
    video = h264(4)
    joints_m = np.arange(51, dtype=float).reshape(17, 3) / 10
    with recorder(path) as writing:
        for k, data in enumerate(video):
            frame_set = frames(k, T0 + k * 40_000_000, (data, "h264"), (png, "png"))
            writing.write_frames(frame_set)
            writing.write_detections(frame_set, [people(np.full((17, 2), 5.0 + k)), None])
            writing.write_scene(
                Scene(k, frame_set.t_ns, (WorkerTrack(3, joints_m, np.full(17, 2), np.zeros(2, int)),), ())
            )
        writing.log("warning", "cam1 lags", T0 + 1)
    recorded = writing.close()

    assert not path.with_name("run.mcap.part").exists()
    assert recorded.path == path
    assert recorded.bytes == path.stat().st_size
    found = stock_messages(path)
    assert {topic: len(messages) for topic, messages in found.items()} == dict(recorded.messages)
    assert [message.data for _, message in found["/cam0/video"]] == video
    assert {message.format for _, message in found["/cam0/video"]} == {"h264"}
    assert {(message.data, message.format) for _, message in found["/cam1/image"]} == {(png, "png")}
    assert [m.frame_id for m in (found["/cam0/video"][0][1], found["/cam1/image"][0][1])] == ["cam0", "cam1"]
    log_record, line = found["/log"][0]
    assert (line.message, line.level, stamp_ns(line.timestamp), log_record.log_time) == ("cam1 lags", 3, T0 + 1, T0 + 1)
    for k, (record, message) in enumerate(found["/cam1/image"]):
        times = {record.log_time, record.publish_time, stamp_ns(message.timestamp)}
        assert times == {T0 + k * 40_000_000 + 1}
        assert record.sequence == k
    with path.open("rb") as stream:
        first = next(make_reader(stream).iter_attachments())
        assert (first.name, first.media_type, first.data) == ("rig.json", "application/json", rig_json)
        assert stream.seek(0) == 0
        assert stream.read(2000).find(b"rig.json") > 0
    assert check_recording(path).findings == ()


def test_rig_metadata_and_messages_have_readers_of_their_own(tmp_path):
    path, (rig, rig_json) = tmp_path / "run.mcap", rig_and_json()
    with recorder(path) as writing:
        writing.log("info", "late", T0 + 5)
        writing.write_scene(Scene(0, T0, (), ()))
    assert read_rig_attachment(path) == rig_json
    metadata = read_metadata(path)
    assert metadata["digest"] == rig.digest
    assert {"geometry_digest": "sha256:g", "verdict": "PASS", "command": "run"}.items() <= metadata.items()
    assert [m.topic for m in iter_messages(path, ["/log", "/scene"])] == ["/scene", "/log"]
    assert next(iter_messages(path, ["/log"])).message.message == "late"


def test_live_messages_are_logged_when_received_and_published_when_captured(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        writing.write_frames(frames(0, T0, None, (None, "")), receive_ns=T0 + 30_000_000)
    record, message = stock_messages(path)["/cam1/image"][0]
    assert (record.log_time, record.publish_time) == (T0 + 30_000_000, T0 + 1)
    assert stamp_ns(message.timestamp) == T0 + 1


def test_images_without_bytes_of_their_own_become_jpeg(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        writing.write_frames(frames(0, T0, (None, ""), None))
    _, message = stock_messages(path)["/cam0/image"][0]
    assert message.format == "jpeg"
    image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(image.astype(int) - IMAGE).max() <= 2


@pytest.mark.parametrize(
    ("model", "name", "params", "distortion"),
    [
        ("opencv4", "plumb_bob", LENS[:8], [*LENS[4:8], 0.0]),
        ("opencv5", "plumb_bob", LENS, LENS[4:]),
        ("opencv8", "rational_polynomial", [*LENS, 0.1, 0.2, 0.3], [*LENS[4:], 0.1, 0.2, 0.3]),
        ("fisheye4", "kannala_brandt", LENS[:8], LENS[4:8]),
    ],
)
def test_lens_models_keep_their_coefficients(model, name, params, distortion):
    message = calibration(RigCamera("cam3", Camera(model, (64, 48), params), Pose.identity()), T0)
    assert (message.frame_id, message.width, message.height, message.distortion_model) == ("cam3", 64, 48, name)
    assert list(message.D) == distortion
    assert list(message.K) == [90.0, 0, 31.5, 0, 91.0, 23.5, 0, 0, 1]
    assert list(message.R) == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert list(message.P) == [90.0, 0, 31.5, 0, 0, 91.0, 23.5, 0, 0, 0, 1, 0]


def test_transforms_carry_a_point_from_a_camera_to_the_world(tmp_path):
    path, (rig, _) = tmp_path / "run.mcap", rig_and_json()
    with recorder(path) as writing:
        writing.log("info", "start", T0)
    placed = {t.child_frame_id: t for t in stock_messages(path)["/tf"][0][1].transforms}
    assert {child: t.parent_frame_id for child, t in placed.items()} == {"cam0": "rig", "cam1": "rig", "rig": "world"}

    def carried(child, point):  # the meaning of a FrameTransform, in scipy's words
        q, t = placed[child].rotation, placed[child].translation
        return Rotation.from_quat([q.x, q.y, q.z, q.w]).apply(point) + np.array([t.x, t.y, t.z])

    point_in_rig = np.array([0.3, -0.2, 4.0])
    point_in_cam1 = rig.camera("cam1").cam_from_rig.apply(point_in_rig)
    np.testing.assert_allclose(carried("cam1", point_in_cam1), point_in_rig, atol=1e-12)
    np.testing.assert_allclose(carried("rig", point_in_rig), WORLD_FROM_RIG.apply(point_in_rig), atol=1e-12)


def test_calibration_and_transforms_come_first_and_then_once_a_second(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        for k in range(31):
            writing.log("info", str(k), T0 + k * 100_000_000)
    messages = list(iter_messages(path))
    assert [m.topic for m in messages[:4]] == ["/cam0/calibration", "/cam1/calibration", "/tf", "/log"]
    for topic in ("/cam0/calibration", "/cam1/calibration", "/tf"):
        assert [m.log_ns - T0 for m in messages if m.topic == topic] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    for message in messages[:3] + messages[-4:-1]:
        placed = message.message.transforms if message.topic == "/tf" else [message.message]
        assert {stamp_ns(one.timestamp) for one in placed} == {message.publish_ns}


def test_annotations_skip_unknown_joints_and_count_pixels_from_the_corner():
    joints = np.full((17, 2), np.nan)
    joints[5], joints[7], joints[9], joints[16] = (10, 20), (12, 24), (14, 30), (40, 50)
    drawn = image_annotations(people(joints), None, T0)
    lines, points = drawn.points
    assert (lines.type, points.type) == (lines.LINE_LIST, points.POINTS)
    assert [(p.x, p.y) for p in lines.points] == [(10.5, 20.5), (12.5, 24.5), (12.5, 24.5), (14.5, 30.5)]
    assert [(p.x, p.y) for p in points.points] == [(10.5, 20.5), (12.5, 24.5), (14.5, 30.5), (40.5, 50.5)]
    assert len(drawn.texts) == 0
    assert len(image_annotations(people(np.full((17, 2), np.nan)), None, T0).points) == 0


def test_a_hint_is_drawn_where_it_belongs_to_a_track_only():
    view = replace(people(np.ones((17, 2)), np.ones((17, 2))), hints=np.array([1]))
    assert len(image_annotations(view, None, T0).points) == 2
    assert len(image_annotations(view, ViewTracks((7, None), ()), T0).points) == 2
    assert len(image_annotations(view, ViewTracks((None, 7), ()), T0).points) == 4


def test_boxes_are_closed_and_name_class_track_and_score():
    view = ViewDetections(np.zeros((0, 17, 2)), np.zeros((0, 17)), ("hardhat",), [[1, 2, 11, 22]], [0.875])
    drawn = image_annotations(view, ViewTracks((), (4,)), T0)
    assert drawn.points[0].type == drawn.points[0].LINE_LOOP
    assert [(p.x, p.y) for p in drawn.points[0].points] == [(1.5, 2.5), (11.5, 2.5), (11.5, 22.5), (1.5, 22.5)]
    assert drawn.texts[0].text == "hardhat 4 0.88"
    assert image_annotations(view, None, T0).texts[0].text == "hardhat 0.88"


def test_a_track_keeps_its_colour_and_others_are_grey():
    view = people(np.ones((17, 2)), np.ones((17, 2)), np.ones((17, 2)))
    first = [p.outline_color for p in image_annotations(view, ViewTracks((7, 8, None), ()), T0).points[::2]]
    later = [p.outline_color for p in image_annotations(view, ViewTracks((8, None, 7), ()), T0 + 5).points[::2]]
    assert (first[0], first[1], first[2]) == (later[2], later[0], later[1])
    assert first[0] != first[1]
    assert first[2].r == first[2].g == first[2].b


def test_annotations_refuse_tracks_that_do_not_fit():
    with pytest.raises(ValueError, match="zip"):
        image_annotations(people(np.ones((17, 2))), ViewTracks((1, 2), ()), T0)


def worker(track_id: int, joints_m: np.ndarray) -> WorkerTrack:
    return WorkerTrack(track_id, joints_m, np.full(17, 2), np.zeros(2, int))


def test_the_scene_stands_in_the_world_where_there_is_one():
    joints = np.full((17, 3), np.nan)
    joints[5], joints[7] = (1, 2, 3), (1, 2.5, 3)
    scene = Scene(0, T0, (worker(4, joints),), (ObjectTrack(9, "hardhat", np.array([0.5, 0, 2]), 3, np.zeros(2, int)),))
    for world in (WORLD_FROM_RIG, None):
        _, person, thing = SceneDrawer(rig_and_json(world)[0]).update(scene).entities
        moved = joints if world is None else joints @ world.rotation.T + world.translation_m
        assert {person.frame_id, thing.frame_id} == {"rig" if world is None else "world"}
        spheres = [[s.pose.position.x, s.pose.position.y, s.pose.position.z] for s in person.spheres]
        np.testing.assert_allclose(spheres, moved[[5, 7]], atol=1e-12)
        np.testing.assert_allclose([[p.x, p.y, p.z] for p in person.lines[0].points], moved[[5, 7]], atol=1e-12)
        assert (person.id, thing.id) == ("worker/4", "object/hardhat/9")
        assert (person.texts[0].text, thing.texts[0].text) == ("worker 4", "hardhat 9")


def test_what_vanished_from_the_scene_is_deleted_once():
    drawer = SceneDrawer(rig_and_json()[0])
    known, unknown = np.ones((17, 3)), np.full((17, 3), np.nan)
    updates = [
        drawer.update(Scene(k, T0 + k, tuple(worker(i, joints) for i, joints in workers.items()), ()))
        for k, workers in enumerate([{1: known, 2: known}, {1: known, 2: unknown}, {1: known}, {2: known}])
    ]
    assert [[e.id for e in u.entities] for u in updates] == [
        ["status", "worker/1", "worker/2"], ["status", "worker/1"], ["status", "worker/1"], ["status", "worker/2"]
    ]  # fmt: skip
    assert [[d.id for d in u.deletions] for u in updates] == [[], ["worker/2"], [], ["worker/1"]]
    assert stamp_ns(updates[1].deletions[0].timestamp) == T0 + 1


def test_video_can_be_decoded_from_its_first_recorded_frame(tmp_path):
    path, packets = tmp_path / "run.mcap", h264(12)
    with recorder(path) as writing:
        for k, data in enumerate(packets[2:]):  # a stream joined between two key frames
            writing.write_frames(frames(k, T0 + k * 33_000_000, (data, "h264"), None))
    kept = [message.data for _, message in stock_messages(path)["/cam0/video"]]
    assert kept == packets[6:]
    assert dict(writing.close().undecodable) == {"/cam0/video": 4}
    recorded, whole = decoded(kept), decoded(packets)
    assert len(recorded) == 6
    for got, want in zip(recorded, whole[6:], strict=True):
        np.testing.assert_array_equal(got.to_ndarray(), want.to_ndarray())
    assert check_recording(path).ok


def test_slice_and_picture_kinds_agree_with_the_decoder():
    packets = h264(12, b_frames=2)
    b_pictures = sum(frame.pict_type == av.video.frame.PictureType.B for frame in decoded(packets))
    assert b_pictures > 0
    assert sum(map(has_b_slice, packets)) == b_pictures
    assert sum(map(is_key_frame, packets)) == sum(f.key_frame for f in decoded(packets))
    assert not any(map(has_b_slice, h264(12)))


def test_a_message_is_in_the_file_within_the_interval_though_no_call_follows(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path, fsync_interval_s=0.2) as writing:
        writing.log("info", "the last word", T0)
        time.sleep(0.4)
        recovery = recover_recording(path.with_name("run.mcap.part"), tmp_path / "copy.mcap")
    assert recovery.messages["/log"] == 1


def test_an_unfinished_recording_in_the_way_is_named_and_kept(tmp_path):
    path = tmp_path / "run.mcap"
    part = path.with_name("run.mcap.part")
    part.write_bytes(b"precious")
    with pytest.raises(RecordingError) as caught:
        recorder(path)
    assert str(caught.value) == (
        "an unfinished recording is in the way\n"
        f"  where:    {part}\n"
        "  expected: no such file\n"
        "  got:      8 bytes of a run that did not end\n"
        f"  do next:  run `recognition recover {part} -o {path}` and then delete it, or delete it if it is not needed"
    )
    assert part.read_bytes() == b"precious"


def test_a_finished_recording_is_replaced_only_by_a_finished_one(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"earlier")
    with recorder(path) as writing:
        writing.log("info", "x", T0)
        assert path.read_bytes() == b"earlier"
    assert check_recording(path).ok


def test_an_exception_leaves_a_finished_part_from_which_nothing_is_lost(tmp_path):
    path = tmp_path / "run.mcap"
    part = path.with_name("run.mcap.part")

    def failing_run():
        with recorder(path) as writing:
            writing.log("info", "x", T0)
            raise KeyError("the runtime failed")

    with pytest.raises(KeyError, match="the runtime failed"):
        failing_run()
    assert not path.exists()
    assert "recognition recover" in check_recording(part).findings[0].text
    recovery = recover_recording(part, path)
    assert (recovery.losses, recovery.messages["/log"]) == ((), 1)
    assert check_recording(path).ok


def test_a_run_without_messages_still_gives_a_sound_recording(tmp_path):
    with recorder(tmp_path / "run.mcap"):
        pass
    assert check_recording(tmp_path / "run.mcap").ok


def test_bad_input_is_refused_in_words(tmp_path):
    rig, rig_json = rig_and_json()
    with pytest.raises(RecordingError, match="cannot write the recording"):
        recorder(tmp_path / "absent" / "run.mcap")
    other = Rig(rig.site, rig.cameras, rig.reference, rig.verdict, digest="sha256:other")
    with pytest.raises(RecordingError, match="the rig and its file are not the same"):
        Recorder(tmp_path / "a.mcap", rig=other, rig_json=rig_json, metadata={})
    named, named_json = rig_and_json(ids=("cam0", "world"))
    with pytest.raises(RecordingError, match="a camera is called world"):
        Recorder(tmp_path / "b.mcap", rig=named, rig_json=named_json, metadata={})
    with pytest.raises(ValueError, match="metadata must not set digest"):
        Recorder(tmp_path / "c.mcap", rig=rig, rig_json=rig_json, metadata={"digest": "x"})
    with pytest.raises(ValueError, match="fsync_interval_s must be positive, got 0"):
        recorder(tmp_path / "d.mcap", fsync_interval_s=0)
    assert not list(tmp_path.iterdir())
    with recorder(tmp_path / "e.mcap") as writing:
        with pytest.raises(RecordingError, match="a time cannot be recorded"):
            writing.log("info", "x", -2_000_000)
        with pytest.raises(ValueError, match="level of a log line must be one of debug, info"):
            writing.log("loud", "x", T0)
        with pytest.raises(ValueError, match="must be h264, jpeg or png, got 'hevc'"):
            writing.write_frames(frames(0, T0, (b"x", "hevc"), None))
    with pytest.raises(RecordingError, match="the recording is closed"):
        writing.log("info", "x", T0)


def test_readers_name_the_command_for_an_unfinished_recording(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        writing.log("info", "x", T0)
    data = path.read_bytes()
    part = tmp_path / "cut.mcap.part"
    for size in (len(data) // 2, 20, len(data) - 3):
        part.write_bytes(data[:size])
        for read in (read_rig_attachment, read_metadata, lambda p: list(iter_messages(p))):
            with pytest.raises(RecordingError) as caught:
                read(part)
            assert caught.value.do_next == f"run `recognition recover {part} -o {tmp_path / 'cut.mcap'}`"
    with pytest.raises(RecordingError, match="cannot open the recording"):
        read_metadata(tmp_path / "absent.mcap")


NODE_READER = """
const { McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");
const fs = require("node:fs/promises");
(async () => {
  const handle = await fs.open(process.argv[2], "r");
  const readable = {
    size: async () => BigInt((await handle.stat()).size),
    read: async (offset, length) => {
      const buffer = new Uint8Array(Number(length));
      await handle.read(buffer, 0, buffer.length, Number(offset));
      return buffer;
    },
  };
  const zstd = (data, size) => decompress(data, new Uint8Array(Number(size)));
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: { zstd } });
  const messages = {}, attachments = {};
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const topic = reader.channelsById.get(message.channelId).topic;
    messages[topic] = (messages[topic] ?? 0) + 1;
  }
  for await (const attachment of reader.readAttachments()) attachments[attachment.name] = attachment.data.length;
  console.log(JSON.stringify({ messages, attachments }));
})();
"""


def node_packages() -> Path:
    """Where @mcap/core is installed, once per checkout; skips where that cannot be done."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("node and npm are not installed")
    folder = REPOSITORY / ".cache" / "node"
    if not all((folder / "node_modules" / name).exists() for name in ("@mcap/core", "fzstd")):
        folder.mkdir(parents=True, exist_ok=True)
        command = [
            npm,
            "install",
            "--no-audit",
            "--no-fund",
            "--prefix",
            str(folder),
            "@mcap/core@2.2.2",
            "fzstd@0.1.1",
        ]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            pytest.skip(f"npm cannot install @mcap/core: {error}")
    return folder / "node_modules"


def test_the_library_under_foxglove_reads_the_recording_by_its_index(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        for k, data in enumerate(h264(6)):
            writing.write_frames(frames(k, T0 + k * 40_000_000, (data, "h264"), (None, "")))
    script = tmp_path / "read.cjs"
    script.write_text(NODE_READER)
    environment = {**os.environ, "NODE_PATH": str(node_packages())}
    done = subprocess.run(
        ["node", script, path], capture_output=True, text=True, env=environment, check=True, timeout=60
    )
    found = json.loads(done.stdout)
    assert found["messages"] == dict(writing.close().messages)
    assert found["attachments"] == {"rig.json": len(rig_and_json()[1])}
