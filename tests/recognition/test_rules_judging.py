"""What rules say of scenes that are built by hand."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rule_scenes import (
    CONFIGS,
    RIG,
    RIG_FROM_WORLD,
    Film,
    hat,
    head_m,
    ladder,
    platform,
    rule,
    standing,
    thing,
    window,
    worker,
)

from recognition.errors import RigRefusedError
from recognition.observations import Scene
from recognition.rules import Judge, load_rules
from recognition.synthetic import HEIGHT_M

SITE = load_rules(CONFIGS / "site.rules.toml")
STEP = 0.1


def truth(when, workers=(), things=(), seconds=None, **more):
    return Film(rule(when, **more)).show(workers, things, seconds).truths()


def margin(when, workers=(), things=(), **more):
    return Film(rule(when, **more)).show(workers, things).last.verdicts[0].margin


def near(value):
    return pytest.approx(value, abs=1e-6)


# The four violations as meant.


def test_a_worker_without_a_hat_is_found_within_a_second_and_cleared_when_it_is_worn_again():
    film = Film(SITE)
    film.show([worker(1, 0, 0)], [hat(9, 0, 0)], 1.0)
    film.show([worker(1, 0, 0)], [hat(9, 0, 0, worn=False)], 1.0)
    film.show([worker(1, 0, 0)], [hat(9, 0, 0)], 1.0)
    assert film.raised() == [("no_hat", near(1.0), near(2.0))]
    (event,) = film.events.values()
    assert event.raised_ns - event.start_ns == near(0.3e9)
    assert [(actor.kind, actor.track_id, actor.role) for actor in event.actors] == [("worker", 1, "w")]


def test_one_hat_between_two_heads_is_worn_by_one_worker_only():
    together = [worker(1, 0, 0), worker(2, 0.05, 0)]
    between = [thing(9, "hard_hat", head_m(0.02, 0) + [0, 0, 0.1])]
    own = truth("each w: exists hard_hat o of w: dist(w.head, o) < 0.10 H", together, between)
    shared = truth("each w: exists hard_hat o: dist(w.head, o) < 0.10 H", together, between)
    assert sorted(own) == [False, True]
    assert shared == [True, True]


def test_a_head_that_nobody_sees_is_no_violation_and_ends_none():
    film = Film(SITE)
    film.show([worker(1, 0, 0, views=1)], [], 1.0)
    assert film.raised() == []
    film.show([worker(1, 0, 0)], [], 1.0).show([worker(1, 0, 0, views=1)], [], 1.5)
    assert film.raised() == [("no_hat", near(1.0), None)]


@pytest.mark.parametrize(("x", "y"), [(-3.5, 0.0), (2.0, 1.0), (1.5, -2.0)])
def test_a_hat_is_missed_only_where_two_images_have_room_for_it(x, y):
    """Rising in small steps, a head leaves the images of the cameras one after the other, its hat before it."""
    counts = set()
    for z in np.arange(0.0, 3.0, 0.05):
        crown = RIG_FROM_WORLD.apply(head_m(x, y, z) + [0, 0, 0.09])
        barely, amply = (sum(has_room(entry, crown, radius_m) for entry in RIG.cameras) for radius_m in (0.12, 0.2))
        (found,) = truth("each w: visible(w.crown)", [worker(1, x, y, z)])
        assert found is (True if amply >= 2 else None if barely < 2 else found)
        counts.add(barely)
    assert {0, 1} <= counts


def has_room(entry, point, radius_m):
    """Whether a camera's image holds all of a small square around a point of the rig, by projecting its corners."""
    in_cam, (width, height) = entry.cam_from_rig.apply(point), entry.camera.size_wh
    corners = in_cam + radius_m * np.array([[a, b, 0] for a in (-1, 0, 1) for b in (-1, 0, 1)])
    px = entry.camera.project(corners)
    return bool(((px > -0.5) & (px < [width - 0.5, height - 0.5])).all())


def test_a_camera_that_does_not_see_the_worker_misses_no_hat():
    one = replace(worker(1, 0, 0), members=np.array([0, -1, -1, -1]))
    assert truth("each w: visible(w.head)", [one]) == [True]
    assert truth("each w: visible(w.crown)", [one]) == [None]
    assert truth("each w: visible(w.crown)", [replace(one, members=np.array([0, -1, 2, -1]))]) == [True]
    assert truth("each w: visible(w.crown)", [worker(1, 0, 0, views=1)]) == [None]


def test_a_hat_that_one_of_two_cameras_sees_neither_raises_nor_ends():
    film, seen_by_one = Film(SITE), [thing(9, "hard_hat", head_m(0, 0) + [0, 0, 0.1], views=1)]
    assert film.show([worker(1, 0, 0)], seen_by_one, 2.0).raised() == []
    film.show([worker(1, 0, 0)], [], 1.0).show([worker(1, 0, 0)], seen_by_one, 1.5)
    assert film.raised() == [("no_hat", near(2.0), None)]


def test_a_hat_that_no_camera_sees_for_a_while_is_not_its_workers():
    """The tracker tells it for longer; the cameras that see the head would see it."""
    carried = [replace(hat(9, 0, 0), views=0)]
    film = Film(rule("each w: exists hard_hat o of w: dist(w.crown, o) < 0.20 H")).show(
        [worker(1, 0, 0)], [hat(9, 0, 0)]
    )
    for expected in (True, False):
        assert film.show([worker(1, 0, 0)], carried).truths() == [expected]
    (own,) = film.watch.judge.explain("r")[0].why.parts
    assert own.detail.endswith("no camera has seen it for 0.2 s")
    assert film.show([worker(1, 0, 0)], [hat(9, 0, 0)]).truths() == [True]
    anybody = Film(rule("each w: exists hard_hat o: dist(w.crown, o) < 0.20 H"))
    assert anybody.show([worker(1, 0, 0)], carried, 0.5).truths() == [True]


def test_a_ladder_in_use_must_be_held():
    climber = worker(1, 0, 0.35, 1.0)
    holder = worker(2, 0, -0.4, hands=[0.2, 0.1, 1.2])
    apart = worker(2, 2, -2)
    film = Film(SITE)
    hats = [hat(11, 0, 0.35, 1.0), hat(12, 0, -0.4), hat(13, 2, -2)]
    film.show([climber, holder], [ladder(9, 0, 0), *hats], 2.0)
    assert film.raised("ladder") == []
    film.show([climber, apart], [ladder(9, 0, 0), *hats], 2.0)
    film.show([climber, holder], [ladder(9, 0, 0), *hats], 2.0)
    assert film.raised() == [("ladder", near(2.0), near(4.0))]
    (event,) = film.events.values()
    assert [(a.kind, a.track_id, a.role) for a in event.actors] == [("ladder", 9, "l"), ("worker", 1, "w")]


def test_who_holds_a_ladder_and_is_hidden_for_a_while_raises_nothing():
    climber, holder = worker(1, 0, 0.35, 1.0), worker(2, 0, -0.4, hands=[0.2, 0.1, 1.2])
    hats = [hat(11, 0, 0.35, 1.0), hat(12, 0, -0.4)]
    film = Film(SITE)
    film.show([climber, holder], [ladder(9, 0, 0), *hats], 1.0)
    film.show([climber], [ladder(9, 0, 0), *hats], 2.0)
    film.show([climber, worker(7, 0, -0.4, hands=[0.2, 0.1, 1.2])], [ladder(9, 0, 0), *hats], 1.0)
    assert film.raised() == []


def test_standing_beside_or_under_a_ladder_is_not_climbing_it():
    film = Film(SITE)
    film.show([worker(1, 0, 0.35), worker(2, 0, 1.6)], [ladder(9, 0, 0), hat(11, 0, 0.35), hat(12, 0, 1.6)], 2.0)
    assert film.raised() == []


def test_a_large_window_needs_two():
    def at(t):
        return 0.5 * t

    def alone(t):
        return [worker(1, at(t) - 0.9, 0, hands=[at(t) - 0.7, 0, 1.0]), worker(2, -3, -2)]

    def together(t):
        return [alone(t)[0], worker(2, at(t) + 0.9, 0, hands=[at(t) + 0.7, 0, 1.0])]

    def things(t):
        return [window(9, at(t), 0, 0.3), hat(11, at(t) - 0.9, 0), hat(12, -3, -2), hat(13, at(t) + 0.9, 0)]

    film = Film(SITE)
    film.show(together, things, 2.0).show(alone, things, 2.0).show(together, things, 2.0)
    assert film.raised() == [("window", near(2.0), near(4.0))]


def test_who_stands_behind_a_window_does_not_carry_it_though_nobody_sees_the_hands():
    carrier, behind = worker(1, -0.9, 0, hands=[-0.7, 0, 1.0]), worker(2, 0.3, 1.2, unseen=(7, 8, 9, 10))
    things = [window(9, 0, 0, 0.3), hat(11, -0.9, 0), hat(12, 0.3, 1.2), hat(13, 0.9, 0)]
    assert Film(SITE).show([carrier, behind], things, 1.0).raised() == [("window", near(0.0), None)]
    at_it = worker(2, 0.9, 0, unseen=(7, 8, 9, 10))
    assert Film(SITE).show([carrier, at_it], things, 1.0).raised() == []


def test_a_window_on_the_floor_may_be_touched_by_one():
    film = Film(SITE)
    film.show([worker(1, 0, -0.4, hands=[0, 0, 1.0])], [window(9, 0, 0, 0.0), hat(11, 0, -0.4)], 2.0)
    assert film.raised() == []


@pytest.mark.parametrize(("bottom", "box_m"), [(0.25, 2.1), (0.0, 1.1)], ids=["keypoints high", "boxes high"])
def test_a_window_that_stands_by_its_boxes_or_its_keypoints_is_not_known_to_be_carried(bottom, box_m):
    def held_for_2_s(window_there):
        return Film(SITE).show([worker(1, 0, -0.4, hands=[0, 0, 1.0])], [window_there, hat(11, 0, -0.4)], 2.0).raised()

    assert held_for_2_s(window(9, 0, 0, bottom, box_m=box_m)) == []
    assert held_for_2_s(window(9, 0, 0, 0.25)) == [("window", near(0.0), None)]
    high = margin("each large_window o: clearance(o.bottom) > 0.1 m", [], [window(9, 0, 0, 0.25, box_m=1.8)])
    assert high == pytest.approx(0.15 / 0.1 - 1)


def test_a_window_in_its_opening_may_be_touched_by_one():
    opening = "[openings.wall]\nfrom_m = [-0.7, 0.0]\nto_m = [0.7, 0.0]\nheight_m = [0.9, 2.5]"
    when = "each large_window o: not mounted(o)"
    assert truth(when, [], [window(9, 0, 0.05, 0.9)], more=opening) == [False]
    assert truth(when, [], [window(9, 0, 0.6, 0.9)], more=opening) == [True]
    assert truth(when, [], [window(9, 0.5, 0.05, 0.9)], more=opening) == [True]
    assert truth(when, [], [window(9, 0, 0.05, 0.9, known=())], more=opening) == [None]
    assert truth(when, [], [window(9, 0, 0.05, 0.9)]) == [True]


def test_two_on_a_platform_are_one_too_many():
    hats = [hat(11, -0.4, 0, 0.6), hat(12, 0.4, 0, 0.6), hat(13, 2, 0)]
    film = Film(SITE)
    film.show([worker(1, -0.4, 0, 0.6), worker(2, 2, 0)], [platform(9, 0, 0), *hats], 1.0)
    film.show([worker(1, -0.4, 0, 0.6), worker(2, 0.4, 0, 0.6)], [platform(9, 0, 0), *hats], 1.0)
    film.show([worker(1, -0.4, 0, 0.6), worker(2, 2, 0)], [platform(9, 0, 0), *hats], 1.0)
    assert film.raised() == [("platform", near(1.0), near(2.0))]
    (event,) = film.events.values()
    assert {(a.kind, a.track_id) for a in event.actors} == {("platform", 9), ("worker", 1), ("worker", 2)}


# Measures.


@pytest.mark.parametrize(
    ("when", "value"),
    [
        ("each w: dist(w.feet, w.head) > 0.1 m", head_m(1, 2)[2] - 0.039 * HEIGHT_M),
        ("each w: dist(w.feet, w.neck, xy) < 9 m", 0.0),
        ("each w: clearance(w.left_ear) > 0.1 m", head_m(1, 2)[2]),
        ("each w: exists toolbox o: dist(w.feet, o, xy) > 0.1 m", 5.0),
        ("each w: exists toolbox o: dist(w.feet, o, z) > 0.1 m", 1.0 - 0.039 * HEIGHT_M),
        ("each toolbox o: clearance(o.bottom) > 0.1 m", 1.0 - 0.15),
        ("each w: exists platform p: dist(w.feet, p.footprint, xy) > 0.1 m", np.hypot(1 - 0.3, 2 - 0.35)),
        ("each w: exists platform p: dist(w.feet, p.top, z) > 0.1 m", 0.6 + 0.08 - 0.039 * HEIGHT_M),
        (
            "each w: exists ladder l: dist(w.feet, l.axis, xy) > 0.1 m",
            np.hypot(1, 2 + 0.8 - 0.8 * 0.039 * HEIGHT_M / 3),
        ),
        ("each w: exists ladder l: dist(w.feet, l.extent) > 0.1 m", None),
        ("each w: dist(w.feet, zone, xy) > 0.1 m", 1.0),
    ],
)
def test_measures_are_what_geometry_says(when, value):
    things = [thing(5, "toolbox", [4, 6, 1]), platform(6, -0.5, 0), ladder(7, 0, -0.8)]
    zone = "[zones.zone]\npolygon_m = [[2, 0], [4, 0], [4, 4], [2, 4]]"
    film = Film(rule(when, more=zone)).show([worker(1, 1, 2)], things)
    (binding,) = film.watch.judge.explain("r")
    said = next(found for found in amounts(binding.why))
    if value is None:  # the ladder's face: by brute force over its points
        a, b = np.meshgrid(np.linspace(-0.2, 0.2, 81), np.linspace(0, 1, 601))
        face = np.stack([a, -0.8 + 0.8 * b, 3 * b], axis=-1)
        value = np.linalg.norm(face - [1, 2, 0.039 * HEIGHT_M], axis=-1).min()
    assert said == pytest.approx(value, rel=5e-3, abs=2e-3)


def amounts(why):
    """What was measured, of every comparison."""
    if "; limit" in why.detail:
        yield float(why.detail.partition(" m")[0])
    for part in why.parts:
        yield from amounts(part)


def test_height_is_the_median_of_the_segments_and_scales_limits():
    film = Film(rule("each w: clearance(w.head) > 0.9 H")).show([worker(1, 0, 0)], seconds=1)
    limit = film.watch.judge.explain("r")[0].why.detail.partition("limit ")[2]
    assert float(limit.removesuffix(" m (0.9 H)")) == pytest.approx(0.9 * HEIGHT_M, abs=0.01)
    assert margin("each w: clearance(w.head) > 0.5 H", [worker(1, 0, 0)]) == pytest.approx(
        head_m(0, 0)[2] / (0.5 * HEIGHT_M) - 1, abs=0.01
    )


def test_a_height_is_told_by_trunk_and_neck_alone_and_by_no_less():
    def height_m(*unseen):
        film = Film(rule("each w: clearance(w.head) > 0.9 H")).show([worker(1, 0, 0, unseen=unseen)], seconds=1)
        return film.last.verdicts[0].truth, film.watch.judge.explain("r")[0].why.detail.partition("limit ")[2]

    is_above, limit = height_m(1, 2, 7, 8, 13, 14)
    assert is_above is True
    assert float(limit.removesuffix(" m (0.9 H)")) == pytest.approx(0.9 * HEIGHT_M, abs=0.03)
    assert height_m(3, 4, 7, 8, 13, 14)[0] is None


def test_speed_is_over_half_a_second_and_unknown_before():
    film = Film(rule("each w: speed(w.torso) > 1 m/s"))
    film.show(lambda t: [worker(1, 1.5 * t, 0)], seconds=0.2)
    assert film.truths() == [None]
    film.show(lambda t: [worker(1, 1.5 * t, 0)], seconds=1.0)
    assert film.truths() == [True]
    assert film.last.verdicts[0].margin == near(0.5)
    film.show([worker(1, 2, 0)], seconds=1.0)
    assert film.truths() == [False]


# Three values.


def test_margins_are_shares_of_the_limit():
    at_2m = [thing(5, "cone", [2, 0, 0.5])]
    feet = "dist(w.feet, o, xy)"
    assert margin(f"each w: exists cone o: {feet} < 4 m", [worker(1, 0, 0)], at_2m) == near(0.5)
    assert margin(f"each w: exists cone o: {feet} < 1.6 m", [worker(1, 0, 0)], at_2m) == near(-0.25)
    assert margin(f"each w: not exists cone o: {feet} < 1.6 m", [worker(1, 0, 0)], at_2m) == near(0.25)
    both = f"each w: exists cone o: {feet} < 4 m and {feet} < 2.5 m"
    assert margin(both, [worker(1, 0, 0)], at_2m) == near(0.2)
    assert margin(both.replace("and", "or"), [worker(1, 0, 0)], at_2m) == near(0.5)


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("each w: dist(w.left_ankle, w.nose) < 9 m and dist(w.head, w.neck) < 9 m", None),
        ("each w: dist(w.left_ankle, w.nose) < 9 m or dist(w.head, w.neck) < 9 m", True),
        ("each w: clearance(w.left_ankle) < 0.3 m and dist(w.head, w.neck) > 9 m", False),
        ("each w: not clearance(w.left_ankle) < 0.3 m", None),
        ("each w: clearance(w.left_ankle) < 0.3 m", None),
    ],
)
def test_unknown_follows_kleene(when, expected):
    knees_down = (13, 14, 15, 16)
    when = when.replace("dist(w.left_ankle, w.nose) < 9 m", "clearance(w.left_ankle) < 0.3 m")
    assert truth(when, [worker(1, 0, 0, unseen=knees_down)]) == [expected]


def test_an_unseen_wrist_is_within_an_arms_length():
    """Far from a ladder nobody touches it, even if the hand is not seen; near it, nobody knows."""
    when = "each w: exists ladder l: dist(w.hands, l.extent) < 0.15 H"
    far, close = worker(1, 4, 0, unseen=(9, 10)), worker(1, 0, -0.5, unseen=(9, 10))
    assert truth(when, [far], [ladder(9, 0, 0)]) == [False]
    assert truth(when, [close], [ladder(9, 0, 0)]) == [None]
    one_hand = worker(1, 0, -0.5, hands=[0.2, 0.1, 1.2], unseen=(10,))
    assert truth(when, [one_hand], [ladder(9, 0, 0)]) == [True]


def test_an_unseen_joint_is_within_the_bones_to_the_nearest_that_is_seen():
    """Of one of whom only the right shoulder is seen: how far, at most, everything else is."""
    only = [worker(1, 0, 0, unseen=set(range(17)) - {6})]
    shoulder = standing(0, 0)[6]
    for point, reach_m in (("right_wrist", 0.75), ("left_wrist", 1.2), ("right_ankle", 1.7), ("left_ankle", 2.05)):
        for away_m, expected in ((reach_m - 0.05, None), (reach_m + 0.15, False)):
            cone = [thing(5, "cone", shoulder + [away_m, 0, 0])]
            assert truth(f"each w: exists cone o: dist(w.{point}, o) < 0.1 m", only, cone) == [expected], point


def test_a_crown_is_above_the_head_along_the_body_and_somewhere_around_a_head_alone():
    assert margin("each w: dist(w.crown, w.head) < 0.18 m", [worker(1, 0, 0)]) == pytest.approx(0.5, abs=1e-6)
    assert margin("each w: clearance(w.crown) > 1 m", [worker(1, 0, 0)]) == pytest.approx(
        head_m(0, 0)[2] + 0.09 - 1, abs=1e-3
    )
    head_alone = [worker(1, 0, 0, unseen=range(5, 17))]
    cone = [thing(5, "cone", head_m(0, 0) + [0, 0, 0.2])]
    for limit, expected in ((0.10, False), (0.20, None), (0.30, True)):
        assert truth(f"each w: exists cone o: dist(w.crown, o) < {limit} m", head_alone, cone) == [expected]


def test_who_was_not_measured_yet_is_an_adult():
    """Head and arms alone give no height: 0.25 H is 0.375 to 0.5 m."""
    hands = [worker(1, 0, 0, hands=[0, 0, 1.2], unseen=(5, 6, 11, 12, 13, 14, 15, 16))]
    film = Film(rule("each w: exists cone o: dist(w.left_wrist, o) < 0.25 H"))
    for away_m, expected in ((0.36, True), (0.4, None), (0.6, False)):
        assert film.show(hands, [thing(5, "cone", [0, away_m, 1.2])]).truths() == [expected]
    (found,) = film.watch.judge.explain("r")[0].why.parts
    assert found.detail.endswith("limit 0.375 to 0.5 m (0.25 H; the worker was not measured yet)")


def test_one_missing_keypoint_is_completed_and_without_two_a_ladder_is_taken_to_stand_upright():
    when = "each w: exists ladder l: dist(w.feet, l.axis, xy) < 0.25 H"
    climber = [worker(1, 0, 0.35, 1.0)]
    assert truth(when, climber, [ladder(9, 0, 0, known=(0, 1, 2))]) == [True]
    middle = thing(9, "ladder", [0, 0.2, 1.5])
    assert truth(when, climber, [middle]) == [True]
    assert truth(when, [worker(1, 0, 0.8, 1.0)], [middle]) == [False]


def test_an_object_whose_keypoints_are_not_known_has_the_usual_size_of_its_kind():
    on = [worker(1, 0.4, 0, 0.6), worker(2, 1.2, 0, 0.6)]
    deck = [thing(9, "platform", [0, 0, 0.3])]
    assert truth("each w: exists platform p: dist(w.feet, p.footprint, xy) < 0.10 m", on, deck) == [True, False]
    assert truth("each w: exists platform p: dist(w.feet, p.top, z) < 0.10 m", on, deck) == [True, True]
    pane, hands = (
        [thing(9, "large_window", [0, 0, 1])],
        "each w: exists large_window o: dist(w.hands, o.extent) < 0.20 m",
    )
    for away_m, expected in ((0.6, True), (0.9, None), (1.2, False)):
        assert truth(hands, [worker(1, 0, -away_m, hands=[0, -away_m, 1])], pane) == [expected]


def test_a_ladder_that_stands_is_remembered_while_its_keypoints_are_hidden():
    film = Film(rule("each w: exists ladder l: dist(w.feet, l.axis, xy) < 0.25 H"))
    film.show([worker(1, 0, 0.35, 1.0)], [ladder(9, 0, 0)])
    assert film.show([worker(1, 0, 0.35, 1.0)], [ladder(9, 0, 0, known=())]).truths() == [True]
    assert film.show([worker(1, 0, 0.35, 1.0)], [ladder(9, 1, 0, known=())]).truths() == [False]


def test_counts_are_between_those_who_do_and_those_who_may():
    hidden = [worker(1, 0, 0), worker(2, 1, 0, unseen=(13, 14, 15, 16))]
    when = "count(w: clearance(w.feet) < 0.3 m) {}"
    expected = {"< 3": True, ">= 1": True, ">= 2": None, "== 0": False, "== 1": None, "!= 3": True, "> 2": False}
    assert {text: truth(when.format(text), hidden)[0] for text in expected} == expected
    assert truth(when.format("== 2"), [worker(1, 0, 0), worker(2, 1, 0)]) == [True]


def test_a_worker_who_was_lost_may_still_be_near_and_is_not_far_away():
    near_by = "each w: exists v != w: dist(w.torso, v.torso) < 1 m"
    far_off = "each w: exists v != w: dist(w.torso, v.torso) < 9 m"
    for when, gone_at, expected in ((near_by, 0.9, None), (near_by, 9.0, False), (far_off, 0.9, True)):
        film = Film(rule(when)).show([worker(1, 0, 0), worker(2, gone_at, 0)])
        film.show([worker(1, 0, 0)], seconds=1.0)
        assert film.truths()[0] is expected, when
        assert film.show([worker(1, 0, 0)], seconds=10.0).truths()[0] is False


def test_nothing_is_judged_of_what_is_not_monitored():
    film = Film(SITE).show([worker(1, 0, 0)], [], 1.0)
    film.show([], [], 1.0, status="NOT MONITORED")
    (verdict,) = film.last.verdicts
    assert verdict.truth is None
    assert verdict.is_active
    (event,) = film.watch.lasting()
    assert event.status == "NOT MONITORED"
    assert event.end_ns is None


# Time.


def test_it_is_raised_after_for_s_of_truth_and_ended_after_clear_s_of_falsehood():
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=0.5, clear_s=0.4))
    down, up = [worker(1, 0, 0)], [worker(1, 0, 0, 1.5)]
    film.show(down, seconds=1).show(up, seconds=0.4).show(down, seconds=0.1)  # 1.0 to 1.4
    film.show(up, seconds=1).show(down, seconds=0.3).show(up, seconds=1).show(down, seconds=1)
    assert film.raised() == [("r", near(1.5), near(3.8))]


@pytest.mark.parametrize(("step_s", "instants"), [(0.03333, 10), (0.0999, 4), (0.097, 5)])
def test_instants_that_come_a_little_early_do_not_delay_it_by_a_whole_period(step_s, instants):
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=0.3), step_s=step_s)
    for number in range(1, instants + 1):
        film.show([worker(1, 0, 0, 1.5)])
        assert film.last.verdicts[0].is_active is (number == instants), number


def test_what_is_unknown_neither_raises_nor_ends():
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=0.5, clear_s=0.3))
    up, hidden = [worker(1, 0, 0, 1.2)], [worker(1, 0, 0, 1.2, unseen=range(1, 17))]
    down = [worker(1, 0, 0)]
    film.show(up, seconds=0.3).show(hidden, seconds=0.8).show(up, seconds=0.2)  # 0.2 s and 0.1 s of truth
    assert film.raised() == []
    film.show(up, seconds=1).show(hidden, seconds=5).show(down, seconds=0.2).show(hidden, seconds=2)
    assert film.raised() == [("r", near(0.0), None)]


def test_what_was_unknown_for_a_second_before_it_was_raised_begins_anew():
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=0.5))
    up, hidden = [worker(1, 0, 0, 1.2)], [worker(1, 0, 0, 1.2, unseen=range(1, 17))]
    film.show(up, seconds=0.4).show(hidden, seconds=2).show(up, seconds=1)
    assert film.raised() == [("r", near(2.4), None)]


def test_it_is_held_no_longer_than_max_hold_s():
    film = Film(rule("each w: clearance(w.feet) > 1 m", max_hold_s=2))
    film.show([worker(1, 0, 0, 1.5)], seconds=1).show([], seconds=5)
    assert film.raised() == [("r", near(0.0), near(2.9))]
    (event,) = film.events.values()
    assert "its end was not seen" in event.caveats[-1]


def test_unknown_may_count_as_false():
    film = Film(rule("each w: clearance(w.feet) > 1 m", on_unknown="clear", clear_s=0.3))
    film.show([worker(1, 0, 0, 1.5)], seconds=1).show([], seconds=2)
    assert film.raised() == [("r", near(0.0), near(1.0))]


def test_a_gap_in_time_is_unknown():
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=5), step_s=4.0)
    assert film.show([worker(1, 0, 0, 1.5)], seconds=20).raised() == []


def test_the_limit_after_exit_holds_while_the_violation_lasts():
    film = Film(rule("each w: clearance(w.feet) > 1.0 m exit 0.5 m"))
    for height, active in ((0.7, False), (1.2, True), (0.7, True), (0.3, False), (0.7, False)):
        film.show([worker(1, 0, 0, height)], seconds=0.3)
        assert film.last.verdicts[0].is_active is active, height


# Identities.


def test_a_violation_goes_on_under_a_new_track_number():
    film = Film(rule("each w: clearance(w.feet) > 1 m", for_s=0.3))
    film.show([worker(1, 0, 0, 1.5)], seconds=1).show([], seconds=1).show([worker(8, 0.3, 0, 1.5)], seconds=1)
    film.show([worker(8, 0.3, 0)], seconds=1)
    assert film.raised() == [("r", near(0.0), near(3.0))]
    (event,) = film.events.values()
    assert event.actors[0].track_id == 8


def test_a_new_track_far_away_is_somebody_else():
    film = Film(rule("each w: clearance(w.feet) > 1 m"))
    film.show([worker(1, 0, 0, 1.5)], seconds=1).show([worker(8, 4, 0, 1.5)], seconds=1)
    assert [event.actors[0].track_id for event in film.events.values()] == [1, 8]


def test_two_workers_have_two_events():
    film = Film(rule("each w: clearance(w.feet) > 1 m"))
    film.show([worker(1, 0, 0, 1.5), worker(2, 3, 0, 1.5)], seconds=1).show([worker(2, 3, 0, 1.5)], seconds=1)
    assert len(film.events) == 2


def test_one_who_had_two_tracks_for_a_while_is_not_lost_when_the_second_ends():
    film = Film(rule("count(w: clearance(w.feet) < 1 m) == 1"))
    film.show([worker(1, 0, 0)]).show([worker(1, 0, 0), worker(2, 0.2, 0)])
    assert film.truths() == [False]
    assert film.show([worker(2, 0.2, 0)]).truths() == [True]


# The whole.


def test_the_same_scenes_give_the_same_events():
    def events():
        film = Film(SITE)
        rng = np.random.default_rng(5)
        for _ in range(150):
            x = rng.normal(0, 0.5, (3, 2))
            film.show(
                [worker(n + 1, *p, z=rng.choice([0, 1.0])) for n, p in enumerate(x)],
                [ladder(20, 0, 0), platform(21, 0.5, 0), hat(22, *x[0]), window(23, 0, 1, rng.choice([0, 0.5]))],
            )
        return list(film.events.values())

    first = events()
    assert len(first) > 3
    assert repr(first) == repr(events())
    assert len({event.event_id for event in first}) == len(first)


def test_rules_that_need_the_floor_refuse_a_rig_without_one_and_name_the_command():
    bare = replace(RIG, world_from_rig=None)
    with pytest.raises(RigRefusedError, match="rigcal world") as caught:
        Judge(SITE, bare)
    assert "ladder" in caught.value.what
    Judge(load_rules(CONFIGS / "paper.rules.toml"), bare)


def test_time_must_advance():
    film = Film(SITE).show([worker(1, 0, 0)])
    scene = film.judgements[0]
    with pytest.raises(ValueError, match="expected a time after"):
        film.watch.judge.judge(empty_at(scene.t_ns))
    assert film.watch.step(empty_at(scene.t_ns)) == (film.judgements[-1], ())


def empty_at(t_ns):
    return Scene(0, t_ns, (), ())
