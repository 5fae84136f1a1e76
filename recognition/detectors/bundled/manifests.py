"""Manifests of the bundled networks.

They have no ``input``: :mod:`recognition.detectors.bundled.decode` defines it for all networks of these families.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from recognition.detectors.manifest import NetworkFacts, Strict, Text
from recognition.observations import JOINTS

PERSON, HARD_HAT = "person", "hard_hat"
"""The classes that the definition of the networks names."""
SITE_FAMILY, WORKER_FAMILY = "rigcal_site", "rigcal_worker"
Score = Annotated[float, Field(gt=0, lt=1)]


class Training(Strict):
    """How the network came about."""

    command: Text
    """What was run."""
    data: Text
    """What it was trained on: the recipe."""
    date: Text
    """When, YYYY-MM-DD."""


class BundledManifest(NetworkFacts):
    """What both manifests state."""

    notice: Text
    """What whoever uses a result must know; goes into recordings and to the terminal."""
    trained: Training


class SiteManifest(BundledManifest):
    """Manifest of a site network: people, their joints and objects in the whole image."""

    family: Literal["rigcal_site"]
    classes: Annotated[tuple[Text, ...], Field(min_length=1)]
    """Names in the order of the network's scores; the first is ``person``."""
    keypoints: dict[Text, Annotated[int, Field(ge=1, le=4)]] = Field(default_factory=dict)
    """How many keypoints the classes have that have any."""
    score_thresholds: dict[Text, Score]
    """For each class: detections below it are dropped."""
    hint_score: Score | None = None
    """Somebody who scores less than ``person`` asks but this much is a hint; without it nobody is."""
    joint_score: Score
    """A joint less surely visible is not detected."""
    min_joints: Annotated[int, Field(ge=1, le=17)]
    """Somebody of whom fewer joints are detected is not detected."""

    @field_validator("classes")
    @classmethod
    def _people_first(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if value[0] != PERSON:
            raise ValueError(f"the first class must be {PERSON}")
        if len(set(value)) < len(value):
            raise ValueError("class names repeat")
        return value

    @field_validator("keypoints")
    @classmethod
    def _of_objects(cls, value: dict[str, int], info: ValidationInfo) -> dict[str, int]:
        unknown = sorted(set(value) - set(info.data.get("classes", (PERSON, *value))[1:]))
        if unknown:
            raise ValueError(f"none of the classes of objects: {', '.join(unknown)}")
        return value

    @field_validator("hint_score")
    @classmethod
    def _below_people(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is not None and value >= info.data.get("score_thresholds", {}).get(PERSON, 1.0):
            raise ValueError(f"must be below the score_threshold of {PERSON}")
        return value

    @field_validator("score_thresholds")
    @classmethod
    def _one_per_class(cls, value: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        wrong = sorted(set(value) ^ set(info.data.get("classes", value)))
        if wrong:
            raise ValueError(f"one for each of the classes is needed, not so: {', '.join(wrong)}")
        return value


class WorkerManifest(BundledManifest):
    """Manifest of a worker network: joints and hard hats in a crop around one worker."""

    family: Literal["rigcal_worker"]
    joints: Annotated[tuple[Text, ...], Field(min_length=1)]
    """Which joints it knows, in its order; others are left to the site network."""
    joint_score: Score
    """Where a joint scores less, the site network's counts."""
    hat_score: Score
    """Hard hats below it are dropped."""

    @field_validator("joints")
    @classmethod
    def _known_joints(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in value if name not in JOINTS]
        if unknown:
            raise ValueError(f"none of the 17 joints: {', '.join(unknown)}")
        if len(set(value)) < len(value):
            raise ValueError("joints repeat")
        return value
