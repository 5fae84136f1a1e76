"""``recognition render``: a recording as video, pictures and a layout, for people who look."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recognition.cli._amounts import seconds
from recognition.cli._app import (
    CodecOption,
    JsonOption,
    RecordingArgument,
    ShowFacesOption,
    VideoCodec,
    app,
    print_json,
)
from recognition.cli._chosen import used_cameras
from recognition.cli._judged import events_of
from recognition.cli._show import progress
from rigcal.errors import OptionError, OutputError, writing

if TYPE_CHECKING:
    from recognition.viewing import Picture, Rendering


@app.command()
def render(
    recording: RecordingArgument,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="OUT.mp4", help="Write a video of all frames, in place of an old one."),
    ] = None,
    png: Annotated[Path | None, typer.Option(metavar="OUT_DIR", help="Write pictures into this folder.")] = None,
    every: Annotated[str, typer.Option(metavar="5s", help="Time between the pictures of --png.")] = "5s",
    layout: Annotated[
        Path | None, typer.Option(metavar="OUT.json", help="Write a layout that Foxglove shows this recording with.")
    ] = None,
    views: Annotated[str | None, typer.Option(metavar="cam0,cam2", help="Show only these cameras.")] = None,
    from_s: Annotated[
        float, typer.Option("--from", metavar="S", help="Begin so many seconds after the first frame.")
    ] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", metavar="S", help="End so many seconds after the first frame [the last].")
    ] = None,
    events: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Show violations of this events file [those in the recording]."),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth every track by what came after, as replay --smooth.")
    ] = False,
    show_faces: ShowFacesOption = False,
    codec: CodecOption = VideoCodec.h264,
    as_json: JsonOption = False,
) -> None:
    """Make a recording visible: every view with skeletons, boxes and identities, and a floor plan beside them.

    Who violates a rule is red, as long as that lasts.

    Heads are blurred, of everybody whom the run's networks saw in any frame near; faces of people whom no network
    saw are NOT blurred. A view that was not looked at for a second is blurred as a whole, and so is every view of a
    recording without detections.

    IN.mcap is a file, the name NAME.mcap of the segments NAME.000.mcap and so on, or a folder with one recording.

    Exit code 0: done; 2: not a recording, or one without frames.
    """
    from recognition.sources.recording import open_recording
    from recognition.viewing import Rendering, RenderOptions, encoder_of, foxglove_layout, read_footage

    if output is None and png is None and layout is None:
        raise OptionError("-o", expected="-o OUT.mp4, --png OUT_DIR or --layout OUT.json", got=None)
    _require_suffix("-o", output, ".mp4")
    _require_suffix("--layout", layout, ".json")
    if output is not None:
        encoder_of(codec.value)
    every_s = seconds("--every", every)
    opened = open_recording(recording)
    use = used_cameras(opened.rig, views)
    options = RenderOptions(use, from_s, to_s, None if output else every_s, show_faces, smooth)
    footage = read_footage(opened, from_s=from_s, to_s=to_s)
    told: dict[str, Any] = {"recording": str(recording), "warnings": list(opened.warnings)}
    if layout is not None:
        shown = {camera_id: topic for (camera_id, topic) in footage.topics.items()
                 if use[opened.rig.camera_ids.index(camera_id)]}  # fmt: skip
        with writing(layout):
            layout.write_text(json.dumps(foxglove_layout(opened.rig, shown), indent=1) + "\n", encoding="utf-8")
        told["layout"] = str(layout)
    if output is not None or png is not None:
        with progress(None, quiet=as_json, label="placing") as bar:
            rendering = Rendering(footage, options, events=events_of(opened, events), progress=bar)
        with progress(len(rendering.ticks_ns), quiet=as_json, label="drawing") as bar:
            told |= _pictures(rendering, output, png, every_s, codec, bar)
        told["warnings"] += _warnings(rendering, show_faces=show_faces)
        told["faces"] = "shown" if show_faces else "blurred"
    _tell(told, as_json)


def _require_suffix(option: str, path: Path | None, suffix: str) -> None:
    """Refuse a name of another kind: somebody may have named the recording, which would be overwritten."""
    if path is not None and path.suffix.lower() != suffix:
        raise OptionError(option, expected=f"a name that ends in {suffix}", got=path.name)


def _warnings(rendering: Rendering, *, show_faces: bool) -> Iterator[str]:
    if not rendering.has_detections:
        hidden = (
            "" if show_faces else ", and every view is blurred as a whole, since nobody knows whose faces are in it"
        )
        yield f"the recording holds no detections: nobody is drawn{hidden}"
    if rendering.broken:
        yield f"{rendering.broken} frames could not be decoded"


def _pictures(
    rendering: Rendering,
    output: Path | None,
    png: Path | None,
    every_s: float,
    codec: VideoCodec,
    bar: Callable[[int], None] | None,
) -> dict[str, Any]:
    """Write what was asked for; what was written."""
    from recognition.viewing import VideoWriter

    count, files, next_s = 0, 0, float("-inf")
    with ExitStack() as stack:
        writer = None
        if output is not None:
            stack.enter_context(writing(output))
            writer = stack.enter_context(VideoWriter(output, rendering.size_wh, rendering.rate, codec.value))
        for picture in rendering.pictures():
            count += 1
            if writer is not None:
                writer.write(picture.image_bgr, picture.t_ns)
            if png is not None and picture.after_s >= next_s:
                _write_png(png, picture)
                files, next_s = files + 1, picture.after_s + every_s - 0.5 / rendering.rate
            if bar:
                bar(count)
    told: dict[str, Any] = {"frames": count} if output else {}
    told |= {"video": str(output)} if output else {}
    return told | ({"png": str(png), "pictures": files} if png else {})


def _write_png(folder: Path, picture: Picture) -> None:
    import cv2

    path = folder / f"{picture.after_s:010.3f}s.png"
    with writing(path):
        is_made, data = cv2.imencode(".png", picture.image_bgr)
        if not is_made:
            raise OutputError(path, got="the picture could not be encoded")
        path.write_bytes(data.tobytes())


def _tell(told: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(told)
        return
    for warning in told["warnings"]:
        typer.echo(f"warning: {warning}")
    faces = "faces shown" if told.get("faces") == "shown" else "heads of everybody detected blurred"
    if "video" in told:
        typer.echo(f"video     {told['video']} ({told['frames']} frames, {faces})")
    if "png" in told:
        typer.echo(f"pictures  {told['png']} ({told['pictures']} files, {faces})")
    if "layout" in told:
        typer.echo(f"layout    {told['layout']} (in Foxglove: Layouts, Import from file; it blurs nobody)")
