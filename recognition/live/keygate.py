"""After a loss in an H.264 stream everything up to the next key frame is of no use."""

from __future__ import annotations


class KeyGate:
    """Open until a packet of one camera is lost, then shut until a key frame comes."""

    def __init__(self) -> None:
        self._open = True

    def shut(self) -> None:
        """Something was lost."""
        self._open = False

    def passes(self, *, is_key: bool) -> bool:
        """Whether the next packet can be decoded."""
        self._open = self._open or is_key
        return self._open
