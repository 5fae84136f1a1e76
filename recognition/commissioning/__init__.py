"""Commissioning: whether the rules work on a new site, with its people and its networks, before anybody relies on them.

A scripted walk of ten minutes brings about what each rule forbids, and what looks like it and is allowed. A rule
passes where every violation is found within two seconds and nothing is found while all is safe. The outcome is a
record, which holds the digests of the rules, of the rig and of the networks: where one of them changes it stands for
nothing any more, and ``recognition run`` says so.
"""

from recognition.commissioning.deriving import derived_walk
from recognition.commissioning.record import (
    CommissionRecord,
    Network,
    networks_of,
    read_record,
    record_of,
    write_record,
)
from recognition.commissioning.results import RuleResult, StepResult, results_of
from recognition.commissioning.standing import STANDING_KEY, Standing, record_beside, standing_of
from recognition.commissioning.walk import (
    Performed,
    Step,
    Walk,
    as_done,
    by_the_clock,
    load_walk,
    require_suited,
    walk_text,
)
from recognition.commissioning.walking import walked
from recognition.commissioning.witness import Glance, Witness

__all__ = [
    "STANDING_KEY",
    "CommissionRecord",
    "Glance",
    "Network",
    "Performed",
    "RuleResult",
    "Standing",
    "Step",
    "StepResult",
    "Walk",
    "Witness",
    "as_done",
    "by_the_clock",
    "derived_walk",
    "load_walk",
    "networks_of",
    "read_record",
    "record_beside",
    "record_of",
    "require_suited",
    "results_of",
    "standing_of",
    "walk_text",
    "walked",
    "write_record",
]
