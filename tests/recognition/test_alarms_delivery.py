"""What a run raises reaches a webhook once and in order, whatever the webhook does; the run never waits for it."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import QUICK, SECOND, T0, Announcements, HttpServer, event, options_of, wait_for, webhook

from recognition.alarms import Alarms, Answer, Subject, append_answer
from recognition.alarms import delivery as delivery_module
from recognition.alarms import keeper as keeper_module
from recognition.alarms import service as service_module

SECRET = "hunter2"


@pytest.fixture
def server(monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(service_module, "CLOSING_S", 1.0)
    monkeypatch.setattr(keeper_module, "LOOK_S", 0.02)
    made = HttpServer()
    yield made
    made.close()


def started(tmp_path, server, announce=None, *, head="", **webhook_options) -> Alarms:
    options = options_of(tmp_path, head + webhook(server, **webhook_options), TOKEN=SECRET)
    announce = Announcements() if announce is None else announce
    return Alarms(options, tmp_path / "run.mcap", announce=announce, retry=QUICK)


def raise_and_end(alarms: Alarms, first: int, count: int) -> list[str]:
    for k in range(first, first + count):
        alarms.raise_(event(f"e{k}", t_s=k))
        alarms.raise_(event(f"e{k}", t_s=k, now_s=k + 0.5))
        alarms.raise_(event(f"e{k}", t_s=k, end_s=k + 1))
    return [f"e{k}/{phase}" for k in range(first, first + count) for phase in ("raised", "ended")]


def test_an_event_is_told_when_it_is_raised_and_when_it_ends(tmp_path, server):
    with started(tmp_path, server, more='headers = { Authorization = "Bearer ${TOKEN}" }') as alarms:
        alarms.raise_(event())
        wait_for(lambda: server.events == ["e1/raised"])
        alarms.raise_(event(now_s=1))
        alarms.raise_(event(end_s=2))
        wait_for(lambda: server.events == ["e1/raised", "e1/ended"])
    raised, ended = (one for one in server.taken if one["format"] == "recognition.alarm")
    assert raised["actors"] == [{"name": "worker 1", "role": "w"}]
    assert (raised["start_utc"], raised["raised_utc"]) == ("2026-11-18T11:06:40.000Z", "2026-11-18T11:06:40.300Z")
    assert raised["end_utc"] is None
    assert ended["end_utc"] == "2026-11-18T11:06:42.000Z"
    assert (raised["site"], raised["caveats"]) == ("hall-3", ["not validated on real people"])
    assert (ended["worst_margin"], ended["run"]) == (0.4, raised["run"])
    at = server.attempts.index(raised)
    assert server.headers[at]["Idempotency-Key"] == "e1/raised"
    assert server.headers[at]["Authorization"] == f"Bearer {SECRET}"


def test_everything_arrives_once_and_in_order_through_failures_stalls_and_refused_connections(tmp_path, server):
    announced = Announcements()
    with started(tmp_path, server, announced) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wanted = raise_and_end(alarms, 0, 3)
        wait_for(lambda: server.events == wanted)
        server.status = 500
        wanted += raise_and_end(alarms, 3, 3)
        wait_for(lambda: any("answers 500" in one for one in announced))
        server.status, server.stalls = 200, True
        wanted += raise_and_end(alarms, 6, 3)
        wait_for(lambda: "does not answer: timed out" in str(alarms.status[0].fault))
        server.stalls = False
        server.close()
        wanted += raise_and_end(alarms, 9, 3)
        wait_for(lambda: "Connection refused" in str(alarms.status[0].fault))
        server.open()
        wait_for(lambda: len(server.events) >= len(wanted))
    assert server.events == wanted
    assert server.beats[-1]["status"] == "NOT MONITORED"
    assert announced[-1].startswith("info: room is told again")
    assert (alarms.status[0].delivered, alarms.status[0].waiting, alarms.status[0].lost) == (24, 0, 0)


def test_the_run_never_waits_for_a_target_that_stalls(tmp_path, server, monkeypatch):
    server.stalls = True
    began_s = time.thread_time()
    with started(tmp_path, server, timeout_s=4) as alarms:
        slowest = 0.0
        for k in range(200):
            at = time.monotonic()
            raise_and_end(alarms, k, 1)
            alarms.heartbeat("MONITORED", "", T0)
            slowest = max(slowest, time.monotonic() - at)
        monkeypatch.setattr(service_module, "CLOSING_S", 0.1)
    assert slowest < 2, "the stall is 4 s"
    assert time.thread_time() - began_s < 1


def test_what_an_earlier_run_could_not_deliver_is_delivered_by_the_next(tmp_path, server):
    server.status = 503
    with started(tmp_path, server) as alarms:
        wanted = raise_and_end(alarms, 0, 2)
        wait_for(lambda: len(server.attempts) > 3)
    server.status, announced = 200, Announcements()
    with started(tmp_path, server, announced) as alarms:
        wanted += raise_and_end(alarms, 2, 1)
        wait_for(lambda: len(server.events) >= len(wanted))
    assert server.events == wanted
    assert "info: room: 4 messages of an earlier run are sent now" in announced
    with started(tmp_path, server):
        pass
    assert server.events == wanted, "nothing waits any more"


def test_a_message_that_is_at_fault_holds_nothing_up(tmp_path, server):
    announced = Announcements()
    with started(tmp_path, server, announced) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: server.beats and server.beats[-1]["status"] == "MONITORED")
        server.status = 422
        alarms.raise_(event("bad"))
        wait_for(lambda: alarms.status[0].lost == 1)
        server.status = 200
        alarms.raise_(event("good"))
        wait_for(lambda: server.events == ["good/raised"])
    assert any(one.endswith("answers 422: bad/raised is given up") for one in announced)
    assert server.beats[-1]["lost"] == 1


def test_a_webhook_that_takes_no_heartbeats_gets_its_events(tmp_path, server):
    server.refuses_beats, announced = True, Announcements()
    with started(tmp_path, server, announced) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: announced)
        wanted = raise_and_end(alarms, 0, 5)
        wait_for(lambda: server.events == wanted)
        assert "answers 422" in alarms.status[0].fault
    assert announced == [f"warning: room is not told: {server.url.split('/hook')[0]} answers 422; 0 wait"]


def test_redirections_are_not_followed(tmp_path, server):
    server.status = 307
    with started(tmp_path, server) as alarms:
        alarms.raise_(event())
        wait_for(lambda: "answers 307" in str(alarms.status[0].fault))
    assert server.events == []


def test_no_secret_is_announced_or_kept(tmp_path, server):
    announced = Announcements()
    options = options_of(
        tmp_path, webhook(server, more='headers = { Authorization = "Bearer ${TOKEN}" }'), TOKEN=SECRET
    )
    assert SECRET not in repr(options)
    assert "secret-path" not in repr(options)
    for status in (500, 422):
        server.status = status
        with Alarms(options, tmp_path / "run.mcap", announce=announced, retry=QUICK) as alarms:
            alarms.raise_(event(f"e{status}"))
            wait_for(lambda: alarms.status[0].fault)
            assert SECRET not in str(alarms.status)
    kept = b"".join(file.read_bytes() for file in tmp_path.rglob("*") if file.is_file())
    for secret in (SECRET, "secret-path"):
        assert not any(secret in one for one in announced)
    assert SECRET.encode() not in kept


def test_a_change_of_status_is_told_at_once_and_the_end_is_not_monitored(tmp_path, server):
    with started(tmp_path, server) as alarms:
        wait_for(lambda: server.beats)
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: server.beats[-1]["status"] == "MONITORED", within_s=1)
        alarms.heartbeat("NOT MONITORED", "0 of 4 cameras", T0)
        wait_for(lambda: server.beats[-1]["status"] == "NOT MONITORED", within_s=1)
        alarms.heartbeat("DEGRADED", "2 of 4 cameras", T0)
        wait_for(lambda: server.beats[-1]["status"] == "DEGRADED", within_s=1)
    told = [(one["status"], one["reason"]) for one in server.beats]
    assert told == [
        ("NOT MONITORED", "the run has started and has no result yet"),
        ("MONITORED", ""),
        ("NOT MONITORED", "0 of 4 cameras"),
        ("DEGRADED", "2 of 4 cameras"),
        ("NOT MONITORED", "the run has ended"),
    ]
    assert server.beats[0]["next_within_s"] == 30


def test_a_run_that_falls_silent_is_not_monitored(tmp_path, server):
    with started(tmp_path, server, head="silence_s = 0.2\n") as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: server.beats and server.beats[-1]["reason"] == "the run has said nothing for 0.2 s")
        assert server.beats[-1]["status"] == "NOT MONITORED"
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: server.beats[-1]["status"] == "MONITORED", within_s=1)


def test_a_run_that_fails_says_so(tmp_path, server):
    def run() -> None:
        with started(tmp_path, server) as alarms:
            alarms.heartbeat("MONITORED", "", T0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    assert (server.beats[-1]["status"], server.beats[-1]["reason"]) == ("NOT MONITORED", "the run has failed")


def test_heartbeats_come_as_often_as_the_file_says(tmp_path, server):
    with started(tmp_path, server, head="heartbeat_s = 1\nsilence_s = 60\n") as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: sum(one["status"] == "MONITORED" for one in server.beats) == 2)


def test_a_target_is_told_only_of_what_is_grave_enough(tmp_path, server):
    with started(tmp_path, server, more='severity = "alarm"') as alarms:
        alarms.raise_(event("small", severity="warning"))
        alarms.raise_(event("grave", severity="alarm"))
        wait_for(lambda: server.events == ["grave/raised"])
        alarms.raise_(event("small", severity="warning", end_s=1))
        alarms.raise_(event("grave", severity="alarm", end_s=1))
        wait_for(lambda: server.events == ["grave/raised", "grave/ended"])


def test_targets_do_not_hold_each_other_up(tmp_path, server):
    other = HttpServer()
    other.stalls = True
    try:
        options = options_of(tmp_path, webhook(other, name="slow") + webhook(server))
        with Alarms(options, tmp_path / "run.mcap", announce=Announcements(), retry=QUICK) as alarms:
            alarms.raise_(event())
            wait_for(lambda: server.events == ["e1/raised"], within_s=1)
            wait_for(lambda: [(one.name, one.waiting) for one in alarms.status] == [("slow", 1), ("room", 0)])
    finally:
        other.close()


def mute(tmp_path, subject: Subject, until_s: float, *, whole_rule=False) -> None:
    at_ns = event().start_ns
    until_ns = at_ns + round(until_s * 1e9)
    append_answer(tmp_path / "run.mcap", Answer("muted", subject, "kim", at_ns, until_ns, whole_rule=whole_rule))


def test_what_is_muted_is_noted_and_not_told_until_the_mute_ends(tmp_path, server):
    with started(tmp_path, server) as alarms:
        alarms.raise_(event("first"))
        wait_for(lambda: server.events == ["first/raised"])
        mute(tmp_path, Subject("first", "no_hat", event().actors), 60)
        wait_for(lambda: alarms._keeper.answers.answers)
        alarms.raise_(event("first", end_s=5))
        alarms.raise_(event("muted", t_s=10))
        alarms.raise_(event("muted", t_s=10, end_s=20))
        alarms.raise_(event("other worker", t_s=21, worker=8))
        alarms.raise_(event("other rule", t_s=22, rule="ladder"))
        alarms.raise_(event("long", t_s=30))
        alarms.raise_(event("long", t_s=30, now_s=40))
        alarms.heartbeat("MONITORED", "", T0 + 59 * SECOND)
        alarms.raise_(event("marker", t_s=59, worker=9))
        alarms.heartbeat("MONITORED", "", T0 + 60 * SECOND)
        alarms.heartbeat("MONITORED", "", T0 + 61 * SECOND)
        wanted = [
            "first/raised",
            "first/ended",
            "other worker/raised",
            "other rule/raised",
            "marker/raised",
            "long/raised",
        ]
        wait_for(lambda: len(server.events) == len(wanted))
        notes = tmp_path / "run.alarms.jsonl"
        wait_for(lambda: notes.read_text().count("\n") == 8)
    assert server.events == wanted
    assert '"event_id": "muted"' in notes.read_text()
    assert notes.read_text().count('"muted_by": "kim"') == 4  # first ended, muted raised and ended, long raised


def test_a_whole_rule_can_be_muted(tmp_path, server):
    mute(tmp_path, Subject("first", "no_hat", event().actors), 60, whole_rule=True)
    with started(tmp_path, server) as alarms:
        alarms.raise_(event("e1", worker=8))
        alarms.raise_(event("e2", worker=8, rule="ladder"))
        wait_for(lambda: server.events == ["e2/raised"])


def test_only_what_can_fail_is_caught(tmp_path, server, monkeypatch):
    """A mistake of ours in a delivery must not look like health: its thread ends, and the test sees it."""
    raised = []
    monkeypatch.setattr(delivery_module.threading, "excepthook", lambda args: raised.append(args.exc_type))
    with started(tmp_path, server) as alarms:
        wait_for(lambda: server.beats)
        monkeypatch.setattr(alarms._deliveries[0]._target, "beat", lambda body: 1 / 0)
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: raised == [ZeroDivisionError])
