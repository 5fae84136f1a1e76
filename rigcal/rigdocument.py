"""The rig file's content as checked values: every key, its type, and what must hold between keys.

Pydantic stands only at this edge; inside, a rig is the plain :class:`rigcal.rig.Rig`. Numbers are strict (no text, no
truth values) and finite, unknown keys are refused except under ``extensions``. Only a key whose value may be null may
be left out. Meaning and units are those of the format's version 1; the docstrings below become the JSON Schema.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from rigcal.board import Board, board_from_dict
from rigcal.camera import MODELS
from rigcal.geometry import Pose

FORMAT: Literal["rigcal.rig"] = "rigcal.rig"
VERSION: Literal[1] = 1

Number: TypeAlias = Annotated[float, Field(strict=True)]
Positive: TypeAlias = Annotated[float, Field(strict=True, gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(strict=True, ge=0)]
Count: TypeAlias = Annotated[int, Field(strict=True, ge=0)]
PositiveCount: TypeAlias = Annotated[int, Field(strict=True, gt=0)]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Text: TypeAlias = Annotated[str, Field(min_length=1)]

QUATERNION_NORM_TOLERANCE = 1e-6
"""A longer or shorter quaternion was not written by a program; rounding to float64 leaves about 1e-16."""
ROWS_PER_COVARIANCE_ENTRY = 3
CORRELATION_TOLERANCE = 1e-6
"""How far two mirrored correlations may differ: far above an inverse's rounding, far below what a gate reads."""


def refusal(expected: str, got: object, entry: str = "") -> PydanticCustomError:
    """A failed check between keys; ``entry`` is the path below the model that raises it, such as ``.chain``."""
    context = {"expected": expected, "got": str(got), "entry": entry}
    return PydanticCustomError("refusal", "expected {expected}, got {got}", context)


def _checked_utc(value: str) -> str:
    expected = "a time in UTC such as 2026-11-22T09:30:01Z"
    try:
        offset = datetime.fromisoformat(value).utcoffset()
    except ValueError as error:
        raise refusal(expected, repr(value)) from error
    if offset != timedelta(0):
        raise refusal(expected, repr(value))
    return value


Utc: TypeAlias = Annotated[str, AfterValidator(_checked_utc)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _no_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict) and (unknown := [key for key in data if key not in cls.model_fields]):
            raise refusal("one of " + ", ".join(cls.model_fields), f"unknown key {unknown[0]!r}", f".{unknown[0]}")
        return data


class PoseEntry(_Entry):
    """A rigid transform, ``x_target = R(quat) x_source + translation``; the key that holds it names the frames."""

    quat_wxyz: tuple[Number, Number, Number, Number]
    """Unit quaternion, scalar first."""
    translation_m: tuple[Number, Number, Number]
    """Metres, in the target's frame."""

    @field_validator("quat_wxyz")
    @classmethod
    def _unit(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        norm = float(np.linalg.norm(value))
        if abs(norm - 1) > QUATERNION_NORM_TOLERANCE:
            raise refusal(f"a quaternion of length 1 within {QUATERNION_NORM_TOLERANCE:g}", f"length {norm:.9g}")
        return value

    @classmethod
    def of(cls, pose: Pose) -> PoseEntry:
        """The entry of a pose."""
        quat, translation = pose.quat_wxyz.tolist(), pose.translation_m.tolist()
        return cls(quat_wxyz=tuple(quat), translation_m=tuple(translation))

    @property
    def pose(self) -> Pose:
        """The pose of this entry."""
        return Pose.from_quat_wxyz(self.quat_wxyz, self.translation_m)


class RmseEntry(_Entry):
    """Root-mean-square reprojection errors, sqrt(mean(dx^2 + dy^2)) over corners; null where without meaning."""

    intrinsic: NotNegative | None = None
    """The camera calibrated alone."""
    pairwise: NotNegative | None = None
    """The last pair of the camera's chain solved alone."""
    chained: NotNegative | None = None
    """Boards placed by the reference camera, seen through the chain: the compounded error."""
    refined: NotNegative | None = None
    """After the joint solve, over used corners."""
    held_out: NotNegative | None = None
    """Over board views kept out of the joint solve."""
    all: NotNegative | None = None
    """After the joint solve, over every detected corner."""


class SigmaEntry(_Entry):
    """One standard deviation of what was estimated for a camera."""

    fx_px: NotNegative
    fy_px: NotNegative
    cx_px: NotNegative
    cy_px: NotNegative
    position_m: NotNegative
    """Of the camera's position relative to the reference camera."""
    rotation_deg: NotNegative
    """Of the camera's rotation relative to the reference camera."""


class FindingEntry(_Entry):
    """A board view that was not used as it was detected."""

    frame: Text
    action: Literal["dropped", "unflipped", "downweighted"]
    reason: Text


class ViewsEntry(_Entry):
    """How many images a camera gave, and what became of them."""

    frames: Count
    detected: Count
    used: Count
    findings: tuple[FindingEntry, ...]


class ClockEntry(_Entry):
    """A camera's clock: ``t_rig = t_cam + offset_s + drift_ppm * 1e-6 * (t_cam - at)``; rig time is UTC."""

    offset_s: Number
    drift_ppm: Number
    at_utc: Utc
    bound_s: NotNegative
    """Half-width of the interval that holds the true offset, at ``at_utc``."""
    drift_bound_ppm: NotNegative
    """How fast the bound grows away from ``at_utc``."""
    method: Literal["probe", "video", "declared"]


class CameraEntry(_Entry):
    """One camera. Pixel (0, 0) is the centre of the top-left pixel; axes x right, y down, z forward."""

    id: Text
    serial: str | None = None
    size_wh: tuple[PositiveCount, PositiveCount]
    """Image width and height in pixels."""
    model: Literal["opencv4", "opencv5", "opencv8", "fisheye4"]
    coefficients: dict[str, Number]
    """By OpenCV's names; fx, fy, cx, cy in pixels."""
    cam_from_rig: PoseEntry
    rmse_px: RmseEntry
    chain: Annotated[tuple[Text, ...], Field(min_length=1)]
    """Cameras from the reference to this one."""
    sigma: SigmaEntry | None = None
    views: ViewsEntry
    clock: ClockEntry | None = None
    """Null until measured."""

    @model_validator(mode="after")
    def _coefficients_of_the_model(self) -> CameraEntry:
        names = MODELS[self.model]
        if set(self.coefficients) != set(names):
            got = ", ".join(self.coefficients) or "none"
            raise refusal(f"{', '.join(names)} for {self.model}", got, ".coefficients")
        for name in ("fx", "fy"):
            if self.coefficients[name] <= 0:
                raise refusal("a focal length above 0 px", self.coefficients[name], f".coefficients.{name}")
        return self


class CheckerboardEntry(_Entry):
    """A checkerboard, counted in inner corners."""

    kind: Literal["checkerboard"]
    columns: PositiveCount
    rows: PositiveCount
    square_size_m: Positive


class CharucoEntry(_Entry):
    """A ChArUco board, counted in squares."""

    kind: Literal["charuco"]
    columns: PositiveCount
    rows: PositiveCount
    square_size_m: Positive
    marker_ratio: Positive
    dictionary: Text
    inverted: Flag
    legacy: Flag


class AprilGridEntry(_Entry):
    """An AprilGrid, counted in tags."""

    kind: Literal["aprilgrid"]
    columns: PositiveCount
    rows: PositiveCount
    tag_size_m: Positive
    spacing: Positive
    family: Text
    border_bits: PositiveCount


BoardEntry: TypeAlias = Annotated[CheckerboardEntry | CharucoEntry | AprilGridEntry, Field(discriminator="kind")]


class PairEntry(_Entry):
    """Two cameras that saw the board together."""

    cameras: tuple[Text, Text]
    views: Count
    rmse_px: NotNegative | None
    """Of the pair solved alone."""


class CovarianceEntry(_Entry):
    """Covariance of the poses, for left perturbations ``(exp(w) R, t + v)`` of ``cam_from_rig``."""

    order: tuple[Text, ...]
    """``CAMERA.rotation_rad`` then ``CAMERA.translation_m`` for each camera: three rows and columns each."""
    matrix: tuple[tuple[Number, ...], ...]
    """Square and symmetric; rad^2, rad m and m^2."""
    given_lenses: tuple[tuple[Number, ...], ...] | None = None
    """The same if the lenses were known exactly: what poses solved later with these lenses are compared by. Left out
    where it is not known."""

    @model_serializer(mode="wrap")
    def _without_what_is_not_known(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in write(self).items() if name != "given_lenses" or value is not None}

    @model_validator(mode="after")
    def _well_formed(self) -> CovarianceEntry:
        ids = [name.rpartition(".")[0] for name in self.order[::2]]
        pattern = [f"{camera_id}.{part}" for camera_id in ids for part in ("rotation_rad", "translation_m")]
        if list(self.order) != pattern or len(set(ids)) != len(ids):
            raise refusal("CAMERA.rotation_rad, CAMERA.translation_m for each camera", ", ".join(self.order), ".order")
        self._check_matrix(self.matrix, ".matrix")
        if self.given_lenses is not None:
            self._check_matrix(self.given_lenses, ".given_lenses")
        return self

    def _check_matrix(self, matrix: tuple[tuple[float, ...], ...], entry: str) -> None:
        rows = ROWS_PER_COVARIANCE_ENTRY * len(self.order)
        if {len(row) for row in matrix} - {rows} or len(matrix) != rows:
            got = f"{len(matrix)} rows of {sorted({len(row) for row in matrix})}"
            raise refusal(f"{rows} rows of {rows} values, 6 per camera", got, entry)
        values = np.reshape(np.array(matrix, dtype=np.float64), (rows, rows))
        sigma = np.sqrt(np.maximum(np.diag(values), 0))
        asymmetry = np.abs(values - values.T)
        if (asymmetry > CORRELATION_TOLERANCE * np.outer(sigma, sigma)).any() or (np.diag(values) < 0).any():
            got = f"a diagonal from {np.diag(values).min():.3g}, entries that differ by {asymmetry.max():.3g}"
            raise refusal("a symmetric matrix with a diagonal of 0 or more", got, entry)


class GateEntry(_Entry):
    """One quality gate: a value and the limit that it was held against."""

    name: Text
    camera: str | None = None
    """Null for a gate of the whole rig."""
    value: Number | None = None
    """Null where it could not be measured."""
    limit: Number
    passed: Flag
    advice: str | None = None
    """The next action in words, where the gate failed."""


class HistoryEntry(_Entry):
    """A command that wrote the file."""

    command: Text
    utc: Utc
    parent_digest: str | None = None
    """Digest of the file that the command read."""


class ProvenanceEntry(_Entry):
    """What the file was made from, and with what."""

    rigcal: Text
    """Version of rigcal."""
    inputs_sha256: str
    options: dict[str, JsonValue]
    packages: dict[str, str]


class RigDocument(_Entry):
    """A calibrated rig of cameras with the evidence for it. The rig frame is the reference camera's."""

    format: Literal["rigcal.rig"] = FORMAT
    version: Literal[1] = VERSION
    site: Text
    created_utc: Utc
    reference: Text
    """The camera whose frame is the rig frame; its ``cam_from_rig`` is the identity."""
    board: BoardEntry | None = None
    """Null where another tool calibrated the rig."""
    cameras: Annotated[tuple[CameraEntry, ...], Field(min_length=1)]
    pairs: tuple[PairEntry, ...]
    covariance: CovarianceEntry | None = None
    world_from_rig: PoseEntry | None = None
    """To a world with z up and the floor at 0; null until measured."""
    gates: tuple[GateEntry, ...]
    verdict: Literal["PASS", "RECAPTURE", "IMPORTED"]
    history: tuple[HistoryEntry, ...]
    provenance: ProvenanceEntry
    extensions: dict[str, JsonValue] = Field(default_factory=dict)
    """Anything beside the format, by whose it is; every command keeps it."""
    geometry_digest: str = ""
    """Like ``digest``, without clocks, history, times and provenance."""
    digest: str = ""
    """SHA-256 of the UTF-8 JSON without this key, keys sorted, separators "," and ":"; empty until written."""

    @property
    def camera_ids(self) -> tuple[str, ...]:
        """Identifiers in rig order."""
        return tuple(camera.id for camera in self.cameras)

    @property
    def calibration_board(self) -> Board | None:
        """The board that calibrated the rig, where one did."""
        return board_from_dict(self.board.model_dump()) if self.board else None

    @model_validator(mode="after")
    def _consistent(self) -> RigDocument:
        known = self.camera_ids
        if repeated := sorted({camera_id for camera_id in known if known.count(camera_id) > 1}):
            raise refusal("camera ids that differ", f"{', '.join(repeated)} more than once", ".cameras")
        if self.reference not in known:
            raise refusal(f"one of {', '.join(known)}", repr(self.reference), ".reference")
        for index, camera in enumerate(self.cameras):
            self._check_camera(index, camera)
        for index, pair in enumerate(self.pairs):
            if unknown := set(pair.cameras) - set(known):
                raise refusal(f"two of {', '.join(known)}", ", ".join(sorted(unknown)), f".pairs[{index}].cameras")
        order = self.covariance.order if self.covariance else ()
        if unknown := {name.rpartition(".")[0] for name in order} - set(known):
            raise refusal(f"entries of {', '.join(known)}", ", ".join(sorted(unknown)), ".covariance.order")
        return self

    def _check_camera(self, index: int, camera: CameraEntry) -> None:
        entry, chain = f".cameras[{index}]", camera.chain
        if camera.id == self.reference and not np.allclose(camera.cam_from_rig.pose.matrix, np.eye(4), atol=1e-12):
            raise refusal("the identity, as this is the reference camera", "another pose", f"{entry}.cam_from_rig")
        if chain[0] != self.reference or chain[-1] != camera.id or set(chain) - set(self.camera_ids):
            expected = f"known cameras from {self.reference} to {camera.id}"
            raise refusal(expected, ", ".join(chain), f"{entry}.chain")
