"""Access units in Annex B form: their parameter sets found, and put where decoders want them."""

import pytest

from recognition.h264 import is_key_frame, nal_types, parameter_sets, with_parameter_sets

LONG = b"\x00\x00\x00\x01"
SHORT = b"\x00\x00\x01"
SPS, PPS, AUD, SEI, IDR = b"\x67\x64\x00\x0d", b"\x68\xeb\xc0", b"\x09\xf0", b"\x06\x05\x01", b"\x65\x88\x84"
SETS = LONG + SPS + LONG + PPS


@pytest.mark.parametrize("code", [LONG, SHORT])
def test_parameter_sets_are_found_with_either_start_code(code):
    unit = b"".join(code + nal for nal in (AUD, SPS, PPS, SEI, IDR))
    assert parameter_sets(unit) == SETS
    assert nal_types(unit + code + SPS) == [9, 7, 8, 6, 5]


def test_one_kind_of_parameter_set_alone_is_none():
    assert parameter_sets(LONG + SPS + LONG + IDR) == b""
    assert parameter_sets(b"") == b""


@pytest.mark.parametrize("code", [LONG, SHORT])
def test_parameter_sets_are_put_first_but_after_the_delimiter(code):
    plain, delimited = code + SEI + code + IDR, code + AUD + code + IDR
    assert not is_key_frame(plain)
    assert with_parameter_sets(plain, SETS) == SETS + plain
    assert with_parameter_sets(delimited, SETS) == code + AUD + SETS + code + IDR
    assert is_key_frame(with_parameter_sets(delimited, SETS))
