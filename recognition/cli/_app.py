"""The application that the commands register with, and what they share."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
    help="Recognise workers and objects in 3D with a calibrated rig, and record everything to MCAP.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
ViewsOption = Annotated[str | None, typer.Option(metavar="cam0,cam2", help="Use only these cameras of the rig.")]
InterpolateOption = Annotated[
    bool,
    typer.Option(
        "--interpolate", help="Move detections to the instants' common times; for cameras not triggered together."
    ),
]
RecordingArgument = Annotated[Path, typer.Argument(metavar="IN.mcap", help="A recording.")]


class VideoCodec(StrEnum):
    """How an mp4 is encoded."""

    h264 = "h264"
    mpeg4 = "mpeg4"


CodecOption = Annotated[
    VideoCodec, typer.Option(help="mpeg4 where FFmpeg has no H.264 encoder; browsers do not show it.")
]
ShowFacesOption = Annotated[
    bool, typer.Option("--show-faces", help="Do not blur heads: only where the people shown agreed to that.")
]


@app.callback()
def _program() -> None:
    """Recognise workers and objects in 3D with a calibrated rig, and record everything to MCAP."""


def print_json(value: dict[str, Any]) -> None:
    typer.echo(json.dumps(value, ensure_ascii=False))
