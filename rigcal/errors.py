"""The exception tree of rigcal.

    RigcalError
    ├── BoardSpecError            a --board string that cannot be read, or a size without a unit
    ├── SiteFileError             a hand-written site file with a mistake
    ├── OptionError               an option of a stage outside its range
    ├── OutputError               a file that cannot be written
    ├── TargetError               a board that cannot be printed as asked
    ├── MeasuredLengthError       a length measured by hand that cannot be read, or between unknown cameras
    ├── CaptureError              a capture folder, image or video that cannot be used
    │   ├── EmptyCaptureError
    │   ├── BrokenFileError
    │   ├── TimestampsError
    │   └── ImageSizeError
    ├── DetectionError            images are readable, the board is not in them
    │   ├── NoBoardError
    │   ├── UnclearBoardError
    │   ├── WrongBoardError
    │   ├── WrongSpacingError
    │   └── MirroredImagesError
    ├── CalibrationError          boards were found, the rig cannot be computed from them
    │   ├── TooFewViewsError
    │   ├── NotConnectedError
    │   └── SisterError               declared alike, but not alike
    ├── RigFileError              a rig file that must not be used
    │   ├── RigFileDigestError
    │   ├── RigFileVersionError
    │   ├── RigFileSchemaError
    │   └── EvidenceError         the residuals beside it are another rig's
    ├── RigCaptureError           a capture that does not belong to the rig file
    ├── TableError                a table of points or pixels that cannot be read
    ├── WorldError                measurements that do not give a floor and a vertical
    │   ├── NotFlatError
    │   ├── BelowFloorError
    │   └── WorldPointError
    ├── DriftError                views that cannot tell which camera moved
    └── FormatError               another tool's file
        ├── FormatEntryError
        ├── UnknownFormatError
        ├── ForeignNameError
        └── LossyExportError

Every message says what is wrong, where, what was expected, what was got, and what to do next.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar


class RigcalError(Exception):
    """A problem that the user can mend; its message is complete and is shown without a traceback."""

    def __init__(
        self, what: str, *, where: object = None, expected: object = None, got: object = None, do_next: str
    ) -> None:
        self.what, self.do_next = what, do_next
        self.where, self.expected, self.got = (None if v is None else str(v) for v in (where, expected, got))
        super().__init__(self._message())

    def _message(self) -> str:
        lines = [self.what]
        rows = (
            ("where", self.where),
            ("expected", self.expected),
            ("got", self.got),
            ("do next", self.do_next),
        )
        lines += [f"  {name + ':':<10}{value}" for name, value in rows if value is not None]
        return "\n".join(lines)


class OptionError(RigcalError):
    """An option of a stage is outside its range."""

    def __init__(self, name: str, *, expected: str, got: object) -> None:
        super().__init__(
            f"option {name} is out of range",
            expected=expected,
            got=repr(got),
            do_next=f"give {name} as {expected}",
        )


class OutputError(RigcalError):
    """A result cannot be written."""

    def __init__(self, path: Path, *, got: str) -> None:
        super().__init__(
            "cannot write this file",
            where=path,
            expected="a folder that can be written to, with space on its disk",
            got=got,
            do_next="choose another place with -o, or free some space",
        )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make the folder of an output, and turn a refusal of the file system into an :class:`OutputError`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise OutputError(path, got=error.strerror or str(error)) from error


class BoardSpecError(RigcalError):
    """A board specification that cannot be read."""

    def __init__(self, spec: str, *, problem: str, expected: str) -> None:
        super().__init__(
            f"cannot read the board {spec!r}: {problem}",
            expected=expected,
            got=repr(spec),
            do_next="write it like checkerboard:9x6:25mm, charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000 "
            "or aprilgrid:6x6:88mm:spacing=0.3:family=tag36h11",
        )


class TargetError(RigcalError):
    """A board that cannot be printed true to scale on the paper that was asked for."""

    def __init__(self, problem: str, *, where: object, expected: str, got: str, do_next: str) -> None:
        super().__init__(
            f"cannot print this board: {problem}", where=where, expected=expected, got=got, do_next=do_next
        )


class SiteFileError(RigcalError):
    """A site file that cannot be used."""

    def __init__(self, path: Path | str, *, problem: str, expected: str, got: object, do_next: str) -> None:
        super().__init__(f"site file: {problem}", where=path, expected=expected, got=got, do_next=do_next)


class MeasuredLengthError(RigcalError):
    """A length that was measured by hand and cannot be used."""

    def __init__(self, option: str, text: str, *, problem: str) -> None:
        form = "a length with its unit, such as 59.6mm"
        example = f"{option} 59.6mm"
        if option != "--measured-square":
            form = "two cameras of the capture and a length with its unit, such as cam0,cam1:2.41m"
            example = f"{option} cam0,cam1:2.41m"
        super().__init__(
            f"cannot use this measured length: {problem}",
            where=option,
            expected=form,
            got=repr(text),
            do_next=f"write it like {example}, in mm, cm or m",
        )


class CaptureError(RigcalError):
    """A capture that cannot be used."""


class EmptyCaptureError(CaptureError):
    """A folder holds no camera's images or videos."""

    def __init__(self, path: Path, *, got: str) -> None:
        super().__init__(
            "no camera images or videos here",
            where=path,
            expected="one folder of images per camera, one video per camera, or images named like left01.jpg",
            got=got,
            do_next="give the folder that directly holds the cameras' folders, videos or images",
        )


class BrokenFileError(CaptureError):
    """An image or a video that cannot be decoded."""

    def __init__(self, path: Path, *, expected: str, got: str) -> None:
        super().__init__(
            "cannot decode this file",
            where=path,
            expected=expected,
            got=got,
            do_next="copy it again from the camera, or remove it and run again",
        )


class TimestampsError(CaptureError):
    """``timestamps.csv`` contradicts the capture beside it."""

    def __init__(self, path: Path, *, problem: str, expected: str, got: str) -> None:
        super().__init__(
            f"timestamps: {problem}",
            where=path,
            expected=expected,
            got=got,
            do_next="mend the file, or remove it to group by file names or frame numbers instead",
        )


class ImageSizeError(CaptureError):
    """Images of one camera differ in size, within a capture or between captures."""

    def __init__(
        self,
        camera_id: str,
        *,
        where: object,
        expected_wh: tuple[int, int],
        got_wh: tuple[int, int],
        source: str,
    ) -> None:
        super().__init__(
            f"camera {camera_id} has images of another size",
            where=where,
            expected=f"{expected_wh[0]}x{expected_wh[1]} px, as in {source}",
            got=f"{got_wh[0]}x{got_wh[1]} px",
            do_next="record at one resolution, crop and rotation; calibrate each resolution by itself",
        )


class DetectionError(RigcalError):
    """The images are readable, but the board is not found in them."""


class NoBoardError(DetectionError):
    """Cameras in which no board was found, and no other board either."""

    def __init__(
        self, where: str, *, board: str, images: int, tried: Sequence[str], seen: str, also: Sequence[str] = ()
    ) -> None:
        shown = ", ".join(tried[:4]) + (f" and {len(tried) - 4} others" if len(tried) > 4 else "")
        got = [f"0 boards; the likeliest images have {seen}"]
        got += [f"not found in them either: {shown}"] if tried else []
        got += [f"{', '.join(also)} saw none either"] if also else []
        super().__init__(
            f"no board found in {where}",
            where=f"{where}, {images} images",
            expected=f"{board} in at least one image",
            got="; ".join(got),
            do_next="check that the whole board with its white margin is in view, sharp and lit, nearer than "
            "40 squares' width, and that --board counts inner corners (checkerboard) or squares (charuco)",
        )


class UnclearBoardError(DetectionError):
    """The board is in the images, but too small, blurred, faint or hidden to be found."""

    _TOLD: ClassVar = {
        "square": (
            "the board is too small in the images",
            "squares of at least {limit:.0f} px",
            "squares of {value:.1f} px",
            "bring the board nearer, to {percent:.0f} % of its distance or less, or print a larger one",
        ),
        "blur": (
            "the board is too blurred in the images",
            "edges blurred over at most {limit:.1f} px",
            "edges blurred over {value:.1f} px, on squares of {square_px:.0f} px",
            "hold the board still for every view, shorten the exposure, and focus the lens at the board's distance",
        ),
        "step": (
            "the board is too dark or too faint in the images",
            "at least {limit:.0f} grey levels from black to white",
            "{value:.0f} grey levels from black to white",
            "add light, or lengthen the exposure and hold the board still",
        ),
        "markers": (
            "the board's squares are seen, but its markers cannot be read",
            "markers as {board} has them",
            "squares of {square_px:.0f} px without such markers",
            "check dict= and marker= of --board against the printed board, and that nothing covers the markers",
        ),
        "part": (
            "only a part of the board is seen",
            "all of its {limit:.0f} corners",
            "a part with {value:.0f} corners",
            "keep the whole board and a white margin of half a square in view, with no hand or stand on its squares",
        ),
    }

    def __init__(
        self,
        *,
        where: str,
        board: str,
        cause: str,
        value: float,
        limit: float,
        square_px: float,
        shown: int,
        images: int,
    ) -> None:
        known = {"board": board, "value": value, "limit": limit, "square_px": square_px}
        what, expected, got, do_next = (
            text.format(**known, percent=100 * min(value / limit, 1)) for text in self._TOLD[cause]
        )
        super().__init__(
            what,
            where=where,
            expected=expected,
            got=f"{got}, in {shown} of {images} images that were looked at",
            do_next=do_next,
        )


class WrongBoardError(DetectionError):
    """Another board than the one given is in the images."""

    def __init__(
        self,
        *,
        where: str,
        given: str,
        given_count: int,
        found: str,
        found_count: int,
        images: int,
        sampled: bool = False,
        spec: str | None = None,
    ) -> None:
        of = f"of the {images} likeliest images" if sampled else f"of {images} images"
        super().__init__(
            f"the board is not {given}",
            where=where,
            expected=f"{given} in most images",
            got=f"{given} in {given_count} {of}; {found} in {found_count} {of}",
            do_next=_board_advice(given, spec)
            if spec
            else "count the board's inner corners (checkerboard), squares (charuco) or tags (aprilgrid) and run "
            "again with --board",
        )


def _board_advice(given: str, spec: str) -> str:
    same_kind = given.partition(":")[0] == spec.partition(":")[0]
    return f"run again with --board {spec}" + ("" if same_kind else ", and in it the size measured on that board")


class WrongSpacingError(DetectionError):
    """The tags of an AprilGrid are set wider or narrower than was given."""

    def __init__(self, *, given: float, measured: float, views: int) -> None:
        super().__init__(
            "the tags of the board are not spaced as given",
            where=f"{views} views of the board",
            expected=f"spacing={given:g}, the gap between two tags over the side of a tag",
            got=f"spacing={measured:.3f}",
            do_next=f"measure gap and tag on the board, and run again with spacing={measured:.2g} in --board",
        )


class MirroredImagesError(DetectionError):
    """Every view of every camera shows the board's mirror image."""

    def __init__(self, camera_ids: Sequence[str], *, views: int) -> None:
        super().__init__(
            "the images are mirrored",
            where=f"camera {', '.join(camera_ids)}",
            expected="the board as it was printed, in some view of some camera",
            got=f"its mirror image in {views} of {views} views",
            do_next="switch off mirroring (flip, selfie view) in the cameras or the recorder and capture again; a "
            "board whose back is seen must show its front to a camera too",
        )


class CalibrationError(RigcalError):
    """Boards were found, but the rig cannot be computed from them."""


class TooFewViewsError(CalibrationError):
    """A camera with too few usable board views."""

    def __init__(self, camera_id: str, *, views: int, needed: int, dropped: int = 0) -> None:
        detail = f"{views} usable views" + (f" ({dropped} were dropped as bad)" if dropped else "")
        super().__init__(
            f"camera {camera_id} has too few board views to be calibrated",
            where=f"camera {camera_id}",
            expected=f"at least {needed} views of the board in different positions and tilts",
            got=detail,
            do_next=f"show the board to {camera_id} at several distances, tilted 20-45 degrees, in every corner "
            "of its image",
        )


class NotConnectedError(CalibrationError):
    """Groups of cameras that no board view joins to the reference camera."""

    def __init__(
        self,
        groups: Sequence[Sequence[str]],
        *,
        needed: int,
        bridge: tuple[str, str],
        unexplained: Mapping[tuple[str, str], int],
    ) -> None:
        named = "; ".join("{" + ", ".join(group) + "}" for group in groups)
        got = f"{len(groups)} groups without a shared view between them"
        do_next = (
            f"show the board to {bridge[0]} and {bridge[1]} at the same time in {needed} or more positions, "
            "and add those images to the capture"
        )
        group_of = {camera_id: index for index, group in enumerate(groups) for camera_id in group}
        odd = {pair: views for pair, views in unexplained.items() if group_of[pair[0]] != group_of[pair[1]]}
        if odd:
            seen = "; ".join(f"{one} and {two} share {views} views" for (one, two), views in odd.items())
            got = f"{seen}, but no place of the cameras explains them"
            do_next = (
                "check that no camera mirrors its image, that images of equal number or time were taken together, and "
                f"that there is one board; else show it to {bridge[0]} and {bridge[1]} together, held still"
            )
        super().__init__(
            f"cameras are not connected to {groups[0][0]}: no shared board views join {len(groups)} groups",
            where=f"groups {named}",
            expected=f"every camera reached from {groups[0][0]} through pairs with {needed} or more shared board views",
            got=got,
            do_next=do_next,
        )


class SisterError(CalibrationError):
    """Cameras that the site file declares alike, whose images or lens models differ."""

    def __init__(self, first: str, second: str, *, expected: str, got: str) -> None:
        super().__init__(
            f"cameras {first} and {second} are declared alike, but are not",
            where=f"camera {second}",
            expected=f"{expected}, as {first} has",
            got=got,
            do_next=f"record {second} as {first} is recorded, or remove its like = ... from the site file",
        )


class RigFileError(RigcalError):
    """A rig file that must not be used."""


class RigFileDigestError(RigFileError):
    """The content does not match the digest: the file was edited by hand or damaged."""

    def __init__(self, path: Path | str, *, expected: str, got: str) -> None:
        super().__init__(
            "the rig file was changed after rigcal wrote it",
            where=path,
            expected=f"digest {expected}",
            got=f"digest {got}",
            do_next="restore the file that rigcal wrote, or calibrate again with rigcal calibrate; rig files are "
            "not edited by hand",
        )


class RigFileVersionError(RigFileError):
    """The file was written by a newer rigcal."""

    def __init__(self, path: Path | str, *, expected: int, got: object) -> None:
        super().__init__(
            f"the rig file has format version {got}, this rigcal reads version {expected}",
            where=path,
            expected=f"version {expected}",
            got=f"version {got}",
            do_next="upgrade rigcal, or calibrate again with this one",
        )


class RigFileSchemaError(RigFileError):
    """The file does not have the rig file's form: a missing, unknown or malformed entry."""

    def __init__(self, path: Path | str, *, entry: str, expected: str, got: object) -> None:
        super().__init__(
            f"not a valid rig file: {entry}",
            where=path,
            expected=expected,
            got=got,
            do_next="use a file written by rigcal calibrate or rigcal import; own entries belong under extensions",
        )


class EvidenceError(RigFileError):
    """The residuals beside a rig file are of other cameras."""

    def __init__(self, *, expected: Sequence[str], got: Sequence[str]) -> None:
        super().__init__(
            "the residuals beside the rig file belong to another rig",
            where="the .residuals.npz of the same name",
            expected=f"residuals of {', '.join(expected)}",
            got=f"residuals of {', '.join(got)}",
            do_next="move that file away, or calibrate again with rigcal calibrate, which writes both",
        )


class RigCaptureError(RigcalError):
    """A capture of other cameras than the rig's."""

    def __init__(self, path: Path | str, *, unknown: Sequence[str], known: Sequence[str]) -> None:
        super().__init__(
            f"the rig has no camera {', '.join(unknown)}",
            where=path,
            expected=f"cameras of the rig: {', '.join(known)}",
            got=f"cameras {', '.join(unknown)}",
            do_next="name each folder or video after its camera as in the rig file, or give the rig file of this site",
        )


class TableError(RigcalError):
    """A table of named points or pixels with a missing, doubled or malformed entry."""

    def __init__(self, path: Path | str, *, problem: str, expected: str, got: object, do_next: str) -> None:
        super().__init__(problem, where=path, expected=expected, got=got, do_next=do_next)


class WorldError(RigcalError):
    """Measurements from which no floor and vertical can be computed."""


class NotFlatError(WorldError):
    """Placements of a board that do not lie on one plane."""

    def __init__(self, worst: str, *, height_mm: float, tilt_deg: float, limit_mm: float, limit_deg: float) -> None:
        super().__init__(
            f"the board does not lie flat: {worst} does not fit one floor with the other placements",
            where=worst,
            expected=f"every placement within {limit_mm:.0f} mm and {limit_deg:.1f} degrees of one plane",
            got=f"{height_mm:+.0f} mm off in height, {tilt_deg:.1f} degrees off in tilt",
            do_next="remove that placement's images, or lay the board flat on the floor there and capture it again",
        )


class BelowFloorError(WorldError):
    """Cameras that would lie below the floor."""

    def __init__(self, heights_m: Sequence[tuple[str, float]], *, method: str, do_next: str) -> None:
        got = ", ".join(f"{camera} at {height:+.2f} m" for camera, height in heights_m)
        super().__init__(
            f"{', '.join(camera for camera, _ in heights_m)} would lie below the floor",
            where=method,
            expected="every camera above the floor",
            got=got,
            do_next=do_next,
        )


class WorldPointError(WorldError):
    """Named points that contradict the rig or each other, or that do not determine a world."""


class DriftError(RigcalError):
    """Board views that cannot tell whether, or which, camera moved."""


class FormatError(RigcalError):
    """A file of another tool that cannot be read or written."""


class FormatEntryError(FormatError):
    """An entry of another tool's file that is missing or malformed."""

    def __init__(self, path: Path | str, entry: str, *, expected: str, got: object) -> None:
        super().__init__(
            f"cannot use the entry {entry or '(top level)'}",
            where=path,
            expected=expected,
            got=got,
            do_next="mend that entry, or write the file again with the tool that made it",
        )


class UnknownFormatError(FormatError):
    """A format that rigcal does not know, cannot recognise, or cannot use in this direction."""

    def __init__(self, problem: str, *, where: object, formats: Sequence[str], got: str, option: str) -> None:
        super().__init__(
            problem,
            where=where,
            expected="one of " + ", ".join(formats),
            got=got,
            do_next=f"name one of these formats with {option}",
        )


class ForeignNameError(FormatError):
    """The target format cannot hold a camera's name."""

    def __init__(self, camera_id: str, *, to: str, expected: str) -> None:
        super().__init__(
            f"{to} cannot hold the name of camera {camera_id}",
            where=f"camera {camera_id}",
            expected=expected,
            got=repr(camera_id),
            do_next="rename that camera's folder in the capture and calibrate again, or export to anipose or "
            "foxglove, which hold any name",
        )


class LossyExportError(FormatError):
    """The target format has no place for a coefficient that is not zero."""

    def __init__(self, *, camera_id: str, model: str, to: str, coefficients: Sequence[str], do_next: str) -> None:
        super().__init__(
            f"{to} cannot hold every coefficient of camera {camera_id}",
            where=f"camera {camera_id}, model {model}",
            expected=f"a lens model that {to} can store without loss",
            got=", ".join(coefficients),
            do_next=do_next,
        )
