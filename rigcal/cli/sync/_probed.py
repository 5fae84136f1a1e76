"""Where the exchanges with hosts come from: the hosts themselves, or a log of earlier probes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.cli.sync._app import progress_bar

if TYPE_CHECKING:
    from rigcal.rigdocument import RigDocument
    from rigcal.sync.estimator.estimate import HostClock
    from rigcal.sync.exchanges import Exchanges
    from rigcal.sync.log import ProbeLog
    from rigcal.sync.network import HostProbe, Target

ROUND_S = 10.0
"""What a killed long probe loses of its log at the most."""


@dataclass(frozen=True, slots=True)
class Probed:
    """A host, and its clock where it answered."""

    probe: HostProbe
    """Its last round."""
    exchanges: Exchanges
    """Of all rounds."""
    sent: int | None
    """None where only the answers were logged."""
    lost: int | None
    clock: HostClock | None


def probe_hosts(targets: tuple[Target, ...], seconds: float, rate: float, log: Path | None) -> list[Probed]:
    """Probe all hosts; a long probe is logged every few seconds, and Ctrl-C ends it with what it has."""
    from rigcal.sync.log import append_exchanges
    from rigcal.sync.network import probe as ask

    rounds: list[tuple[HostProbe, ...]] = []
    total = max(1, round(seconds / ROUND_S)) if log else 1
    with progress_bar("probing") as bar:
        task = bar.add_task("", total=total)
        try:
            for _ in range(total):
                rounds.append(ask(targets, seconds=seconds / total, rate_hz=rate))
                if log is not None:
                    append_exchanges(log, {c: p.exchanges for p in rounds[-1] for c in p.target.camera_ids})
                bar.advance(task)
        except KeyboardInterrupt:
            if not rounds:
                raise
    return [_joined(parts) for parts in zip(*rounds, strict=True)]


def _joined(rounds: tuple[HostProbe, ...]) -> Probed:
    from rigcal.sync.exchanges import Exchanges

    exchanges = Exchanges.joined([one.exchanges for one in rounds])
    return Probed(rounds[-1], exchanges, sum(p.sent for p in rounds), sum(p.lost for p in rounds), _clock_of(exchanges))


def _clock_of(exchanges: Exchanges) -> HostClock | None:
    from rigcal.sync.estimator.estimate import estimate_clock

    return estimate_clock(exchanges) if len(exchanges) else None


def probed_in_log(path: Path, log: ProbeLog, targets: tuple[Target, ...], document: RigDocument) -> list[Probed]:
    """What a log says of the host of each camera, one by one: a log names cameras, not hosts.

    Raises:
        ProbeLogError: where the log holds no probe, or probes of a camera that the rig has not or whose host was not
            named.
    """
    from rigcal.sync.network import Target

    alone = {c: Target((c,), target.host, target.port) for target in targets for c in target.camera_ids}
    _check_cameras(path, log, tuple(alone), document.camera_ids)
    return [_logged(alone[c], log.get(c)) for c in document.camera_ids if c in alone]


def _check_cameras(path: Path, log: ProbeLog, named: tuple[str, ...], camera_ids: tuple[str, ...]) -> None:
    from rigcal.errors import ProbeLogError

    if not log:
        raise ProbeLogError(
            path,
            problem="the log holds no probe",
            expected="rows of answered probes below the first line",
            got="no whole row",
            do_next="give the log of a probe that was answered, or probe the hosts: leave --from-log out",
        )
    if strangers := [camera_id for camera_id in log if camera_id not in camera_ids]:
        raise ProbeLogError(
            path,
            problem=f"the rig has no camera {', '.join(map(repr, strangers))}",
            expected=f"cameras of the rig: {', '.join(camera_ids)}",
            got=f"probes of {', '.join(log)}",
            do_next="give the log that was made with this rig, or remove those rows",
        )
    if nameless := [camera_id for camera_id in log if camera_id not in named]:
        raise ProbeLogError(
            path,
            problem=f"it is not said on which host {', '.join(nameless)} hangs",
            expected="a host for every camera of the log",
            got=f"hosts for {', '.join(named)}",
            do_next="add clock = entries to the site file, or name them: CAMERA=HOST",
        )


def _logged(target: Target, exchanges: Exchanges | None) -> Probed:
    from rigcal.sync.exchanges import UNKNOWN, Exchanges
    from rigcal.sync.network import HostProbe

    answers = Exchanges.joined([]) if exchanges is None else exchanges
    probe = HostProbe(
        target=target,
        address=None,
        port=None,
        ours=bool((answers.host_monotonic_ns != UNKNOWN).any()),
        exchanges=answers,
        sent=len(answers),
        lost=0,
        late=0,
        duplicates=0,
        spoofed=0,
        malformed=0,
        kisses=(),
        claim=None,
        reason=None if len(answers) else "the log holds no answer of it",
    )
    return Probed(probe, answers, None, None, _clock_of(answers))
