"""Model manifests: the few facts about a network that its ONNX file does not carry.

A manifest is a TOML file beside the model with the same stem (``yolox_nano.toml`` beside ``yolox_nano.onnx``).

Decision: a network is described by data, and code exists once per family of networks. The alternative, an
adapter class per network, repeats scaling, padding and colour order in each, which is where ports of networks
usually go wrong in silence. The cost: a network of a new family needs a decode function before it can be loaded.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from recognition.detectors.coco import COCO80
from recognition.errors import ModelError
from rigcal.site import entry_name

Text = Annotated[str, Field(min_length=1)]
CLASS_SETS = {"coco80": COCO80}


class Strict(BaseModel):
    """Entries of a manifest: no others, and never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class InputSpec(Strict):
    """What the network expects: ``(pixel * scale - mean) / std`` per channel, in the order of ``colour``."""

    name: Text
    """Name of the graph's input."""
    size_wh: tuple[PositiveInt, PositiveInt]
    """Width and height in pixels."""
    layout: Literal["nchw", "nhwc"]
    dtype: Literal["float32", "uint8", "int32"]
    colour: Literal["bgr", "rgb"]
    scale: PositiveFloat = 1.0
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (1.0, 1.0, 1.0)
    resize: Literal["letterbox", "stretch"]
    """``letterbox`` keeps the aspect and fills up with ``pad``; ``stretch`` does not keep it."""
    align: Literal["top_left", "centre"] = "top_left"
    """Where a letterboxed image lies in the input."""
    pad: Annotated[int, Field(ge=0, le=255)] = 114
    """Grey value of what lies outside the image."""

    @model_validator(mode="after")
    def _integers_stay_as_they_are(self) -> InputSpec:
        if self.dtype != "float32" and (self.scale != 1 or any(self.mean) or self.std != (1, 1, 1)):
            raise ValueError("an input of whole numbers takes pixels as they are: leave out scale, mean and std")
        return self

    @model_validator(mode="after")
    def _stretched_is_not_aligned(self) -> InputSpec:
        if self.resize == "stretch" and self.align != "top_left":
            raise ValueError("align is for letterbox: a stretched image fills the input")
        return self


class NetworkFacts(Strict):
    """What every manifest states."""

    family: Text
    """Which adapter reads the network's output."""
    licence: Text
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    """Of the ONNX file, so that a manifest cannot be applied to another network."""


class Manifest(NetworkFacts):
    """What the manifest states of a network whose input differs from others of its family."""

    input: InputSpec


class BoxManifest(Manifest):
    """Manifest of a network that finds boxes."""

    classes: Annotated[tuple[Text, ...], Field(min_length=1)]
    """Names in the order of the network's class channels; in the file also the name of a known set, ``coco80``."""
    person_class: str | None = None
    """The class whose boxes are people; left out where the network finds no people."""
    rename: dict[Text, Text] = Field(default_factory=dict)
    """From the network's name of a class to that which rules know; several classes may become one."""
    score_threshold: Annotated[float, Field(gt=0, lt=1)]
    """Boxes below it are dropped; it belongs to the network, because families scale their scores differently."""

    @field_validator("classes", mode="before")
    @classmethod
    def _named_set(cls, value: object) -> object:
        if isinstance(value, str) and value not in CLASS_SETS:
            raise ValueError(f"unknown set of classes; give a list of names, or {', '.join(CLASS_SETS)}")
        return CLASS_SETS[value] if isinstance(value, str) else value

    @field_validator("classes")
    @classmethod
    def _distinct(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) < len(value):
            raise ValueError("class names repeat")
        return value

    @field_validator("person_class")
    @classmethod
    def _one_of_the_classes(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None and value not in info.data.get("classes", (value,)):
            raise ValueError("none of the classes")
        return value

    @field_validator("rename")
    @classmethod
    def _renamed_are_classes(cls, value: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        unknown = [name for name in value if name not in info.data.get("classes", value)]
        if unknown:
            raise ValueError(f"none of the classes: {', '.join(unknown)}")
        return value

    @property
    def names(self) -> tuple[str, ...]:
        """The classes by the names that rules know, in the order of the network's channels."""
        return tuple(self.rename.get(name, name) for name in self.classes)

    @property
    def person_name(self) -> str | None:
        """The name among them of people."""
        return None if self.person_class is None else self.rename.get(self.person_class, self.person_class)


class PeopleManifest(Manifest):
    """Manifest of a network that finds people with their joints in one run."""

    joints: Literal["coco17"]
    """Order of the joints."""
    score_threshold: Annotated[float, Field(gt=0, lt=1)]
    """People below it are dropped."""


class PoseManifest(Manifest):
    """Manifest of a network that finds the joints of one person in a crop."""

    joints: Literal["coco17"]
    """Order of the joints."""
    crop_margin: Annotated[float, Field(ge=1, le=3)]
    """The crop's size over the person box's."""


AnyManifest: TypeAlias = BoxManifest | PeopleManifest | PoseManifest


FormT = TypeVar("FormT", bound=NetworkFacts)


def read_manifest(path: Path | Traversable, forms: Mapping[str, type[FormT]]) -> FormT:
    """Read a manifest; ``forms`` tells which form the manifests of each family have.

    Raises:
        ModelError: where it is absent, no TOML, of an unknown family, or has a missing, unknown or malformed entry.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelError(
            "cannot read the model manifest",
            where=path,
            expected="a TOML file",
            got=error.strerror,
            do_next="check the path",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(
            "the model manifest is not TOML",
            where=path,
            expected="TOML text",
            got=error,
            do_next="mend that line",
        ) from error
    family = data.get("family")
    if not isinstance(family, str) or family not in forms:
        raise ModelError(
            "unknown model family",
            where=path,
            expected=f"family = one of {', '.join(sorted(forms))}",
            got=repr(family),
            do_next="name the family whose output the network has, or add an adapter to recognition.detectors",
        )
    return _validated(data, forms[family], path)


def manifest_digest(manifest: NetworkFacts) -> str:
    """SHA-256 of a manifest's entries, hexadecimal: the same for files that say the same."""
    return hashlib.sha256(manifest.model_dump_json().encode()).hexdigest()


def _validated(data: dict[str, Any], form: type[FormT], path: Path | Traversable) -> FormT:
    try:
        return form.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        entry = entry_name(first["loc"])
        absent = first["type"] == "missing"
        raise ModelError(
            f"model manifest: entry {entry}: {first['msg'].lower()}",
            where=path,
            expected=f"the entries {entries_text(form)}",
            got="nothing" if absent else repr(first["input"]),
            do_next=f"add {entry}" if absent else f"mend or remove {entry}",
        ) from error


def entries_text(form: type[BaseModel]) -> str:
    """Entries of a form as one reads them: ``family, licence, ..., input.name, ...``."""
    plain = [name for name in form.model_fields if name != "input"]
    inside = [f"input.{name}" for name in InputSpec.model_fields] if "input" in form.model_fields else []
    return ", ".join(plain + inside)
