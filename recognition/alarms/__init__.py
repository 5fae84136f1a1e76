"""Alarms: events to whoever must act on them, heartbeats so that silence tells nothing false, and operators' answers.

>>> options = load_alarms(Path("hall-3.alarms.toml"), os.environ)  # doctest: +SKIP
>>> with Alarms(options, Path("OUT.mcap"), announce=print) as alarms:  # doctest: +SKIP
...     alarms.heartbeat(scene.status, scene.reason, scene.t_ns)
...     alarms.raise_(event)
"""

from recognition.alarms.answers import Answer, Answers, Subject, append_answer, find_subject, read_answers
from recognition.alarms.backoff import RetryOptions
from recognition.alarms.delivery import TargetStatus
from recognition.alarms.identities import ShiftNames
from recognition.alarms.options import AlarmOptions, MqttOptions, WebhookOptions, load_alarms
from recognition.alarms.places import ALARMS_SUFFIX, ANSWERS_SUFFIX, beside, recording_named
from recognition.alarms.service import Alarms

__all__ = [
    "ALARMS_SUFFIX",
    "ANSWERS_SUFFIX",
    "AlarmOptions",
    "Alarms",
    "Answer",
    "Answers",
    "MqttOptions",
    "RetryOptions",
    "ShiftNames",
    "Subject",
    "TargetStatus",
    "WebhookOptions",
    "append_answer",
    "beside",
    "find_subject",
    "load_alarms",
    "read_answers",
    "recording_named",
]
