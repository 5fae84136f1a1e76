"""What a source's address and its failures are called in messages; no password ever is in them."""

from __future__ import annotations

import errno
import re
from pathlib import Path
from urllib.parse import urlsplit

import av.error

_STATUS: tuple[tuple[type[av.error.FFmpegError], str], ...] = (
    (av.error.HTTPUnauthorizedError, "it refuses the user name or the password (401)"),
    (av.error.HTTPForbiddenError, "it refuses to show this stream to this user (403)"),
    (av.error.HTTPNotFoundError, "it has no stream of this name (404)"),
    (av.error.HTTPBadRequestError, "it does not understand the request (400)"),
    (av.error.HTTPTooManyRequestsError, "it has too many viewers already (429)"),
    (av.error.HTTPError, "it answers with an error of its own"),
    (av.error.ConnectionRefusedError, "nothing listens there: the connection is refused"),
    (av.error.ConnectionResetError, "it closed the connection"),
    (av.error.FileNotFoundError, "there is no such file"),
    (av.error.PermissionError, "it may not be read"),
    (av.error.IsADirectoryError, "it is a folder, not a video"),
    (av.error.InvalidDataError, "it holds no video that can be read"),
    (av.error.EOFError, "it ended before the first frame"),
    (av.error.ProtocolNotFoundError, "its kind of address is not known"),
)
_NUMBERS = {
    errno.EHOSTUNREACH: "there is no way to this host",
    errno.ENETUNREACH: "there is no way to its network",
    errno.ETIMEDOUT: "it does not answer",
    errno.EIO: "it cannot be reached, or its name is not known",
}


_HOST = re.compile(r"([\w.-]*|\[[0-9a-fA-F:.%]+\])(:\d+)?")
_SECRET = re.compile(r"pass|pwd|token|secret|key=|@", re.IGNORECASE)


def shown_address(url: str) -> str:
    """An address without user, password and query, for messages; a file's path as it is.

    Where it is not clear where the password ends, or the path holds one as some cameras want it, less is shown.
    """
    if "://" not in url:
        return str(Path(url))
    scheme, _, rest = url.partition("://")
    authority, slash, path = re.split(r"[?#]", rest, maxsplit=1)[0].partition("/")
    host = authority.rpartition("@")[2]
    if not _HOST.fullmatch(host):
        return f"{scheme}://..."
    return f"{scheme}://{host}{slash}" + ("..." if _SECRET.search(path) else path)


def is_live(url: str) -> bool:
    """Whether an address is a stream's rather than a file's."""
    return "://" in url and urlsplit(url).scheme != "file"


def failure(error: av.error.FFmpegError, *, waited_s: float) -> str:
    """Why a source cannot be opened, in words."""
    if isinstance(error, av.error.ExitError):
        return f"it does not answer within {waited_s:.3g} s"
    for kind, words in _STATUS:
        if isinstance(error, kind):
            return words
    named = (error.strerror or "no reason is given").lower()
    return _NUMBERS.get(error.errno or 0, f"it cannot be opened ({named})")
