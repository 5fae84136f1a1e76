"""What a user writes down: boards, site files, lengths."""

from __future__ import annotations

from pathlib import Path

from rigcal.errors._base import RigcalError


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
