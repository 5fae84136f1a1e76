"""What tests of alarms need: events, an HTTP server that misbehaves on order, and waiting for what threads do."""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from recognition.alarms import AlarmOptions, RetryOptions, load_alarms
from recognition.events import Actor, Event, Margin

T0 = 1_795_000_000_000_000_000
"""2026-11-18T11:06:40Z."""
SECOND = 1_000_000_000
QUICK = RetryOptions(first_s=0.01, longest_s=0.1)
HEAD = 'format = "recognition.alarms"\nversion = 1\nsite = "hall-3"\n'


def event(name="e1", *, t_s=0.0, end_s=None, rule="no_hat", worker=7, severity="alarm", now_s=None) -> Event:
    start_ns = T0 + round(t_s * SECOND)
    latest_s = now_s if now_s is not None else end_s if end_s is not None else t_s
    return Event(
        event_id=name,
        rule=rule,
        sentence="a worker wears no hard hat",
        severity=severity,
        start_ns=start_ns,
        raised_ns=start_ns + 300_000_000,
        end_ns=None if end_s is None else T0 + round(end_s * SECOND),
        actors=(Actor("worker", worker, "w"),),
        margins=(Margin(start_ns, float("nan")), Margin(T0 + round(latest_s * SECOND), 0.4)),
        cameras=("cam0", "cam1"),
        confidence=1.0,
        status="MONITORED",
        rules_digest="sha256:1",
        rig_digest="sha256:2",
        rig_verdict="PASS",
        caveats=("not validated on real people",),
    )


def options_of(folder: Path, text: str, **environment: str) -> AlarmOptions:
    path = folder / "hall-3.alarms.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return load_alarms(path, environment)


def webhook(server: HttpServer, *, name="room", timeout_s=0.3, more="") -> str:
    return f'[[webhooks]]\nname = "{name}"\nurl = "{server.url}"\ntimeout_s = {timeout_s}\n{more}\n'


def wait_for(is_so, *, within_s=5.0) -> None:
    until_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < until_s, "it did not happen in time"
        time.sleep(0.005)


class Announcements(list):
    """What operators are told, as ``level: text``."""

    def __call__(self, level: str, text: str) -> None:
        self.append(f"{level}: {text}")


class HttpServer:
    """Takes alarms on loopback; ``status`` is what it answers, ``stalls`` whether it answers at all."""

    def __init__(self) -> None:
        self.status, self.stalls, self.refuses_beats = 200, False, False
        self.attempts: list[dict] = []
        self.taken: list[dict] = []
        self.headers: list[dict[str, str]] = []
        self._port = 0
        self._released = threading.Event()
        self.open()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._port}/hook/secret-path"

    def open(self) -> None:
        """Begin to listen, on the port as before."""
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                outer.take(self)

            def log_message(self, *args) -> None:
                pass

        ThreadingHTTPServer.allow_reuse_address = True
        self._server = ThreadingHTTPServer(("127.0.0.1", self._port), Handler)
        self._server.daemon_threads = True
        self._port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,))
        self._thread.start()

    def close(self) -> None:
        """Listen no more: connections are refused."""
        self._released.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def take(self, request: BaseHTTPRequestHandler) -> None:
        document = json.loads(request.rfile.read(int(request.headers["Content-Length"])))
        self.attempts.append(document)
        self.headers.append(dict(request.headers.items()))
        if self.stalls:
            self._released.wait(5)
            return
        is_refused = self.refuses_beats and document["format"] == "recognition.heartbeat"
        status = 422 if is_refused else self.status
        if status == 200:
            self.taken.append(document)
        request.send_response(status)
        request.send_header("Location", self.url)
        request.end_headers()

    @property
    def events(self) -> list[str]:
        """The events that were taken, in order."""
        return [one["message_id"] for one in self.taken if one["format"] == "recognition.alarm"]

    @property
    def beats(self) -> list[dict]:
        return [one for one in self.taken if one["format"] == "recognition.heartbeat"]
