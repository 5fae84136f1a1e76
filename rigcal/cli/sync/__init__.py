"""The commands of clocks: answer probes, probe, compare video, check before a recording, report after it."""

from rigcal.cli._app import app
from rigcal.cli.sync import probe, report, serve, verify, video
from rigcal.cli.sync._app import sync_app

__all__ = ["probe", "report", "serve", "sync_app", "verify", "video"]

app.add_typer(sync_app, name="sync")
