"""Rule files: what is refused, where, and with which advice."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rule_scenes import CONFIGS

from recognition.errors import RulesError
from recognition.rules import load_rules, parse_rules
from recognition.rules.parsing import ExpressionError, parse_condition, parse_head, parse_when

SHIPPED = sorted(CONFIGS.rglob("*.rules.toml"))
SITE = (CONFIGS / "site.rules.toml").read_text()
ZONES = """
[zones.pit]
polygon_m = [[0, 0], [3, 0], [3, 2], [0, 2]]
height_m = [-1.0, 2.0]

[openings.east]
from_m = [4.0, 0.0]
to_m = [4.0, 1.5]
height_m = [0.9, 2.3]

[[rules]]
name = "pit"
sentence = "a worker is in the pit"
when = "each w: inside(w.feet, pit)"
"""

PLANTED = {
    "not TOML": ("version = 1", "version = = 1", "TOML"),
    "a bracket of TOML not closed": ("[definitions]", "[definitions", "TOML"),
    "another format": ('"recognition.rules"', '"recognition.rule"', "did you mean recognition.rules"),
    "a version of the future": ("version = 1", "version = 2", "version 2"),
    "an unknown section": ("[definitions]", "[defintions]", "did you mean definitions"),
    "an unknown key of a rule": ("for_s = 0.3", "for_sec = 0.3", "did you mean for_s"),
    "an unknown severity": ('severity = "alarm"', 'severity = "alert"', "unknown severity"),
    "an unknown word for on_unknown": ('on_unknown = "hold"', 'on_unknown = "held"', "did you mean hold"),
    "a negative duration": ("for_s = 0.3", "for_s = -0.3", "out of range"),
    "a duration in quotes": ("clear_s = 0.3", 'clear_s = "0.3 s"', "out of range"),
    "a name twice": ('name = "window"', 'name = "ladder"', "two rules"),
    "a rule without a condition": ('when = "each platform p: count(w: on(w, p)) >= 2"\n', "", "when is missing"),
    "an unknown class": ("each platform p", "each plattform p", "did you mean platform"),
    "an unknown class in braces": ("{ladder, step_ladder}", "{ladder, stepladder}", "did you mean step_ladder"),
    "an unknown variable": ("count(w: on(w, p))", "count(w: on(v, p))", "unknown name v"),
    "an unknown point": ("visible(w.crown)", "visible(w.corwn)", "did you mean crown"),
    "an unknown definition": ("not worn(w)", "not wron(w)", "did you mean worn"),
    "an unknown measure": ("speed(o) > 0.2", "sped(o) > 0.2", "goes? not|does not go on|did you mean speed"),
    "an unknown zone": ("inside(w.feet, pit)", "inside(w.feet, pitt)", "did you mean pit"),
    "an unknown unit": ("> 0.2 m/s", "> 0.2 m/h", "unknown unit"),
    "a limit without a unit": ("dist(w.crown, o) < 0.20 H", "dist(w.crown, o) < 0.20", "without a unit"),
    "a length for a speed": ("> 0.2 m/s", "> 0.2 m", "not measured in m"),
    "the height of nobody": ("clearance(o.bottom) > 0.05 m", "clearance(o.bottom) > 0.05 H", "whose height"),
    "an impossible distance": ("dist(w.hands, o.extent) < 0.25 H", "dist(w.hands, o.extent) < 15 H", "impossible"),
    "a limit of nothing": ("dist(w.crown, o) < 0.20 H", "dist(w.crown, o) < 0 H", "impossible"),
    "an impossible speed": ("> 0.2 m/s", "> 99 m/s", "impossible"),
    "a count that is always so": (">= 2", ">= 0", "always"),
    "exit on the wrong side": ("> 0.15 H exit 0.12 H", "> 0.15 H exit 0.18 H", "wrong side"),
    "too few arguments": ("clearance(w.feet) > 0.15", "dist(w.feet) > 0.15", "takes 2 arguments"),
    "too many arguments": ("each w: not worn(w) and visible(w.crown)", "each w: not worn(w, w)", "takes 1 argument"),
    "a worker where an object belongs": ("exists w: climbs(w, l)", "exists w: climbs(w, w)", "no axis"),
    "an object without an axis": ("each l in {ladder, step_ladder}", "each l in {ladder, cone}", "cone has no axis"),
    "a worker without a point": ("visible(w.crown)", "visible(w)", "which point of w"),
    "a distance in no way": ("dist(w.left_ankle, p.top, z)", "dist(w.feet, p.top, xy)", "not measured in xy"),
    "a variable about which nothing is said": ("exists v != w: holds(v, l)", "exists v != w: holds(w, l)", "about v"),
    "a variable that is taken": ("exists v != w: holds(v, l)", "exists w: holds(w, l)", "is taken"),
    "a definition that uses itself": ('= "dist(w.hands, l.extent) < 0.15 H and', '= "holds(w, l) and', "uses itself"),
    "a definition that nobody uses": ("not worn(w)", "not visible(w.neck)", "no rule uses"),
    "a bracket not closed": ("count(w: on(w, p)) >= 2", "count(w: on(w, p) >= 2", "does not go on"),
    "arithmetic": (
        "dist(w.left_ankle, p.top, z) < 0.20 m",
        "w.left_ankle.z - p.top < 0.20 m",
        "does not go on|do not have",
    ),
    "a colon missing": ("each w: not worn", "each w not worn", "does not go on|unknown class"),
    "each in the middle": ("exists v != w: holds", "each v: holds", "only at the beginning"),
    "a zone of two corners": ("[[0, 0], [3, 0], [3, 2], [0, 2]]", "[[0, 0], [3, 0]]", "too few corners"),
    "a zone that crosses itself": ("[3, 0], [3, 2], [0, 2]", "[3, 2], [3, 0], [0, 2]", "crosses itself"),
    "a zone upside down": ("[-1.0, 2.0]", "[2.0, -1.0]", "no height"),
    "an opening of no width": ("\nto_m = [4.0, 1.5]", "\nto_m = [4.0, 0.0]", "no width"),
}
ELSEWHERE = {
    "a rule without a condition": '[[rules]]\nname = "platform"',
    "a definition that nobody uses": '"worn(w)"',
}
"""Mistakes that show in another line than the one that was changed."""


@pytest.mark.parametrize("mistake", PLANTED)
def test_a_planted_mistake_is_refused_with_its_line(mistake):
    before, after, words = PLANTED[mistake]
    text = SITE + ZONES
    assert before in text, "nothing was planted"
    parse_rules(text, "site.rules.toml")
    planted = text.replace(before, after, 1)
    with pytest.raises(RulesError) as caught:
        parse_rules(planted, "site.rules.toml")
    error = caught.value
    at = text.index(before) + before.startswith("\n")
    if mistake in ELSEWHERE:
        at = planted.index(ELSEWHERE[mistake])
    assert any(word in error.what + " " + str(error.got) for word in words.split("|")), str(error)
    assert error.line == planted[:at].count("\n") + 1, str(error)
    assert str(error.where) == f"site.rules.toml:{error.line}:{error.column}"
    line = planted.splitlines()[error.line - 1]
    assert 1 <= error.column <= len(line) + 1


@pytest.mark.parametrize(
    ("when", "column"),
    [
        ("each w: visible(w.haed)", "haed"),
        ("each w: dist(w.head, w.feet) < 0.1 Q", "Q"),
        ("each w: clearance(w.feet) < 90 m", "90"),
        ("each w: worn(w)", "worn"),
        ("each hat o: speed(o) > 1 m/s", "hat"),
        ("each w: exists v: clearance(w.feet) > 1 m", "v:"),
        ("each w: clearance(w.feet) > 1 m and", None),
    ],
)
def test_the_column_is_that_of_the_wrong_word(when, column):
    text = f'format = "recognition.rules"\nversion = 1\n[[rules]]\nname = "r"\nsentence = "s"\nwhen = "{when}"\n'
    with pytest.raises(RulesError) as caught:
        parse_rules(text, "r.toml")
    line = text.splitlines()[5]
    assert (caught.value.line, caught.value.column) == (6, (line.index(column) if column else len(line) - 1) + 1)


def test_columns_are_right_in_strings_of_several_lines():
    head = 'format = "recognition.rules"\nversion = 1\n[[rules]]\nname = "r"\nsentence = "s"\nwhen = """\n'
    text = head + 'each w:\n  visible(w.head)\n  and speed(w.torso) > 1 kg\n"""\n'
    with pytest.raises(RulesError) as caught:
        parse_rules(text, "r.toml")
    assert (caught.value.line, caught.value.column) == (9, 26)


def test_a_mistake_in_a_definition_is_found_there_and_one_in_its_use_at_the_use():
    with pytest.raises(RulesError, match="cone has no axis") as caught:
        parse_rules(SITE.replace("each l in {ladder, step_ladder}: exists w", "each cone l: exists w"), "r.toml")
    assert "climbs(w, l) and not" in SITE.splitlines()[caught.value.line - 1]
    with pytest.raises(RulesError, match="unknown point axsi"):
        parse_rules(SITE.replace("l.axis", "l.axsi"), "r.toml")


def test_the_message_says_what_where_expected_got_and_what_to_do():
    with pytest.raises(RulesError) as caught:
        parse_rules(SITE.replace("each platform p", "each plattform p"), "site.rules.toml")
    assert str(caught.value) == (
        "rule file: unknown class plattform (did you mean platform?)\n"
        f"  where:    site.rules.toml:{caught.value.line}:14\n"
        "  expected: hard_hat, ladder, step_ladder, platform, large_window, small_window, toolbox, cone, bucket, "
        "drill, saw_horse, scaffold, wheelbarrow, barrel\n"
        "  got:      plattform\n"
        "  do next:  mend the name, or declare the class of another network under [classes]"
    )


def test_classes_of_other_networks_can_be_declared():
    text = SITE.replace("[definitions]", '[classes]\ntower = "deck"\n\n[definitions]').replace(
        "each platform p", "each p in {platform, tower}"
    )
    assert parse_rules(text, "r.toml").rule("platform").checked.classes == ("platform", "tower")


def test_a_chain_of_definitions_that_explodes_is_refused():
    chain = "\n".join(f'"d{n}(w)" = "d{n + 1}(w) and d{n + 1}(w)"' for n in range(30))
    text = (
        f'format = "recognition.rules"\nversion = 1\n[definitions]\n{chain}\n"d30(w)" = "visible(w.head)"\n'
        '[[rules]]\nname = "r"\nsentence = "s"\nwhen = "each w: d0(w)"\n'
    )
    with pytest.raises(RulesError, match="too large"):
        parse_rules(text, "r.toml")


def test_conditions_that_are_too_deep_are_refused():
    with pytest.raises(ExpressionError, match="too deep"):
        parse_condition("(" * 5000 + "visible(w.head)" + ")" * 5000)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.name)
def test_shipped_files_are_sound(file):
    rules = load_rules(file)
    assert rules.rules
    assert rules.digest.startswith("sha256:")
    assert rules.name == file.name.removesuffix(".rules.toml")


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(RulesError, match="cannot read it"):
        load_rules(tmp_path / "none.rules.toml")
    (tmp_path / "latin.rules.toml").write_bytes(b"# a\n# b\xe9\n")
    with pytest.raises(RulesError, match="UTF-8") as caught:
        load_rules(tmp_path / "latin.rules.toml")
    assert caught.value.line == 2


def mutated(rng, text):
    """A text with up to four random changes: characters, words and lines lost, doubled, exchanged or made up."""
    for _ in range(rng.randint(1, 4)):
        kind, at = rng.randrange(6), rng.randrange(len(text))
        if kind == 0:
            text = text[:at] + text[at + rng.randint(1, 9) :]
        elif kind == 1:
            text = text[:at] + rng.choice("(){}[]<>=!.,:\"'\\\n\t #-+*/%0123456789aHmwé\x00") + text[at:]
        elif kind == 2:
            end = min(at + rng.randint(1, 40), len(text))
            text = text[:end] + text[at:end] + text[end:]
        elif kind == 3:
            lines = text.split("\n")
            a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[a], lines[b] = lines[b], lines[a]
            text = "\n".join(lines)
        elif kind == 4:
            words = [
                "exists",
                "each",
                "count",
                "not",
                "and",
                "w",
                "o",
                "hard_hat",
                "0.10 H",
                "9e999",
                "nan",
                "dist",
                "xy",
            ]
            text = text[:at] + f" {rng.choice(words)} " + text[at:]
        else:
            text = text[:at] + chr(rng.randrange(32, 1000)) + text[at + 1 :]
        text = text or " "
    return text


def test_a_thousand_random_mutations_give_a_rule_set_or_a_rules_error():
    rng = random.Random(7)
    texts = [path.read_text() for path in SHIPPED] + [SITE + ZONES]
    refused = []
    for number in range(1000):
        text = mutated(rng, texts[number % len(texts)])
        try:
            parse_rules(text, "r.toml")
        except RulesError as error:
            refused.append((text, error.line, error.column))
    assert 400 < len(refused) < 1000
    for text, line, column in refused:
        assert 1 <= line <= text.count("\n") + 1, text
        assert column >= 1, text


def test_expressions_are_read_as_they_are_bound():
    when = parse_when("each w: each v != w: not a(w) and b(v) or c(w)")
    assert [domain.variable.text for domain in when.each] == ["w", "v"]
    assert when.body.word == "or"
    assert when.body.parts[0].word == "and"
    swallowed = parse_condition("exists w: a(w) and b(w)")
    assert swallowed.body.word == "and"
    name, variables = parse_head("climbs(w, l)")
    assert (name.text, [v.text for v in variables]) == ("climbs", ["w", "l"])
