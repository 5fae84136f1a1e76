"""``recognition evidence``: what there is to see of the violations in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import (
    CodecOption,
    JsonOption,
    RecordingArgument,
    ShowFacesOption,
    VideoCodec,
    app,
    print_json,
)
from recognition.cli._evidence import evidence_folder, require_encoder, write_evidence
from recognition.cli._judged import events_of
from recognition.errors import EventsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recognition.events import Event


@app.command()
def evidence(
    recording: RecordingArgument,
    events: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Events file of this recording [the events in the recording].")
    ] = None,
    event: Annotated[
        list[str] | None, typer.Option(metavar="ID", help="Only this event; once for each [all of them].")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Write to this folder [NAME.evidence].")
    ] = None,
    show_faces: ShowFacesOption = False,
    codec: CodecOption = VideoCodec.h264,
    as_json: JsonOption = False,
) -> None:
    """Write a folder for each violation: a video of all views from 5 s before to 5 s after, pictures, margins.

    Heads are blurred as `recognition render` does. NAME.evidence beside the recording is deleted together with it by
    `recognition retain`; another folder is not.

    Exit code 0: done, also where nothing was violated; 2: not a recording, or no such event.
    """
    from recognition.sources.recording import open_recording

    require_encoder(codec.value)
    chosen = _chosen(events_of(open_recording(recording), events), event)
    exhibits = write_evidence(recording, chosen, output, show_faces=show_faces, codec=codec.value, quiet=as_json)
    folder = output or evidence_folder(recording)
    if as_json:
        print_json(
            {
                "recording": str(recording),
                "evidence": str(folder),
                "events": [
                    {"event_id": one.event.event_id, "folder": str(one.folder), "lacking": list(one.lacking)}
                    for one in exhibits
                ],
                "faces": "shown" if show_faces else "blurred",
            }
        )
        return
    for one in exhibits:
        typer.echo(f"{one.folder}  {one.event.rule}: {one.event.sentence}")
        for words in one.lacking:
            typer.echo(f"  it lacks {words}")
    if not exhibits:
        typer.echo("nothing was violated, so that there is nothing to show")


def _chosen(events: Sequence[Event], wanted: Sequence[str] | None) -> Sequence[Event]:
    known = {event.event_id: event for event in events}
    unknown = [event_id for event_id in wanted or () if event_id not in known]
    if unknown:
        raise EventsError(
            "there is no such event",
            where="--event",
            expected=f"one of {', '.join(known)}" if known else "an event, but nothing was violated",
            got=", ".join(unknown),
            do_next="take the event_id that `recognition replay IN.mcap` tells",
        )
    return [known[event_id] for event_id in dict.fromkeys(wanted)] if wanted else events
