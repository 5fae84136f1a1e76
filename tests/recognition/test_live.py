"""Live runs: everything that arrives is recorded, frame sets are skipped as a whole, what is wrong is said."""

import re
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from live_fakes import FPS, SIZE_WH, Buckets, Conductor, FakeCamera, h264_units

from recognition.errors import RecordingError
from recognition.grouping import GroupingOptions
from recognition.live import LiveFeed, LiveOptions
from recognition.live import camera as live_camera
from recognition.live import feed as live_feed
from recognition.live.journal import Journal
from recognition.live.recording import PacketRecording
from recognition.recording import Recorder, check_recording, iter_messages
from recognition.runtime import RunOptions, run_live
from recognition.sources.stream import Packet
from recognition.synthetic import semicircle_rig
from rigcal.rig import ClockModel
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

DAY_S = 86400.0
GROUPING = GroupingOptions(wait_s=2.0, silent_s=3.0, fps=FPS)
"""More patient than by default: a machine that tests may be busy."""


def rig_of_cameras(folder, count, *, clocks=True):
    """A rig as read from its file; every camera has a clock that was measured just now."""
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    made = semicircle_rig(count, size_wh=SIZE_WH)
    clock = ClockModel(0.0, 0.0, now, 1e-4, 0.1, "probe") if clocks else None
    made = replace(made, cameras=tuple(replace(camera, clock=clock) for camera in made.cameras))
    path = folder / "s.rig.json"
    write_rigfile(document_of_rig(made, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64), path)
    return path, rig_of(read_rigfile(path))


class Run:
    """A live run over fake cameras: its result, scenes, what was said, and its recording.

    Frames come when the ones before were placed, unless ``paced``.
    """

    def __init__(
        self,
        folder,
        make,
        *,
        count=3,
        frames=45,
        detector=None,
        clocks=True,
        stop=None,
        is_live=True,
        paced=False,
    ):
        path, rig = rig_of_cameras(folder, count, clocks=clocks)
        self.recording, self.scenes, self.said = folder / "r.mcap", [], []
        conductor = Conductor()
        self.cameras = make(time.time_ns() + 50_000_000, frames, None if paced else conductor)
        options = LiveOptions(use=(True,) * count, is_live=is_live, clock_age_s=DAY_S, grouping=GROUPING)
        recorder = Recorder(self.recording, rig=rig, rig_json=path.read_bytes(), metadata={})
        feed = LiveFeed(rig, self.cameras, detector or Buckets(), recorder, time.time_ns, options)
        feed.announce = lambda entry: self.said.append(f"{entry.level}: {entry.text}")

        def note(scene):
            self.scenes.append(scene)
            conductor.placed(scene)

        with recorder, feed:
            self.result = run_live(rig, feed, recorder, RunOptions(), on_scene=note, stop=stop)
        self.status = feed.status
        self.check = check_recording(self.recording)
        assert self.check.ok, self.check.findings
        logged = [message.message.message for message in iter_messages(self.recording, ["/log"])]
        assert [line.partition(": ")[2] for line in self.said] == logged

    @property
    def statuses(self):
        """The statuses in order, each once for as long as it lasted."""
        found = [scene.status for scene in self.scenes]
        return [status for n, status in enumerate(found) if n == 0 or found[n - 1] != status]

    def recorded(self, camera, kind="image"):
        return self.check.messages.get(f"/cam{camera}/{kind}", 0)


def cameras_of(count, **special):
    """Ordinary cameras; ``cam1={...}`` has other arguments."""
    return lambda start_ns, frames, conductor: [
        FakeCamera(camera, start_ns, **{"frames": frames, "conductor": conductor, **special.get(f"cam{camera}", {})})
        for camera in range(count)
    ]


def test_a_slow_detector_skips_whole_frame_sets_and_everything_is_recorded(tmp_path):
    run = Run(tmp_path, cameras_of(3), detector=Buckets(0.02), paced=True)
    assert [run.recorded(camera) for camera in range(3)] == [45, 45, 45]
    assert [one.recorded for one in run.status.cameras] == [45, 45, 45]
    assert run.status.sets == run.status.looked_at + run.status.skipped
    assert run.status.skipped >= 10
    assert run.result.instants == run.status.looked_at == len(run.scenes)
    assert f"{run.status.skipped} of {run.status.sets} frame sets were skipped" in run.said[-1]
    assert 0.02 < run.status.latency_p50_s <= run.status.latency_p95_s


def test_a_camera_that_is_unplugged_and_returns_degrades_the_results_meanwhile(tmp_path):
    run = Run(tmp_path, cameras_of(3, cam1={"lost": (10, 20)}), frames=30)
    assert run.statuses == ["MONITORED", "DEGRADED", "MONITORED"]
    reasons = {scene.reason for scene in run.scenes if scene.status == "DEGRADED"}
    assert "2 of 3 cameras (cam1: lost: the camera hung up: connection reset)" in reasons
    assert [run.recorded(camera) for camera in range(3)] == [30, 20, 30]
    assert "error: cam1: the camera is lost: the camera hung up: connection reset; look at its cable" in run.said
    assert "warning: cam1: the camera is back after 0.1 s" in run.said
    assert run.status.cameras[1].interruptions == 1


def test_a_camera_that_ends_does_not_hold_the_others_up(tmp_path):
    run = Run(tmp_path, cameras_of(3, cam1={"frames": 10}), frames=30)
    assert run.status.sets == run.status.looked_at == 30
    assert run.scenes[-1].status == "DEGRADED"
    assert "cam1: its stream has ended" in run.scenes[-1].reason


def test_what_cannot_be_decoded_is_recorded_and_said(tmp_path):
    units = h264_units(30, key_every=15)
    broken = [(b"\x00\x00\x01\x41" + bytes(20) if n == 5 else unit, key) for n, (unit, key) in enumerate(units)]
    cameras = cameras_of(3, cam0={"units": broken}, cam1={"units": units}, cam2={"units": units})
    run = Run(tmp_path, cameras, frames=30)
    assert [run.recorded(camera, "video") for camera in range(3)] == [30, 30, 30]
    assert run.status.cameras[0].corrupt == 1
    assert run.status.cameras[0].undecoded == 10  # up to the key frame 15
    reason = "a frame of camera cam0 cannot be decoded"
    assert f"error: cam0: frames cannot be used up to the next key frame: {reason}" in run.said
    assert f"2 of 3 cameras (cam0: {reason})" in {scene.reason for scene in run.scenes}
    assert run.statuses == ["MONITORED", "DEGRADED", "MONITORED"]


@pytest.mark.parametrize("step_s", [2.0, -2.0])
def test_a_camera_whose_clock_is_set_is_left_out_and_said(tmp_path, step_s):
    run = Run(tmp_path, cameras_of(3, cam2={"shift_s": {20: step_s}}), frames=30)
    assert run.statuses == ["MONITORED", "DEGRADED"]
    assert [run.recorded(camera) for camera in range(3)] == [30, 30, 30]
    [said] = [line for line in run.said if "NOT USED" in line]
    found = re.fullmatch(r"error: cam2: NOT USED, its clock was set by (\S+) s; measure it: rigcal sync probe", said)
    assert float(found[1]) == pytest.approx(step_s, abs=0.1)
    times_ns = [scene.t_ns for scene in run.scenes]
    assert times_ns == sorted(times_ns)


def test_a_step_that_the_source_takes_out_counts_after_the_next_interruption(tmp_path):
    """Until then its times go on as before; from then on they bear the step."""
    run = Run(tmp_path, cameras_of(3, cam2={"steps": {10: 1.5}, "lost": (20, 25)}), frames=30)
    assert run.statuses == ["MONITORED", "DEGRADED"]
    assert [scene.status for scene in run.scenes] == ["MONITORED"] * 20 + ["DEGRADED"] * 10
    assert any("warning: cam2: the clock of camera cam2 was set by +1.500 s" in line for line in run.said)
    assert "its clock was set by +1.500 s; measure it: rigcal sync probe" in run.scenes[-1].reason


def test_one_camera_of_two_is_not_monitored_and_is_recorded(tmp_path):
    run = Run(tmp_path, cameras_of(2, cam1={"frames": 0}), count=2, frames=20)
    assert run.statuses == ["NOT MONITORED"]
    assert run.scenes[-1].reason == "1 of 2 cameras (cam1: its stream has ended)"
    assert run.scenes[-1].workers == run.scenes[-1].objects == ()
    assert run.recorded(0) == 20
    assert run.result.statuses == {"NOT MONITORED": len(run.scenes)}


def test_silence_is_a_result_too(tmp_path, monkeypatch):
    """Where nothing comes an instant says so again and again."""
    monkeypatch.setattr(live_feed, "SILENCE_S", 0.2)
    stopping = time.monotonic() + 1.0
    run = Run(
        tmp_path,
        cameras_of(2, cam0={"lost": (0, 400)}, cam1={"lost": (0, 400)}),
        count=2,
        frames=400,
        paced=True,
        stop=lambda: time.monotonic() > stopping,
    )
    assert run.result.stopped
    assert run.statuses == ["NOT MONITORED"]
    assert 2 <= len(run.scenes) <= 5
    assert run.scenes[0].cameras == 0
    assert [one.lag_s for one in run.status.cameras] == [None, None]


def test_cameras_without_a_clock_are_recorded_and_not_monitored(tmp_path, monkeypatch):
    monkeypatch.setattr(live_feed, "SILENCE_S", 0.05)
    monkeypatch.setattr(live_feed, "_POLL_S", 0.02)
    run = Run(tmp_path, cameras_of(2), count=2, frames=10, clocks=False)
    assert run.statuses == ["NOT MONITORED"]
    assert run.scenes[0].reason.startswith("0 of 2 cameras (cam0: its clock was never measured; measure it: rigcal")
    assert [run.recorded(camera) for camera in range(2)] == [10, 10]
    assert run.said.count("error: cam0: NOT USED, its clock was never measured; measure it: rigcal sync probe") == 1


def test_files_need_no_clock(tmp_path):
    cameras = cameras_of(2, cam0={"live": False}, cam1={"live": False})
    run = Run(tmp_path, cameras, count=2, frames=10, clocks=False, is_live=False)
    assert run.statuses == ["MONITORED"]
    for message in iter_messages(run.recording):
        assert message.log_ns == message.publish_ns


def test_a_run_that_is_stopped_has_a_finished_recording(tmp_path):
    stopping = time.monotonic() + 0.8
    run = Run(tmp_path, cameras_of(3), frames=500, stop=lambda: time.monotonic() > stopping, paced=True)
    assert run.result.stopped
    assert [run.recorded(one.camera) for one in run.cameras] == [one.sent for one in run.cameras]
    assert run.status.sets == run.status.looked_at + run.status.skipped
    assert [one.fault for one in run.status.cameras] == [None] * 3  # that a run ends is no fault of theirs
    assert run.recording.exists()


def test_scenes_are_recorded_with_the_times_of_their_frames(tmp_path):
    run = Run(tmp_path, cameras_of(2), count=2, frames=10)
    scenes = [message.publish_ns for message in iter_messages(run.recording, ["/scene"])]
    frames = {message.publish_ns for message in iter_messages(run.recording, ["/cam0/image"])}
    assert scenes == [scene.t_ns for scene in run.scenes]
    assert set(scenes) <= frames
    tallied = Counter(scene.status for scene in run.scenes)
    assert run.result.statuses == dict(tallied)


def test_a_decoder_that_falls_behind_goes_on_at_a_key_frame_and_the_recording_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(live_camera, "CAPACITY", 3)
    units = h264_units(40, key_every=10)

    class Slow(FakeCamera):
        def decoder(self):
            decoder = super().decoder()
            decode = decoder.decode
            decoder.decode = lambda packet: time.sleep(0.02) or decode(packet)
            return decoder

    run = Run(
        tmp_path,
        lambda start_ns, frames, _conductor: [
            Slow(0, start_ns, frames, units=units),
            FakeCamera(1, start_ns, frames, units=units),
        ],
        count=2,
        frames=40,
        paced=True,
    )
    assert run.status.cameras[0].undecoded >= 10
    assert run.status.cameras[0].corrupt == 0
    assert [run.recorded(camera, "video") for camera in range(2)] == [40, 40]


class StalledDisk:
    """A recorder whose disk stands still until it is let go."""

    stopped = None

    def __init__(self):
        self.packets = []

    def write_packet(self, packet):
        self.packets.append(packet)


def test_what_finds_no_room_is_lost_up_to_the_next_key_frame_counted_and_said():
    disk, journal = StalledDisk(), Journal(lambda: 7)
    recording = PacketRecording(disk, ["cam0", "cam1"], journal, capacity_bytes=250)
    packets = [
        Packet(camera, number, number, None, bytes(30), "h264", number % 4 == 0)
        for number in range(12)
        for camera in range(2)
    ]
    for packet in packets[:14]:  # frames 0 to 6 of both
        recording.put(packet)
    assert recording.lost == [3, 3]
    assert recording.waiting_bytes == 240
    recording.close()
    recording.run()
    for packet in packets[14:]:
        recording.put(packet)
    recording.close()
    recording.run()
    assert [p.number for p in disk.packets if p.camera == 0] == [0, 1, 2, 3, 8, 9, 10, 11]
    assert recording.lost == [4, 4]
    assert recording.written == [8, 8]
    texts = [(entry.level, entry.text) for entry in journal.read()]
    assert texts == [
        ("error", "cam0: frames are NOT RECORDED, the disk is too slow: 0 MB wait to be written"),
        ("error", "cam1: frames are NOT RECORDED, the disk is too slow: 0 MB wait to be written"),
        ("error", "cam0: 4 frames were not recorded, now it goes on"),
        ("error", "cam1: 4 frames were not recorded, now it goes on"),
    ]


def test_a_disk_that_refuses_ends_the_run_with_its_error(tmp_path, monkeypatch):
    def refuse(self, packet):
        raise RecordingError("cannot write the recording", got="Input/output error", do_next="mend it")

    monkeypatch.setattr(Recorder, "write_packet", refuse)
    with pytest.raises(RecordingError, match="Input/output error"):
        Run(tmp_path, cameras_of(2), count=2, frames=100)
    assert (tmp_path / "r.mcap.part").exists()


def test_rates_are_those_of_the_last_second(tmp_path, monkeypatch):
    monkeypatch.setattr(live_feed, "_BOOKS_S", 0.2)
    run = Run(tmp_path, cameras_of(2), count=2, frames=50, paced=True)
    assert all(0.3 * FPS < one.fps < 2 * FPS for one in run.status.cameras)
    assert run.status.sets_per_s > 0
