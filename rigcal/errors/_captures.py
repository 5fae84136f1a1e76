"""Captures, and boards that are not found in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from rigcal.errors._base import RigcalError


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
