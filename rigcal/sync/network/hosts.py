"""Which host tells which camera's time, from the command line or from the site file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigcal.errors import TimeHostError
from rigcal.sync.network.sockets import written

if TYPE_CHECKING:
    from rigcal.site import Site

_LAST_PORT = 65_535
_V6_PORT = re.compile(r"\[(?P<host>[^\[\]]+)\](?::(?P<port>.*))?")
_SCHEME = re.compile(r"(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<rest>.*)", re.IGNORECASE)
_FORMS = "CAMERA=HOST, with HOST as name, name:port, [IPv6]:port or ntp://name:port"


@dataclass(frozen=True, slots=True)
class Target:
    """A host to probe, and the cameras that stamp by its clock."""

    camera_ids: tuple[str, ...]
    host: str
    """A name or an address, without brackets."""
    port: int | None = None
    """None: ask where ``rigcal sync serve`` answers, and where NTP does."""

    @property
    def name(self) -> str:
        """The host as one writes it."""
        return self.host if self.port is None else written(self.host, self.port)


@dataclass(frozen=True, slots=True)
class SiteTargets:
    """The hosts that a site file names."""

    targets: tuple[Target, ...]
    without_clock: tuple[str, ...]
    """Cameras of the rig for which the file names none."""


def targets_of(arguments: Sequence[str], camera_ids: Sequence[str]) -> tuple[Target, ...]:
    """The hosts of a command line: ``CAMERA=HOST`` each, or one bare host per camera in rig order, or one for all.

    A host that several cameras hang on is one target, and is probed once.

    Raises:
        TimeHostError: where an argument cannot be read, names a camera that the rig has not or names it again, or
            where hosts without a camera are neither one nor as many as the cameras.
    """
    named = [argument for argument in arguments if _camera_of(argument) is not None]
    if not named:
        return _grouped(zip(_in_rig_order(arguments, camera_ids), arguments, strict=True))
    if len(named) < len(arguments):
        bare = next(argument for argument in arguments if argument not in named)
        raise TimeHostError(
            "some hosts are given with their camera and others without",
            expected=_example(camera_ids),
            got=" ".join(arguments),
            do_next=f"say whose clock {bare} is: CAMERA={bare}",
        )
    pairs = [(_known_camera(argument, camera_ids), argument.partition("=")[2]) for argument in arguments]
    _once_each([camera_id for (camera_id,), _ in pairs], arguments)
    return _grouped(pairs)


def targets_of_site(site: Site, camera_ids: Sequence[str]) -> SiteTargets:
    """The hosts of the ``clock`` entries of a site file, for the cameras of a rig.

    Raises:
        TimeHostError: where an entry cannot be read, or no camera of the rig has one.
    """
    declared = {camera.id: camera.clock for camera in site.cameras if camera.clock is not None}
    known = [camera_id for camera_id in camera_ids if camera_id in declared]
    if not known:
        raise TimeHostError(
            "the site file names no host for any camera of the rig",
            where=f"site {site.site}",
            expected='clock = "ntp://HOST" under [[cameras]]',
            got=f"no clock entry for {', '.join(camera_ids)}",
            do_next="add the entries, or name the hosts on the command line: CAMERA=HOST",
        )
    pairs = [((camera_id,), declared[camera_id]) for camera_id in known]
    without = tuple(camera_id for camera_id in camera_ids if camera_id not in declared)
    return SiteTargets(_grouped(pairs, f"clock of a camera of site {site.site}"), without)


def parse_host(text: str, where: str | None = None) -> tuple[str, int | None]:
    """Host and port of ``name``, ``name:port``, ``[IPv6]:port``, a bare IPv6 address, or any of them as ``ntp://``.

    ``where`` is where it was written, for the message.

    Raises:
        TimeHostError: where it is none of these.
    """
    rest = text.strip()
    if scheme := _SCHEME.fullmatch(rest):
        if scheme["scheme"].lower() != "ntp":
            raise _unreadable(text, where, f"the scheme {scheme['scheme']}://, where only ntp:// can be asked")
        rest = scheme["rest"].rstrip("/")
    port: str | None
    if brackets := _V6_PORT.fullmatch(rest):
        host, port = brackets["host"], brackets["port"]
    elif rest.count(":") > 1:
        host, port = rest, None
    else:
        host, colon, after = rest.partition(":")
        port = after if colon else None
    if not host or re.search(r"[\s/@\[\]=]", host):
        raise _unreadable(text, where, "no host name" if not host else f"{host!r}, which is no host name")
    if port is None:
        return host, None
    if not port.isascii() or not port.isdigit() or not 1 <= int(port) <= _LAST_PORT:
        raise _unreadable(text, where, f"the port {port!r}, which is no number from 1 to {_LAST_PORT}")
    return host, int(port)


def _unreadable(text: str, where: str | None, got: str) -> TimeHostError:
    return TimeHostError(
        f"the host {text!r} cannot be read",
        where=where,
        expected="name, name:port, [IPv6]:port or ntp://name:port",
        got=got,
        do_next="mend it; for instance camera-0.local, or 192.168.1.20:123",
    )


def _camera_of(argument: str) -> str | None:
    """What stands before the first ``=``."""
    camera_id, sign, _ = argument.partition("=")
    return camera_id.strip() if sign else None


def _known_camera(argument: str, camera_ids: Sequence[str]) -> tuple[str, ...]:
    camera_id = _camera_of(argument) or ""
    if camera_id not in camera_ids:
        raise TimeHostError(
            f"the rig has no camera {camera_id!r}",
            where=argument,
            expected=f"one of {', '.join(camera_ids)}",
            got=repr(camera_id),
            do_next="name the camera as the rig file does",
        )
    return (camera_id,)


def _once_each(named: Sequence[str], arguments: Sequence[str]) -> None:
    twice = [camera_id for camera_id in dict.fromkeys(named) if named.count(camera_id) > 1]
    if twice:
        got = " ".join(a for a, camera_id in zip(arguments, named, strict=True) if camera_id == twice[0])
        raise TimeHostError(
            f"camera {twice[0]} is given more than one host",
            expected="one host per camera",
            got=got,
            do_next=f"keep the host whose clock stamps the frames of {twice[0]}",
        )


def _in_rig_order(arguments: Sequence[str], camera_ids: Sequence[str]) -> list[tuple[str, ...]]:
    """The cameras of each bare host."""
    if len(arguments) == 1:
        return [tuple(camera_ids)]
    if len(arguments) == len(camera_ids):
        return [(camera_id,) for camera_id in camera_ids]
    raise TimeHostError(
        "it is not clear which host tells which camera's time",
        expected=f"one host for all, {len(camera_ids)} hosts in rig order, or {_FORMS}",
        got=f"{len(arguments)} hosts for the {len(camera_ids)} cameras {', '.join(camera_ids)}",
        do_next=f"say whose clock each is, for instance {_example(camera_ids)}",
    )


def _example(camera_ids: Sequence[str]) -> str:
    return " ".join(f"{camera_id}=HOST" for camera_id in camera_ids[:2])


def _grouped(pairs: Iterable[tuple[tuple[str, ...], str]], where: str | None = None) -> tuple[Target, ...]:
    """One target per host and port, in the order in which they came."""
    cameras: dict[tuple[str, int | None], tuple[str, ...]] = {}
    for camera_ids, text in pairs:
        host, port = parse_host(text, where)
        key = (host.lower(), port)
        cameras[key] = cameras.get(key, ()) + camera_ids
    return tuple(Target(camera_ids, host, port) for (host, port), camera_ids in cameras.items())
