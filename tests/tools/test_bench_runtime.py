"""The runtime's benchmark measures what it says: the association is given, and the picture shows every figure."""

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from recognition.synthetic_crowds import Bursts, crowd
from recognition.synthetic_views import DetectorNoise

sys.path.insert(0, str(Path(__file__).parents[2] / "tools" / "bench"))
from runtime_crowds import METHODS, given_the_association, tracked
from runtime_plot import Curve, growth_plot
from runtime_rejudge import rejudged


@pytest.mark.parametrize("method", METHODS)
def test_with_the_association_given_nobody_is_confused_with_anybody(method):
    people = crowd(3, seconds=2.0, seed=0)
    given, alone = given_the_association(people, method), tracked(people, method)
    assert (given.switches, given.precision) == (0, 1.0)
    assert given.pcp3d >= alone.pcp3d - 1e-3
    assert given.recall > 0.9


@pytest.mark.parametrize("method", METHODS)
def test_perfect_detections_are_worth_full_marks(method):
    people = crowd(1, seconds=1.0, seed=1, noise=DetectorNoise(), bursts=Bursts(per_minute=0.0))
    scores = tracked(people, method)
    assert scores.pcp3d > 0.93
    assert scores.mpjpe_m < 0.01


def test_what_is_judged_again_both_ways_is_the_same_and_costs_less_by_the_tracks(tmp_path):
    line = rejudged(tmp_path, 0.05)
    assert line["same_events"] is True
    assert line["events_per_hour"] >= 1200  # one or more in three seconds
    assert line["frame_sets_per_hour"] == 54_000
    assert 1000 < line["tracks_bytes_per_frame_set"] < line["recording_bytes_per_frame_set"]
    assert 0.0 < line["ratio"] < 1.0


def test_the_plot_has_every_figure_where_it_belongs():
    curves = [Curve(method, cameras, (1, 4, 20), (1.0, 10.0, 100.0)) for method in ("a", "b") for cameras in (4, 16)]
    root = ET.fromstring(growth_plot(curves, frame_ms=33.3))
    lines = root.findall("{*}polyline")
    assert len(lines) == 4
    height = [float(point.split(",")[1]) for point in lines[0].attrib["points"].split()]
    assert np.diff(height) == pytest.approx(np.full(2, height[1] - height[0]))  # decades are equally high
    assert [text.text for text in root.findall("{*}text") if "cameras" in text.text] == ["4 cameras", "16 cameras"] * 2


def test_the_names_of_lines_that_end_near_each_other_are_apart():
    curves = [Curve("a", cameras, (1, 20), (1.0, ms)) for cameras, ms in ((4, 3.0), (8, 6.3), (12, 6.2), (16, 6.4))]
    root = ET.fromstring(growth_plot(curves, frame_ms=33.3))
    names = {text.text: float(text.attrib["y"]) for text in root.findall("{*}text") if "cameras" in text.text}
    assert sorted(names, key=names.get, reverse=True) == ["4 cameras", "12 cameras", "8 cameras", "16 cameras"]
    assert np.diff(sorted(names.values())).min() >= 12.9
