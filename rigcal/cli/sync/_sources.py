"""Live sources, watched for their stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rigcal.cli.sync._app import progress_bar

if TYPE_CHECKING:
    from rigcal.site import Site
    from rigcal.sync.check import StampReading


def sources_of(given: list[str], site: Site | None, camera_ids: tuple[str, ...]) -> dict[str, str]:
    """Where each camera is seen live: ``CAMERA=URL``, URLs in rig order, or the site file's.

    Raises:
        OptionError: where URLs are neither as many as the cameras nor named, or name a camera that the rig has not.
    """
    from rigcal.errors import OptionError

    if not given:
        declared = {camera.id: camera.source for camera in site.cameras} if site else {}
        return {camera_id: url for camera_id in camera_ids if (url := declared.get(camera_id))}
    named = [text.partition("=") for text in given]
    if all(sign and "://" not in name for name, sign, _ in named):
        found = {name: url for name, _, url in named}
    else:
        found = dict(zip(camera_ids, given, strict=False)) if len(given) == len(camera_ids) else {}
    if not found or set(found) - set(camera_ids):
        raise OptionError(
            "CAPTURE|URL",
            expected=f"one capture folder, {len(camera_ids)} URLs in rig order, or CAMERA=URL with CAMERA one of "
            f"{', '.join(camera_ids)}",
            got=f"{len(given)} sources",
        )
    return found


def watched(urls: dict[str, str], site: Site | None, seconds: float) -> dict[str, StampReading]:
    """The stamps of live sources."""
    from rigcal.pace import judge_pace
    from rigcal.sync.check import StampReading
    from rigcal.sync.live.watch import watch_sources

    with progress_bar("watching the sources") as bar:
        task = bar.add_task("", total=None)
        watches = watch_sources(
            urls, seconds=seconds, progress=lambda done, total: bar.update(task, completed=done, total=total)
        )
    found = {}
    for watch in watches:
        declared = site.camera(watch.camera_id) if site else None
        fps = declared.fps if declared and declared.fps else watch.declared_fps
        found[watch.camera_id] = StampReading(
            watch.stamp_source,
            judge_pace(watch.t_s - watch.t_s[:1].sum(), declared_fps=fps),
            arrived_fps=watch.arrived_fps,
            trouble=watch.trouble,
        )
    return found
