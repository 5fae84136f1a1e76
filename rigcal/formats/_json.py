"""JSON text of another tool as entries."""

from __future__ import annotations

import json
from pathlib import Path

from rigcal.errors import FormatError
from rigcal.formats._entries import Entry


def parsed_json(file: Path, text: str) -> Entry:
    """The whole file as one entry.

    Raises:
        FormatError: where the text is not JSON.
    """
    try:
        return Entry(file, "", json.loads(text))
    except ValueError as error:
        do_next = "mend it, or write the file again with the tool that made it"
        raise FormatError("this is not JSON", where=file, expected="JSON text", got=error, do_next=do_next) from error
