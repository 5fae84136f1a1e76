"""Many messages of one kind that differ in a few numbers: filled in by numpy, read by protobuf in C.

A drawing has hundreds of points, and to set them field by field from Python takes most of what recording takes. Here a
message is serialized once, copies of it are made with other numbers in the same places, and protobuf reads them with
``MergeFromString``, which appends what is repeated and sets the rest. The 17 points of a person take 20 us when they
are set one by one, and 2 us so, together with those of three others (thread time).

Decision: the copies are read back into messages, and not joined to a whole message by hand, so that lengths and the
form of what is written stay protobuf's business: the bytes are those of messages that were set field by field.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from google.protobuf.message import Message

from rigcal.geometry import Floats


class Stencil:
    """The serialized form of a message in which some numbers are left open.

    Args:
        count: How many.
        draw: Makes the message of that many numbers; each must be one double of it.

    Raises:
        ValueError: where a number is no double of the message, or several.
    """

    def __init__(self, count: int, draw: Callable[..., Message]) -> None:
        marks = [np.pi + number for number in range(count)]  # none is 0, which protobuf leaves out
        data = draw(*marks).SerializeToString()
        self._blank = np.frombuffer(data, np.uint8)
        doubles = [struct.pack("<d", mark) for mark in marks]
        for number, double in enumerate(doubles):
            if data.count(double) != 1:
                raise ValueError(f"number {number} must be one double of the message, is {data.count(double)}")
        places = [data.index(double) for double in doubles]
        self._names = [str(number) for number in range(count)]
        self._row = np.dtype(
            {"names": self._names, "formats": ["<f8"] * count, "offsets": places, "itemsize": len(data)}
        )

    def copies(self, numbers: Floats) -> list[Any]:
        """The message with each row of numbers (..., count), in lists of the same shape."""
        rows = np.empty((*numbers.shape[:-1], len(self._blank)), np.uint8)
        rows[:] = self._blank
        doubles = rows.view(self._row)[..., 0]
        for number, name in enumerate(self._names):
            doubles[name] = numbers[..., number]
        copies: list[Any] = rows.view(f"V{len(self._blank)}")[..., 0].tolist()
        return copies
