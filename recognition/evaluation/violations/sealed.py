"""The sealed half: nothing is judged on it by rules that are not committed, and every run on it is written down.

The rule files must be, byte for byte, those of the commit that git has checked out (``git show HEAD:./FILE``): then
nobody can look at the result first and choose the thresholds afterwards without a trace. Without git, or outside of a
repository, this cannot be known, and the run is refused; there is no way around it.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recognition import __version__
from recognition.errors import DatasetError
from recognition.evaluation.violations.truth import KINDS
from rigcal.errors import writing

SEALED = "test"
"""The half that nobody fits anything on."""
LOG = "evaluations.jsonl"
"""Beside our rule file: a line for each run on the sealed half, in order."""


@dataclass(frozen=True, slots=True)
class Code:
    """The code that a run was made with."""

    commit: str
    is_modified: bool
    """Whether the files of the repository differ from the commit's."""

    @property
    def document(self) -> dict[str, Any]:
        """As the log has it."""
        return {"version": __version__, "commit": self.commit, "modified": self.is_modified}


def require_committed(paths: Sequence[Path]) -> Code:
    """The code's version, where all rule files are committed as they are.

    Raises:
        DatasetError: where one is not, or there is no git to know it from.
    """
    for path in paths:
        committed = _git(path, "show", f"HEAD:./{path.name}")
        if committed is None:
            raise _refused(path, "it is not in the commit that is checked out")
        if committed != path.read_bytes():
            raise _refused(path, "it differs from the one in the commit that is checked out")
    commit, changes = _git(paths[0], "rev-parse", "HEAD"), _git(paths[0], "status", "--porcelain", "-uno")
    return Code((commit or b"").decode().strip(), bool(changes))


def write_down(path: Path, code: Code, utc: str, document: Mapping[str, Any]) -> None:
    """Append a run to the log.

    Args:
        path: Of the log.
        code: Of the run.
        utc: When it was.
        document: Of :func:`recognition.evaluation.violations.document_of`, with ``networks`` and ``views``.

    Raises:
        OutputError: where it cannot be written; nothing should be told of the run then.
    """
    entry = {
        "utc": utc,
        "code": code.document,
        **{name: document[name] for name in ("rules", "networks", "views")},
        "sequences": [sequence["name"] for sequence in document["sequences"]],
        "figures": {row["name"]: _figures(row) for row in document["rows"]},
        "failures": len(document["failures"]),
    }
    with writing(path), path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, ensure_ascii=False) + "\n")


def _figures(row: Mapping[str, Any]) -> dict[str, Any]:
    figures: dict[str, Any] = {"false_alarms_per_hour": row["false_alarms_per_hour"]}
    for part in ("outside_transitions", "raw"):
        names = ("accuracy_percent", "balanced_accuracy_percent", "f1")
        figures[part] = {kind: {name: row[part][kind][name] for name in names} for kind in KINDS}
    return figures


def _git(path: Path, *arguments: str) -> bytes | None:
    """What git says in the file's folder; None where it fails.

    Raises:
        DatasetError: where there is no git.
    """
    try:
        done = subprocess.run(["git", "-C", str(path.resolve().parent), *arguments], capture_output=True, check=False)
    except FileNotFoundError as error:
        raise _refused(path, "git, which would know whether it is committed, is not installed") from error
    return done.stdout if done.returncode == 0 else None


def _refused(path: Path, reason: str) -> DatasetError:
    return DatasetError(
        "the sealed half is judged by committed rules only",
        where=path,
        expected="a rule file that is the same in the commit that is checked out",
        got=reason,
        do_next="fit and choose on --split validation, commit the rule files, and run this once",
    )
