"""The alarms file ``NAME.alarms.toml``: who is told of events, and how.

::

    format = "recognition.alarms"
    version = 1
    site = "hall-3"
    heartbeat_s = 10.0                         # every so often everybody is told whether the site is monitored
    shifts = ["06:00", "14:00", "22:00"]       # workers are numbered anew in each
    time_zone = "Europe/Berlin"                # of the shifts

    [[webhooks]]
    name = "control-room"
    url = "https://alarms.example/hook"
    headers = { Authorization = "Bearer ${ALARMS_TOKEN}" }

    [[mqtt]]
    name = "sirens"
    host = "broker.example"
    topic = "hall-3/safety"                    # hall-3/safety/events and hall-3/safety/heartbeat
    tls = true
    username = "recognition"
    password = "${BROKER_PASSWORD}"

``${NAME}`` is a variable of the environment. Decision: this is a file of its own rather than a table of the site file,
which is copied into reports and shared between those who calibrate; a password may be written in neither, so that only
a reference is accepted for it. No message of this module shows a text out of the file, for any might be a secret that
stands under a mistyped name: it names the entry and says what is expected there.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from datetime import time
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    SecretStr,
    ValidationError,
    field_validator,
    model_validator,
)

from recognition.errors import AlarmsError

FORMAT, VERSION, SUFFIX = "recognition.alarms", 1, ".alarms.toml"
_REFERENCE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")
_CONTROLS = re.compile(r"[\x00-\x1f\x7f]")

Severity = Literal["info", "warning", "alarm"]
_FROM_LEAST = ("info", "warning", "alarm")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)


class _TargetOptions(_Strict):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    """What it is called in messages, and its file in the queue."""
    severity: Severity = "warning"
    """Events below this are not sent."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 10.0
    """An attempt fails that took longer."""


class WebhookOptions(_TargetOptions):
    """An address that takes HTTP POST with JSON."""

    url: SecretStr
    headers: dict[str, SecretStr] = {}

    @field_validator("url")
    @classmethod
    def _usable_url(cls, value: SecretStr) -> SecretStr:
        try:
            parts = urlsplit(value.get_secret_value())
            is_good = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:  # a port that is no number, an address that is no IPv6
            is_good = False
        if not is_good or not value.get_secret_value().isascii() or re.search(r"\s", value.get_secret_value()):
            raise ValueError("http://HOST/PATH or https://HOST/PATH is expected, in ASCII, without spaces")
        if parts.username is not None:
            raise ValueError("no login may stand in an address; give it as headers.Authorization")
        return value

    @field_validator("headers")
    @classmethod
    def _usable_headers(cls, value: dict[str, SecretStr]) -> dict[str, SecretStr]:
        for name, content in value.items():
            text = content.get_secret_value()
            if not re.fullmatch(r"[A-Za-z0-9-]+", name) or not text.isascii() or _CONTROLS.search(text):
                raise ValueError("headers are ASCII on one line; a variable may hold a line end that must go")
        return value

    @property
    def shown(self) -> str:
        """The address as it may be shown: a path can be a secret."""
        parts = urlsplit(self.url.get_secret_value())
        return f"{parts.scheme}://{parts.hostname}{'' if parts.port is None else f':{parts.port}'}"


class MqttOptions(_TargetOptions):
    """A broker of MQTT 5."""

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    topic: Annotated[str, Field(pattern=r"^[^+#\x00$/][^+#\x00]*[^+#\x00/]$")]
    """``TOPIC/events`` has the events, ``TOPIC/heartbeat`` whether the site is monitored, retained."""
    tls: bool = False
    ca_file: Path | None = None
    """Certificates that the broker's is signed with; None: those of the system."""
    username: SecretStr | None = None
    password: SecretStr | None = None

    @model_validator(mode="after")
    def _consistent(self) -> MqttOptions:
        if self.password is not None and self.username is None:
            raise ValueError("a password needs a username")
        if self.ca_file is not None and not self.tls:
            raise ValueError("ca_file needs tls = true")
        return self

    @property
    def shown(self) -> str:
        """The broker, as it may be shown."""
        return f"{'mqtts' if self.tls else 'mqtt'}://{self.host}:{self.open_port}"

    @property
    def open_port(self) -> int:
        """The port, MQTT's own where none is given."""
        return self.port or (8883 if self.tls else 1883)


class AlarmOptions(_Strict):
    """Everything that an alarms file says."""

    format: Literal["recognition.alarms"]
    version: Literal[1]
    site: Annotated[str, Field(min_length=1)]
    heartbeat_s: Annotated[float, Field(ge=1, le=300)] = 10.0
    silence_s: PositiveFloat = 5.0
    """When the run has not said for so long how the site is monitored, it is NOT MONITORED."""
    shifts: Annotated[tuple[time, ...], Field(min_length=1)] = (time(0, 0),)
    time_zone: str = "UTC"
    queue: Path | None = None
    """Folder of what waits to be sent; None: ``NAME.alarms.queue`` beside the file."""
    most_waiting: Annotated[int, Field(ge=10, le=1_000_000)] = 10_000
    """Messages per target; of more, the oldest are given up and counted as lost."""
    webhooks: tuple[WebhookOptions, ...] = ()
    mqtt: tuple[MqttOptions, ...] = ()

    @field_validator("time_zone")
    @classmethod
    def _known_zone(cls, value: str) -> str:
        try:
            ZoneInfo(value)
        except (KeyError, ValueError, OSError) as error:
            raise ValueError("a name of the time zone database is expected, such as Europe/Berlin") from error
        return value

    @field_validator("shifts")
    @classmethod
    def _in_order(cls, value: tuple[time, ...]) -> tuple[time, ...]:
        if list(value) != sorted(set(value)):
            raise ValueError("the starts of the shifts are expected in order of the day, each once")
        return value

    @model_validator(mode="after")
    def _targets(self) -> AlarmOptions:
        names = [target.name for target in (*self.webhooks, *self.mqtt)]
        if not names:
            raise ValueError("at least one [[webhooks]] or [[mqtt]] is expected")
        if len(set(names)) != len(names):
            raise ValueError("names of targets are expected to differ")
        return self


def gravity_of(severity: str) -> int:
    """How grave a severity is, from 0; one that nobody knows is as grave as can be."""
    return _FROM_LEAST.index(severity) if severity in _FROM_LEAST else len(_FROM_LEAST)


def load_alarms(path: Path, environment: Mapping[str, str]) -> AlarmOptions:
    """Read an alarms file.

    Args:
        path: The file.
        environment: Where ``${NAME}`` is looked up, ``os.environ``.

    Returns:
        Its options, with the paths in it made relative to its folder.

    Raises:
        AlarmsError: where it is absent, no TOML, has a missing, unknown or malformed entry, a password that is written
            out, or a reference to a variable that is not set.
    """
    data = _toml(path)
    _require_references(path, data)
    try:
        options = AlarmOptions.model_validate(_filled(data, path, environment, ""))
    except ValidationError as error:
        raise _mistake(path, error) from error
    name = path.name.removesuffix(SUFFIX).removesuffix(".toml")
    queue = path.parent / (options.queue or f"{name}.alarms.queue")
    brokers = tuple(
        broker.model_copy(update={"ca_file": path.parent / broker.ca_file}) if broker.ca_file else broker
        for broker in options.mqtt
    )
    for broker in brokers:
        if broker.ca_file is not None and not broker.ca_file.is_file():
            raise AlarmsError(
                f"the certificates of {broker.name} are not there",
                where=f"{path}, ca_file",
                expected="a file of certificates in PEM, relative to the alarms file",
                got=f"no file {broker.ca_file}",
                do_next="mend the path",
            )
    return options.model_copy(update={"queue": queue, "mqtt": brokers})


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise AlarmsError(
            "cannot read the alarms file",
            where=path,
            expected="a file that says who is told of events",
            got=error.strerror,
            do_next="check the path of --alarms and its permissions",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        place = re.search(r"at (line \d+, column \d+|end of document)", str(error))
        raise AlarmsError(
            "the alarms file is not TOML",
            where=path if place is None else f"{path}, {place[1]}",
            expected="TOML text in UTF-8",
            do_next="mend that line",
        ) from None


def _require_references(path: Path, data: dict[str, Any]) -> None:
    """A password that is written out would be copied with the file."""
    brokers = data.get("mqtt")
    for index, broker in enumerate(brokers if isinstance(brokers, list) else []):
        password = broker.get("password") if isinstance(broker, dict) else None
        if isinstance(password, str) and not _REFERENCE.fullmatch(password):
            raise AlarmsError(
                "a password is written into the alarms file",
                where=f"{path}, mqtt[{index}].password",
                expected='a reference to a variable of the environment, password = "${BROKER_PASSWORD}"',
                got="something else",
                do_next="set such a variable where the run is started, and change the password if others saw the file",
            )


def _filled(value: Any, path: Path, environment: Mapping[str, str], entry: str) -> Any:
    """The same with the variables of the environment put in."""
    if isinstance(value, dict):
        return {k: _filled(v, path, environment, f"{entry}.{k}" if entry else k) for k, v in value.items()}
    if isinstance(value, list):
        return [_filled(v, path, environment, f"{entry}[{i}]") for i, v in enumerate(value)]
    if not isinstance(value, str):
        return value
    missing = [name for name in _REFERENCE.findall(value) if not environment.get(name)]
    if missing:
        raise AlarmsError(
            "the alarms file refers to a variable of the environment that is not set",
            where=f"{path}, {entry}",
            expected=f"a variable {missing[0]}",
            got="none, or an empty one",
            do_next=f"set {missing[0]} where the run is started",
        )
    return _REFERENCE.sub(lambda match: environment[match[1]], value)


def _mistake(path: Path, error: ValidationError) -> AlarmsError:
    first = error.errors(include_url=False, include_context=False, include_input=True)[0]
    entry = ""
    for part in first["loc"]:
        entry += f"[{part}]" if isinstance(part, int) else f".{part}" if entry else part
    message, found = first["msg"].removeprefix("Value error, "), first["input"]
    is_unknown, is_missing = first["type"] == "extra_forbidden", first["type"] == "missing"
    return AlarmsError(
        f"the alarms file has {'an unknown' if is_unknown else 'no' if is_missing else 'a bad'} entry",
        where=f"{path}, {entry or '(top level)'}",
        expected="only the entries that the documentation names" if is_unknown else message,
        got=str(found) if isinstance(found, (bool, int, float)) else None if is_missing else _kind(found),
        do_next=f"add {entry}" if is_missing else f"mend or remove {entry or 'what it says'}",
    )


def _kind(found: Any) -> str:
    """What was found, without its text."""
    kinds = {str: "a text", dict: "a table", list: "a list"}
    return next((name for kind, name in kinds.items() if isinstance(found, kind)), "something else")
