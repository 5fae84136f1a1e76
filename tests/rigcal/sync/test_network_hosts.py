"""Which host tells which camera's time."""

from __future__ import annotations

import pytest

from rigcal.errors import TimeHostError
from rigcal.site import Site, SiteCamera
from rigcal.sync.network import Target, targets_of, targets_of_site
from rigcal.sync.network.hosts import parse_host

RIG = ("cam0", "cam1", "cam2")


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("camera-0.local", "camera-0.local", None),
        ("10.0.0.5", "10.0.0.5", None),
        ("10.0.0.5:123", "10.0.0.5", 123),
        ("ntp://camera-0.local", "camera-0.local", None),
        ("NTP://camera-0.local/", "camera-0.local", None),
        ("ntp://camera-0.local:12123", "camera-0.local", 12123),
        ("[fe80::1%eth0]:123", "fe80::1%eth0", 123),
        ("[::1]", "::1", None),
        ("::1", "::1", None),
        ("ntp://[2001:db8::7]:40000/", "2001:db8::7", 40000),
    ],
)
def test_hosts_are_read_in_every_form(text, host, port):
    assert parse_host(text) == (host, port)


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("ptp://camera-0", "the scheme ptp://, where only ntp:// can be asked"),
        ("camera-0:http", "the port 'http', which is no number from 1 to 65535"),
        ("camera-0:0", "the port '0', which is no number from 1 to 65535"),
        ("camera-0:70000", "the port '70000', which is no number from 1 to 65535"),
        (":123", "no host name"),
        ("ntp://", "no host name"),
        ("a host", "'a host', which is no host name"),
        ("camera-0/path", "'camera-0/path', which is no host name"),
    ],
)
def test_an_unreadable_host_is_an_error_that_shows_the_forms(text, got):
    with pytest.raises(TimeHostError) as caught:
        parse_host(text)
    assert str(caught.value) == (
        f"the host {text!r} cannot be read\n"
        "  expected: name, name:port, [IPv6]:port or ntp://name:port\n"
        f"  got:      {got}\n"
        "  do next:  mend it; for instance camera-0.local, or 192.168.1.20:123"
    )


def test_cameras_are_named_with_their_hosts_in_any_order():
    targets = targets_of(["cam2=c:123", "cam0=ntp://a"], RIG)
    assert targets == (Target(("cam2",), "c", 123), Target(("cam0",), "a", None))


def test_as_many_bare_hosts_as_cameras_are_in_rig_order():
    targets = targets_of(["a", "b", "c:124"], RIG)
    assert [(t.camera_ids, t.name) for t in targets] == [(("cam0",), "a"), (("cam1",), "b"), (("cam2",), "c:124")]


def test_one_bare_host_tells_the_time_of_every_camera():
    assert targets_of(["recorder"], RIG) == (Target(RIG, "recorder", None),)


def test_a_host_of_several_cameras_is_probed_once():
    targets = targets_of(["cam0=pi-1", "cam1=PI-1", "cam2=pi-1:123"], RIG)
    assert targets == (Target(("cam0", "cam1"), "pi-1", None), Target(("cam2",), "pi-1", 123))


def test_another_number_of_bare_hosts_asks_for_names():
    with pytest.raises(TimeHostError) as caught:
        targets_of(["a", "b"], RIG)
    assert str(caught.value) == (
        "it is not clear which host tells which camera's time\n"
        "  expected: one host for all, 3 hosts in rig order, or CAMERA=HOST, with HOST as name, name:port, "
        "[IPv6]:port or ntp://name:port\n"
        "  got:      2 hosts for the 3 cameras cam0, cam1, cam2\n"
        "  do next:  say whose clock each is, for instance cam0=HOST cam1=HOST"
    )


def test_bare_and_named_hosts_do_not_mix():
    with pytest.raises(TimeHostError) as caught:
        targets_of(["cam0=a", "b"], RIG)
    assert str(caught.value) == (
        "some hosts are given with their camera and others without\n"
        "  expected: cam0=HOST cam1=HOST\n"
        "  got:      cam0=a b\n"
        "  do next:  say whose clock b is: CAMERA=b"
    )


def test_a_camera_that_the_rig_has_not_is_an_error():
    with pytest.raises(TimeHostError) as caught:
        targets_of(["cam7=a"], RIG)
    assert str(caught.value) == (
        "the rig has no camera 'cam7'\n"
        "  where:    cam7=a\n"
        "  expected: one of cam0, cam1, cam2\n"
        "  got:      'cam7'\n"
        "  do next:  name the camera as the rig file does"
    )


def test_a_camera_given_twice_is_an_error():
    with pytest.raises(TimeHostError) as caught:
        targets_of(["cam0=a", "cam1=b", "cam0=c"], RIG)
    assert str(caught.value) == (
        "camera cam0 is given more than one host\n"
        "  expected: one host per camera\n"
        "  got:      cam0=a cam0=c\n"
        "  do next:  keep the host whose clock stamps the frames of cam0"
    )


def site_with(*clocks):
    return Site(site="yard", cameras=tuple(SiteCamera(id=f"cam{i}", clock=c) for i, c in enumerate(clocks)))


def test_a_site_file_names_hosts_and_cameras_without_one_are_told_apart():
    found = targets_of_site(site_with("ntp://pi-1", None, "ntp://pi-1", "ntp://elsewhere"), RIG)
    assert found.targets == (Target(("cam0", "cam2"), "pi-1", None),)
    assert found.without_clock == ("cam1",)


def test_a_site_file_without_clocks_says_what_to_write():
    with pytest.raises(TimeHostError) as caught:
        targets_of_site(site_with(None, None), RIG)
    assert str(caught.value) == (
        "the site file names no host for any camera of the rig\n"
        "  where:    site yard\n"
        '  expected: clock = "ntp://HOST" under [[cameras]]\n'
        "  got:      no clock entry for cam0, cam1, cam2\n"
        "  do next:  add the entries, or name the hosts on the command line: CAMERA=HOST"
    )


def test_an_unreadable_clock_of_a_site_file_says_where_it_is_written():
    with pytest.raises(TimeHostError) as caught:
        targets_of_site(site_with("ptp://pi-1"), RIG)
    assert str(caught.value) == (
        "the host 'ptp://pi-1' cannot be read\n"
        "  where:    clock of a camera of site yard\n"
        "  expected: name, name:port, [IPv6]:port or ntp://name:port\n"
        "  got:      the scheme ptp://, where only ntp:// can be asked\n"
        "  do next:  mend it; for instance camera-0.local, or 192.168.1.20:123"
    )
