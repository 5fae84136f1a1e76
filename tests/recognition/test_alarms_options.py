"""Alarms files: every mistake is named by its entry, and nothing out of the file is ever shown."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import HEAD, options_of

from recognition.alarms import RetryOptions, load_alarms
from recognition.alarms.backoff import Backoff
from recognition.errors import AlarmsError
from rigcal.errors import OptionError

HOOK = '[[webhooks]]\nname = "room"\nurl = "https://alarms.example/hook"\n'
BROKER = '[[mqtt]]\nname = "sirens"\nhost = "broker.example"\ntopic = "hall-3/safety"\n'


def test_what_a_file_says_is_understood(tmp_path):
    options = options_of(
        tmp_path,
        'heartbeat_s = 5\nshifts = ["06:00", "14:00"]\ntime_zone = "Europe/Berlin"\n'
        + HOOK
        + 'headers = { Authorization = "Bearer ${TOKEN}" }\n'
        + BROKER
        + 'tls = true\nusername = "site"\npassword = "${BROKER_PASSWORD}"\n',
        TOKEN="t0ken",
        BROKER_PASSWORD="hunter2",
    )
    assert options.webhooks[0].headers["Authorization"].get_secret_value() == "Bearer t0ken"
    assert options.webhooks[0].shown == "https://alarms.example"
    assert options.mqtt[0].password.get_secret_value() == "hunter2"
    assert options.mqtt[0].shown == "mqtts://broker.example:8883"
    assert [f"{start:%H:%M}" for start in options.shifts] == ["06:00", "14:00"]
    assert options.queue == tmp_path / "hall-3.alarms.queue"
    assert "hunter2" not in repr(options)
    assert "t0ken" not in repr(options)


def test_paths_in_the_file_are_relative_to_it(tmp_path):
    (tmp_path / "ca.pem").touch()
    options = options_of(tmp_path, 'queue = "../waiting"\n' + BROKER + 'tls = true\nca_file = "ca.pem"\n')
    assert options.queue == tmp_path / "../waiting"
    assert options.mqtt[0].ca_file == tmp_path / "ca.pem"


def test_the_example_of_the_documentation_is_right(tmp_path):
    from recognition.alarms import options as module

    example = module.__doc__.split("::\n", 1)[1].split("``${NAME}``")[0].replace("\n    ", "\n")
    path = tmp_path / "hall-3.alarms.toml"
    path.write_text(example)
    assert load_alarms(path, {"ALARMS_TOKEN": "a", "BROKER_PASSWORD": "b"}).site == "hall-3"
    assert tomllib.loads(example)["format"] == "recognition.alarms"


def test_the_example_file_is_right():
    path = Path(__file__).parents[2] / "rig_configs" / "example.alarms.toml"
    options = load_alarms(path, {"ALARMS_TOKEN": "a", "BROKER_PASSWORD": "b"})
    assert [target.name for target in (*options.webhooks, *options.mqtt)] == ["control-room", "sirens"]


SECRET = "hunter2"
MISTAKES = {
    "unknown": (HOOK + f'pasword = "{SECRET}"', "webhooks[0].pasword", "unknown"),
    "severity": (HOOK + f'severity = "{SECRET}"', "webhooks[0].severity", "'info', 'warning' or 'alarm'"),
    "login in address": (f'[[webhooks]]\nname = "a"\nurl = "https://u:{SECRET}@h/"', "webhooks[0].url", "no login"),
    "scheme": (f'[[webhooks]]\nname = "a"\nurl = "ftp://{SECRET}"', "webhooks[0].url", "https://HOST/PATH"),
    "port": (f'[[webhooks]]\nname = "a"\nurl = "http://h:{SECRET}"', "webhooks[0].url", "https://HOST/PATH"),
    "space": (f'[[webhooks]]\nname = "a"\nurl = "http://h/ {SECRET}"', "webhooks[0].url", "without spaces"),
    "header": (HOOK + f'headers = {{ A = "{SECRET}\\n" }}', "webhooks[0].headers", "on one line"),
    "timeout": (HOOK + "timeout_s = 0", "webhooks[0].timeout_s", "greater than 0"),
    "no url": ('[[webhooks]]\nname = "a"', "webhooks[0].url", "add webhooks[0].url"),
    "name": (f'[[webhooks]]\nname = "../{SECRET}"\nurl = "http://h"', "webhooks[0].name", "match pattern"),
    "topic": (BROKER.replace("hall-3/safety", f"{SECRET}/#"), "mqtt[0].topic", "match pattern"),
    "username": (BROKER + 'password = "${SET}"', "mqtt[0]", "a password needs a username"),
    "ca_file": (BROKER + 'ca_file = "ca.pem"', "mqtt[0]", "ca_file needs tls = true"),
    "ca_file absent": (BROKER + 'tls = true\nca_file = "ca.pem"', "ca_file", "no file"),
    "same names": (HOOK + BROKER.replace("sirens", "room"), "(top level)", "names of targets are expected to differ"),
    "no target": ("", "(top level)", "at least one [[webhooks]] or [[mqtt]]"),
    "zone": ('time_zone = "Mars/Base"\n' + HOOK, "time_zone", "Europe/Berlin"),
    "shifts": ('shifts = ["14:00", "06:00"]\n' + HOOK, "shifts", "in order of the day"),
    "heartbeat": ("heartbeat_s = 0.1\n" + HOOK, "heartbeat_s", "0.1"),
    "variable": (BROKER + 'username = "a"\npassword = "${UNSET}"', "mqtt[0].password", "a variable UNSET"),
    "written out": (BROKER + f'username = "a"\npassword = "{SECRET}"', "mqtt[0].password", "reference to a variable"),
    "not TOML": (HOOK + f'password = "{SECRET}\n', "line 7", "mend that line"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_no_text_of_the_file_is_shown(tmp_path, name):
    text, entry, said = MISTAKES[name]
    with pytest.raises(AlarmsError) as caught:
        options_of(tmp_path, text, SET="x")
    assert entry in caught.value.where
    assert said in str(caught.value)
    assert SECRET not in str(caught.value)


def test_another_format_or_version_is_refused(tmp_path):
    for old, new, entry in (("recognition.alarms", "other", "format"), ("version = 1", "version = 2", "version")):
        path = tmp_path / "x.toml"
        path.write_text(HEAD.replace(old, new) + HOOK)
        with pytest.raises(AlarmsError, match=entry):
            load_alarms(path, {})


def test_a_file_that_is_not_there_is_an_error_that_says_so(tmp_path):
    with pytest.raises(AlarmsError) as caught:
        load_alarms(tmp_path / "none.toml", {})
    assert str(caught.value).splitlines()[0] == "cannot read the alarms file"
    assert caught.value.got == "No such file or directory"


def test_waits_grow_to_the_longest_vary_and_begin_again_after_a_success():
    backoff = Backoff(RetryOptions(first_s=1, longest_s=8, seed=3), "room")
    waits = [backoff.next_s() for _ in range(200)]
    for wait, longest in zip(waits, [1, 2, 4, *[8] * 197], strict=True):
        assert longest / 2 <= wait <= longest
    assert len(set(waits)) == 200
    backoff.reset()
    assert backoff.next_s() <= 1


def test_the_same_seed_gives_the_same_waits_and_each_target_its_own():
    def waits(seed: int, name: str) -> list[float]:
        backoff = Backoff(RetryOptions(seed=seed), name)
        return [backoff.next_s() for _ in range(5)]

    assert waits(1, "a") == waits(1, "a")
    assert waits(1, "a") != waits(1, "b")
    assert waits(1, "a") != waits(2, "a")


@pytest.mark.parametrize("first_s", [0, -1, 61])
def test_waits_out_of_order_are_refused(first_s):
    with pytest.raises(OptionError, match="first_s"):
        RetryOptions(first_s=first_s)
