"""Alarms through a real broker: mosquitto on loopback, started by the tests."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from paho.mqtt.client import Client, MQTTv5
from paho.mqtt.enums import CallbackAPIVersion

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import QUICK, T0, Announcements, event, options_of, wait_for

from recognition.alarms import Alarms
from recognition.alarms import service as service_module

PROGRAM = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="mosquitto is not installed")
SECRET = "hunter2"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Broker:
    """mosquitto, with a user ``site`` where a password is wanted."""

    def __init__(self, folder: Path, *, password: str | None = None, certificate: Path | None = None) -> None:
        self.port = free_port()
        lines = [f"listener {self.port} 127.0.0.1", "persistence false", "allow_anonymous true"]
        if password is not None:
            file = folder / "users"
            command = ["mosquitto_passwd", "-c", "-b", str(file), "site", password]
            subprocess.run(command, check=True, capture_output=True)
            lines[-1:] = ["allow_anonymous false", f"password_file {file}", f"user {os.environ.get('USER', 'root')}"]
        if certificate is not None:
            lines += [f"certfile {certificate}", f"keyfile {certificate}", f"user {os.environ.get('USER', 'root')}"]
        self._config = folder / "mosquitto.conf"
        self._config.write_text("\n".join(lines) + "\n")
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen([PROGRAM, "-c", str(self._config)], stderr=subprocess.DEVNULL)
        wait_for(self._answers)

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def _answers(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0


class Subscriber:
    """Hears everything below a topic."""

    def __init__(self, port: int, topic: str = "hall-3/#") -> None:
        self.heard: list[tuple[str, dict, bool]] = []
        self._client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTv5)
        self._client.on_message = lambda _c, _d, m: self.heard.append((m.topic, json.loads(m.payload), m.retain))
        ready = []
        self._client.on_connect = lambda *_: self._client.subscribe(topic, qos=1)
        self._client.on_subscribe = lambda *_: ready.append(True)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        wait_for(lambda: ready)

    @property
    def events(self) -> list[str]:
        return [one["message_id"] for topic, one, _ in self.heard if topic == "hall-3/events"]

    @property
    def statuses(self) -> list[str]:
        return [one["status"] for topic, one, _ in self.heard if topic == "hall-3/heartbeat"]

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def broker(tmp_path, monkeypatch):
    monkeypatch.setattr(service_module, "CLOSING_S", 1.0)
    made = Broker(tmp_path)
    yield made
    made.kill()


@pytest.fixture
def subscriber(broker):
    made = Subscriber(broker.port)
    yield made
    made.close()


def entry(port: int, more: str = "") -> str:
    return f'[[mqtt]]\nname = "sirens"\nhost = "127.0.0.1"\nport = {port}\ntopic = "hall-3"\ntimeout_s = 1\n{more}\n'


def started(tmp_path, broker, announce=None, more="", **environment) -> Alarms:
    options = options_of(tmp_path, entry(broker.port, more), **environment)
    announce = Announcements() if announce is None else announce
    return Alarms(options, tmp_path / "run.mcap", announce=announce, retry=QUICK)


def test_events_arrive_in_order_and_the_status_is_retained(tmp_path, broker, subscriber):
    with started(tmp_path, broker) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        for k in range(20):
            alarms.raise_(event(f"e{k}", t_s=k))
            alarms.raise_(event(f"e{k}", t_s=k, end_s=k + 1))
        wait_for(lambda: len(subscriber.events) == 40)
        late = Subscriber(broker.port)
        wait_for(lambda: late.statuses == ["MONITORED"])
        assert late.heard[0][2], "retained"
        assert late.events == []
        late.close()
    assert subscriber.events == [f"e{k}/{phase}" for k in range(20) for phase in ("raised", "ended")]
    wait_for(lambda: subscriber.statuses[-1] == "NOT MONITORED")
    assert subscriber.heard[-1][1]["reason"] == "the run has ended"


def test_a_broker_that_is_killed_and_comes_back_gets_everything_once(tmp_path, broker, subscriber):
    announced = Announcements()
    with started(tmp_path, broker, announced) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        alarms.raise_(event("before"))
        wait_for(lambda: subscriber.events == ["before/raised"])
        subscriber.close()  # who listens next is then the only one, and hears all in order
        broker.kill()
        alarms.raise_(event("during"))
        alarms.raise_(event("during", end_s=1))
        wait_for(lambda: alarms.status[0].fault)
        broker.start()
        again = Subscriber(broker.port)
        alarms.raise_(event("after"))
        wait_for(lambda: "after/raised" in again.events)
        assert again.events == ["during/raised", "during/ended", "after/raised"]
        again.close()
    assert any("cannot be reached" in one or "connection was lost" in one for one in announced)


CHILD = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from alarm_fakes import T0, Announcements
from recognition.alarms import Alarms, load_alarms
folder = Path({folder!r})
with Alarms(load_alarms(folder / "hall-3.alarms.toml", {{}}), folder / "run.mcap", announce=Announcements()) as alarms:
    while True:
        alarms.heartbeat("MONITORED", "", T0)
        time.sleep(0.05)
"""


def test_the_broker_itself_says_not_monitored_when_the_run_is_killed(tmp_path, broker, subscriber):
    options_of(tmp_path, entry(broker.port))
    code = CHILD.format(tests=str(Path(__file__).parent), folder=str(tmp_path))
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen([sys.executable, "-c", code], cwd=root, env=environment) as child:
        wait_for(lambda: "MONITORED" in subscriber.statuses)
        child.send_signal(signal.SIGKILL)
        wait_for(lambda: subscriber.statuses[-1] == "NOT MONITORED", within_s=1)
    assert "was killed" in subscriber.heard[-1][1]["reason"]
    late = Subscriber(broker.port)
    wait_for(lambda: late.statuses == ["NOT MONITORED"])
    late.close()


def test_an_event_that_nobody_listens_to_waits(tmp_path, broker):
    with started(tmp_path, broker) as alarms:
        alarms.raise_(event())
        wait_for(lambda: "has nobody who listens to hall-3/events" in str(alarms.status[0].fault))
        assert alarms.status[0].waiting == 1
        listener = Subscriber(broker.port)
        wait_for(lambda: listener.events == ["e1/raised"])
        wait_for(lambda: alarms.status[0].fault is None)
        listener.close()


def test_a_broker_that_hangs_is_given_up_and_tried_again(tmp_path, broker, subscriber):
    with started(tmp_path, broker) as alarms:
        alarms.heartbeat("MONITORED", "", T0)
        wait_for(lambda: "MONITORED" in subscriber.statuses)
        broker._process.send_signal(signal.SIGSTOP)
        alarms.raise_(event())
        wait_for(lambda: "no answer within 1 s" in str(alarms.status[0].fault))
        broker._process.send_signal(signal.SIGCONT)
        wait_for(lambda: alarms.status[0].waiting == 0)
    assert set(subscriber.events) == {"e1/raised"}


def test_a_wrong_password_is_told_without_it(tmp_path, monkeypatch):
    monkeypatch.setattr(service_module, "CLOSING_S", 1.0)
    broker, announced = Broker(tmp_path, password="right"), Announcements()
    login = 'username = "site"\npassword = "${BROKER_PASSWORD}"'
    try:
        with started(tmp_path, broker, announced, login, BROKER_PASSWORD=SECRET) as alarms:
            wait_for(lambda: "refuses the connection: Not authorized" in str(alarms.status[0].fault))
        assert not any(SECRET in one for one in announced)
        with started(tmp_path, broker, announced, login, BROKER_PASSWORD="right") as alarms:
            alarms.heartbeat("MONITORED", "", T0)
            wait_for(lambda: alarms._deliveries[0]._said == alarms._pulse.health())
        assert alarms.status[0].fault is None
    finally:
        broker.kill()


# paho-mqtt leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_a_broker_whose_certificate_nobody_vouches_for_is_told_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(service_module, "CLOSING_S", 1.0)
    certificate = tmp_path / "broker.pem"
    command = (
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=127.0.0.1 "
        f"-addext subjectAltName=IP:127.0.0.1 -keyout {certificate} -out {tmp_path / 'ca.pem'}"
    )
    subprocess.run(command.split(), check=True, capture_output=True)
    certificate.write_text(certificate.read_text() + (tmp_path / "ca.pem").read_text())
    broker = Broker(tmp_path, certificate=certificate)
    try:
        with started(tmp_path, broker, more="tls = true") as alarms:
            wait_for(lambda: "CERTIFICATE_VERIFY_FAILED" in str(alarms.status[0].fault))
        with started(tmp_path, broker, more='tls = true\nca_file = "ca.pem"') as alarms:
            alarms.heartbeat("MONITORED", "", T0)
            wait_for(lambda: alarms._deliveries[0]._said == alarms._pulse.health())
        assert alarms.status[0].fault is None
    finally:
        broker.kill()
