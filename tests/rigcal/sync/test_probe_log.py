"""Claims about the probe log: exact to the nanosecond, readable after a killed writer, and never another file's end."""

import numpy as np
import pytest

from rigcal.errors import OutputError, ProbeLogError
from rigcal.sync.exchanges import UNKNOWN, Exchanges
from rigcal.sync.log import PROBE_LOG, append_exchanges, probe_log_beside, read_exchanges

HEADER = "cam_id,t1_ns,t2_ns,t3_ns,t4_ns,rig_monotonic_ns,host_monotonic_ns"
SENT_NS = 1_763_804_400_123_456_789  # has more digits than a float64


def exchanges(count=3, *, start_ns=SENT_NS, host_monotonic=True):
    sent = start_ns + 1_000_000_000 * np.arange(count)
    known = 77 + np.arange(count) if host_monotonic else np.full(count, UNKNOWN)
    return Exchanges(sent, sent + 2_000_101, sent + 2_000_203, sent + 307, 5_000_000_000 + np.arange(count), known)


def assert_same(got, wanted):
    for name in Exchanges.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name), err_msg=name)


def test_a_log_gives_back_what_was_written_to_the_nanosecond(tmp_path):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"cam0": exchanges(), "cam1": exchanges(2, host_monotonic=False)})
    append_exchanges(path, {"cam0": exchanges(1, start_ns=SENT_NS + 10**10)})
    log = read_exchanges(path)
    assert (list(log), len(log), log.torn) == (["cam0", "cam1"], 2, 0)
    assert len(log["cam0"]) == 4
    assert_same(log["cam0"][:3], exchanges())
    assert_same(log["cam1"], exchanges(2, host_monotonic=False))


def test_the_form_is_one_header_and_whole_nanoseconds_with_nothing_for_an_unknown_clock(tmp_path):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"hall, north": exchanges(1)})
    append_exchanges(path, {"cam1": exchanges(1, host_monotonic=False)})
    assert path.read_text() == (
        f"{HEADER}\n"
        '"hall, north",1763804400123456789,1763804400125456890,1763804400125456992,1763804400123457096,5000000000,77\n'
        "cam1,1763804400123456789,1763804400125456890,1763804400125456992,1763804400123457096,5000000000,\n"
    )
    assert list(read_exchanges(path)) == ["hall, north", "cam1"]


@pytest.mark.parametrize("left", [1, 2, 5, 40, 60, 90])
def test_half_a_row_of_a_killed_writer_is_left_out_and_the_next_append_mends_it(tmp_path, left):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"cam0": exchanges(2)})
    whole = path.read_bytes()
    path.write_bytes(whole[:-left])
    log = read_exchanges(path)
    assert log.torn == 1
    assert_same(log["cam0"], exchanges(1))
    assert append_exchanges(path, {"cam0": exchanges(1, start_ns=SENT_NS + 1_000_000_000)}) == 1
    assert append_exchanges(path, {}) == 0
    log = read_exchanges(path)
    assert (log.torn, len(log["cam0"])) == (0, 2)


@pytest.mark.parametrize("kept", [0, 1, len(HEADER)])
def test_a_writer_killed_within_the_header_leaves_an_empty_log(tmp_path, kept):
    path = tmp_path / PROBE_LOG
    path.write_text(HEADER[:kept])
    log = read_exchanges(path)
    assert (len(log), log.torn) == (0, int(kept > 0))
    assert append_exchanges(path, {"cam0": exchanges()}) == int(kept > 0)
    assert_same(read_exchanges(path)["cam0"], exchanges())


def test_a_long_torn_row_is_cut_off_whole(tmp_path):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"cam0": exchanges(1)})
    with path.open("a") as file:
        file.write("\0" * 10_000)  # what a power cut leaves on some file systems
    assert append_exchanges(path, {"cam0": exchanges(1)}) == 1
    assert len(read_exchanges(path)["cam0"]) == 2


def test_a_log_that_a_spreadsheet_saved_with_other_line_ends_reads_as_well(tmp_path):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"cam0": exchanges()})
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert_same(read_exchanges(path)["cam0"], exchanges())


def test_a_log_stands_in_its_capture_or_beside_its_recording(tmp_path):
    assert probe_log_beside(tmp_path) == tmp_path / "clock_probes.csv"
    assert probe_log_beside(tmp_path / "run.mcap") == tmp_path / "run.clock_probes.csv"


def test_an_absent_log_says_that_the_report_goes_without(tmp_path):
    with pytest.raises(ProbeLogError) as caught:
        read_exchanges(tmp_path / "none.csv")
    assert str(caught.value) == (
        "the probe log cannot be read\n"
        f"  where:    {tmp_path / 'none.csv'}\n"
        "  expected: a file that rigcal sync probe wrote, clock_probes.csv in the capture\n"
        "  got:      No such file or directory\n"
        "  do next:  check the path, or leave the log out: the report is made without it"
    )


def test_another_file_is_neither_read_nor_cut(tmp_path):
    path = tmp_path / "timestamps.csv"
    path.write_text("cam_id,frame_time\n0,1.0")
    message = (
        "this is no probe log\n"
        f"  where:    {path}\n"
        f"  expected: first line {HEADER}\n"
        "  got:      cam_id,frame_time\n"
        "  do next:  give the file that rigcal sync probe wrote; another file is never overwritten"
    )
    for use in (lambda: read_exchanges(path), lambda: append_exchanges(path, {"cam0": exchanges()})):
        with pytest.raises(ProbeLogError) as caught:
            use()
        assert str(caught.value) == message
    assert path.read_text() == "cam_id,frame_time\n0,1.0"


@pytest.mark.parametrize(
    ("row", "what", "got"),
    [
        ("cam0,1,2,3", "line 3 is no row of a probe log", "cam0,1,2,3"),
        (",1,2,3,4,5,6", "line 3 is no row of a probe log", ",1,2,3,4,5,6"),
        ("", "line 3 is no row of a probe log", "an empty line"),
        ("cam0,1.7638E+18,2,3,4,5,6", "line 3 holds something else than times", "cam0,1.7638E+18,2,3,4,5,6"),
        ("cam0,,2,3,4,5,6", "line 3 holds something else than times", "cam0,,2,3,4,5,6"),
        (f"cam0,{2**63},2,3,4,5,6", "line 3 holds something else than times", f"cam0,{2**63},2,3,4,5,6"),
    ],
)
def test_a_malformed_row_is_named_by_its_line(tmp_path, row, what, got):
    path = tmp_path / PROBE_LOG
    append_exchanges(path, {"cam0": exchanges(1)})
    with path.open("a") as file:
        file.write(f"{row}\ncam0,1,2,3,4,5,6\n")
    with pytest.raises(ProbeLogError) as caught:
        read_exchanges(path)
    assert (caught.value.what, caught.value.got, caught.value.where) == (what, got, str(path))
    assert caught.value.do_next.startswith("remove line 3, or take the log as rigcal sync probe wrote it")


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write this file"):
        append_exchanges(tmp_path / "file" / PROBE_LOG, {"cam0": exchanges()})
