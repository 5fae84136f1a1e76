"""A run is judged as it goes, its recording says so, and a replay finds the same events to the last bit."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import HEAD, HttpServer, webhook
from judged_runs import FPS, FRAMES, NO_HAT, NOTICE, QUICKER, T0, instants, judged_run, recorder_of, site_in
from typer.testing import CliRunner

from recognition.cli import app, main
from recognition.commissioning import CommissionRecord, write_record
from recognition.commissioning.record import RecordedRule
from recognition.errors import AlarmsError, CommissionError, RecordingError, RigRefusedError, RulesError
from recognition.events import event_document, event_of, read_events
from recognition.judging import UNKNOWN_NETWORKS, read_rulebook, recorded_rulebook, watch_of
from recognition.monitoring import judged
from recognition.observations import FrameSet, Instant, ViewDetections
from recognition.placing import PlacingOptions
from recognition.recording import (
    Recorder,
    check_recording,
    iter_messages,
    origin,
    read_metadata,
    read_rules_attachment,
    recorded_events,
)
from recognition.recording.messages import VIOLATION_RGB
from recognition.replay import replay
from recognition.rules import parse_rules
from recognition.runtime import RunOptions, run, run_live
from recognition.sources.detections_file import write_detections
from recognition.sources.recording import open_recording
from rigcal.errors import OptionsError
from rigcal.rigfile import read_rigfile

GAP = {(k, v) for k in (9, 10) for v in (0, 1, 2)} | {(15, 0)}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return site_in(tmp_path_factory.mktemp("judging"))


@pytest.fixture(scope="module")
def ran(site):
    """A run in which two instants have a single camera, and one has three."""
    told, scenes = [], []
    path, result = judged_run(
        site, "r.mcap", absent=GAP, on_event=lambda *word: told.append(word), on_scene=scenes.append
    )
    return path, result, told, scenes


def replayed(site, path, rules=None, *, places=True):
    """By placing again, or by the tracks in the recording."""
    opened = open_recording(path)
    book = rules or recorded_rulebook(opened).rules
    watch = watch_of(book, opened.rig, opened.metadata, opened.metadata["geometry_digest"])
    result = replay(opened, PlacingOptions() if places else None, watch=watch)
    assert result.is_placed_again is places
    return result


def documents(events):
    """Events that can be compared: NaN is not equal to itself."""
    return [event_document(event) for event in events]


def messages(path, *topics):
    return [one.message for one in iter_messages(path, topics)]


def keys(message):
    return {pair.key: pair.value for pair in message.metadata}


def test_the_worker_without_a_hat_is_found_and_no_other(ran):
    _, result, _, _ = ran
    (event,) = result.events
    (actor,) = event.actors
    assert (event.rule, event.severity, event.end_ns) == ("no_hat", "alarm", None)
    assert actor.track_id in result.worker_instants
    assert event.raised_ns - event.start_ns == 300_000_000
    assert event.caveats == (NOTICE,)
    assert event.status == "NOT MONITORED"  # for two instants of it


def test_every_instant_is_judged_also_those_that_are_no_scenes(ran):
    _, result, _, scenes = ran
    assert len(scenes) == FRAMES
    assert [scene.index for scene in scenes if scene.status == "NOT MONITORED"] == [9, 10]
    assert result.placed == FRAMES - 2
    (event,) = result.events
    times = [margin.t_ns for margin in event.margins]
    assert {scenes[9].t_ns, scenes[10].t_ns} <= set(times)


@pytest.mark.parametrize("places", [True, False])
def test_a_replay_finds_the_runs_own_events_to_the_last_bit(site, ran, places):
    path, result, _, _ = ran
    again = replayed(site, path, places=places)
    assert documents(again.events) == documents(result.events) != []
    assert dict(again.statuses) == dict(result.statuses)
    assert (again.start_ns, again.end_ns) == (T0, T0 + round((FRAMES - 1) * 1e9 / FPS))


@pytest.mark.parametrize("places", [True, False])
def test_other_rules_find_other_events_in_the_same_recording(site, ran, places):
    path, result, _, _ = ran
    (event,) = replayed(site, path, parse_rules(QUICKER, "q"), places=places).events
    assert event.raised_ns - event.start_ns == 100_000_000
    assert event.event_id != result.events[0].event_id


def test_the_recording_holds_the_rule_file_and_check_tells_another(site, ran, monkeypatch):
    path, result, _, _ = ran
    assert read_rules_attachment(path) == NO_HAT.encode()
    assert recorded_rulebook(open_recording(path)).rules.name == "hats"
    checked = check_recording(path)
    assert checked.ok, checked.findings
    assert f"rules {result.events[0].rules_digest}" in checked.facts
    with monkeypatch.context() as patch:
        patch.setattr(origin, "rules_digest", lambda _toml: "sha256:another")
        judged_run(site, "other.mcap")
    words = [finding.text for finding in check_recording(site.folder / "other.mcap").findings]
    assert words == [f"the rule file's digest is {result.events[0].rules_digest}, the metadata says sha256:another"]


def test_what_happens_to_an_event_is_in_the_recording_with_its_margins_at_the_end(ran):
    path, result, told, _ = ran
    words = [keys(message) for message in messages(path, "/events")]
    phases = [word["phase"] for word in words]
    assert phases == [phase for _, phase in told]
    assert (phases[0], phases[-1]) == ("raised", "lasting")
    assert set(phases[1:-1]) <= {"changed"}
    assert all(json.loads(word["document"])["margins"] == [] for word in words[:-1])
    assert documents([event_of(json.loads(words[-1]["document"]))]) == documents(result.events)
    assert words[0]["actors"] == f"w = worker {result.events[0].actors[0].track_id}"
    assert documents(recorded_events((path,))) == documents(result.events)
    lines = [line.message for line in messages(path, "/log")]
    assert [line.partition(" (")[0] for line in lines] == ["no_hat: a worker wears no <hard hat>", "no_hat"]
    assert lines[1].endswith(f"lasts at the end of the run; {result.events[0].event_id}")


def test_who_violates_a_rule_is_red_in_3d_and_over_the_images(ran):
    path, result, _, _ = ran
    (event,) = result.events
    (actor,) = event.actors
    red = {}
    for one in iter_messages(path, ["/scene"]):
        for entity in one.message.entities:
            colours = {(s.color.r, s.color.g, s.color.b) for s in entity.spheres}
            if VIOLATION_RGB in colours:
                red.setdefault(one.publish_ns, set()).add(entity.id)
                assert entity.texts[0].text == f"worker {actor.track_id}: no_hat"
        status = next(entity for entity in one.message.entities if entity.id == "status")
        assert ("VIOLATED: no_hat" in status.texts[0].text) == (one.publish_ns in red)
    assert min(red) == event.raised_ns
    assert set.union(*red.values()) == {f"worker/{actor.track_id}"}
    named = {text.text for message in messages(path, "/cam0/annotations") for text in message.texts}
    assert f"worker {actor.track_id}: no_hat" in named


class Feed:
    """A live feed that is not there: run_live asks it for instants, and what it is to say of them."""

    def __init__(self, site, of_run):
        self._site, self._of_run = site, of_run

    def instants(self, stop):
        for instant in self._of_run:
            if stop():
                return
            yield instant

    def judged(self, frame_set):
        return judged(self._site.rig.camera_ids, (True,) * 4, frame_set)

    def placed(self, frame_set):
        """Nothing is measured."""

    def log_ns(self):
        return None


def test_an_instant_without_any_camera_of_a_live_run_is_judged_again_by_its_replay(site):
    nothing = (ViewDetections.empty(),) * 4
    of_run = instants(site)
    blind = [Instant(FrameSet(k, of_run[k].frame_set.t_ns, (None,) * 4, (None,) * 4), nothing) for k in (11, 12)]
    of_run[11:13] = blind
    book = read_rulebook(site.folder / "hats.rules.toml")
    recorder, metadata = recorder_of(site, site.folder / "live.mcap", book)
    watch = watch_of(book.rules, site.rig, metadata, read_rigfile(site.rig_path).geometry_digest)
    with recorder:
        result = run_live(site.rig, Feed(site, of_run), recorder, RunOptions(), watch=watch)
    assert result.statuses == {"MONITORED": FRAMES - 2, "NOT MONITORED": 2}
    for places in (True, False):
        again = replayed(site, site.folder / "live.mcap", places=places)
        assert dict(again.statuses) == dict(result.statuses)
        assert documents(again.events) == documents(result.events) != []
    assert check_recording(site.folder / "live.mcap").ok


def test_an_instant_that_is_not_later_than_the_last_is_no_scene_and_counts_the_same_in_every_replay(site):
    of_run = instants(site)
    of_run.insert(6, replace(of_run[5], frame_set=replace(of_run[5].frame_set, index=FRAMES)))
    book = read_rulebook(site.folder / "hats.rules.toml")
    recorder, metadata = recorder_of(site, site.folder / "twice.mcap", book)
    watch = watch_of(book.rules, site.rig, metadata, read_rigfile(site.rig_path).geometry_digest)
    with recorder:
        result = run(site.rig, of_run, recorder, RunOptions(), watch=watch)
    assert (result.instants, result.placed, result.statuses) == (FRAMES + 1, FRAMES, {"MONITORED": FRAMES + 1})
    for places in (True, False):
        again = replayed(site, site.folder / "twice.mcap", places=places)
        assert (again.instants, again.placed, dict(again.statuses)) == (FRAMES + 1, FRAMES, dict(result.statuses))
        assert documents(again.events) == documents(result.events) != []


# --- the commands ---------------------------------------------------------------------------------------------------


def invoke(*arguments):
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def error_of(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments]).exception


@pytest.fixture(scope="module")
def detections(site):
    path = site.folder / "d.npz"
    write_detections(path, [list(views) for views in site.views], time_s=[T0 * 1e-9 + k / FPS for k in range(FRAMES)])
    return path


@pytest.fixture(scope="module")
def by_command(site, detections):
    """``recognition run --rules --events`` on detections."""
    recording, events = site.folder / "c.mcap", site.folder / "c.events.json"
    rules = site.folder / "hats.rules.toml"
    code, told = invoke(
        "run", site.rig_path, "--detections", detections, "-o", recording, "--rules", rules, "--events", events
    )
    assert code == 0
    return recording, events, told


def test_run_and_replay_write_the_same_bytes(site, by_command):
    recording, events, told = by_command
    assert "1 violation of hats (sha256:" in told
    assert "no_hat: a worker wears no <hard hat> (worker" in told
    own = ("--rules", site.folder / "hats.rules.toml")
    by_tracks, by_placing = "; the tracks that the run recorded, placed by", "; placed as the run did, by"
    for more, how in (((), by_tracks), (own, by_tracks), (("--place",), by_placing), (("--place", *own), by_placing)):
        code, output = invoke("replay", recording, "--events", site.folder / "again.json", *more)
        assert code == 0
        assert f"{how} the method tracked" in output.splitlines()[0]
        assert (site.folder / "again.json").read_bytes() == events.read_bytes()
    log = read_events(events)
    assert (log.rules_name, log.recording, log.association) == ("hats", "c.mcap", "tracked")
    assert log.monitoring == {"MONITORED": FRAMES}
    assert log.caveats == (UNKNOWN_NETWORKS,)


def test_a_changed_rule_file_judges_a_recording_anew(site, by_command):
    changed = site.folder / "quicker.rules.toml"
    changed.write_text(QUICKER)
    code, output = invoke("replay", by_command[0], "--rules", changed, "--json")
    told = json.loads(output)
    assert code == 0
    assert told["rules"]["name"] == "quicker"
    assert [event["raised_ns"] - event["start_ns"] for event in told["events"]] == [100_000_000]
    assert told["monitoring"] == {"MONITORED": FRAMES}
    assert told["events_file"] is None
    written = []
    for more in ((), ("--place",)):
        assert invoke("replay", by_command[0], "--rules", changed, "--events", site.folder / "q.json", *more)[0] == 0
        written.append((site.folder / "q.json").read_bytes())
    assert written[0] == written[1] != by_command[1].read_bytes()


def test_the_json_of_a_run_holds_its_events(site, detections):
    rules = site.folder / "hats.rules.toml"
    code, output = invoke(
        "run", site.rig_path, "--detections", detections, "-o", site.folder / "j.mcap", "--rules", rules, "--json"
    )
    told = json.loads(output)
    assert code == 0
    assert [event["rule"] for event in told["events"]] == ["no_hat"]
    assert told["rules"]["digest"] == told["events"][0]["rules_digest"]
    assert told["messages"]["/events"] >= 2


def test_a_run_says_whether_its_site_is_commissioned(site):
    rules, rig_digest = site.folder / "hats.rules.toml", read_rigfile(site.rig_path).geometry_digest
    write_detections(site.folder / "two.npz", [list(views) for views in site.views[:2]], time_s=[1.0, 1.1])
    run = ("run", site.rig_path, "--detections", site.folder / "two.npz", "-o", site.folder / "w.mcap", "--rules")
    none = "not commissioned: there is no s.commission.json beside the rig file"
    assert none in invoke(*run, rules)[1].splitlines()
    assert json.loads(invoke(*run, rules, "--json")[1])["commissioning"] == none
    made = CommissionRecord(
        site="s", author="N. N.", at_utc="2026-11-22T10:00:00+00:00", people="real", rules_name="hats",
        rules_digest=read_rulebook(rules).rules.digest, rig_digest=rig_digest, rig_verdict="PASS", networks=(),
        cameras=site.rig.camera_ids, recording="walk.mcap", walk=(),
        results=(RecordedRule(rule="no_hat", verdict="pass", worst_delay_s=None, steps=()),),
    )  # fmt: skip
    beside, elsewhere = site.folder / "s.commission.json", site.folder / "other.commission.json"
    write_record(made, beside)
    try:
        says = "commissioned 2026-11-22 by N. N.: no_hat pass"
        assert says in invoke(*run, rules)[1].splitlines()
        assert read_metadata(site.folder / "w.mcap")["commissioning"] == says
        changed = site.folder / "changed.rules.toml"
        changed.write_text(QUICKER)
        words = "not commissioned: rules changed since 2026-11-22, see s.commission.json"
        assert words in invoke(*run, changed)[1].splitlines()
        beside.rename(elsewhere)
        assert says in invoke(*run, rules, "--commission", elsewhere)[1].splitlines()
        error = error_of(*run, changed, "--commission", elsewhere)
        assert isinstance(error, CommissionError)
        assert "this record was made with other rules" in str(error)
    finally:
        beside.unlink(missing_ok=True)
        elsewhere.unlink(missing_ok=True)


@pytest.mark.parametrize(
    "option", [("--events", "e.json"), ("--commission", "c.json"), ("--alarms", "a.toml"), ("--evidence",)]
)
def test_what_needs_rules_is_refused_without_them(site, detections, option):
    error = error_of("run", site.rig_path, "--detections", detections, "-o", site.folder / "no.mcap", *option)
    assert isinstance(error, OptionsError)
    assert option[0] in str(error)
    assert f"add --rules FILE, or leave {option[0]} out" in str(error)
    assert not list(site.folder.glob("no.*"))


def test_a_replay_without_rules_anywhere_refuses_events(site, detections):
    recording = site.folder / "plain.mcap"
    assert invoke("run", site.rig_path, "--detections", detections, "-o", recording)[0] == 0
    assert recorded_rulebook(open_recording(recording)) is None
    error = error_of("replay", recording, "--events", site.folder / "x.json")
    assert isinstance(error, OptionsError)
    assert "the run was judged by none" in str(error)
    assert invoke("replay", recording)[0] == 0


def test_a_bad_rule_or_alarms_file_ends_a_run_before_it_records(site, detections):
    bad = site.folder / "bad.rules.toml"
    bad.write_text(NO_HAT.replace("0.10 H", "0.10"))
    run = ("run", site.rig_path, "--detections", detections, "-o", site.folder / "never.mcap", "--rules")
    assert isinstance(error_of(*run, bad), RulesError)
    (site.folder / "bad.alarms.toml").write_text(HEAD + "nonsense = 1\n")
    good = site.folder / "hats.rules.toml"
    assert isinstance(error_of(*run, good, "--alarms", site.folder / "bad.alarms.toml"), AlarmsError)
    assert not list(site.folder.glob("never*"))


def test_rules_that_need_the_floor_refuse_a_rig_without_one(site):
    text = NO_HAT.replace("visible(w.head) and not worn(w)", "clearance(w.feet) > 1 m").partition("[definitions]")
    rules = parse_rules(text[0] + "[[rules]]" + text[2].partition("[[rules]]")[2], "floor")
    with pytest.raises(RigRefusedError, match="rigcal world"):
        watch_of(rules, replace(site.rig, world_from_rig=None), {}, "")


def test_alarms_of_a_run_are_delivered_with_heartbeats(site, detections):
    server = HttpServer()
    try:
        (site.folder / "a.alarms.toml").write_text(HEAD + webhook(server))
        code, _ = invoke(
            "run", site.rig_path, "--detections", detections, "-o", site.folder / "a.mcap",
            "--rules", site.folder / "hats.rules.toml", "--alarms", site.folder / "a.alarms.toml",
        )  # fmt: skip
    finally:
        server.close()
    assert code == 0
    bodies = server.taken
    alarms = [body for body in bodies if body["format"] == "recognition.alarm"]
    assert [(body["rule"], body["phase"]) for body in alarms] == [("no_hat", "raised")]
    assert {body["status"] for body in bodies if body["format"] == "recognition.heartbeat"} >= {"MONITORED"}
    assert (site.folder / "a.alarms.jsonl").exists()


def test_an_operator_answers_to_an_event_of_a_recording_that_had_no_alarms(site, by_command, monkeypatch, capsys):
    recording, events, _ = by_command
    (event,) = read_events(events).events
    monkeypatch.setattr(sys, "argv", ["recognition", "ack", str(recording), event.event_id, "--by", "kim"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert f"{event.event_id} (no_hat): acknowledged" in capsys.readouterr().out


def test_a_rule_file_with_another_recording_is_refused_by_its_digest(site):
    book = read_rulebook(site.folder / "hats.rules.toml")
    with pytest.raises(ValueError, match="metadata must not set rules"):
        Recorder(
            site.folder / "z.mcap", rig=site.rig, rig_json=site.rig_path.read_bytes(),
            metadata={"rules.digest": "sha256:0"}, rules_toml=book.toml,
        )  # fmt: skip
    with pytest.raises(RecordingError):
        recorded_events((site.folder / "z.mcap",))
