"""``recognition rules``: files checked and said in sentences, and reasons found in a recording."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from judged_runs import bare
from rule_scenes import CONFIGS, HEADER, Film, rule, thing, worker

from recognition.cli import app
from recognition.judging import watch_of
from recognition.observations import FrameSet, Instant
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.rules import load_rules
from recognition.rules.sentences import described
from recognition.runtime import RunOptions, run
from recognition.sources.recording import open_recording
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

SITE, PAPER = CONFIGS / "site.rules.toml", CONFIGS / "paper.rules.toml"
FRAMES, FPS = 24, 25.0


def told(*arguments):
    done = CliRunner().invoke(app, ["rules", *map(str, arguments)])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of two who walk, of whom the second has no hat, and its scenes."""
    folder = tmp_path_factory.mktemp("recorded")
    made = document_of_rig(semicircle_rig(), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, folder / "s.rig.json")
    rig = rig_of(read_rigfile(folder / "s.rig.json"))
    site, placing = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1), PlacingOptions()
    instants = []
    for k in range(FRAMES):
        views = tuple(bare(view.detections) for view in observe(site, k))
        t_ns = 10**18 + round(k * 1e9 / FPS)
        instants.append(Instant(FrameSet(k, t_ns, (None,) * len(views)), views))
    metadata = {PLACING_KEY: options_text(placing), VIEWS_KEY: ",".join(rig.camera_ids)}
    path = folder / "o.mcap"
    rig_json = (folder / "s.rig.json").read_bytes()
    with Recorder(path, rig=rig, rig_json=rig_json, metadata=metadata) as recorder:
        result = run(rig, instants, recorder, RunOptions(placing=placing))
    return path, rig, result.scenes


def test_check_names_the_rules_of_sound_files_and_the_line_of_others(tmp_path):
    assert told("check", SITE, PAPER)[0] == 0
    assert "no_hat, ladder, window, platform; needs the floor; sha256:" in told("check", SITE)[1]
    assert "runs without a floor" in told("check", PAPER)[1]
    bad = tmp_path / "bad.rules.toml"
    bad.write_text(SITE.read_text().replace("0.20 H", "0.20"))
    code, output = told("check", SITE, bad, "--json")
    found = json.loads(output)
    assert code == 2
    assert [document["ok"] for document in found["files"]] == [True, False]
    line = bad.read_text().splitlines()[found["files"][1]["line"] - 1]
    assert line[: found["files"][1]["column"] - 1].endswith("0.20")
    code, output = told("check", bad)
    assert code == 2
    assert "a limit without a unit" in output


def test_a_rule_is_said_in_sentences():
    rules = load_rules(SITE)
    assert list(described(rules.rule("platform"), rules)) == [
        "For each platform p: there are at least 2 workers w for whom on(w, p).",
        "on(w, p): the distance on the plan from the feet of w to the footprint of p is below 0.50 m (0.60 m while the "
        "violation lasts), and stands(w, p).",
        "stands(w, p): the distance in height from the left ankle of w to the top of p is below 0.20 m (0.22 m while "
        "the violation lasts), and the distance in height from the right ankle of w to the top of p is below 0.20 m "
        "(0.22 m while the violation lasts).",
        "Raised after 0.15 s (alarm); ended when it has not been so for 0.15 s; what cannot be told leaves it as it "
        "is, for 2 s at most.",
    ]
    code, output = told("explain", SITE, "--rule", "ladder")
    assert code == 0
    assert "there is no worker v other than w for whom holds(v, l)" in output
    assert "platform" not in output
    assert set(json.loads(told("explain", SITE, "--json")[1])["rules"]) == {"no_hat", "ladder", "window", "platform"}


@pytest.mark.parametrize("file", sorted(CONFIGS.rglob("*.rules.toml")), ids=lambda path: path.name)
def test_every_shipped_rule_has_sentences(file):
    rules = load_rules(file)
    for one in rules.rules:
        lines = list(described(one, rules))
        assert len(lines) >= 2
        assert all(line.endswith(".") and "None" not in line for line in lines)


def test_a_reason_in_a_recording_is_found_by_time_and_by_event(recorded):
    path, rig, scenes = recorded
    watch, events = watch_of(load_rules(SITE), rig, {}, open_recording(path).geometry_digest), {}
    for scene in scenes:
        events |= {event.event_id: event for event in watch.step(scene)[1]}
    (event,) = events.values()
    assert event.rule == "no_hat"
    by_event = told("explain", SITE, path, "--event", event.event_id, "--rule", "no_hat", "--json")
    by_time = told(
        "explain", SITE, path, "--at", (event.raised_ns - scenes[0].t_ns) / 1e9, "--rule", "no_hat", "--json"
    )
    assert by_event[0] == 0
    assert json.loads(by_event[1]) == json.loads(by_time[1])
    bindings = json.loads(by_event[1])["rules"]["no_hat"]
    (active,) = [binding for binding in bindings if binding["is_active"]]
    assert active["truth"] is True
    assert active["why"]["text"] == "not worn(w) and visible(w.crown)"
    code, output = told("explain", SITE, path, "--event", event.event_id)
    assert code == 0
    assert f"w = worker {event.actors[0].track_id}: violated since" in output
    assert "4 cameras see it, 2 are needed" in output


def test_an_instant_or_event_that_is_not_there_is_said(recorded):
    path, _, _ = recorded
    for option, value in (("--at", 900), ("--at", -1), ("--event", "no_hat-0")):
        code, output = told("explain", SITE, path, option, value)
        assert code == 1, option
        assert "has no" in output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((SITE, "--at", 3), "a recording beside it"),
        ((SITE, "x.mcap"), "either --at or --event"),
        ((SITE, "x.mcap", "--at", 3, "--event", "e"), "either --at or --event"),
        ((SITE, "--rule", "hat"), "one of no_hat, ladder, window, platform"),
    ],
)
def test_options_that_do_not_fit_are_refused(arguments, words):
    done = CliRunner().invoke(app, ["rules", "explain", *map(str, arguments)])
    assert isinstance(done.exception, OptionError)
    assert words in str(done.exception)


def test_an_explanation_says_what_is_not_known():
    film = Film(rule("each w: exists toolbox o: dist(w.left_wrist, o.extent) < 0.5 m"))
    film.show([worker(1, 0, 0, unseen=(9,))], [thing(5, "toolbox", [0.4, 0, 0.8])])
    (binding,) = film.watch.judge.explain("r")
    assert binding.why.truth is None
    lines = list(binding.why.lines())
    assert lines[0].startswith("unknown exists toolbox o")
    assert "between 0.0423 and 0.742 m" in lines[1]
    assert lines[1].endswith("limit 0.5 m; left_wrist of worker 1 is not known, within 0.35 m")


def test_explanations_have_the_truth_and_margin_of_the_verdict():
    film = Film(load_rules(SITE))
    rng = np.random.default_rng(3)
    for _ in range(40):
        film.show([worker(n, *rng.normal(0, 1, 2), unseen=rng.choice(17, rng.integers(9))) for n in (1, 2, 3)])
        for verdict in film.last.verdicts:
            if not verdict.is_active:
                found = [b for b in film.watch.judge.explain(verdict.rule) if b.verdict == verdict]
                assert found[0].why is None or found[0].why.truth == verdict.truth


def test_the_language_is_documented_with_a_file_that_is_sound():
    """The example in the package's docstring, of every section."""
    import recognition.rules

    text = recognition.rules.__doc__.split("::\n\n", 1)[1].split("\n\n**Who.**")[0]
    text = "\n".join(line[4:] for line in text.splitlines())
    assert text.startswith(HEADER)
    assert recognition.rules.parse_rules(text, "doc").zones
