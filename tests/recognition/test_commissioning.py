"""Commissioning: the walk, what it says of each rule, the record, and what the record is worth afterwards."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from rule_scenes import CONFIGS, HEADER, RIG, hat, worker

from recognition.cli import app
from recognition.cli._signals import Stop
from recognition.cli._walking import OVER, Walking
from recognition.commissioning import (
    Glance,
    Network,
    Performed,
    Step,
    Walk,
    Witness,
    as_done,
    by_the_clock,
    derived_walk,
    load_walk,
    networks_of,
    read_record,
    record_beside,
    require_suited,
    results_of,
    standing_of,
    walk_text,
    walked,
    write_record,
)
from recognition.errors import CommissionError
from recognition.observations import FrameSet, Instant, Scene
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.rules import load_rules, parse_rules
from recognition.runtime import RunOptions, run
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

SITE = CONFIGS / "site.rules.toml"
NO_HAT = """[[rules]]
name = "no_hat"
sentence = "a worker wears no hard hat"
when = "each w: visible(w.head) and not exists hard_hat o of w: dist(w.head, o) < 0.14 H"
"""
RULES = parse_rules(HEADER + NO_HAT, "hats.rules.toml")
S = 1_000_000_000
MODEL = {"model.site": "site.onnx " + "a" * 64}


def step(violates=(), *, about=("no_hat",), seconds=10.0, prepare_s=0.0):
    return Step("do it", about, violates, prepare_s, seconds)


def glances(*spans, until=20.0, told=True, blind=False):
    """Ten a second; a violation at (from, to), which began at ``from``."""
    found = []
    for n in range(round(until * 10)):
        t_s = n / 10
        began = next((a for a, b in spans if a <= t_s < b), None)
        since = {} if began is None else {"no_hat": round(began * S)}
        found.append(Glance(round(t_s * S), blind, since, frozenset({"no_hat"} if told else ())))
    return found


def result(found, *steps):
    """Of no_hat, over steps of ten seconds one after the other."""
    walk = by_the_clock(Walk("w", steps or (step(), step(("no_hat",)))), 0)
    return results_of(RULES, found, walk)[0]


def outcomes(found, *steps):
    return [(s.outcome, s.delay_s) for s in result(found, *steps).steps]


def test_the_walk_of_the_site_rules_takes_ten_minutes_and_tries_every_rule_both_ways():
    rules = load_rules(SITE)
    walk = derived_walk(rules)
    assert 540 <= walk.seconds <= 660
    for rule in rules.rules:
        own = [step for step in walk.steps if rule.name in step.about]
        assert sum(rule.name in step.violates for step in own) >= 2
        assert sum(not step.violates for step in own) >= 2


@pytest.mark.parametrize("path", sorted((CONFIGS / "examples").glob("*.rules.toml")), ids=lambda path: path.name)
def test_a_rule_that_nobody_foresaw_is_walked_by_its_sentence(path):
    rules = load_rules(path)
    walk = derived_walk(rules)
    require_suited(walk, rules, path)
    for rule in rules.rules:
        wrong = [step for step in walk.steps if rule.name in step.violates]
        assert all(rule.sentence in step.say and step.seconds > rule.for_s + 1 for step in wrong)
        assert wrong


def test_a_walk_is_read_as_it_was_written(tmp_path):
    walk = Walk('hall "3"', (step(), replace(step(("no_hat",), prepare_s=2.5), say="nimm den Helm ab\tjetzt")))
    path = tmp_path / "w.walk.toml"
    path.write_text(walk_text(walk), encoding="utf-8")
    assert load_walk(path) == walk


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("version = 1", "version = 2", "this is no walk"),
        ('say = "do it"', 'say = ""', "step 1 does not say what to do"),
        ("seconds = 10", "seconds = 0.2", "step 1 has no such seconds"),
        ("seconds = 10", "seconds = true", "step 1 has no such seconds"),
        ("prepare_s = 0", "prepare_s = -1", "step 1 has no such prepare_s"),
        ("violates = []", 'violates = "no_hat"', "step 1 names no rules"),
        ("violates = []", "violates = []\nhow = 3", "step 1 has an entry that is not known"),
        ("[[steps]]", "[steps]", "the walk has no steps"),
        ("[[steps]]", "[[steps", "cannot read this walk"),
    ],
)
def test_a_mistake_in_a_walk_is_named(tmp_path, old, new, problem):
    path = tmp_path / "w.walk.toml"
    path.write_text(walk_text(Walk("w", (step(),))).replace(old, new, 1))
    with pytest.raises(CommissionError, match=problem):
        load_walk(path)


def test_a_walk_for_other_rules_is_refused():
    with pytest.raises(CommissionError, match="step 1 of the walk names the rule ladder, which there is not"):
        require_suited(Walk("w", (step(about=("ladder",)),)), RULES, "w.walk.toml")


def test_a_rule_passes_that_finds_the_violation_in_time_and_nothing_else():
    found = result(glances((11.5, 20.0)))
    assert found.verdict == "pass"
    assert [s.outcome for s in found.steps] == ["silent", "found"]
    assert found.worst_delay_s == pytest.approx(1.5)


def test_a_violation_that_is_found_after_two_seconds_is_late_and_one_never_found_is_missed():
    assert outcomes(glances((12.5, 20.0)))[1] == ("late", 2.5)
    assert outcomes(glances())[1] == ("missed", None)
    assert result(glances()).verdict == "FAIL"


def test_a_rule_that_waits_before_it_raises_has_that_time_and_a_second():
    rules = parse_rules(HEADER + NO_HAT + "for_s = 5\n", "slow.rules.toml")
    walk = by_the_clock(Walk("w", (step(), step(("no_hat",)))), 0)
    assert results_of(rules, glances((15.9, 20.0)), walk)[0].verdict == "pass"
    assert results_of(rules, glances((16.1, 20.0)), walk)[0].verdict == "FAIL"


def test_what_is_found_in_a_safe_step_is_a_false_alarm():
    assert outcomes(glances((3.0, 3.2), (11.0, 20.0)))[0] == ("false alarm", 3.0)


def test_a_violation_from_before_may_end_within_two_seconds():
    steps = step(("no_hat",)), step()
    assert outcomes(glances((0.5, 11.9)), *steps)[1] == ("silent", None)
    assert outcomes(glances((0.5, 12.2)), *steps)[1] == ("false alarm", 2.0)
    assert outcomes(glances((0.5, 10.0), (10.3, 11.0)), *steps)[1] == ("false alarm", 0.3)


def test_silence_of_a_rule_that_cannot_tell_or_is_blind_is_no_pass():
    assert outcomes(glances((11.0, 20.0), told=False))[0] == ("cannot tell", None)
    assert outcomes(glances((11.0, 20.0), blind=True))[0] == ("not monitored", None)
    assert outcomes(glances(until=9.0))[1] == ("not monitored", None)


def test_a_rule_must_be_silent_in_steps_about_others_and_is_not_tried_by_them():
    others = step(about=()), step(about=())
    assert result(glances(told=False), *others).verdict == "not tried"
    assert result(glances((3.0, 4.0)), *others).verdict == "FAIL"
    assert result(glances((11.0, 20.0)), step(("no_hat",)), step(("no_hat",))).steps[0].outcome == "missed"


def test_a_witness_remembers_what_a_watch_says():
    witness = Witness(RULES, RIG)
    for n in range(10):
        hats = (hat(9, 0, 0),) if n < 5 else ()
        witness.step(Scene(n, n * S // 10, (worker(1, 0, 0),), hats))
    seen = witness.glances
    assert [glance.since_ns.get("no_hat") for glance in seen] == [None] * 8 + [S // 2] * 2
    assert all(glance.determined == {"no_hat"} and not glance.is_blind for glance in seen)


class Guide:
    """A clock that only waiting moves, and everything that was said."""

    def __init__(self, ends_at=1e9):
        self.now_s, self.said, self.ends_at = 0.0, [], ends_at

    def wait(self, seconds):
        self.now_s += seconds
        return self.now_s < self.ends_at

    def confirmed(self):
        return self.wait(7.0)

    def walk(self, *steps, asks=False):
        confirmed = self.confirmed if asks else None
        return list(
            walked(
                Walk("w", steps), now_ns=lambda: round(self.now_s * S), say=self.said.append, wait=self.wait,
                confirmed=confirmed,
            )
        )  # fmt: skip


def test_a_walk_by_the_clock_keeps_to_its_times():
    steps = step(prepare_s=5.0), step(("no_hat",), prepare_s=2.0)
    guide = Guide()
    assert guide.walk(*steps) == list(by_the_clock(Walk("w", steps), 0))
    assert guide.said[0] == "step 1 of 2: do it"


def test_a_step_begins_when_all_are_in_place_and_can_be_walked_again_by_the_clock():
    done = Guide().walk(step(prepare_s=5.0), asks=True)
    assert (done[0].start_ns, done[0].end_ns) == (7 * S, 17 * S)
    again = as_done("w", done, 4 * S)
    assert by_the_clock(again, 4 * S)[0].start_ns == 7 * S
    assert again.steps[0].prepare_s == pytest.approx(3.0)


def test_a_walk_that_is_stopped_has_the_steps_that_were_done():
    assert len(Guide(ends_at=12.0).walk(step(), step())) == 1


def test_the_end_of_a_walk_ends_the_run_and_the_end_of_a_run_the_walk():
    stop = Stop()
    walking = Walking(stop)
    with walking.beside(Walk("w", (step(seconds=1e-3),)), lambda: 0, asks=False):
        while not stop():
            pass
    assert stop.by == OVER
    assert len(walking.performed) == 1
    left = Walking(Stop())
    with left.beside(Walk("w", (step(seconds=60.0),)), lambda: 0, asks=False):
        pass
    assert left.performed == []


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Six seconds of two who walk, and lose their hats after three; the rig file and the recording."""
    folder = tmp_path_factory.mktemp("walk")
    rig_path, path = folder / "s.rig.json", folder / "s.mcap"
    made = document_of_rig(semicircle_rig(), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, rig_path)
    rig, frames, fps = rig_of(read_rigfile(rig_path)), 60, 10
    site, placing = simulate(rig, workers=2, frames=frames, fps=fps, seed=1), PlacingOptions()
    instants = []
    for k in range(frames):
        views = tuple(bare(view.detections) if k >= 30 else view.detections for view in observe(site, k))
        instants.append(Instant(FrameSet(k, 10**18 + k * S // fps, (None,) * len(views)), views))
    metadata = {PLACING_KEY: options_text(placing), VIEWS_KEY: ",".join(rig.camera_ids), **MODEL}
    with Recorder(path, rig=rig, rig_json=rig_path.read_bytes(), metadata=metadata) as recorder:
        run(rig, instants, recorder, RunOptions(placing=placing))
    (folder / "r.rules.toml").write_text(HEADER + NO_HAT)
    walk = Walk("w", (step(seconds=2.5, prepare_s=0.4), step(("no_hat",), seconds=2.9, prepare_s=0.1)))
    (folder / "w.walk.toml").write_text(walk_text(walk))
    return folder


def bare(view):
    """What a camera saw, without hats."""
    keep = [n for n, name in enumerate(view.object_class) if name != "hard_hat"]
    return replace(
        view,
        object_class=tuple(view.object_class[n] for n in keep),
        object_xyxy=view.object_xyxy[keep],
        object_score=view.object_score[keep],
        object_keypoints_px=view.object_keypoints_px[keep],
    )


def commission(folder, *more):
    names = ("--rules", folder / "r.rules.toml", "--recording", folder / "s.mcap", "--script", folder / "w.walk.toml")
    done = CliRunner().invoke(app, ["commission", str(folder / "s.rig.json"), *map(str, (*names, *more))])
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


def stands(folder, given=None, **changed):
    found = read_record(record_beside(folder / "s.rig.json"))
    own = {"rules_digest": found.rules_digest, "rig_digest": found.rig_digest, "networks": found.networks} | changed
    return standing_of(folder / "s.rig.json", given, **own)


def test_a_recorded_walk_makes_a_record_that_a_run_finds_beside_the_rig_file(recorded):
    assert not stands_before(recorded).is_commissioned
    code, output = commission(recorded, "--by", "N. N.", "--json")
    told = json.loads(output)
    assert code == 0
    assert [(r["rule"], r["verdict"]) for r in told["results"]] == [("no_hat", "pass")]
    found = read_record(recorded / "s.commission.json")
    assert found.networks == networks_of(MODEL)
    assert found.rig_digest == read_rigfile(recorded / "s.rig.json").geometry_digest
    assert stands(recorded).line == f"commissioned {found.at_utc[:10]} by N. N.: no_hat pass"


def stands_before(folder):
    return standing_of(folder / "none.rig.json", None, rules_digest="", rig_digest="", networks=())


def test_people_who_are_not_real_are_told_of(recorded):
    commission(recorded, "--by", "N. N.", "--simulated")
    assert "by N. N. on simulated people: no_hat pass" in stands(recorded).line


def test_a_walk_that_is_not_as_its_script_fails_and_says_where(recorded, tmp_path):
    other = tmp_path / "other.walk.toml"
    walk = Walk("w", (step(("no_hat",), seconds=2.5, prepare_s=0.4), step(seconds=2.9, prepare_s=0.1)))
    other.write_text(walk_text(walk))
    code, output = commission(recorded, "--by", "N.", "--script", other, "-o", tmp_path / "x.commission.json")
    assert code == 1
    assert "FAIL      no_hat: 0 violations found" in output
    assert "step 1: missed (do it)" in output
    assert "step 2: false alarm" in output


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"rules_digest": "sha256:x"}, "rules"),
        ({"rig_digest": "sha256:x"}, "rig"),
        ({"networks": (Network(family="site", name="site.onnx", sha256="b" * 64),)}, "networks"),
        ({"rules_digest": "sha256:x", "networks": ()}, "rules, networks"),
    ],
)
def test_a_record_counts_for_what_it_was_made_with_only(recorded, changed, what):
    commission(recorded, "--by", "N. N.")
    standing_now = stands(recorded, **changed)
    assert not standing_now.is_commissioned
    assert standing_now.line.startswith(f"not commissioned: {what} changed since 20")
    with pytest.raises(CommissionError, match="this record was made with other"):
        stands(recorded, recorded / "s.commission.json", **changed)


def test_a_record_that_was_edited_or_is_newer_or_no_record_is_refused(recorded, tmp_path):
    commission(recorded, "--by", "N. N.")
    text, path = (recorded / "s.commission.json").read_text(), tmp_path / "a.commission.json"
    for old, new, problem in (
        ("N. N.", "M. M.", "this record was changed since it was written"),
        ('"version": 1', '"version": 2', "this record is of a newer version"),
        ('"verdict": "pass"', '"verdict": "fine"', "this is no commissioning record: results.0.verdict"),
        ("{", "", "cannot read this commissioning record"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(CommissionError, match=problem):
            read_record(path)
    path.write_text("[]")
    with pytest.raises(CommissionError, match="this is no commissioning record"):
        read_record(path)
    written = write_record(read_record(recorded / "s.commission.json"), path)
    assert read_record(path) == written


def test_a_recording_of_another_rig_and_a_record_without_an_author_are_refused(recorded, tmp_path):
    with pytest.raises(OptionError, match="--by"):
        commission(recorded)
    document = document_of_rig(semicircle_rig(3), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(document, tmp_path / "other.rig.json")
    names = ("--rules", recorded / "r.rules.toml", "--recording", recorded / "s.mcap", "--by", "N.")
    done = CliRunner().invoke(app, ["commission", str(tmp_path / "other.rig.json"), *map(str, names)])
    assert isinstance(done.exception, CommissionError)
    assert "the recording is of another rig" in str(done.exception)


def test_the_plan_is_a_walk_that_can_be_edited(recorded, tmp_path):
    code, output = commission(recorded, "--plan")
    (tmp_path / "p.walk.toml").write_text(output)
    assert code == 0
    assert load_walk(tmp_path / "p.walk.toml").steps == load_walk(recorded / "w.walk.toml").steps


def test_performed_steps_are_judged_where_they_were():
    walk = (Performed(step(), 0, 5 * S), Performed(step(("no_hat",)), 8 * S, 12 * S))
    assert results_of(RULES, glances((8.5, 20.0)), walk)[0].verdict == "pass"
