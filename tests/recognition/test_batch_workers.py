"""Whoever judges a batch, and whoever of them is killed meanwhile: the results are those of one after the other."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from batch_recordings import RULES, Site, content, judged

from recognition.batch import Orders
from recognition.crews import Crew, WorkerLostError, carried_out, dask_scheduler, dask_workers, process_pool
from recognition.errors import BatchError

RECORDINGS = 20
ORDERS = Orders(RULES, "walks.rules.toml")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Twenty recordings, two of them damaged."""
    folder = tmp_path_factory.mktemp("inputs")
    site = Site(folder, 60)
    for k in range(RECORDINGS):
        path = site.record(folder / f"r{k:02d}.mcap", 2 * k, 16)
        if k in (5, 15):
            path.write_bytes(path.read_bytes()[:-50])
    return folder


@pytest.fixture(scope="module")
def serial(inputs, tmp_path_factory):
    """The results of one after the other in this process: every file."""
    output = tmp_path_factory.mktemp("serial")
    with ThreadPoolExecutor(1) as executor:
        result = judged([inputs], output, ORDERS, Crew(lambda: executor, 1, ()))
    assert (len(result.rows), result.failed) == (RECORDINGS, 2)
    assert len({row.events_digest for row in result.rows}) == RECORDINGS - 1  # the failed ones share None
    assert sum(sum((row.events or {}).values()) for row in result.rows) > RECORDINGS
    return content(output)


def kill_one_at(rows: int, killed: list[int]):
    """To be told of every row: kills a worker process when there are so many."""
    before = set(multiprocessing.active_children())

    def on_row(_row, done):
        if done == rows:
            workers = set(multiprocessing.active_children()) - before
            killed.append(min(worker.pid for worker in workers))
            os.kill(killed[0], signal.SIGKILL)

    return on_row


def test_a_batch_on_processes_one_of_which_is_killed_half_way_equals_the_serial_run(inputs, serial, tmp_path):
    killed = []
    on_row = kill_one_at(RECORDINGS // 2, killed)
    with process_pool(2) as crew:
        result = judged([inputs], tmp_path, ORDERS, crew, on_row=on_row)
    assert len(killed) == 1
    assert len(result.rows) == RECORDINGS
    assert content(tmp_path) == serial
    assert killed[0] not in [process.pid for process in multiprocessing.active_children()]


def test_a_batch_on_two_dask_workers_one_of_which_is_killed_half_way_equals_the_serial_run(inputs, serial, tmp_path):
    pytest.importorskip("distributed", reason="Dask is an extra: pip install rigcal[dask]")
    killed = []
    on_row = kill_one_at(RECORDINGS // 2, killed)
    with dask_workers(2) as crew:
        result = judged([inputs], tmp_path, ORDERS, crew, on_row=on_row)
    assert len(killed) == 1
    assert len(result.rows) == RECORDINGS
    assert content(tmp_path) == serial


def test_work_that_kills_its_worker_twice_is_given_up_and_the_rest_is_done():
    with process_pool(2) as crew:  # signal 0 does nothing, 9 kills, -1 is refused
        results = list(carried_out(signal.raise_signal, [0, 0, 9, 0, -1, 0, 0], crew, stop=lambda: False))
    assert sorted(task for task, _ in results) == [-1, 0, 0, 0, 0, 0, 9]
    kinds = {task: type(result) for task, result in results}
    assert kinds == {0: type(None), 9: WorkerLostError, -1: OSError}


def test_no_dask_scheduler_is_said_in_words(monkeypatch):
    pytest.importorskip("distributed", reason="Dask is an extra: pip install rigcal[dask]")
    monkeypatch.setattr("recognition.crews._CONNECT_S", 0.3)
    with pytest.raises(BatchError) as caught, dask_scheduler("tcp://127.0.0.1:9"):
        pass
    assert str(caught.value).splitlines()[:2] == [
        "no Dask scheduler answers",
        "  where:    tcp://127.0.0.1:9",
    ]


def test_a_dask_scheduler_without_workers_is_refused():
    pytest.importorskip("distributed", reason="Dask is an extra: pip install rigcal[dask]")
    with pytest.raises(BatchError, match="the Dask scheduler has no workers"), dask_workers(0):
        pass


def test_ctrl_c_leaves_what_is_done_and_the_same_command_goes_on(inputs, serial, tmp_path):
    (tmp_path / "walks.rules.toml").write_text(RULES)
    arguments = ["batch", str(inputs), "-o", str(tmp_path / "out"), "--rules", str(tmp_path / "walks.rules.toml")]
    command = [sys.executable, "-c", "from recognition.cli import main; main()", *arguments, "--jobs", "1"]
    journal = tmp_path / "out/batch.jsonl.part"
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as going:
        while not (journal.exists() and journal.stat().st_size) and going.poll() is None:
            time.sleep(0.01)
        os.killpg(going.pid, signal.SIGINT)  # as a terminal does: to all processes of the command
        said, errors = going.communicate(timeout=60)
    assert going.returncode == 1, errors
    assert "Traceback" not in errors
    match = re.fullmatch(
        r"stopped by the keyboard: (\d+) ok, (\d+) failed, (\d+) not done\n"
        rf"what is done is in {re.escape(str(journal))}; the same command again goes on from there\n",
        said,
    )
    assert match, said
    done = int(match[1]) + int(match[2])
    assert 0 < done < RECORDINGS
    assert done + int(match[3]) == RECORDINGS
    assert len(journal.read_text().splitlines()) == done
    assert not (tmp_path / "out/batch.jsonl").exists()
    with ThreadPoolExecutor(1) as executor:
        result = judged([inputs], tmp_path / "out", ORDERS, Crew(lambda: executor, 1, ()))
    assert (result.failed, result.reused) == (2, int(match[1]))
    assert content(tmp_path / "out") == serial
