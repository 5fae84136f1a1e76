"""What a live run follows: sources from the command line and the site file, and captures at their own pace."""

import time

import cv2
import numpy as np
import pytest

from recognition.errors import SourceError
from recognition.feeds import FeedOptions
from recognition.live import chosen_sources, live_cameras, paced_capture
from recognition.sources.stream import Packet
from recognition.synthetic import semicircle_rig
from rigcal.site import Site, load_site

RIG = semicircle_rig(3, size_wh=(64, 48))
ALL = (True, True, True)
URLS = [f"rtsp://user:secret@camera-{n}.local/live" for n in range(3)]


def shown(addresses):
    return {view: str(url) for view, url in addresses.items()}


EXPECTED = {view: f"rtsp://***@camera-{view}.local/live" for view in range(3)}


def test_one_folder_is_a_capture(tmp_path):
    assert chosen_sources([str(tmp_path)], RIG, ALL, None) == tmp_path


def test_addresses_are_in_rig_order_or_named():
    assert shown(chosen_sources(URLS, RIG, ALL, None)) == EXPECTED
    named = [f"cam{n}={URLS[n]}" for n in (2, 0, 1)]
    assert shown(chosen_sources(named, RIG, ALL, None)) == EXPECTED
    some = chosen_sources([URLS[0], URLS[2]], RIG, (True, False, True), None)
    assert shown(some) == {0: EXPECTED[0], 2: EXPECTED[2]}


def test_an_address_may_hold_an_equals_sign():
    urls = [f"rtsp://{host}.local/live?channel=1" for host in "abc"]
    found = chosen_sources(urls, RIG, ALL, None)
    assert [found[view].with_credentials for view in range(3)] == urls


def site(**sources):
    cameras = [{"id": camera, **({"source": url} if url else {})} for camera, url in sources.items()]
    return Site.model_validate({"site": "hall", "cameras": cameras})


def test_the_site_file_names_the_sources_where_nothing_is_given():
    declared = site(cam0=URLS[0], cam1=URLS[1], cam2=URLS[2])
    assert shown(chosen_sources([], RIG, ALL, declared)) == EXPECTED
    assert chosen_sources([], RIG, ALL, None) is None


def test_a_site_file_without_all_of_them_says_which():
    with pytest.raises(SourceError) as caught:
        chosen_sources([], RIG, ALL, site(cam0=URLS[0], cam1=None))
    assert str(caught.value) == (
        "the site file does not say where cam1, cam2 can be seen live\n"
        "  where:    site hall\n"
        '  expected: source = "rtsp://HOST/PATH" for each camera of the rig\n'
        "  got:      1 of 3\n"
        "  do next:  add them, name the sources with --source, or leave cameras out with --views"
    )


@pytest.mark.parametrize(
    ("given", "got"),
    [
        (URLS[:1], "1 address"),
        (URLS[:2], "2 addresses"),
        ([f"cam0={URLS[0]}", f"cam1={URLS[1]}", f"cam0={URLS[2]}"], "3 addresses, for cam0, cam1, cam0"),
        ([f"cam0={URLS[0]}", f"cam1={URLS[1]}", f"cam7={URLS[2]}"], "3 addresses, for cam0, cam1, cam7"),
        (["one", "two"], "one two"),
    ],
)
def test_sources_that_do_not_suit_the_rig_are_refused(given, got):
    with pytest.raises(SourceError) as caught:
        chosen_sources(given, RIG, ALL, None)
    assert str(caught.value) == (
        "the sources do not suit the rig\n"
        "  where:    --source\n"
        "  expected: one capture folder, or an address for each of cam0, cam1, cam2: in this order, or as "
        "cam0=rtsp://HOST/PATH\n"
        f"  got:      {got}\n"
        "  do next:  give --source once for each camera; leave cameras out with --views"
    )
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("name", ["run.mcap", "run.mcap.part"])
def test_a_recording_is_not_looked_at_anew_but_replayed(name):
    with pytest.raises(SourceError) as caught:
        chosen_sources([name], RIG, ALL, None)
    assert str(caught.value) == (
        "a recording is no source of frames to look at anew\n"
        f"  where:    {name}\n"
        "  expected: a capture folder, or the addresses of live cameras\n"
        "  got:      an MCAP recording, which holds what the networks saw in its frames\n"
        f"  do next:  place that again: recognition replay {name}"
    )


def test_nothing_that_is_recorded_of_live_cameras_holds_credentials():
    source = live_cameras(RIG, chosen_sources(URLS, RIG, ALL, None))
    assert [stream.camera for stream in source.streams] == [0, 1, 2]
    assert source.facts["source.cam1"] == EXPECTED[1]
    assert "secret" not in repr(source)
    assert source.is_live
    assert abs(source.now_ns() - time.time_ns()) < 1e9


def capture(folder, frames, fps):
    image = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    for camera in RIG.camera_ids:
        for number in range(frames):
            path = folder / camera / f"{1_775_986_200_000_000_000 + round(number * 1e9 / fps)}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(image)
    return folder


def test_a_capture_comes_at_its_own_pace(tmp_path):
    source = paced_capture(capture(tmp_path, 8, 20.0), RIG, FeedOptions(ALL, 20.0))
    assert not source.is_live
    assert source.bytes == sum(path.stat().st_size for path in tmp_path.rglob("*.jpg"))
    first = source.now_ns()
    streams = [stream.packets() for stream in source.streams]
    for stream in source.streams[1:]:
        stream.close()
    for stream in streams[1:]:
        assert list(stream) == []  # those do not hold the others up
    came = []
    for packet in streams[0]:
        assert isinstance(packet, Packet)
        came.append((packet.t_ns, source.now_ns()))
    assert first == came[0][0] == 1_775_986_200_000_000_000
    assert all(now_ns >= t_ns for t_ns, now_ns in came)
    assert len(came) == 8


def test_a_site_states_how_old_clocks_may_be(tmp_path):
    path = tmp_path / "s.site.toml"
    path.write_text('site = "hall"\nclock_age_s = 3600\n[[cameras]]\nid = "cam0"\n')
    assert load_site(path).clock_age_s == 3600.0
    assert site(cam0=None).clock_age_s == 86400.0
