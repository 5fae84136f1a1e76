"""The part of YAML that Kalibr and ROS write.

Context: both write nested tables, lists of numbers and lists of tables, in PyYAML's layout, which people then edit.
Decision: read exactly that (block tables, block lists, flow lists over several lines, comments, quotes) and refuse
the rest by line, rather than depend on a YAML library for two formats. OpenCV's reader is no help: it wants a
``%YAML:1.0`` header and reports no lines. Cost: this module; anchors, flow tables and multi-line text are refused.
"""

from __future__ import annotations

import json
import math
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from rigcal.errors import FormatError

_KEY = re.compile(r"""(?P<key>[A-Za-z_][\w.\-/]*|"[^"]*"|'[^']*')\s*:(?:\s+(?P<value>\S.*))?$""")
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$")
_TOKEN = re.compile(r"""\s*(\[|\]|,|"[^"]*"|'[^']*'|[^\[\],\s][^\[\],]*)""")
_COMMENT = re.compile(r"""^((?:"[^"]*"|'[^']*'|[^"'#]|(?<=\S)#)*?)(?:(?:^|(?<=\s))#.*)?$""")
_REFUSED_START = tuple("&*!|>{%@`")
_CONSTANTS = {"true": True, "false": False, "null": None, "~": None}


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    indent: int
    text: str


def parse_yaml(file: Path, text: str) -> dict[str, Any]:
    """Read YAML into tables, lists, numbers and texts.

    Raises:
        FormatError: for anything outside the part that Kalibr and ROS write, naming the line.
    """
    reader = _Reader(file, text)
    return reader.table(0)


class _Reader:
    def __init__(self, file: Path, text: str) -> None:
        self._file = file
        self._lines = deque(self._logical_lines(text))

    def _refuse(self, line: _Line, expected: str) -> NoReturn:
        raise FormatError(
            "cannot read this YAML",
            where=f"{self._file}, line {line.number}",
            expected=expected,
            got=line.text,
            do_next="write it as its tool does: tables, lists and numbers, without anchors, tabs or { }",
        )

    def _logical_lines(self, text: str) -> list[_Line]:
        """Lines without comments, each flow list joined into one line."""
        lines: list[_Line] = []
        open_brackets = 0
        for number, raw in enumerate(text.splitlines(), start=1):
            comment = _COMMENT.match(raw)
            content = (comment[1] if comment else raw).rstrip()
            if not content.strip() or content == "---" or (not lines and content.startswith("%YAML")):
                continue
            line = _Line(number, len(content) - len(content.lstrip(" ")), content.strip())
            if "\t" in content[: line.indent + 1]:
                self._refuse(line, "spaces before an entry")
            if open_brackets:
                last = lines.pop()
                line = _Line(last.number, last.indent, f"{last.text} {line.text}")
            open_brackets = max(0, line.text.count("[") - line.text.count("]"))
            lines.append(line)
        if open_brackets:
            self._refuse(lines[-1], "a ] for every [")
        return lines

    def table(self, indent: int) -> dict[str, Any]:
        """The entries that stand at one indent."""
        result: dict[str, Any] = {}
        while self._lines and self._lines[0].indent >= indent and not self._at_item():
            line = self._lines.popleft()
            match = _KEY.match(line.text)
            if match is None or line.indent != indent:
                self._refuse(line, f"an entry 'name: value' with {indent} spaces before it")
            key = str(self._scalar(line, match["key"]))
            if key in result:
                self._refuse(line, f"one entry {key}")
            result[key] = self._flow(line, match["value"]) if match["value"] else self._nested(line)
        if indent == 0 and self._lines:
            self._refuse(self._lines[0], "an entry 'name: value'")
        return result

    def _at_item(self) -> bool:
        return bool(self._lines) and self._lines[0].text.startswith("- ")

    def _nested(self, parent: _Line) -> Any:
        """What stands below ``name:``: a list (which may have the same indent), a table, or nothing."""
        if self._at_item() and self._lines[0].indent >= parent.indent:
            return self._items(self._lines[0].indent)
        if self._lines and self._lines[0].indent > parent.indent:
            return self.table(self._lines[0].indent)
        return None

    def _items(self, indent: int) -> list[Any]:
        items = []
        while self._at_item() and self._lines[0].indent == indent:
            line = self._lines.popleft()
            text = line.text[2:].lstrip()
            if _KEY.match(text):
                inner = indent + len(line.text) - len(text)
                self._lines.appendleft(_Line(line.number, inner, text))
                items.append(self.table(inner))
            else:
                items.append(self._flow(line, text))
        return items

    def _flow(self, line: _Line, text: str) -> Any:
        """A scalar, or a flow list of scalars and flow lists."""
        if not text.startswith("["):
            return self._scalar(line, text)
        tokens = deque(_TOKEN.findall(text))
        tokens.popleft()
        value = self._flow_list(line, tokens)
        if tokens:
            self._refuse(line, "nothing after the last ]")
        return value

    def _flow_list(self, line: _Line, tokens: deque[str]) -> list[Any]:
        values: list[Any] = []
        while tokens and tokens[0] != "]":
            token = tokens.popleft()
            if token == ",":
                self._refuse(line, "a value between commas")
            values.append(self._flow_list(line, tokens) if token == "[" else self._scalar(line, token.strip()))
            if tokens and tokens[0] == ",":
                tokens.popleft()
            elif not tokens or tokens[0] != "]":
                break
        if not tokens:
            self._refuse(line, "a ] for every [")
        if tokens.popleft() != "]":
            self._refuse(line, "a comma between values")
        return values

    def _scalar(self, line: _Line, text: str) -> Any:
        if _NUMBER.match(text) and math.isfinite(float(text)):
            return float(text) if re.search(r"[.eE]", text) else int(text)
        if text.startswith(_REFUSED_START) or _NUMBER.match(text):
            self._refuse(line, "a number, a text or a list of them")
        if text[0] in "\"'":
            return text[1:-1]
        return _CONSTANTS.get(text.lower(), text)


def number_text(value: float) -> str:
    """A number that every YAML 1.1 reader takes for one: ``1e-05`` without a point would be read as a text."""
    text = repr(float(value))
    return text.replace("e", ".0e", 1) if "e" in text and "." not in text else text


def list_text(values: Sequence[float | int]) -> str:
    """A flow list of numbers on one line; whole numbers given as int stay whole."""
    return "[" + ", ".join(str(v) if isinstance(v, int) else number_text(v) for v in values) + "]"


def quoted(text: str) -> str:
    """A text in double quotes."""
    return json.dumps(text, ensure_ascii=False)
