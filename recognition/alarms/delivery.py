"""One thread per target: what waits is delivered in order, and in between whether the site is monitored.

A target that fails holds up only itself. Its events are tried again with longer and longer waits, for ever; the first
stays the first, so that the order is kept. Heartbeats are tried again by themselves, at least as often as the alarms
file says: a target that takes only one of the two gets that one. A change of status is said at once, before anything
that waits, and after a failure a heartbeat goes first, because somebody may hold the site for dead.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from recognition.alarms.backoff import Backoff, RetryOptions
from recognition.alarms.messages import Health
from recognition.alarms.pulse import LAST_WORDS, Pulse
from recognition.alarms.targets import DeliveryError, RefusedError, Target
from recognition.alarms.waiting import Waiting

Announce = Callable[[str, str], None]
"""Told of what an operator should know: ``warning`` or ``info``, and the text. Called by several threads."""
Compose = Callable[[Health, int, int], str]
"""A heartbeat of this health, number of waiting messages and number of lost ones."""


@dataclass(frozen=True, slots=True)
class TargetStatus:
    """How one target does."""

    name: str
    delivered: int
    """Events since the start."""
    waiting: int
    lost: int
    """Events that it will never get."""
    fault: str | None
    """Why it cannot be told; None where it can."""
    disk_fault: str | None
    """Why what waits would be lost with the process; None where it would not."""


class Delivery:
    """The thread of one target."""

    def __init__(
        self,
        target: Target,
        waiting: Waiting,
        pulse: Pulse,
        compose: Compose,
        *,
        heartbeat_s: float,
        retry: RetryOptions,
        done: Callable[[], None],
        announce: Announce,
    ) -> None:
        """Deliver from :meth:`start` to :meth:`stop`.

        Args:
            target: Where to.
            waiting: What.
            pulse: Whether the site is monitored.
            compose: Makes heartbeats.
            heartbeat_s: How often one is sent.
            retry: How soon what failed is tried again.
            done: Called when a message waits no more.
            announce: Told when the target fails and when it is back.
        """
        self._target, self._waiting, self._pulse, self._compose = target, waiting, pulse, compose
        self._heartbeat_s = heartbeat_s
        self._beat_waits = Backoff(retry, f"{target.name} heartbeat")
        self._event_waits = Backoff(retry, f"{target.name} events")
        self._on_done, self._announce = done, announce
        self._woken, self._stop_s = threading.Event(), float("inf")
        self._beat_due_s = self._retry_due_s = 0.0
        self._said: Health | None = None
        self._beat_fault: str | None = None
        self._event_fault: str | None = None
        self._delivered = 0
        self._thread = threading.Thread(target=self._run, name=f"alarms-{target.name}", daemon=True)

    def start(self) -> None:
        """Begin to deliver."""
        self._thread.start()

    def wake(self) -> None:
        """There is something new to be said; never waits."""
        self._woken.set()

    def stop(self, within_s: float) -> None:
        """Deliver what can be delivered within the time, without trying again, and end; does not wait for it."""
        self._stop_s = time.monotonic() + within_s
        self.wake()

    def join(self, timeout_s: float) -> None:
        """Wait for the end, but no longer than this: an attempt that hangs is abandoned with its process."""
        self._thread.join(timeout_s)

    @property
    def status(self) -> TargetStatus:
        """How it stands."""
        return TargetStatus(
            name=self._target.name,
            delivered=self._delivered,
            waiting=len(self._waiting),
            lost=self._waiting.lost,
            fault=self._beat_fault or self._event_fault,
            disk_fault=self._waiting.fault,
        )

    @property
    def _is_stopping(self) -> bool:
        return self._stop_s != float("inf")

    def _run(self) -> None:
        is_last_said = False
        try:
            while self._goes_on():
                self._woken.clear()
                self._step()
            is_last_said = self._said in LAST_WORDS and self._beat_fault is None
        finally:
            self._target.close(in_order=is_last_said)

    def _step(self) -> None:
        now_s, health = time.monotonic(), self._pulse.health()
        said = self._said
        is_news = said is None or health.status != said.status or (health in LAST_WORDS and health != said)
        if is_news or now_s >= self._beat_due_s:
            self._beat(health)
        elif now_s >= self._retry_due_s and len(self._waiting):
            self._send()
        elif not self._is_stopping:
            self._woken.wait(self._idle_s(now_s))

    def _goes_on(self) -> bool:
        """Until the end is asked for, and after that as long as there is something that can be said."""
        if not self._is_stopping:
            return True
        can_send = len(self._waiting) > 0 and self._event_fault is None
        return (self._said not in LAST_WORDS or can_send) and time.monotonic() < self._stop_s

    def _idle_s(self, now_s: float) -> float:
        due_s = self._beat_due_s - now_s
        if len(self._waiting):
            due_s = min(due_s, self._retry_due_s - now_s)
        silent_in_s = self._pulse.silent_in_s()
        return max(0.0, min(due_s, silent_in_s) if silent_in_s > 0 else due_s)

    def _beat(self, health: Health) -> None:
        self._said = health
        try:
            self._target.beat(self._compose(health, len(self._waiting), self._waiting.lost))
        except DeliveryError as error:
            self._beat_due_s = time.monotonic() + min(self._beat_waits.next_s(), self._heartbeat_s)
            self._beat_fault = self._told(str(error), self._beat_fault)
            return
        self._beat_due_s = time.monotonic() + self._heartbeat_s
        self._beat_waits.reset()
        if self._beat_fault is not None:
            self._beat_fault, self._retry_due_s = None, 0.0
            self._tell_when_back()

    def _send(self) -> None:
        put = self._waiting.first()
        if put is None:
            return
        is_lost = False
        try:
            self._target.send(put.message)
        except RefusedError as error:
            self._announce("warning", f"{self._target.name}: {error}: {put.message.message_id} is given up")
            is_lost = True
        except DeliveryError as error:
            self._retry_due_s = time.monotonic() + self._event_waits.next_s()
            self._beat_due_s = min(self._beat_due_s, self._retry_due_s)
            self._event_fault = self._told(str(error), self._event_fault)
            return
        self._waiting.done(put, is_lost=is_lost)
        self._delivered += not is_lost
        self._on_done()
        self._event_waits.reset()
        if self._event_fault is not None:
            self._event_fault = None
            self._tell_when_back()

    def _told(self, why: str, before: str | None) -> str:
        """The fault, announced where it is new."""
        if before is None:
            self._announce("warning", f"{self._target.name} is not told: {why}; {len(self._waiting)} wait")
        return why

    def _tell_when_back(self) -> None:
        if self._beat_fault is None and self._event_fault is None:
            self._announce("info", f"{self._target.name} is told again, {len(self._waiting)} wait")
