"""What recording and live sources need to know of an H.264 access unit in Annex B form: its units and their kinds.

NAL unit types and the slice header: ITU-T H.264 (08/2021), table 7-1 and sections 7.3.3, 7.4.1.2.3 and 9.1.
"""

from __future__ import annotations

from collections.abc import Iterator

START_CODE = b"\x00\x00\x01"
SLICE, IDR, SPS, PPS, DELIMITER = 1, 5, 7, 8, 9
_PARAMETER_SETS = frozenset({SPS, PPS})
_KEY_FRAME = frozenset({IDR, SPS, PPS})
_B_SLICE = 1


def starts_with_start_code(data: bytes) -> bool:
    """Whether the first bytes are a start code of three or four bytes."""
    return data.startswith((START_CODE, b"\x00" + START_CODE))


def nal_units(data: bytes) -> Iterator[tuple[int, int]]:
    """Type and offset of the header byte of each NAL unit."""
    offset = data.find(START_CODE)
    while 0 <= offset < len(data) - len(START_CODE):
        yield data[offset + len(START_CODE)] & 0x1F, offset + len(START_CODE)
        offset = data.find(START_CODE, offset + len(START_CODE))


def nal_types(data: bytes) -> list[int]:
    """Types of the NAL units up to the first slice; the sets and the delimiter of an access unit stand before it."""
    types = []
    for kind, _ in nal_units(data):
        types.append(kind)
        if kind in (SLICE, IDR):
            break
    return types


def is_key_frame(data: bytes) -> bool:
    """Whether decoding can begin here: an IDR picture with its sequence and picture parameter sets."""
    return set(nal_types(data)) >= _KEY_FRAME


def has_b_slice(data: bytes) -> bool:
    """Whether the first slice is a B slice, which players of single messages cannot order."""
    for kind, offset in nal_units(data):
        if kind in (SLICE, IDR):
            bits = "".join(f"{byte:08b}" for byte in data[offset + 1 : offset + 9])
            _, rest = _exp_golomb(bits)  # first_mb_in_slice
            slice_type, _ = _exp_golomb(rest)
            return slice_type % 5 == _B_SLICE
    return False


def parameter_sets(data: bytes) -> bytes:
    """The sequence and picture parameter sets of an access unit, each with a start code; empty where one kind lacks."""
    units = list(nal_units(data))
    ends = [*(offset - len(START_CODE) for _, offset in units), len(data)][1:]
    found = [(kind, data[offset:end].rstrip(b"\x00")) for (kind, offset), end in zip(units, ends, strict=True)]
    sets = [(kind, unit) for kind, unit in found if kind in _PARAMETER_SETS]
    if {kind for kind, _ in sets} != _PARAMETER_SETS:
        return b""
    return b"".join(b"\x00" + START_CODE + unit for _, unit in sets)


def with_parameter_sets(data: bytes, sets: bytes) -> bytes:
    """An access unit with ``sets`` put before its slices: first of all, but after an access unit delimiter."""
    units = list(nal_units(data))
    if not units or units[0][0] != DELIMITER or len(units) == 1:
        return sets + data
    start = units[1][1] - len(START_CODE)
    start -= data[start - 1] == 0
    return data[:start] + sets + data[start:]


def _exp_golomb(bits: str) -> tuple[int, str]:
    """One unsigned Exp-Golomb number and the bits after it; 0 where the bits run out."""
    zeros = len(bits) - len(bits.lstrip("0"))
    end = 2 * zeros + 1
    return (int(bits[zeros:end], 2) - 1 if end <= len(bits) else 0), bits[end:]
