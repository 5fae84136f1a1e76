"""URLs of cameras, whose user names and passwords are never logged, recorded or shown.

Decision: of what follows the host, every value of ``name=value`` is hidden, not only those of names that sound like a
login: cameras take credentials in the query and even in the path (``/user=admin_password=abc_channel=1``) under names
that nobody can list. It costs that two channels of one host look alike; messages name the camera beside the address.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Self
from urllib.parse import urlsplit

from recognition.errors import SourceError

SCHEMES = ("rtsp", "rtsps")
HIDDEN = "***"
_VALUE = re.compile(r"=[^&;?/#]+")


def is_url(text: str) -> bool:
    """Whether a source is a URL rather than a path."""
    return "://" in text


@dataclass(frozen=True, slots=True, repr=False)
class SourceUrl:
    """The address of a live camera; ``str`` and ``repr`` show it without credentials."""

    with_credentials: str = field(repr=False)
    """The whole address, only for what opens it."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Check an address.

        Raises:
            SourceError: where it is not an RTSP URL with a host.
        """
        url = cls(text)
        try:
            parts = urlsplit(text)
            is_good = parts.scheme.lower() in SCHEMES and bool(parts.hostname) and parts.port != 0
        except ValueError:  # a port that is no number, an address that is no IPv6
            is_good = False
        if not is_good:
            raise SourceError(
                "not the address of a live camera",
                where="--source, or source in the site file",
                expected="rtsp://HOST/PATH, rtsp://USER:PASSWORD@HOST:PORT/PATH, or rtsps://",
                got=str(url),
                do_next="take the address from the camera's page; write / @ : and % in a password as %2F %40 %3A %25",
            ) from None
        return url

    @property
    def has_login(self) -> bool:
        """Whether the address names a user before its host."""
        return bool(self._parts()[1])

    def __str__(self) -> str:
        scheme, login, rest = self._parts()
        return scheme + (f"{HIDDEN}@" if login else "") + _VALUE.sub(f"={HIDDEN}", rest)

    def __repr__(self) -> str:
        return f"SourceUrl({str(self)!r})"

    def _parts(self) -> tuple[str, str, str]:
        """``rtsp://``, user and password, and the rest; a password may hold ``/``, ``?`` or ``#`` that nobody wrote
        as it should be, so that the login ends at the last ``@``."""
        scheme, separator, rest = self.with_credentials.partition("://")
        login, _, rest = rest.rpartition("@")
        return scheme + separator, login, rest
