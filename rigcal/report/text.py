"""The calibration report for the terminal: rich tables that fit 80 columns, plain text where it is piped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from rigcal.report.numbers import ABSENT, fixed, scaled
from rigcal.report.overlap import weakest_link
from rigcal.report.words import (
    RMSE_MEANINGS,
    findings_counts,
    held_sentence,
    instants_sentence,
    next_actions,
    open_points,
    short_digest,
    verdict_sentence,
)
from rigcal.rigdocument import CameraEntry, PairEntry, RigDocument, ViewsEntry

FINDINGS_SHOWN = 3
"""Views named per camera; a bad capture has hundreds."""
ALL_FINDINGS = "in the HTML report, and in the rig file under cameras[].views.findings"
_STYLES = {"PASS": "bold green", "RECAPTURE": "bold red", "IMPORTED": "bold yellow"}


def text_report(document: RigDocument, *, file_name: str | None = None) -> RenderableType:
    """The report of a rig file as something that a rich console prints.

    Args:
        document: The rig file's content.
        file_name: Name of the rig file, where it has one.
    """
    return Group(*_parts(document, file_name))


def _parts(document: RigDocument, file_name: str | None) -> Iterator[RenderableType]:
    first = Text()
    first.append(document.verdict, style=_STYLES[document.verdict])
    first.append(f" {plain(document.site)}: {plain(verdict_sentence(document))}")
    yield first
    if actions := next_actions(document):
        yield heading("Next actions")
        yield numbered(["\n".join(map(plain, [action.advice, *action.reasons])) for action in actions])
    yield from _cameras(document)
    for sentence in (instants_sentence(document), held_sentence(document)):
        if sentence:
            yield Text(f"\n{plain(sentence)}")
    yield from findings_parts([(camera.id, camera.views) for camera in document.cameras], ALL_FINDINGS)
    if any(camera.clock for camera in document.cameras):
        yield from _clocks(document)
    if points := open_points(document):
        yield heading("Not known yet")
        yield from (Padding(Text(f"- {plain(point)}"), (0, 0, 0, 2)) for point in points)
    yield Text(f"\n{_origin(document, file_name)}", style="dim")


def plain(text: str) -> str:
    """Text without control characters, which a terminal would obey."""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)


def heading(text: str) -> Text:
    """A line above a part of the report."""
    return Text(f"\n{text}", style="bold")


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, left: Sequence[int] = (0,)) -> Table:
    """A table of text; columns that are not in ``left`` are aligned to the right."""
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1), show_edge=False)
    for index, name in enumerate(columns):
        is_text = index in left
        grid.add_column(Text(name), justify="left" if is_text else "right", overflow="fold", no_wrap=not is_text)
    for row in rows:
        grid.add_row(*(Text(cell) for cell in row))
    return grid


def numbered(items: Sequence[str]) -> Table:
    """A numbered list, its lines indented past the numbers."""
    grid = Table.grid(padding=(0, 1))
    grid.add_column(justify="right")
    grid.add_column(overflow="fold")
    for number, item in enumerate(items, 1):
        grid.add_row(Text(f"{number}."), Text(item))
    return grid


def _origin(document: RigDocument, file_name: str | None) -> str:
    board = document.calibration_board
    made = f"{document.created_utc} by rigcal {document.provenance.rigcal}"
    parts = [
        file_name or "",
        made,
        f"board {board.spec}" if board else "board not known",
        f"digest {short_digest(document.digest)}" if document.digest else "not written to a file yet",
        f"geometry {short_digest(document.geometry_digest)}" if document.geometry_digest else "",
    ]
    return plain("; ".join(part for part in parts if part))


def _cameras(document: RigDocument) -> Iterator[RenderableType]:
    yield heading("RMSE, px")
    names = [name for name, _ in RMSE_MEANINGS]
    yield table(
        ["camera", *(name.replace("_", "-") for name in names)],
        [[plain(camera.id), *(fixed(getattr(camera.rmse_px, name)) for name in names)] for camera in document.cameras],
    )
    yield heading("Views (used/found/images), one sigma, the link to the camera before on the chain")
    weakest = weakest_link(document)
    yield table(
        ["camera", "views", "fx, px", "fy, px", "position, mm", "shared views with"],
        [_camera_row(camera, document, weakest) for camera in document.cameras],
        left=(0, 5),
    )


def _camera_row(camera: CameraEntry, document: RigDocument, weakest: PairEntry | None) -> list[str]:
    views, sigma = camera.views, camera.sigma
    return [
        plain(camera.id),
        f"{views.used}/{views.detected}/{views.frames}" if views.frames else ABSENT,
        fixed(sigma.fx_px if sigma else None),
        fixed(sigma.fy_px if sigma else None),
        scaled(sigma.position_m if sigma else None, 1e3, 1),
        _link(camera, document, weakest),
    ]


def _link(camera: CameraEntry, document: RigDocument, weakest: PairEntry | None) -> str:
    """``cam1: 38``; only the other camera where the file does not say how many views they share."""
    if len(camera.chain) == 1:
        return ABSENT
    pair = next((pair for pair in document.pairs if set(pair.cameras) == set(camera.chain[-2:])), None)
    views = f": {pair.views}{', weakest' if pair is weakest else ''}" if pair else ""
    return plain(camera.chain[-2]) + views


def findings_parts(cameras: Sequence[tuple[str, ViewsEntry]], where: str) -> Iterator[RenderableType]:
    """Dropped and mended views by camera id: the first few, then how many more and ``where`` all of them are."""
    found = [(camera_id, views) for camera_id, views in cameras if views.findings]
    if not found:
        return
    yield heading("Views that were not used as detected")
    for camera_id, views in found:
        yield Text(plain(f"{camera_id}: {findings_counts(views)}"))
        for finding in views.findings[:FINDINGS_SHOWN]:
            yield Padding(Text(plain(f"{finding.frame} {finding.action}: {finding.reason}")), (0, 0, 0, 2))
        if (more := len(views.findings) - FINDINGS_SHOWN) > 0:
            yield Padding(Text(f"and {more} more"), (0, 0, 0, 2))
    if any(len(views.findings) > FINDINGS_SHOWN for _, views in found):
        yield Text(f"All of them are {where}.")


def _clocks(document: RigDocument) -> Iterator[RenderableType]:
    yield heading("Clocks, camera to rig time")
    rows = [
        [
            plain(camera.id),
            f"{scaled(clock.offset_s, 1e3, 3)} +- {scaled(clock.bound_s, 1e3, 3)}",
            f"{fixed(clock.drift_ppm)} +- {fixed(clock.drift_bound_ppm)}",
            clock.method,
            clock.at_utc,
        ]
        for camera in document.cameras
        if (clock := camera.clock)
    ]
    yield table(["camera", "offset, ms", "drift, ppm", "method", "at"], rows, left=(0, 3, 4))
