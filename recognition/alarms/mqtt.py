"""Events and heartbeats to a broker of MQTT 5, through paho-mqtt.

``TOPIC/events`` has the events, ``TOPIC/heartbeat`` whether the site is monitored. The latter is retained, so that
whoever subscribes learns it at once, and it is the connection's last will: when this process dies the broker itself
says NOT MONITORED, at once where the connection breaks, else after one and a half heartbeats. The time in a will is
that at which it was left.

Decision: quality of service 1, one message at a time, each taken by the broker before the next. That keeps the order
and needs no state beside the queue on disk; 2 would need the broker and the client to agree on what was in flight when
either was killed, which paho-mqtt keeps in memory only. A lost connection is never repaired by the library, which would
send again by itself: a new client is made, says how the site is monitored and goes on. What was given up is ended
with the request to say the will, since nobody knows when the next connection stands.

Decision: an event that the broker takes but has nobody to give to (reason code 16) was not delivered, and waits.
"""

from __future__ import annotations

import ssl
import threading
import time
from collections.abc import Callable
from math import ceil

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTv5
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from recognition.alarms.messages import Message
from recognition.alarms.options import MqttOptions
from recognition.alarms.targets import UnreachableError

QOS = 1
NOBODY_LISTENS = 0x10
WITH_WILL = 0x04


class Mqtt:
    """The target of a ``[[mqtt]]`` entry."""

    def __init__(self, options: MqttOptions, *, heartbeat_s: float, will: Callable[[], str]) -> None:
        """Connect with the first message.

        Args:
            options: The broker.
            heartbeat_s: How often it will hear something.
            will: The heartbeat that the broker is to say when the connection ends without being closed.
        """
        self.name = options.name
        self._options, self._keepalive_s, self._will = options, ceil(heartbeat_s), will
        self._link: _Link | None = None

    def send(self, message: Message) -> None:
        """Publish an event.

        Raises:
            UnreachableError: where the broker cannot be reached, refuses, or has nobody to give it to.
        """
        self._publish("events", message.body, is_retained=False)

    def beat(self, body: str) -> None:
        """Publish a heartbeat; raises as :meth:`send`, but nobody need listen."""
        self._publish("heartbeat", body, is_retained=True)

    def close(self, *, in_order: bool) -> None:
        """End the connection; unless in order, the broker says the will."""
        if self._link is not None:
            self._link.close(with_will=not in_order)
            self._link = None

    def _publish(self, topic: str, body: str, *, is_retained: bool) -> None:
        topic = f"{self._options.topic}/{topic}"
        try:
            self._link = self._link or _Link(self._options, self._keepalive_s, self._will())
            code = self._link.publish(topic, body, is_retained=is_retained)
        except UnreachableError:
            self.close(in_order=False)
            raise
        if code.is_failure:
            raise UnreachableError(f"{self._options.shown} refuses what is published to {topic}: {code}")
        if code.value == NOBODY_LISTENS and not is_retained:
            raise UnreachableError(f"{self._options.shown} has nobody who listens to {topic}")


class _Link:
    """One connection, from its making to its end; every method raises :class:`UnreachableError`."""

    def __init__(self, options: MqttOptions, keepalive_s: int, will: str) -> None:
        self._options = options
        self._changed = threading.Condition()
        self._connected: ReasonCode | None = None
        self._lost: str | None = None
        self._taken: dict[int, ReasonCode] = {}
        try:
            self._client = self._made(will)
            self._client.connect(options.host, options.open_port, keepalive=keepalive_s)
        except (OSError, ValueError) as error:  # ValueError: a name that no host can have
            words = "timed out" if isinstance(error, TimeoutError) else getattr(error, "strerror", None)
            raise UnreachableError(f"{options.shown} cannot be reached: {words or type(error).__name__}") from None
        self._client.loop_start()
        try:
            code = self._awaited(lambda: self._connected)
            if code.is_failure:
                raise UnreachableError(f"{options.shown} refuses the connection: {code}")
        except UnreachableError:
            self.close(with_will=False)
            raise

    def publish(self, topic: str, body: str, *, is_retained: bool) -> ReasonCode:
        """Hand a message over; returns what the broker says of it."""
        sent = self._client.publish(topic, body.encode(), qos=QOS, retain=is_retained)
        if sent.rc != MQTTErrorCode.MQTT_ERR_SUCCESS:
            raise self._gone("the connection was lost")
        return self._awaited(lambda: self._taken.pop(sent.mid, None))

    def close(self, *, with_will: bool) -> None:
        """End the connection where it still stands; the broker says the will, or forgets it."""
        self._client.disconnect(reasoncode=ReasonCode(PacketTypes.DISCONNECT, identifier=WITH_WILL if with_will else 0))
        self._client.loop_stop()

    def _awaited(self, answer: Callable[[], ReasonCode | None]) -> ReasonCode:
        until_s = time.monotonic() + self._options.timeout_s
        with self._changed:
            while True:
                code = answer()
                if code is not None:
                    return code
                left_s = until_s - time.monotonic()
                if self._lost is not None or left_s <= 0:
                    raise self._gone(self._lost or f"no answer within {self._options.timeout_s:g} s")
                self._changed.wait(left_s)

    def _gone(self, why: str) -> UnreachableError:
        return UnreachableError(f"{self._options.shown}: {why}")

    def _made(self, will: str) -> Client:
        options = self._options
        client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTv5, reconnect_on_failure=False)
        client.connect_timeout = options.timeout_s
        client.will_set(f"{options.topic}/heartbeat", will.encode(), qos=QOS, retain=True)
        if options.tls:
            client.tls_set_context(ssl.create_default_context(cafile=options.ca_file))
        if options.username is not None:
            password = None if options.password is None else options.password.get_secret_value()
            client.username_pw_set(options.username.get_secret_value(), password)
        client.on_connect, client.on_disconnect, client.on_publish = (
            self._on_connect,
            self._on_disconnect,
            self._on_taken,
        )
        return client

    def _on_connect(
        self, _client: Client, _data: object, _flags: ConnectFlags, code: ReasonCode, _properties: Properties | None
    ) -> None:
        with self._changed:
            self._connected = code
            self._changed.notify_all()

    def _on_disconnect(
        self, _client: Client, _data: object, _flags: DisconnectFlags, code: ReasonCode, _properties: Properties | None
    ) -> None:
        with self._changed:
            self._lost = f"the connection was lost: {code}"
            self._changed.notify_all()

    def _on_taken(
        self, _client: Client, _data: object, mid: int, code: ReasonCode, _properties: Properties | None
    ) -> None:
        with self._changed:
            self._taken[mid] = code
            self._changed.notify_all()
