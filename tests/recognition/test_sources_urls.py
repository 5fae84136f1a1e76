"""Addresses of cameras: what opens them is whole, what anybody sees has no credentials."""

import json
import pickle
from dataclasses import dataclass

import pytest

from recognition.errors import SourceError
from recognition.sources.urls import SourceUrl, is_url


@dataclass(frozen=True)
class Holder:
    url: SourceUrl


@pytest.mark.parametrize(
    ("whole", "shown"),
    [
        ("rtsp://camera-0.local/live", "rtsp://camera-0.local/live"),
        ("rtsp://admin:s3cret@10.0.0.7:554/live", "rtsp://***@10.0.0.7:554/live"),
        ("rtsp://admin@[fe80::1]/live", "rtsp://***@[fe80::1]/live"),
        ("rtsp://admin:s3/c?r#e@t@host/live", "rtsp://***@host/live"),
        ("rtsps://host/live?channel=1&password=s3cret", "rtsps://host/live?channel=***&password=***"),
        ("rtsp://host/user=admin_password=s3cret_channel=1", "rtsp://host/user=***"),
    ],
)
def test_no_credentials_are_shown(whole, shown):
    url = SourceUrl(whole)
    assert str(url) == f"{url}" == shown
    assert repr(Holder(url)) == f"Holder(url=SourceUrl({shown!r}))"
    assert json.dumps({"source": str(url)}) == json.dumps({"source": shown})
    assert url.with_credentials == pickle.loads(pickle.dumps(url)).with_credentials == whole


def test_an_address_says_whether_it_holds_a_login():
    assert SourceUrl("rtsp://a:b@host/live").has_login
    assert not SourceUrl("rtsp://host/live").has_login


@pytest.mark.parametrize("text", ["http://host/live", "rtsp:///live", "rtsp://host:port/live", "rtsp://u:s3cret@/live"])
def test_what_is_no_address_of_a_camera_is_refused_without_its_credentials(text):
    with pytest.raises(SourceError) as caught:
        SourceUrl.parse(text)
    assert "not the address of a live camera" in str(caught.value)
    assert "rtsp://USER:PASSWORD@HOST" in str(caught.value)
    assert "s3cret" not in str(caught.value)


def test_urls_are_told_from_paths():
    assert is_url("rtsp://host/live")
    assert not is_url("captures/rtsp")
