"""Alarms of a run: what it raises reaches every target, and silence never passes for safety.

The run calls :meth:`Alarms.raise_` and :meth:`Alarms.heartbeat`, which only put down what is to be said: neither a disk
nor a network holds them up. Behind them stand one thread per target, which delivers, and the keeper, which minds the
disk.
"""

from __future__ import annotations

import time
import uuid
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self
from zoneinfo import ZoneInfo

from recognition.alarms.backoff import RetryOptions
from recognition.alarms.delivery import Announce, Delivery, TargetStatus
from recognition.alarms.identities import ShiftNames
from recognition.alarms.keeper import Keeper
from recognition.alarms.messages import Health, Origin, event_message, heartbeat
from recognition.alarms.mqtt import Mqtt
from recognition.alarms.options import AlarmOptions, gravity_of
from recognition.alarms.pulse import DIED, Pulse
from recognition.alarms.queues import QueueFolder
from recognition.alarms.register import Register, Word
from recognition.alarms.targets import Target
from recognition.alarms.waiting import Waiting
from recognition.alarms.webhook import Webhook
from recognition.events import Event

if TYPE_CHECKING:
    from recognition.observations import Status

CLOSING_S = 5.0
"""How long the end of a run waits for what can still be delivered; the rest waits on disk for the next run."""
MISSED_BEATS = 3
"""After how many heartbeats that do not come a receiver is told to take the site as NOT MONITORED."""


class Alarms:
    """Tells every target of an alarms file what a run raises; a context manager.

    ``raise_`` and ``heartbeat`` are for the thread that judges, ``status`` for any. Where the block ends by an error,
    the targets are told that the run has failed.
    """

    def __init__(
        self, options: AlarmOptions, recording: Path, *, announce: Announce, retry: RetryOptions | None = None
    ) -> None:
        """Open the queue and take up what an earlier run could not deliver.

        Args:
            options: From :func:`recognition.alarms.load_alarms`, which names the queue.
            recording: ``NAME.mcap``, as the run records it; answers and the note of what was raised stand beside it.
            announce: Told when a target cannot be reached, and when it can again; called by several threads.
            retry: How soon what failed is tried again.

        Raises:
            AlarmsError: where the queue cannot be written, or another run uses it.
        """
        if options.queue is None:
            raise ValueError("options without a queue: read them with load_alarms")
        self._origin = Origin(options.site, uuid.uuid4().hex[:12])
        self._next_within_s = MISSED_BEATS * options.heartbeat_s
        self._names = ShiftNames(options.shifts, ZoneInfo(options.time_zone))
        self._pulse = Pulse(options.silence_s)
        self._register = Register()
        targets = self._targets(options)
        self._folder = QueueFolder(options.queue)
        self._queues = [self._folder.open(target.name, most=options.most_waiting) for target in targets]
        self._least = [gravity_of(one.severity) for one in (*options.webhooks, *options.mqtt)]
        self._keeper = Keeper(self._queues, recording, announce)
        self._deliveries = [
            Delivery(
                target,
                queue,
                self._pulse,
                self._composed,
                heartbeat_s=options.heartbeat_s,
                retry=retry or RetryOptions(),
                done=self._keeper.wake,
                announce=announce,
            )
            for target, queue in zip(targets, self._queues, strict=True)
        ]
        self._announce_what_waited(targets, self._queues, announce)

    def __enter__(self) -> Self:
        self._keeper.start()
        for delivery in self._deliveries:
            delivery.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._pulse.end(has_failed=kind is not None)
        until_s = time.monotonic() + CLOSING_S
        for delivery in self._deliveries:
            delivery.stop(CLOSING_S)
        for delivery in self._deliveries:
            delivery.join(max(0.0, until_s - time.monotonic()))
        self._keeper.stop(CLOSING_S)
        self._folder.release()

    def raise_(self, event: Event) -> None:
        """Tell of an event that was raised, has changed or ended; never waits.

        It is sent when it is raised and when it ends. While it is muted it is only noted; one that lasts longer than
        its mute is sent with the first heartbeat after.
        """
        for word in self._register.see(event, self._keeper.answers):
            self._say(word)

    def heartbeat(self, status: Status, reason: str, t_ns: int) -> None:
        """Say how the site is monitored, at every instant; never waits.

        Another status than before is passed on at once, and so is it when nothing was said for the time that the alarms
        file states.

        Args:
            status: Of the scene.
            reason: Why it is not MONITORED, in words.
            t_ns: The instant, rig time in nanoseconds: what mutes end by.
        """
        for word in self._register.due(t_ns, self._keeper.answers):
            self._say(word)
        if self._pulse.beat(status, reason):
            for delivery in self._deliveries:
                delivery.wake()

    @property
    def status(self) -> tuple[TargetStatus, ...]:
        """How the targets do, in the order of the file, webhooks first."""
        return tuple(delivery.status for delivery in self._deliveries)

    def _targets(self, options: AlarmOptions) -> list[Target]:
        brokers = [
            Mqtt(broker, heartbeat_s=options.heartbeat_s, will=lambda: self._composed(DIED, 0, 0))
            for broker in options.mqtt
        ]
        return [*map(Webhook, options.webhooks), *brokers]

    def _announce_what_waited(self, targets: list[Target], queues: list[Waiting], announce: Announce) -> None:
        for target, queue in zip(targets, queues, strict=True):
            if len(queue):
                announce("info", f"{target.name}: {len(queue)} messages of an earlier run are sent now")
        for file in self._folder.strangers({target.name for target in targets}):
            announce("warning", f"{file} is of a target that the alarms file does not name; what waits there stays")

    def _composed(self, health: Health, waiting: int, lost: int) -> str:
        return heartbeat(
            health,
            self._origin,
            at_ns=time.time_ns(),
            next_within_s=self._next_within_s,
            waiting=waiting,
            lost=lost,
        )

    def _say(self, word: Word) -> None:
        if word.is_new:
            self._keeper.note(word)
        if not word.is_told:
            return
        message = event_message(word.event, word.phase, self._origin, self._names)
        gravity = gravity_of(word.event.severity)
        for least, queue, delivery in zip(self._least, self._queues, self._deliveries, strict=True):
            if gravity >= least:
                queue.put(message)
                delivery.wake()
        self._keeper.wake()
