"""What a live run follows: the cameras' addresses, or a capture that is paced as if it were live."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from recognition.errors import SourceError
from recognition.feeds import FeedOptions, capture_warnings, size_of
from recognition.live.pacing import PacedStream, Pacing
from recognition.sources.capture import open_source
from recognition.sources.rtsp import RtspStream
from recognition.sources.stream import Stream
from recognition.sources.synchrony import SyncReport
from recognition.sources.urls import SourceUrl, is_url
from rigcal.rig import Rig
from rigcal.site import Site


@dataclass(frozen=True, slots=True)
class LiveInput:
    """Streams, their clock, and what there is to tell about them."""

    streams: tuple[Stream, ...]
    now_ns: Callable[[], int]
    """The present rig time in nanoseconds, which does not step."""
    is_live: bool
    """Whether they are cameras; else files."""
    facts: dict[str, str]
    """What they are, for the metadata of a recording; without credentials."""
    warnings: tuple[str, ...] = ()
    """What may spoil the result, and what to do."""
    sync: SyncReport | None = None
    """How the cameras of a capture kept time."""
    bytes: int | None = None
    """What the frames of a capture take where they are."""


def chosen_sources(
    given: Sequence[str], rig: Rig, use: Sequence[bool], site: Site | None
) -> Path | dict[int, SourceUrl] | None:
    """What ``--source`` and the site file name: one capture, or an address for each wanted camera by its index.

    Args:
        given: ``CAPTURE``; or ``URL`` for each wanted camera in rig order, or ``CAMERA=URL``.
        rig: The rig.
        use: (V,) which of its cameras are wanted.
        site: Asked where nothing is given.

    Returns:
        None where nothing is named.

    Raises:
        SourceError: where the words are no such thing, or do not suit the rig.
    """
    wanted = [view for view, is_wanted in enumerate(use) if is_wanted]
    if not given:
        return _of_site(site, rig, wanted) if site is not None else None
    if not any(map(is_url, given)):
        if len(given) > 1:
            raise _unsuitable(rig, wanted, " ".join(given))
        return _capture(Path(given[0]))
    ids = rig.camera_ids
    named = [text.partition("=") for text in given]
    has_names = all(is_url(rest) and not is_url(name) for name, _, rest in named)
    if has_names:
        addresses = {ids.index(name): SourceUrl.parse(rest) for name, _, rest in named if name in ids}
    elif len(given) == len(wanted):
        addresses = {view: SourceUrl.parse(text) for view, text in zip(wanted, given, strict=True)}
    else:
        addresses = {}
    if sorted(addresses) != wanted or len(given) != len(wanted):
        names = ", ".join(name for name, _, _ in named)
        count = f"{len(given)} address{'es' * (len(given) > 1)}"
        raise _unsuitable(rig, wanted, f"{count}, for {names}" if has_names else count)
    return addresses


def live_cameras(rig: Rig, addresses: Mapping[int, SourceUrl]) -> LiveInput:
    """The cameras at these addresses, by their index in the rig; nothing is opened yet."""
    streams = []
    for view, url in sorted(addresses.items()):
        camera = rig.cameras[view]
        streams.append(RtspStream(view, camera.id, url, camera.clock, camera.camera.size_wh))
    facts = {f"source.{rig.camera_ids[view]}": str(url) for view, url in sorted(addresses.items())}
    return LiveInput(tuple(streams), _utc(), True, {"instants": "sender reports", **facts})


def paced_capture(path: Path, rig: Rig, options: FeedOptions) -> LiveInput:
    """A capture at its own pace.

    Raises:
        SourceError: where the capture does not suit the rig.
        CaptureError: where the capture itself is faulty.
    """
    capture = open_source(path, rig, use=options.use, fps=options.fps)
    streams = [stream for stream in capture.streams() if stream is not None]
    pacing = Pacing(len(streams), int(capture.timing.t_ns.min()))
    return LiveInput(
        streams=tuple(PacedStream(stream, pacing) for stream in streams),
        now_ns=pacing.now_ns,
        is_live=False,
        facts={"instants": capture.timing.rule, "pace": "realtime"},
        warnings=(*capture.sync.warnings, *capture_warnings(capture, None, options)),
        sync=capture.sync,
        bytes=size_of(capture),
    )


def _capture(path: Path) -> Path:
    if path.name.endswith((".mcap", ".mcap.part")):
        raise SourceError(
            "a recording is no source of frames to look at anew",
            where=path,
            expected="a capture folder, or the addresses of live cameras",
            got="an MCAP recording, which holds what the networks saw in its frames",
            do_next=f"place that again: recognition replay {path}",
        )
    return path


def _of_site(site: Site, rig: Rig, wanted: Sequence[int]) -> dict[int, SourceUrl]:
    declared = {view: site.camera(rig.camera_ids[view]) for view in wanted}
    addresses = {view: camera.source for view, camera in declared.items() if camera and camera.source}
    missing = [rig.camera_ids[view] for view in wanted if view not in addresses]
    if missing:
        raise SourceError(
            f"the site file does not say where {', '.join(missing)} can be seen live",
            where=f"site {site.site}",
            expected='source = "rtsp://HOST/PATH" for each camera of the rig',
            got=f"{len(addresses)} of {len(wanted)}",
            do_next="add them, name the sources with --source, or leave cameras out with --views",
        )
    return {view: SourceUrl.parse(text) for view, text in addresses.items()}


def _unsuitable(rig: Rig, wanted: Sequence[int], got: str) -> SourceError:
    names = [rig.camera_ids[view] for view in wanted]
    return SourceError(
        "the sources do not suit the rig",
        where="--source",
        expected=f"one capture folder, or an address for each of {', '.join(names)}: in this order, or as "
        f"{names[0]}=rtsp://HOST/PATH",
        got=got,
        do_next="give --source once for each camera; leave cameras out with --views",
    )


def _utc() -> Callable[[], int]:
    """UTC as it was when this was called, carried on by a clock that nobody sets."""
    started_ns, origin_ns = time.time_ns(), time.monotonic_ns()
    return lambda: started_ns + time.monotonic_ns() - origin_ns
