"""What waits for a target outlasts its process, a torn end, damage and a disk that is full."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import QUICK, Announcements, HttpServer, event, options_of, wait_for, webhook

from recognition.alarms import Alarms
from recognition.alarms import keeper as keeper_module
from recognition.alarms.journal import Done, Journal, Put, replay
from recognition.alarms.messages import Message
from recognition.alarms.queues import QueueFolder
from recognition.alarms.waiting import SLACK, Waiting
from recognition.errors import AlarmsError


@pytest.fixture
def server(monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    made = HttpServer()
    yield made
    made.close()


def messages(first: int, count: int) -> list[Message]:
    return [Message(f"e{k}/raised", f'{{"n": {k}, "text": "Gerüst"}}') for k in range(first, first + count)]


def filled(path: Path, count: int, **options) -> Waiting:
    queue = Waiting(path, most=options.get("most", 1000))
    for message in messages(0, count):
        queue.put(message)
    return queue


def drained(queue: Waiting) -> list[Message]:
    found = []
    while (put := queue.first()) is not None:
        found.append(put.message)
        queue.done(put)
    return found


def test_what_waits_is_there_again_in_order(tmp_path):
    queue = filled(tmp_path / "q", 5)
    for _ in range(2):
        queue.done(queue.first())
    queue.close()
    again = Waiting(tmp_path / "q", most=1000)
    for message in messages(5, 2):
        again.put(message)
    again.close()
    last = Waiting(tmp_path / "q", most=1000)
    assert drained(last) == messages(2, 5)
    assert last.lost == 0
    last.close()


def test_a_process_that_is_not_asked_leaves_what_was_synced(tmp_path):
    queue = filled(tmp_path / "q", 3)
    queue.sync()
    queue.done(queue.first())
    queue.sync()
    assert [put.message for put in replay(tmp_path / "q").waiting] == messages(1, 2)
    queue.close()


def test_every_torn_end_costs_the_torn_record_alone(tmp_path):
    queue = filled(tmp_path / "q", 3)
    queue.close()
    whole = (tmp_path / "q").read_bytes()
    ends = [index + 1 for index, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(len(whole)):
        (tmp_path / "q").write_bytes(whole[:size])
        found = replay(tmp_path / "q")
        assert [put.message for put in found.waiting] == messages(0, sum(end <= size for end in ends))
        assert found.damaged == 0


def test_a_damaged_record_is_counted_and_the_others_stay(tmp_path):
    queue = filled(tmp_path / "q", 3)
    queue.close()
    data = bytearray((tmp_path / "q").read_bytes())
    data[data.index(b"e1/raised")] ^= 1
    (tmp_path / "q").write_bytes(data)
    again = Waiting(tmp_path / "q", most=1000)
    assert again.lost == 1
    assert drained(again) == [messages(0, 1)[0], messages(2, 1)[0]]
    again.close()


def test_the_file_does_not_grow_with_what_was_delivered(tmp_path):
    queue = Waiting(tmp_path / "q", most=1000)
    largest = 0
    for message in messages(0, 3 * SLACK):
        queue.put(message)
        queue.done(queue.first())
        queue.sync()
        largest = max(largest, (tmp_path / "q").read_bytes().count(b"\n"))
    assert largest <= SLACK + 2
    queue.close()


def test_of_too_many_the_oldest_are_given_up_and_counted(tmp_path):
    queue = filled(tmp_path / "q", 25, most=10)
    assert queue.lost == 15
    queue.close()
    again = Waiting(tmp_path / "q", most=10)
    assert drained(again) == messages(15, 10)
    again.close()


class FullDisk:
    """``os.write`` as of a disk that takes ``room`` bytes more: a part of what comes, then nothing."""

    def __init__(self, monkeypatch, room: int) -> None:
        self.room, self._write = room, os.write
        monkeypatch.setattr(os, "write", self.write)

    def write(self, handle: int, data) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self._write(handle, data[: self.room])
        self.room -= count
        return count


def test_a_full_disk_loses_nothing_that_is_delivered_or_kept_when_there_is_room_again(tmp_path, monkeypatch):
    queue = filled(tmp_path / "q", 3)
    queue.sync()
    disk = FullDisk(monkeypatch, room=70)  # a record and a torn one
    for message in messages(3, 3):
        queue.put(message)
    queue.sync()
    assert queue.fault == "No space left on device"
    assert [put.message for put in replay(tmp_path / "q").waiting][:3] == messages(0, 3)
    queue.sync()
    assert not (tmp_path / "q.new").exists()
    queue.done(queue.first())
    disk.room = 10**9
    queue.put(messages(6, 1)[0])
    queue.sync()
    assert queue.fault is None
    assert [put.message for put in replay(tmp_path / "q").waiting] == messages(1, 6)
    queue.close()


def test_a_full_disk_keeps_no_alarm_from_its_target(tmp_path, monkeypatch, server):
    monkeypatch.setattr(keeper_module, "LOOK_S", 0.02)
    warnings = (
        "warning: what waits to be sent is not on disk and would be lost with this process: No space left on device",
        "warning: what was raised cannot be noted beside the recording: No space left on device",
    )
    announced = Announcements()
    options = options_of(tmp_path, webhook(server))
    with Alarms(options, tmp_path / "run.mcap", announce=announced) as alarms:
        disk = FullDisk(monkeypatch, room=0)
        alarms.raise_(event())
        wait_for(lambda: server.events == ["e1/raised"])
        wait_for(lambda: set(warnings) <= set(announced))
        disk.room = 10**9
        wait_for(lambda: {f"info: no longer: {one.split(': ')[1]}" for one in warnings} <= set(announced))
        assert alarms.status[0].disk_fault is None
    assert (tmp_path / "run.alarms.jsonl").read_text().count("\n") == 1


CHILD = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from alarm_fakes import QUICK, T0, Announcements, event
from recognition.alarms import Alarms, load_alarms
folder = Path({folder!r})
options = load_alarms(folder / "hall-3.alarms.toml", {{}})
with Alarms(options, folder / "run.mcap", announce=Announcements(), retry=QUICK) as alarms:
    alarms.heartbeat("MONITORED", "", T0)
    for k in range(20):
        alarms.raise_(event(f"e{{k}}", t_s=k))
    print("raised", flush=True)
    time.sleep(60)
"""


def test_a_killed_run_forgets_nothing(tmp_path, server):
    server.status = 500
    options = options_of(tmp_path, webhook(server))
    code = CHILD.format(tests=str(Path(__file__).parent), folder=str(tmp_path))
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=root, env=environment) as child:
        assert child.stdout.readline() == b"raised\n"
        queue = tmp_path / "hall-3.alarms.queue" / "room.jsonl"
        wait_for(lambda: queue.read_bytes().count(b'"put"') == 20)
        child.send_signal(signal.SIGKILL)
    server.status = 200
    with Alarms(options, tmp_path / "run.mcap", announce=Announcements(), retry=QUICK) as alarms:
        wait_for(lambda: alarms.status[0].waiting == 0)
    assert server.events == [f"e{k}/raised" for k in range(20)]


def test_a_queue_is_of_one_run_at_a_time(tmp_path):
    folder = QueueFolder(tmp_path / "queue")
    with pytest.raises(AlarmsError, match="another run uses this queue"):
        QueueFolder(tmp_path / "queue")
    folder.release()
    QueueFolder(tmp_path / "queue").release()


def test_the_queue_of_a_killed_run_is_free(tmp_path):
    code = f"""
import os, signal
from pathlib import Path
from recognition.alarms.queues import QueueFolder
held = QueueFolder(Path({str(tmp_path / "queue")!r}))
os.kill(os.getpid(), signal.SIGKILL)
"""
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", code], check=False, cwd=root, env=environment)
    assert done.returncode == -9
    QueueFolder(tmp_path / "queue").release()


def test_a_queue_that_cannot_be_written_is_refused_at_the_start(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(AlarmsError, match="cannot write the queue of alarms"):
        QueueFolder(tmp_path / "file" / "queue")
    folder = QueueFolder(tmp_path / "queue")
    (tmp_path / "queue" / "room.jsonl").mkdir()
    with pytest.raises(AlarmsError, match="cannot write the queue of alarms"):
        folder.open("room", most=10)
    QueueFolder(tmp_path / "queue").release()


def test_what_waits_for_a_target_that_is_no_more_is_told(tmp_path, server):
    announced = Announcements()
    options = options_of(tmp_path, webhook(server))
    options.queue.mkdir()
    (options.queue / "sirens.jsonl").touch()
    with Alarms(options, tmp_path / "run.mcap", announce=announced):
        assert "sirens.jsonl is of a target that the alarms file does not name" in announced[0]


def test_a_journal_is_written_anew_before_it_is_added_to(tmp_path):
    journal = Journal(tmp_path / "q")
    with pytest.raises(ValueError, match="anew first"):
        journal.append([Done((1,))])
    journal.rewrite([Put(1, messages(0, 1)[0])])
    journal.append([Done((1,))])
    journal.close()
    assert replay(tmp_path / "q").waiting == ()
