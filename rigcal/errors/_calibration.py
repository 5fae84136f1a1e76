"""Boards were found, but the rig cannot be computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigcal.errors._base import RigcalError


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
