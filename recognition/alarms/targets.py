"""What delivers a message to one place, and how it says that it could not."""

from __future__ import annotations

from typing import Protocol

from recognition.alarms.messages import Message


class DeliveryError(Exception):
    """An attempt failed; the text says why, in words that anybody may read."""


class UnreachableError(DeliveryError):
    """It may succeed later."""


class RefusedError(DeliveryError):
    """The target will never take this message, whatever it does with others."""


class Target(Protocol):
    """One place; every method is called by one thread, takes a bounded time and raises only :class:`DeliveryError`."""

    name: str
    """As the alarms file has it."""

    def send(self, message: Message) -> None:
        """Deliver an event; it has arrived when this returns."""

    def beat(self, body: str) -> None:
        """Deliver a heartbeat."""

    def close(self, *, in_order: bool) -> None:
        """Let go of the connection; ``in_order`` where the last word was said, so that nobody need miss it."""
