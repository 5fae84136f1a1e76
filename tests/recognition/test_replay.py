"""A replay has the tracks of the run that recorded, to the last bit, whatever the run was."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from recognition.cli import app
from recognition.errors import RecordingError
from recognition.interpolation import in_common_time
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.options import options_of, options_text
from recognition.placing import Placer, PlacingOptions
from recognition.poses import Poses, write_poses
from recognition.recording import TRACKS, Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY, recorded_options, replay
from recognition.runtime import RunOptions, run
from recognition.sources.recording import open_recording
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import DetectorNoise, observe, with_noise
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

FRAMES, FPS = 16, 25.0
T0 = 1_800_000_000_000_000_000
METHODS = ("paper", "tracked")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A rig as read from its file, and what noisy detectors with gaps report of three workers."""
    path = tmp_path_factory.mktemp("site") / "s.rig.json"
    made = document_of_rig(semicircle_rig(), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, path)
    rig = rig_of(read_rigfile(path))
    simulated = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1)
    noise = DetectorNoise(pixel_sigma=2.0, missing_joint=0.1, missed=0.05, false_per_view=0.3)
    views = [
        tuple(view.detections for view in with_noise(observe(simulated, k), rig, noise, seed=k)) for k in range(FRAMES)
    ]
    return path, rig, views


def instants(views, *, late_ns=(0, 7_000_000, -3_000_000, 11_000_000), absent=()) -> list[Instant]:
    """Cameras that are not triggered together; ``absent``: (instant, camera) pairs without a frame."""
    made = []
    for k, seen in enumerate(views):
        t_ns = T0 + round(k * 1e9 / FPS)
        own_ns = tuple(None if (k, v) in absent else t_ns + late for v, late in enumerate(late_ns))
        took_part = tuple(ViewDetections.empty() if t is None else one for t, one in zip(own_ns, seen, strict=True))
        made.append(Instant(FrameSet(k, t_ns, (None,) * len(seen), own_ns), took_part))
    return made


def record(site, path: Path, of_run, method: str, **options):
    """A run on instants, recorded; returns what it found."""
    rig_path, rig, _ = site
    placing = PlacingOptions(method=method)
    metadata = {PLACING_KEY: options_text(placing), VIEWS_KEY: ",".join(rig.camera_ids)}
    with Recorder(path, rig=rig, rig_json=rig_path.read_bytes(), metadata=metadata, **options) as recorder:
        result = run(rig, of_run, recorder, RunOptions(placing=placing))
    assert sum(len(scene.workers) for scene in result.scenes) > FRAMES
    assert result.object_instants
    return result


def assert_same_to_the_last_bit(scenes, others):
    assert len(scenes) == len(others) > 0
    for one, other in zip(scenes, others, strict=True):
        assert (one.index, one.t_ns, one.status, one.cameras) == (other.index, other.t_ns, other.status, other.cameras)
        for these, those in ((one.workers, other.workers), (one.objects, other.objects)):
            assert len(these) == len(those)
            for this, that in zip(these, those, strict=True):
                assert same_bits(this, that)


def same_bits(this, that) -> bool:
    """Every field of two tracks, arrays by their bytes."""
    return same_fields(this, that, type(this).__slots__)


def same_fields(this, that, names) -> bool:
    pairs = [(getattr(this, name), getattr(that, name)) for name in names]
    return all(a.tobytes() == b.tobytes() if isinstance(a, np.ndarray) else repr(a) == repr(b) for a, b in pairs)


@pytest.mark.parametrize("method", METHODS)
def test_a_replay_has_the_tracks_of_the_run_to_the_last_bit(site, tmp_path, method):
    absent = {(5, 0), (9, 1), (9, 2), (9, 3), (10, 2), (11, 2)}  # at instant 9 a single camera is left
    result = record(site, tmp_path / "run.mcap", instants(site[2], absent=absent), method)
    opened = open_recording(tmp_path / "run.mcap")
    again = replay(opened, recorded_options(opened))
    assert_same_to_the_last_bit(result.scenes, again.scenes)
    assert (again.instants, again.incomplete) == (result.instants, 0)
    assert again.worker_instants == dict(result.worker_instants)
    assert again.object_instants == dict(result.object_instants)
    counted = replay(opened, recorded_options(opened), keep_scenes=False)
    assert counted.scenes == ()
    assert replace(counted, scenes=again.scenes) == again


@pytest.mark.parametrize("method", METHODS)
def test_so_does_that_of_a_run_that_interpolated(site, tmp_path, method):
    of_run = list(in_common_time(instants(site[2])))
    assert any(one is not other for i in of_run for one, other in zip(i.views, i.common, strict=True))
    result = record(site, tmp_path / "run.mcap", of_run, method)
    opened = open_recording(tmp_path / "run.mcap")
    assert_same_to_the_last_bit(result.scenes, replay(opened, recorded_options(opened)).scenes)


def test_so_does_that_of_segments_and_of_a_part_of_them(site, tmp_path):
    result = record(site, tmp_path / "run.mcap", instants(site[2]), "paper", segment_s=0.2)
    for path in (tmp_path, tmp_path / "run.mcap"):
        opened = open_recording(path)
        assert len(opened.files) == 4
        assert opened.warnings == ()
        assert_same_to_the_last_bit(result.scenes, replay(opened, recorded_options(opened)).scenes)
    opened.files[0].unlink()
    opened = open_recording(tmp_path)
    assert opened.warnings == ("the run began 1 segments before run.001.mcap: identities are given anew from here",)
    later = replay(opened, recorded_options(opened))
    assert later.scenes[0].index == 5
    opened.files[1].unlink()
    assert open_recording(tmp_path).warnings[1] == "segments 2 to 2 are missing: nothing is known of that time"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("options", [{}, {"segment_s": 0.2}])
def test_the_tracks_in_the_recording_are_the_runs_own_and_are_not_placed_again(
    site, tmp_path, monkeypatch, method, options
):
    absent = {(5, 0), (9, 1), (9, 2), (9, 3), (10, 2), (11, 2)}
    result = record(site, tmp_path / "run.mcap", instants(site[2], absent=absent), method, **options)
    opened = open_recording(tmp_path / "run.mcap")
    again = replay(opened, recorded_options(opened))
    monkeypatch.delattr(Placer, "place")
    own = replay(opened)
    assert (own.is_placed_again, again.is_placed_again) == (False, True)
    assert replace(own, scenes=(), is_placed_again=True) == replace(again, scenes=())
    assert len(own.scenes) == len(result.scenes)
    for one, other in zip(own.scenes, result.scenes, strict=True):
        assert same_fields(one, other, ("index", "t_ns", "status", "reason", "cameras"))
        for this, that in zip((*one.workers, *one.objects), (*other.workers, *other.objects), strict=True):
            assert same_fields(this, that, [name for name in type(this).__slots__ if "covariance" not in name])


def test_a_recording_of_detections_alone_is_placed_again(site, tmp_path):
    rig_path, rig, views = site
    with Recorder(tmp_path / "run.mcap", rig=rig, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
        for instant in instants(views):
            recorder.write_detections(instant.frame_set, instant.views)
    opened = open_recording(tmp_path / "run.mcap")
    assert not opened.holds_tracks
    assert replay(opened).is_placed_again


def test_so_is_what_shall_be_smoothed_and_a_part_of_a_recording(site, tmp_path):
    record(site, tmp_path / "run.mcap", instants(site[2]), "tracked")
    opened = open_recording(tmp_path / "run.mcap")
    assert opened.holds_tracks
    assert replay(opened, smooth=True).is_placed_again
    part = replay(opened.between(T0 + 300_000_000, None))
    assert part.is_placed_again
    assert 0 < part.instants < FRAMES


def test_instants_whose_tracks_are_lost_are_counted(site, tmp_path):
    class Lossy(Recorder):
        def _write(self, messages, receive_ns):
            super()._write(messages, receive_ns)
            if [m for m in messages if m.topic == TRACKS and m.message.instant in (6, 7, 12)]:
                self._numbers[TRACKS] += 1  # as if one more had been there

    rig_path, rig, views = site
    with Lossy(tmp_path / "run.mcap", rig=rig, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
        run(rig, instants(views), recorder, RunOptions())
    again = replay(open_recording(tmp_path / "run.mcap"))
    assert (again.is_placed_again, again.instants, again.incomplete) == (False, FRAMES, 3)
    said = CliRunner().invoke(app, ["replay", str(tmp_path / "run.mcap")]).output
    assert "warning: 3 instants are lost and were left out" in said


def test_an_instant_that_lost_a_camera_is_left_out_and_counted(site, tmp_path):
    lost = {7, 12}
    path = tmp_path / "run.mcap"

    class Lossy(Recorder):
        def _write(self, messages, receive_ns):
            topics = [m.topic for m in messages]
            gone = "/cam2/detections" in topics and messages[0].message.instant in lost
            super()._write([m for m in messages if not (gone and m.topic == "/cam2/detections")], receive_ns)

    rig_path, rig, views = site
    with Lossy(path, rig=rig, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
        run(rig, instants(views), recorder, RunOptions(placing=PlacingOptions(method="paper")))
    again = replay(open_recording(path), PlacingOptions(method="paper"))
    assert (again.instants, again.incomplete) == (FRAMES - 2, 2)
    assert lost.isdisjoint(scene.index for scene in again.scenes)


def test_another_method_may_be_asked_for(site, tmp_path):
    result = record(site, tmp_path / "run.mcap", instants(site[2]), "paper")
    opened = open_recording(tmp_path / "run.mcap")
    assert recorded_options(opened) == PlacingOptions(method="paper")
    other = replay(opened, PlacingOptions(method="tracked"))
    assert len(other.scenes) == len(result.scenes)
    assert other.scenes[-1].workers[0].joints_m.tobytes() != result.scenes[-1].workers[0].joints_m.tobytes()


def test_the_command_writes_the_poses_of_the_run(site, tmp_path):
    rig = site[1]
    result = record(site, tmp_path / "run.mcap", instants(site[2]), "paper", segment_s=0.5)
    write_poses(Poses.of(result.scenes, rig.world_from_rig), tmp_path / "run.npz")
    arguments = ["replay", str(tmp_path / "run.mcap"), "--poses", str(tmp_path / "again.npz"), "--json"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["instants"], told["scenes"], told["association"], told["warnings"]) == (FRAMES, FRAMES, "paper", [])
    assert told["workers"] == {str(track): count for track, count in result.worker_instants.items()}
    with np.load(tmp_path / "run.npz") as one, np.load(tmp_path / "again.npz") as other:
        assert sorted(one) == sorted(other)
        for name in one:
            assert one[name].tobytes() == other[name].tobytes(), name
    assert (told["how"], told["placed_again"]) == (
        "the tracks that the run recorded, placed by the method paper",
        False,
    )
    (tmp_path / "again.npz").unlink()
    told = json.loads(CliRunner().invoke(app, [*arguments, "--place"]).stdout)
    assert (told["how"], told["placed_again"]) == ("placed as the run did, by the method paper", True)
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "run.npz").read_bytes()
    said = CliRunner().invoke(app, ["replay", str(tmp_path), "--association", "tracked", "--smooth"]).output
    assert said.splitlines()[0] == (
        f"{FRAMES} instants, {FRAMES} of them in 3D, rig IMPORTED; placed by the method tracked, not the run's paper, "
        "smoothed"
    )


def test_a_recording_that_does_not_say_how_it_was_placed_is_placed_by_default_and_it_is_said(site, tmp_path):
    rig_path, rig, views = site
    with Recorder(tmp_path / "run.mcap", rig=rig, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
        run(rig, instants(views), recorder, RunOptions())
    opened = open_recording(tmp_path / "run.mcap")
    assert recorded_options(opened) is None
    own = CliRunner().invoke(app, ["replay", str(tmp_path / "run.mcap")]).output
    assert own.splitlines()[0].endswith("the tracks that the run recorded")
    assert "warning" not in own
    done = CliRunner().invoke(app, ["replay", str(tmp_path / "run.mcap"), "--place"])
    assert "warning: the recording does not say how it was placed: tracks may differ" in done.output


def test_what_cannot_be_replayed_is_refused_in_words(site, tmp_path):
    rig_path, rig, _ = site
    with pytest.raises(RecordingError, match="cannot open the recording"):
        open_recording(tmp_path / "absent.mcap")
    for name in ("a", "b"):
        record(site, tmp_path / f"{name}.mcap", instants(site[2]), "paper", segment_s=0.3)
    (tmp_path / "a.001.mcap").unlink()
    (tmp_path / "b.001.mcap").rename(tmp_path / "a.001.mcap")
    with pytest.raises(RecordingError) as caught:
        open_recording(tmp_path / "a.mcap")
    assert str(caught.value) == (
        "the segments are not of one run\n"
        f"  where:    {tmp_path}\n"
        "  expected: segments that one run recorded\n"
        "  got:      2 files of 2 runs\n"
        "  do next:  move the others away, or replay one file at a time"
    )
    with Recorder(tmp_path / "run.mcap", rig=rig, rig_json=rig_path.read_bytes(), metadata={}) as recorder:
        recorder.log("info", "nothing seen", T0)
    nothing = open_recording(tmp_path / "run.mcap")
    with pytest.raises(RecordingError, match="the recording holds no detections to replay"):
        replay(nothing, PlacingOptions())
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-20])
    with pytest.raises(RecordingError, match="the recording is unfinished or damaged"):
        open_recording(tmp_path / "cut.mcap")


# --- options as text ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Inner:
    limit_m: float = 0.1 + 0.2
    names: tuple[str, ...] = ("a",)

    def __post_init__(self):
        if self.limit_m < 0:
            raise OptionError("limit_m", expected="a number not below 0", got=self.limit_m)


@dataclass(frozen=True)
class Outer:
    method: str = "paper"
    inner: Inner = field(default_factory=Inner)
    count: int | None = None


def test_options_come_back_from_their_text_as_they_were():
    chosen = Outer("tracked", Inner(1 / 3, ("x", "ö")), 7)
    assert options_of(Outer, options_text(chosen)) == chosen
    assert options_of(Outer, '{"inner": {"limit_m": 2.0}}') == replace(Outer(), inner=Inner(2.0))
    assert options_of(PlacingOptions, options_text(PlacingOptions())) == PlacingOptions()
    assert json.loads(options_text(chosen)) == json.loads(json.dumps(asdict(chosen)))


def test_options_of_another_version_are_refused_in_words():
    with pytest.raises(RecordingError) as caught:
        options_of(Outer, '{"inner": {"limit_m": 1, "new": 2}}')
    assert str(caught.value) == (
        "the recording was made with options that this version does not have\n"
        "  expected: options of Inner: limit_m, names\n"
        "  got:      new\n"
        "  do next:  replay it with the version that recorded it; `recognition check` says which"
    )
    for text in ("no JSON", "[1]", '{"inner": 3}'):
        with pytest.raises(RecordingError, match="options that this version does not have"):
            options_of(Outer, text)
    with pytest.raises(OptionError, match="limit_m is out of range"):
        options_of(Outer, '{"inner": {"limit_m": -1}}')
