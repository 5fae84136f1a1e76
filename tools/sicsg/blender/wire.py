"""Messages between the two environments: one line of JSON, then the arrays that it lists, byte for byte.

Neither pickles (the two environments have different numpy) nor files: a pipe moves a picture in milliseconds.
"""

from __future__ import annotations

import json
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
LONGEST_HEADER = 1 << 24
"""Bytes; what is longer is no header but something else that got into the pipe."""


class WireError(Exception):
    """What came through the pipe is no message."""


def send(stream: BinaryIO, header: dict[str, Any], arrays: Arrays | None = None) -> None:
    """Write a message: a JSON object without the entry ``arrays``, and arrays by name."""
    flat = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
    listing = [[name, array.dtype.str, list(array.shape)] for name, array in flat.items()]
    stream.write(json.dumps({**header, "arrays": listing}).encode() + b"\n")
    for array in flat.values():
        stream.write(array.reshape(-1).view(np.uint8))
    stream.flush()


def receive(stream: BinaryIO) -> tuple[dict[str, Any], Arrays] | None:
    """Read a message; None where the stream has ended.

    Raises:
        WireError: if it is no message, or only a part of one.
    """
    line = stream.readline(LONGEST_HEADER)
    if not line:
        return None
    try:
        header = json.loads(line)
        listing = header.pop("arrays")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise WireError(line[:200].decode(errors="replace").rstrip()) from error
    return header, {name: _read_array(stream, dtype, shape) for name, dtype, shape in listing}


def _read_array(stream: BinaryIO, dtype: str, shape: list[int]) -> NDArray[Any]:
    array: NDArray[Any] = np.empty(shape, dtype=np.dtype(dtype))
    left = memoryview(array.reshape(-1).view(np.uint8))
    while len(left) > 0:
        count = stream.readinto(left)
        if not count:
            raise WireError(f"ended {len(left)} bytes before the end of an array {shape}")
        left = left[count:]
    return array
