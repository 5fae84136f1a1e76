"""Rules as data: what must not be, written in a closed language, judged over scenes with three values.

A rule file is TOML::

    format = "recognition.rules"
    version = 1

    [definitions]
    "worn(w)" = "exists hard_hat o of w: dist(w.crown, o) < 0.20 H and visible(o)"

    [zones.pit]
    polygon_m = [[0, 0], [3, 0], [3, 2]]      # on the floor, in the world frame
    height_m = [-0.5, 2.5]                    # optional

    [openings.east]                           # where a window is mounted
    from_m = [4, 0]
    to_m = [4, 1.5]
    height_m = [0.9, 2.3]

    [classes]                                 # of networks other than the bundled ones
    forklift = "plain"                        # or ladder, deck, pane: what the keypoints mean

    [[rules]]
    name = "no_hat"
    sentence = "a worker wears no hard hat"
    when = "each w: not worn(w) and visible(w.crown)"
    for_s = 0.3
    clear_s = 0.3
    on_unknown = "hold"                       # or clear
    max_hold_s = 10
    severity = "warning"                      # or info, alarm

**Who.** ``each w:`` judges a rule for one worker after another, ``each ladder l:`` or ``each l in {ladder,
step_ladder}:`` for objects; ``exists``, ``count(...)`` and ``!=`` are as they read. ``exists hard_hat o of w`` is one
that is nobody else's, and that a camera saw in the last quarter of a second.

**Measures.** ``dist(a, b)``, with ``xy`` on the plan and ``z`` in height; ``clearance(p)`` over the floor; ``speed(p)``
over the last half second. Points of workers are ``head`` (between the ears, else eyes, nose), ``crown`` (0.09 m above
it along the body, where the middle of a hard hat is that is worn), ``neck`` (between the shoulders), ``torso`` (mean of
shoulders and hips), ``feet`` (between the ankles), ``hands`` (the nearer wrist) and the joints; of objects ``o`` (its
centre) and ``o.bottom`` (by their boxes; of windows between that and their keypoints). Distances are also measured from
``l.axis`` of ladders (``xy``: on the point's own level), ``p.footprint`` (xy) and ``p.top`` (z; of feet and ankles from
where they are on it, 0.08 m above) of decks, ``o.extent``, and zones (xy).

**Limits** bear a unit: ``m cm mm H m/s km/h``. ``H`` is the height of the worker whom the measure is about: the median
over the track of what the segments of the body add up to, and before that between 1.5 and 2 m. ``> 0.15 H exit 0.12 H``
has another limit while the violation lasts, which makes it harder to end (under ``not``, on the other side). There is
no arithmetic and no user's code.

**Predicates.** ``visible(w.head)``: two cameras see it now, else unknown; ``visible(w.crown)``: so would they see a hat
on the head, all of which their images hold, else unknown; ``inside(w.feet, pit)``; ``mounted(o)``.

**Three values.** What is not known is unknown, never false; see :mod:`recognition.rules.cast` for what can be told
about somebody half hidden, :mod:`recognition.rules.conditions` for margins, :mod:`recognition.rules.timing` for time.

Decisions: ``on``, ``carries``, ``holds`` and the like are definitions in the file, not words of the language, so that
their limits are data too; a definition is checked where it is used, with the kinds of its arguments; one that is used
nowhere, a variable about which nothing is said, a limit that nothing can reach are mistakes.
"""

from __future__ import annotations

from recognition.rules.explaining import Explanation
from recognition.rules.judge import BindingExplanation, Judge
from recognition.rules.ruleset import Rule, RuleSet, load_rules, parse_rules
from recognition.rules.verdict import Actor, Judgement, Verdict

__all__ = [
    "Actor",
    "BindingExplanation",
    "Explanation",
    "Judge",
    "Judgement",
    "Rule",
    "RuleSet",
    "Verdict",
    "load_rules",
    "parse_rules",
]
