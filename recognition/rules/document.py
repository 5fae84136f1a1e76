"""A TOML file whose mistakes have a line and a column.

``tomllib`` gives values without their places; :class:`Places` finds where each key and value stands by one pass over
the lines of a text that ``tomllib`` has accepted.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from recognition.errors import RulesError
from recognition.rules.vocabulary import alike

Keys: TypeAlias = tuple[str | int, ...]
"""Names of tables and keys from the top, and numbers of arrays of tables."""
MOST_CHARACTERS = 200_000
_PART = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=\s*")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'|#.*')
_TOML_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)")


class Places:
    """Where the keys and values of a TOML text stand: offsets from its beginning."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._keys: dict[Keys, int] = {}
        self._values: dict[Keys, int] = {}
        self._scan()

    def line_column(self, offset: int) -> tuple[int, int]:
        """Of an offset, both from 1."""
        before = self._text[:offset]
        return before.count("\n") + 1, offset - (before.rfind("\n") + 1) + 1

    def key(self, keys: Keys) -> int:
        """Offset of a key, or of the nearest table around it."""
        while keys and keys not in self._keys:
            keys = keys[:-1]
        return self._keys.get(keys, 0)

    def value(self, keys: Keys) -> int:
        """Offset of a value, or of the nearest key around it."""
        return self._values.get(keys, self.key(keys))

    def within(self, keys: Keys, offset: int) -> int:
        """Offset of a character of a string value; of the value itself, where it has escapes."""
        start = self.value(keys)
        quotes = next((q for q in ('"""', "'''", '"', "'") if self._text.startswith(q, start)), "")
        first = start + len(quotes)
        if len(quotes) == 3 and self._text[first : first + 1] == "\n":
            first += 1
        raw = self._text[first : first + offset]
        return start if not quotes or ("\\" in raw and quotes[0] == '"') else first + offset

    def _scan(self) -> None:
        table: Keys = ()
        arrays: dict[Keys, int] = {}
        at, skip_to = 0, 0
        for line in self._text.splitlines(keepends=True):
            start, at = at, at + len(line)
            if start < skip_to:
                continue
            header, key = _HEADER.match(line), _KEY.match(line)
            if header:
                table = self._entered(_parts(header[2]), arrays, is_array=header[1] == "[[")
                self._keys.setdefault(table, start + header.start(1))
            elif key:
                keys = (*table, *_parts(key[1]))
                self._keys[keys], self._values[keys] = start + key.start(1), start + key.end()
                skip_to = self._end_of_value(start + key.end())

    def _entered(self, names: tuple[str, ...], arrays: dict[Keys, int], *, is_array: bool) -> Keys:
        """The table that a header opens."""
        keys: Keys = ()
        for number, name in enumerate(names, 1):
            keys = (*keys, name)
            if is_array and number == len(names):
                arrays[keys] = arrays.get(keys, -1) + 1
            if keys in arrays:
                keys = (*keys, arrays[keys])
        return keys

    def _end_of_value(self, start: int) -> int:
        """Where the lines of a value end that has several."""
        for quotes in ('"""', "'''"):
            if self._text.startswith(quotes, start):
                end = self._text.find(quotes, start + 3)
                return len(self._text) if end < 0 else end
        depth, end = 0, start
        for line in self._text[start:].splitlines(keepends=True):
            bare = _QUOTED.sub("", line)
            depth += sum(bare.count(c) for c in "[{") - sum(bare.count(c) for c in "]}")
            end += len(line)
            if depth <= 0:
                break
        return end


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in re.findall(_PART, dotted))


class Table:
    """One table of a file, read key by key."""

    def __init__(self, where: Path | str, places: Places, keys: Keys, content: Mapping[str, Any]) -> None:
        self.where, self.places, self.keys, self._content = where, places, keys, content

    @classmethod
    def of(cls, text: str, where: Path | str) -> Table:
        """The whole file.

        Raises:
            RulesError: where it is no TOML.
        """
        if len(text) > MOST_CHARACTERS:
            _refuse(where, 1, 1, "the file is too large", f"at most {MOST_CHARACTERS} characters", len(text),
                    "take out what is not used")  # fmt: skip
        text = text.replace("\r\n", "\n")
        try:
            content = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # ValueError: also numbers of thousands of digits
            found = _TOML_PLACE.search(str(error))
            line, column = (int(found[1]), int(found[2])) if found and found[1] else Places("").line_column(0)
            if found and not found[1]:
                line, column = text.count("\n") + 1, len(text) - (text.rfind("\n") + 1) + 1
            _refuse(where, line, column, "not valid TOML", "TOML 1.0", _TOML_PLACE.sub("", str(error)),
                    "mend this line, or the one before")  # fmt: skip
        return cls(where, Places(text), (), content)

    def names(self) -> tuple[str, ...]:
        """Keys, in order."""
        return tuple(self._content)

    def table(self, key: str) -> Table:
        """A table; empty where there is none."""
        content = self._content.get(key, {})
        if not isinstance(content, dict):
            self.fail(key, f"{key} is a table", f"[{key}]", content, f"write [{key}] on a line of its own")
        return Table(self.where, self.places, (*self.keys, key), content)

    def tables(self, key: str) -> tuple[Table, ...]:
        """An array of tables."""
        content = self._content.get(key, [])
        if not isinstance(content, list) or not all(isinstance(item, dict) for item in content):
            self.fail(key, f"{key} is an array of tables", f"[[{key}]]", content, f"write [[{key}]] before each")
        return tuple(Table(self.where, self.places, (*self.keys, key, n), item) for n, item in enumerate(content))

    def text(self, key: str, default: str | None = None, *, one_of: Sequence[str] = ()) -> str:
        """A string; required where there is no default."""
        value = self._content.get(key, default)
        if value is None:
            self._lacking(key, f'{key} = "..."')
        if not isinstance(value, str) or not value.strip():
            self.fail(key, f"{key} is a text", 'a text in "quotes"', value, "put it in quotes")
        if one_of and value not in one_of:
            self.fail(key, f"unknown {key} {value}{alike(value, list(one_of))}", " or ".join(one_of), value,
                      "mend the word")  # fmt: skip
        return value

    def number(self, key: str, default: float | None, *, least: float, most: float, unit: str = "") -> float:
        """A number within a range; required where there is no default."""
        value = self._content.get(key, default)
        if value is None:
            self._lacking(key, f"{key} = 1")
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            self.fail(key, f"{key} is out of range", f"a number from {least:g} to {most:g} {unit}".rstrip(), value,
                      "mend the number")  # fmt: skip
        return float(value)

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """So many finite numbers; required where there is no default."""
        value = self._content.get(key, None)
        if value is None and default is not None:
            return default
        if value is None:
            self._lacking(key, f"{key} = [{', '.join(['1.0'] * count)}]")
        if not _are_numbers(value, count):
            self.fail(key, f"{key} is {count} numbers", f"{count} numbers in metres", value, "mend the numbers")
        return tuple(map(float, value))

    def points(self, key: str) -> tuple[tuple[float, float], ...]:
        """Points on the plan: pairs of numbers."""
        value = self._content.get(key, None)
        if value is None:
            self._lacking(key, f"{key} = [[0, 0], [2, 0], [2, 1]]")
        if not isinstance(value, list) or not all(_are_numbers(point, 2) for point in value):
            self.fail(key, f"{key} is a list of points", "[[x, y], ...] in metres", value, "mend the points")
        return tuple((float(x), float(y)) for x, y in value)

    def only(self, *known: str) -> None:
        """Refuse other keys than these."""
        for key in self._content:
            if key not in known:
                self.fail_key(key, f"unknown key {key}{alike(key, known)}", ", ".join(known), key,
                              "mend the name, or leave it out")  # fmt: skip

    def fail(self, key: str, problem: str, expected: str, got: object, do_next: str) -> NoReturn:
        """Refuse a value."""
        self.fail_at(self.places.value((*self.keys, key)), problem, expected, got, do_next)

    def fail_key(self, key: str, problem: str, expected: str, got: object, do_next: str) -> NoReturn:
        """Refuse a key."""
        self.fail_at(self.places.key((*self.keys, key)), problem, expected, got, do_next)

    def fail_at(self, offset: int, problem: str, expected: str, got: object, do_next: str) -> NoReturn:
        """Refuse what stands at an offset of the file."""
        line, column = self.places.line_column(offset)
        _refuse(self.where, line, column, problem, expected, got, do_next)

    def _lacking(self, key: str, example: str) -> NoReturn:
        self.fail_at(self.places.key(self.keys), f"{key} is missing", example, "nothing", f"add {example}")


def _are_numbers(value: object, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(isinstance(n, int | float) and not isinstance(n, bool) and _is_finite(n) for n in value)
    )


def _is_finite(number: float) -> bool:
    return abs(number) < 1e6 and isfinite(number)


def _refuse(
    where: Path | str, line: int, column: int, problem: str, expected: str, got: object, do_next: str
) -> NoReturn:
    said = str(got)
    raise RulesError(
        problem,
        where=where,
        line=line,
        column=column,
        expected=expected,
        got=said if len(said) <= 120 else said[:117] + "...",
        do_next=do_next,
    ) from None
