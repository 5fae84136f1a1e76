"""Clocks from probes of the cameras' hosts, into the rig file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli._app import JsonOption, SiteOption, print_json, show, site_of
from rigcal.cli.sync._app import (
    OutputOption,
    RigOption,
    clock_gates_of,
    clocks_pass,
    show_failed_gates,
    sync_app,
    write_clocks,
)
from rigcal.cli.sync._probed import Probed, probe_hosts, probed_in_log

if TYPE_CHECKING:
    from rigcal.rigdocument import RigDocument
    from rigcal.site import Site
    from rigcal.sync.log import ProbeLog
    from rigcal.sync.network import Target
    from rigcal.sync.record import CameraClock

SECONDS, RATE_HZ = 20.0, 10.0


@sync_app.command()
def probe(
    hosts: Annotated[
        list[str],
        typer.Argument(metavar="SITE|HOST...", help="Site file with clock = entries, or hosts: CAMERA=HOST[:PORT]."),
    ],
    rig: RigOption,
    site: SiteOption = None,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", help="How long to probe; the drift needs minutes.", show_default=f"{SECONDS:g}"),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", help="Probes per second to each host.", show_default=f"{RATE_HZ:g}")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="FILE.csv", help="Also append every probe here, for `rigcal sync report`."),
    ] = None,
    from_log: Annotated[
        Path | None,
        typer.Option("--from-log", metavar="FILE.csv", help="Ask nobody: take the answers that this log holds."),
    ] = None,
    output: OutputOption = None,
    as_json: JsonOption = False,
) -> None:
    """Probe the clock of each camera's host into the rig file.

    Offset and drift come with a bound that holds whatever packets waited. A host is a computer that stamps frames: one
    that runs `rigcal sync serve`, or any NTP server. Hosts without a
    camera's name are taken in rig order; one host alone is every camera's. A capture latency in the site file is added.

    With --from-log the answers come from the log of an earlier probe, such as that of a recording.

    Exit code 0: every host answered and the gate passes; 1: one did not (the others are written); 2: bad input.
    """
    from rigcal.rigfile import read_rigfile
    from rigcal.sync.log import read_exchanges
    from rigcal.sync.record import clock_limits

    document = read_rigfile(rig)
    targets, declared = targets_from(hosts, site_of(site), document)
    logged = None
    if from_log is None:
        found = probe_hosts(targets, SECONDS if seconds is None else seconds, RATE_HZ if rate is None else rate, log)
    else:
        _refuse_beside_a_log({"--seconds": seconds, "--rate": rate, "--log": log})
        logged = read_exchanges(from_log)
        found = probed_in_log(from_log, logged, targets, document)
    clocks = [clock for one in found for clock in clocks_of(one, document, declared)]
    limits = clock_limits(document, declared)
    path = output or rig
    written = write_clocks(document, clocks, limits, "sync probe", path) if clocks else document
    if as_json:
        print_json(
            {
                "rig_file": str(path),
                "written": bool(clocks),
                "torn_rows": logged.torn if logged is not None else None,
                "verdict": written.verdict,
                "hosts": [_as_json(one) for one in found],
                "cameras": {c.id: c.clock.model_dump() for c in written.cameras if c.clock},
                "gates": clock_gates_of(written),
            }
        )
    else:
        show(server_words() if from_log is None or logged is None else _words_of_log(from_log, logged))
        _show(found, written, path if clocks else None)
    raise typer.Exit(0 if clocks_pass(written) and all(one.clock for one in found) else 1)


def _refuse_beside_a_log(options: dict[str, object]) -> None:
    from rigcal.errors import OptionError

    for name, value in options.items():
        if value is not None:
            raise OptionError(name, expected=f"{name} without --from-log, which asks no host", got="both")


def targets_from(hosts: list[str], site: Site | None, document: RigDocument) -> tuple[tuple[Target, ...], Site | None]:
    """Whom to probe: a site file's hosts, or those named; and the site file that was meant."""
    from rigcal.site import load_site
    from rigcal.sync.network import targets_of, targets_of_site

    if len(hosts) == 1 and (hosts[0].endswith(".toml") or Path(hosts[0]).is_file()):
        declared = load_site(Path(hosts[0]))
        return targets_of_site(declared, document.camera_ids).targets, site or declared
    return targets_of(hosts, document.camera_ids), site


def clocks_of(one: Probed, document: RigDocument, site: Site | None) -> list[CameraClock]:
    """The clock of every camera that hangs on a host."""
    from rigcal.sync.record import CameraClock, clock_of_host, entry_of, latency_of

    if one.clock is None:
        return []
    clocks = []
    for camera_id in one.probe.target.camera_ids:
        latency = latency_of(document, site, camera_id)
        evidence: dict[str, Any] = {
            "host": one.probe.target.name,
            "host_clock": entry_of(one.clock.model).model_dump(),
            "exchanges": len(one.exchanges),
            "round_trip_s": one.clock.round_trip_min_s,
        }
        if latency is not None:
            evidence["latency"] = {name: getattr(latency, name) for name in ("latency_s", "bound_s", "source")}
        clocks.append(CameraClock(camera_id, clock_of_host(one.clock.model, latency), evidence))
    return clocks


def server_words() -> str:
    """What is known of this machine's own clock, which rig time is."""
    from rigcal.sync.network import NoTracking, read_tracking

    told = read_tracking()
    if isinstance(told, NoTracking):
        return f"Rig time is this machine's clock; nothing says how far it is from UTC ({told.reason})."
    if told.bound_s is None:
        return "Rig time is this machine's clock, which is not synchronised to UTC (chronyd says so)."
    return f"Rig time is this machine's clock, within {1e3 * told.bound_s:.3g} ms of UTC (chronyd)."


def _words_of_log(path: Path, log: ProbeLog) -> str:
    """What of a log is used."""
    from rigcal.report.text import plain
    from rigcal.sync.record import utc_of

    first = min(int(answers.sent_ns.min()) for answers in log.values())
    last = max(int(answers.returned_ns.max()) for answers in log.values())
    count = sum(map(len, log.values()))
    torn = "; its last row is unfinished and was left out" if log.torn else ""
    return plain(f"{count} answers from {path}, {utc_of(first * 1e-9)} to {utc_of(last * 1e-9)}{torn}")


def _as_json(one: Probed) -> dict[str, Any]:
    probe, clock = one.probe, one.clock
    told = {
        "host": probe.target.name,
        "cameras": list(probe.target.camera_ids),
        "answered": clock is not None,
        "reason": probe.reason,
        "address": probe.address,
        "port": probe.port,
        "sent": one.sent,
        "lost": one.lost,
        "stratum": probe.stratum,
        "claimed_error_s": probe.claimed_error_s,
    }
    if clock is not None:
        told |= {
            "offset_s": clock.model.offset_s,
            "drift_ppm": clock.model.drift_ppm,
            "bound_s": clock.model.bound_s,
            "drift_bound_ppm": clock.model.drift_bound_ppm,
            "round_trip_s": clock.round_trip_min_s,
            "steps": [{"clock": s.clock, "at_s": s.at_s, "jump_s": s.jump_s} for s in clock.steps],
            "confusion": confusion_of(one),
        }
    return told


def confusion_of(one: Probed) -> str | None:
    """A known mistake that a host's offset betrays."""
    from rigcal.sync.network import tai_confusion

    return tai_confusion(one.clock.model.offset_s, one.clock.model.bound_s) if one.clock else None


def _show(found: list[Probed], written: RigDocument, path: Path | None) -> None:
    from rigcal.report.text import plain, table

    columns = ["host", "cameras", "offset, ms", "drift, ppm", "round trip, ms", "lost"]
    show(table(columns, [_row(one) for one in found], left=(0, 1)))
    for one in found:
        if one.clock is None:
            show(plain(f"{one.probe.target.name} does not answer: {one.probe.reason}"))
        elif confusion := confusion_of(one):
            show(plain(f"{one.probe.target.name}: {confusion}"))
        for step in one.clock.steps if one.clock else ():
            whose = one.probe.target.name if step.clock == "host" else "this machine"
            show(plain(f"the clock of {whose} was stepped by {1e3 * abs(step.jump_s):.3g} ms while it was probed"))
    show_failed_gates(written)
    probed = [camera_id for one in found if one.clock for camera_id in one.probe.target.camera_ids]
    if unknown := [camera_id for camera_id in probed if not _knows_latency(written, camera_id)]:
        show(
            plain(
                f"{', '.join(unknown)}: how long after a frame is taken it is stamped is not known nor in the offset; "
                "give capture_latency_s in the site file, or run `rigcal sync video`"
            )
        )
    show(f"rig file {path}: {written.verdict}" if path else "no host answered; no file written")


def _knows_latency(document: RigDocument, camera_id: str) -> bool:
    from rigcal.sync.record import evidence_of_clock

    return "latency" in evidence_of_clock(document, camera_id)


def _row(one: Probed) -> list[str]:
    from rigcal.report.numbers import ABSENT, fixed, scaled
    from rigcal.report.text import plain

    figures = [ABSENT] * 3
    if one.clock is not None:
        model = one.clock.model
        figures = [
            f"{scaled(model.offset_s, 1e3, 3)} +- {scaled(model.bound_s, 1e3, 3)}",
            f"{fixed(model.drift_ppm)} +- {fixed(model.drift_bound_ppm)}",
            scaled(one.clock.round_trip_min_s, 1e3, 3),
        ]
    cameras = ", ".join(one.probe.target.camera_ids)
    lost = ABSENT if one.lost is None else f"{one.lost} of {one.sent}"
    return [plain(one.probe.target.name), plain(cameras), *figures, lost]
