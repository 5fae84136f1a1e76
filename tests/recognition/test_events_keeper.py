"""Events of verdicts: what each says of its violation."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rule_scenes import RIG, Film, rule, worker

from recognition.events import EventKeeper, Watch
from recognition.observations import Scene
from recognition.rules import Judge, Judgement, Verdict

UP = rule("each w: clearance(w.feet) > 1 m", for_s=0.3, clear_s=0.2, severity="alarm")


def seen_by(track, *cameras):
    return replace(track, members=np.array([0 if camera in cameras else -1 for camera in range(4)]))


def steps(*scenes, **provenance):
    """What a watch tells at each of some scenes, 0.1 s apart: (workers, status)."""
    watch = Watch(UP, RIG, **provenance)
    told = [
        watch.step(Scene(n, round((n + 1) * 1e8), tuple(workers), (), status))[1]
        for n, (workers, status) in enumerate(scenes)
    ]
    return told, watch


def test_an_event_is_told_when_it_is_raised_when_it_changes_and_when_it_ends():
    up, down = [seen_by(worker(1, 0, 0, 1.2), 0, 1)], [worker(1, 0, 0)]
    more = [seen_by(up[0], 1, 2)]
    scenes = [*[(up, "MONITORED")] * 5, *[(more, "MONITORED")] * 3, (more, "DEGRADED"), *[(down, "MONITORED")] * 4]
    told, watch = steps(*scenes)
    assert [len(events) for events in told] == [0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 1, 0]
    raised, seen, degraded, _, ended = [events[0] for events in told if events]
    assert len({event.event_id for event in (raised, seen, degraded, ended)}) == 1
    assert (raised.start_ns, raised.raised_ns, raised.end_ns) == (10**8, 4 * 10**8, None)
    assert (raised.cameras, seen.cameras) == (("cam0", "cam1"), ("cam0", "cam1", "cam2"))
    assert (seen.status, degraded.status, ended.status) == ("MONITORED", "DEGRADED", "DEGRADED")
    assert ended.end_ns == 10 * 10**8
    assert [margin.t_ns for margin in ended.margins] == [n * 10**8 for n in range(1, 13)]
    assert all(margin.value > 0 for margin in ended.margins[:9])
    assert all(margin.value < 0 for margin in ended.margins[9:])
    assert ended.confidence == pytest.approx(9 / 12)
    assert watch.lasting() == ()


def test_an_event_says_by_which_rules_and_rig_and_what_it_is_not_worth():
    scenes = [([worker(1, 0, 0, 1.2)], "MONITORED")] * 5
    told, watch = steps(*scenes, rig_digest="sha256:geometry", caveats=("not validated on real people",))
    (event,) = told[3]
    assert (event.rule, event.sentence, event.severity) == ("r", "wrong", "alarm")
    assert (event.rules_digest, event.rig_digest, event.rig_verdict) == (UP.digest, "sha256:geometry", "PASS")
    assert event.caveats == ("not validated on real people",)
    assert steps(*scenes)[0][3][0].rig_digest == RIG.digest
    (lasting,) = watch.lasting()
    assert lasting.event_id == event.event_id
    assert len(lasting.margins) == 5


def test_what_was_unknown_lowers_the_confidence_and_has_no_margin():
    up, hidden = worker(1, 0, 0, 1.2), worker(1, 0, 0, 1.2, unseen=range(1, 17))
    _, watch = steps(*[([up], "MONITORED")] * 4, *[([hidden], "MONITORED")] * 4)
    (event,) = watch.lasting()
    assert event.confidence == pytest.approx(0.5)
    assert np.isnan([margin.value for margin in event.margins]).tolist() == [False] * 4 + [True] * 4


def test_what_never_was_raised_is_no_event():
    up, down = ([worker(1, 0, 0, 1.2)], "MONITORED"), ([worker(1, 0, 0)], "MONITORED")
    told, watch = steps(*[up, up, down] * 5)
    assert not any(told)
    assert watch.lasting() == ()


def test_one_who_does_it_again_has_another_event():
    film = Film(UP)
    for _ in range(3):
        film.show([worker(1, 0, 0, 1.2)], seconds=0.6).show([worker(1, 0, 0)], seconds=0.6)
    assert len(film.events) == 3


def test_a_judgement_that_was_left_out_is_noticed():
    keeper = EventKeeper(UP, RIG)
    scene = Scene(0, 5, (), ())
    ended = Judgement(5, "MONITORED", (Verdict("r", 0, (), False, -1.0, False, None, 3),))
    with pytest.raises(ValueError, match="a judgement was left out"):
        keeper.step(ended, scene)
    assert keeper.step(Judge(UP, RIG).judge(scene), scene) == ()
