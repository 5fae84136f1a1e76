"""Options as text: how a recording says what a run was told, and how a replay is told the same.

Options are frozen dataclasses of numbers, texts, tuples and further options. Their text is JSON; floats are written as
the shortest text that reads back to the same value.
"""

from __future__ import annotations

import json
from dataclasses import asdict, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

from recognition.errors import RecordingError

T = TypeVar("T")


def options_text(options: Any) -> str:
    """The JSON text of a dataclass of options."""
    return json.dumps(asdict(options), sort_keys=True, allow_nan=False)


def options_of(kind: type[T], text: str) -> T:
    """The options that a text says; what it does not name has its default.

    Raises:
        RecordingError: where the text is no JSON object, or names an option that ``kind`` does not have.
        OptionError: where a value is outside its range.
    """
    try:
        stated = json.loads(text)
    except ValueError as error:
        raise _unknown(kind, f"no JSON: {error}") from error
    return _built(kind, stated)


def _built(kind: type[T], stated: Any) -> T:
    if not isinstance(stated, dict):
        raise _unknown(kind, repr(stated))
    hints = get_type_hints(kind)
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]  # every kind is a dataclass
    unknown = sorted(stated.keys() - names)
    if unknown:
        raise _unknown(kind, ", ".join(unknown))
    return kind(**{name: _value(hints[name], value) for name, value in stated.items()})


def _value(hint: Any, value: Any) -> Any:
    if is_dataclass(hint) and isinstance(hint, type):
        return _built(hint, value)
    return tuple(value) if isinstance(value, list) else value


def _unknown(kind: type[Any], got: str) -> RecordingError:
    return RecordingError(
        "the recording was made with options that this version does not have",
        expected=f"options of {kind.__name__}: {', '.join(field.name for field in fields(kind))}",
        got=got,
        do_next="replay it with the version that recorded it; `recognition check` says which",
    )
