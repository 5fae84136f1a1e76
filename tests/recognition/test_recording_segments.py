"""Segments stand alone, begin on a key frame for each camera, and together hold every frame exactly once."""

from __future__ import annotations

import json
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from test_recording_detections import frame_set, seen
from test_recording_write import IMAGE, T0, h264, recorder, rig_and_json, stock_messages

from recognition.cli import app
from recognition.errors import RecordingError
from recognition.h264 import is_key_frame
from recognition.observations import FrameSet, Scene, ViewFrame
from recognition.recording import (
    DiskBudget,
    check_recording,
    check_run,
    check_sequence,
    iter_messages,
    read_metadata,
    read_rig_attachment,
    read_segment,
    recording_files,
    recover_recording,
    rotation,
)
from rigcal.errors import OptionError

PERIOD_NS = 40_000_000
SEGMENT_S = 0.5
VIDEO = [h264(60, key_every=6), h264(60, key_every=9)]


@dataclass(frozen=True)
class Sent:
    """A packet as a source hands it on."""

    camera: int
    number: int
    t_ns: int
    receive_ns: int | None
    encoded: bytes
    encoding: str
    is_key: bool


def packet(camera: int, k: int, *, t_ns: int | None = None, late_ns: int | None = None, encoding: str = "h264") -> Sent:
    t_ns = T0 + k * PERIOD_NS + camera if t_ns is None else t_ns
    data = VIDEO[camera][k]
    return Sent(camera, k, t_ns, None if late_ns is None else t_ns + late_ns, data, encoding, is_key_frame(data))


def videos(files) -> list[dict[str, list[bytes]]]:
    """By file: the frames of each camera's video."""
    return [
        {topic: [m.data for _, m in of_topic] for topic, of_topic in stock_messages(file).items() if "video" in topic}
        for file in files
    ]


def segmented(path: Path, count: int = 60, **options):
    with recorder(path, **{"segment_s": SEGMENT_S, **options}) as writing:
        for k in range(count):
            for camera in range(2):
                writing.write_packet(packet(camera, k))
            writing.write_detections(frame_set(k, (T0 + k * PERIOD_NS,) * 2), [seen(k), seen(k + 1)])
            writing.write_scene(Scene(k, T0 + k * PERIOD_NS, (), ()))
    return writing.close()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return segmented(tmp_path_factory.mktemp("segments") / "run.mcap")


def test_every_frame_is_in_one_segment_and_each_begins_on_a_key_frame(recorded):
    found = videos(recorded.files)
    assert len(found) >= 4
    for camera in range(2):
        topic = f"/cam{camera}/video"
        assert [data for file in found for data in file[topic]] == VIDEO[camera]
        assert all(is_key_frame(file[topic][0]) for file in found)
    assert recorded.undecodable == {}


def test_segments_are_named_in_order_and_stand_alone(recorded):
    _, rig_json = rig_and_json()
    assert [file.name for file in recorded.files] == [f"run.{k:03d}.mcap" for k in range(len(recorded.files))]
    runs = set()
    for k, file in enumerate(recorded.files):
        assert check_recording(file).findings == ()
        assert read_rig_attachment(file) == rig_json
        assert read_metadata(file)["command"] == "run"
        topics = [m.topic for m in iter_messages(file)]
        assert {"/cam0/calibration", "/cam1/calibration", "/tf"} <= set(topics[:4])
        run, index = read_segment(file)
        assert index == k
        runs.add(run)
    assert len(runs) == 1
    assert list(recorded.path.parent.glob("*.part")) == []
    assert sum(file.stat().st_size for file in recorded.files) == recorded.bytes
    counts = [check_recording(file).messages for file in recorded.files]
    assert {t: sum(c.get(t, 0) for c in counts) for t in recorded.messages} == dict(recorded.messages)


def test_a_segment_is_as_long_as_was_asked_and_its_videos_until_their_next_key_frame(recorded):
    for file in recorded.files[:-1]:
        scenes = [m.log_ns for m in iter_messages(file, ["/scene"])]
        assert SEGMENT_S - 0.08 <= (scenes[-1] - scenes[0]) * 1e-9 <= SEGMENT_S + 9 * 0.04


def test_a_recording_is_found_by_its_segments_name_and_by_its_folder(recorded, tmp_path):
    assert recording_files(recorded.path) == recorded.files
    assert recording_files(recorded.path.parent) == recorded.files
    assert recording_files(recorded.files[2]) == (recorded.files[2],)
    assert recording_files(tmp_path / "absent.mcap") == (tmp_path / "absent.mcap",)
    with pytest.raises(RecordingError) as caught:
        recording_files(tmp_path)
    assert str(caught.value) == (
        "the folder holds no recording\n"
        f"  where:    {tmp_path}\n"
        "  expected: one recording, NAME.mcap or its segments NAME.000.mcap, NAME.001.mcap, ...\n"
        "  got:      no file that ends in .mcap\n"
        "  do next:  check the path"
    )
    for name in ("a.mcap", "b.000.mcap", "b.001.mcap"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(RecordingError, match="the folder holds several recordings") as caught:
        recording_files(tmp_path)
    assert caught.value.got == "a.mcap, b.mcap"


def test_a_check_of_a_run_says_how_its_segments_follow(recorded, tmp_path):
    assert check_sequence(recorded.files).ok
    assert check_sequence(recorded.files).findings == ()
    texts = [f.text for f in check_sequence(recorded.files[1:]).findings]
    assert texts == ["the first 1 segments of the run are not there"]
    holed = check_sequence((recorded.files[0], *recorded.files[2:]))
    assert not holed.ok
    assert [f.text for f in holed.findings] == ["segments 1 to 1 are missing"]
    other = segmented(tmp_path / "other.mcap", 30)
    mixed = check_sequence((*recorded.files[:1], other.files[1]))
    assert [f.text for f in mixed.findings] == ["the segments are not of one run"]


def test_what_a_recovered_segment_lost_at_its_end_is_counted(tmp_path):
    with recorder(tmp_path / "run.mcap", segment_s=SEGMENT_S, fsync_interval_s=0.02) as writing:
        for k in range(24):
            writing.write_packet(packet(0, k))
            time.sleep(0.01)  # so that the file has many chunks
    first, second = writing.close().files
    whole = len(videos([first])[0]["/cam0/video"])
    cut = tmp_path / "cut.mcap.part"
    cut.write_bytes(first.read_bytes()[: first.stat().st_size // 2])
    kept = recover_recording(cut, first).messages["/cam0/video"]
    assert 0 < kept < whole
    found = check_sequence((first, second))
    assert found.ok
    assert f"/cam0/video {whole - kept}" in found.findings[0].text
    assert found.findings[0].text.startswith("messages are missing between segments 0 and 1: ")


def test_what_is_not_finished_of_a_run_is_said(recorded, tmp_path):
    for file in recorded.files[:2]:
        (tmp_path / file.name).write_bytes(file.read_bytes())
    part = tmp_path / "run.002.mcap.part"
    part.write_bytes(recorded.files[2].read_bytes()[:-100])
    advice = f"run `recognition recover {part} -o {part.with_suffix('')}`"
    note = f"run.002.mcap.part is not finished and was left out: {advice}"
    for name in (tmp_path, tmp_path / "run.mcap"):
        assert [(f.severity, f.text) for f in check_run(name).findings] == [("error", note)]
    assert check_run(tmp_path / "run.001.mcap").ok
    done = CliRunner().invoke(app, ["check", str(tmp_path), "--json"])
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert [finding["text"] for finding in told["findings"]] == [note]
    assert told["messages"]["/scene"] == sum(check_recording(f).messages["/scene"] for f in recorded.files[:2])
    said = CliRunner().invoke(app, ["check", str(recorded.path)])
    assert said.exit_code == 0
    assert said.output.endswith(f"OK  {recorded.path}, {len(recorded.files)} segments\n")
    for file in recorded.files[:2]:
        (tmp_path / file.name).unlink()
    with pytest.raises(RecordingError, match="the recording is not finished"):
        recording_files(tmp_path / "run.mcap")


def test_a_camera_that_is_lost_is_not_waited_for_and_comes_back_with_a_key_frame(tmp_path, monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(rotation, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    with recorder(tmp_path / "run.mcap", segment_s=SEGMENT_S) as writing:
        for k in range(60):
            writing.write_packet(packet(0, k))
            if k < 8 or k >= 40:
                writing.write_packet(packet(1, k))
            now_s[0] += PERIOD_NS * 1e-9
            if k == 20:
                now_s[0] += rotation.LOST_S
    done = writing.close()
    found = videos(done.files)
    assert [data for file in found for data in file["/cam0/video"]] == VIDEO[0]
    kept = [data for file in found for data in file.get("/cam1/video", [])]
    assert kept == VIDEO[1][:8] + VIDEO[1][45:]  # 45: its first key frame after it is back
    assert done.undecodable == {"/cam1/video": 5}
    assert check_sequence(done.files).ok


def test_streams_that_are_read_at_different_speeds_lose_nothing(tmp_path):
    """Of files, one camera's thread may be far ahead in log time: it waits for no other, and nobody is given up."""
    with recorder(tmp_path / "run.mcap", segment_s=SEGMENT_S) as writing:
        sent = [packet(0, k) for k in range(60)]
        for k in range(60):
            for one in sent[3 * k : 3 * k + 3]:
                writing.write_packet(one)
            writing.write_packet(packet(1, k))
    done = writing.close()
    found = videos(done.files)
    for camera in range(2):
        assert [data for file in found for data in file.get(f"/cam{camera}/video", [])] == VIDEO[camera]
    assert check_sequence(done.files).ok


def test_frames_scenes_and_lines_come_from_threads_of_their_own(tmp_path):
    path = tmp_path / "run.mcap"
    failures = []

    def guarded(work):
        try:
            for k in range(60):
                work(k)
        except RecordingError as error:
            failures.append(error)

    with recorder(path, segment_s=SEGMENT_S) as writing:
        work = [
            lambda k: writing.write_packet(packet(0, k, late_ns=3_000_000)),
            lambda k: writing.write_packet(packet(1, k, late_ns=4_000_000)),
            lambda k: writing.write_scene(Scene(k, T0 + k * PERIOD_NS, (), ()), receive_ns=T0 + (k + 2) * PERIOD_NS),
            lambda k: writing.log("info", str(k), T0 + k * PERIOD_NS, receive_ns=T0 + k * PERIOD_NS),
        ]
        threads = [threading.Thread(target=guarded, args=(one,)) for one in work]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    done = writing.close()
    assert failures == []
    found = videos(done.files)
    for camera in range(2):
        assert [data for file in found for data in file.get(f"/cam{camera}/video", [])] == VIDEO[camera]
    assert done.messages["/scene"] == done.messages["/log"] == 60
    assert check_sequence(done.files).ok


def test_results_that_come_late_are_logged_when_they_are_known(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        for k in range(4):
            writing.write_packet(packet(0, k, late_ns=5_000_000))
        late_ns = T0 + 4 * PERIOD_NS
        writing.write_detections(frame_set(0, (T0, None)), [seen(1), None], receive_ns=late_ns)
        writing.write_scene(Scene(0, T0, (), ()), receive_ns=late_ns)
    found = {topic: [(r.log_time, r.publish_time) for r, _ in of] for topic, of in stock_messages(path).items()}
    assert found["/scene"] == found["/cam0/detections"] == found["/cam0/annotations"] == [(late_ns, T0)]
    assert found["/cam0/video"][0] == (T0 + 5_000_000, T0)
    assert check_recording(path).ok


def test_a_clock_that_is_set_back_leaves_a_sound_recording_that_says_so(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        for k in range(12):
            back_ns = 2_000_000_000 if k >= 6 else 0
            writing.write_packet(packet(0, k, t_ns=T0 + 3_000_000_000 + k * PERIOD_NS - back_ns))
    check = check_recording(path)
    assert check.ok
    texts = [f.text for f in check.findings]
    assert "/cam0/video: capture times run backwards 1 times, by 1.960 s: a clock was set" in texts
    records = [record for record, _ in stock_messages(path)["/cam0/video"]]
    assert [r.publish_time for r in records][6] == T0 + 3_000_000_000 + 6 * PERIOD_NS - 2_000_000_000
    assert [r.log_time for r in records][5:] == [T0 + 3_000_000_000 + 5 * PERIOD_NS] * 7


def test_packets_are_recorded_as_they_are_whatever_their_form(tmp_path):
    path = tmp_path / "run.mcap"
    with recorder(path) as writing:
        writing.write_packet(packet(0, 0))
        writing.write_packet(Sent(1, 0, T0, None, b"\xff\xd8jpeg", "jpeg", True))
        with pytest.raises(ValueError, match="must be h264, jpeg or png, got 'hevc'"):
            writing.write_packet(Sent(1, 1, T0 + 1, None, b"", "hevc", True))
    found = stock_messages(path)
    assert found["/cam0/video"][0][1].data == VIDEO[0][0]
    assert found["/cam1/image"][0][1].data == b"\xff\xd8jpeg"


def test_segments_of_an_earlier_run_are_named_and_kept(recorded, tmp_path):
    earlier = tmp_path / "run.000.mcap"
    earlier.write_bytes(b"precious")
    with pytest.raises(RecordingError) as caught:
        recorder(tmp_path / "run.mcap", segment_s=1)
    assert str(caught.value) == (
        "segments of an earlier run are in the way\n"
        f"  where:    {earlier}\n"
        "  expected: no segments of run.mcap\n"
        "  got:      1 of them, to run.000.mcap\n"
        "  do next:  give another name with -o, or move them away: nothing is overwritten"
    )
    assert earlier.read_bytes() == b"precious"
    earlier.rename(part := tmp_path / "run.004.mcap.part")
    with pytest.raises(RecordingError, match="an unfinished recording is in the way") as caught:
        recorder(tmp_path / "run.mcap", segment_s=1)
    assert caught.value.do_next.startswith(f"run `recognition recover {part} -o {tmp_path / 'run.004.mcap'}`")
    part.write_bytes(b"")
    with pytest.raises(RecordingError, match="delete it: there is nothing in it"):
        recorder(tmp_path / "run.mcap", segment_s=1)


def test_unfinished_recordings_beside_it_are_offered_for_recovery(recorded, tmp_path):
    part = tmp_path / "earlier.mcap.part"
    part.write_bytes(recorded.files[0].read_bytes()[:-100])
    (tmp_path / "poses.npz.part").write_bytes(b"no recording")
    with recorder(tmp_path / "other.mcap"), recorder(tmp_path / "run.mcap") as writing:
        assert [text for text in writing.notices if "other" in text] == []  # that one still goes on
        assert writing.notices == (
            f"earlier.mcap.part is a recording of a run that did not end, {part.stat().st_size / 1e6:.1f} MB: "
            f"run `recognition recover {part} -o {tmp_path / 'earlier.mcap'}` and then delete it",
        )
        with pytest.raises(RecordingError, match="another run is recording here"):
            recorder(tmp_path / "run.mcap")
        assert "a run is still recording it" in check_recording(tmp_path / "run.mcap.part").findings[0].text


def test_options_that_contradict_are_refused(tmp_path):
    with pytest.raises(OptionError, match="segment_s is out of range"):
        recorder(tmp_path / "run.mcap", segment_s=0)
    with pytest.raises(OptionError, match="segment_s is out of range"):
        recorder(tmp_path / "run.mcap", budget=DiskBudget(keep="newest"))
    with pytest.raises(RecordingError, match="segments need a name that they can be told by"):
        recorder(tmp_path / "run", segment_s=1)
    assert list(tmp_path.iterdir()) == []


def test_an_image_source_needs_no_key_frames(tmp_path):
    with recorder(tmp_path / "run.mcap", segment_s=SEGMENT_S) as writing:
        for k in range(40):
            views = tuple(ViewFrame(k, T0 + k * PERIOD_NS, IMAGE, b"\xff\xd8", "jpeg") for _ in range(2))
            writing.write_frames(FrameSet(k, T0 + k * PERIOD_NS, views))
    done = writing.close()
    assert len(done.files) == 4
    assert done.messages["/cam0/image"] == 40
    assert check_sequence(done.files).ok
