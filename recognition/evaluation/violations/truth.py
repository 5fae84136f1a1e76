"""What is true of a sequence: which violations hold at each instant, in which light, and how much is hidden.

The unit is the paper's (Safe-Construct, "Safety Violation Scenarios"): one decision for the whole scene at each
instant and for each violation, shared by all views, and true where a violation is hidden from some of them. Instants
are the frames of camera 0; the scene's violation holds where that of any worker or object does.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recognition.errors import DatasetError
from rigcal.geometry import Bools, Floats, Ints, freeze

KINDS = ("no_hat", "ladder", "window", "platform")
"""The four violations, in the order of the paper's table: names of the rules and in ``truth.json``."""
NEAR_S = 0.5
"""Instants this near to a start or an end count as a transition, and are judged apart."""
SEES_SHARE = 0.3
"""A camera sees a worker or object of which it shows this share of the pixels that there would be if nothing stood
before it."""


class Stretch(NamedTuple):
    """A time in which a violation of the scene lasts, in seconds after the truth's epoch."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class SceneTruth:
    """F instants and K violations of one sequence."""

    name: str
    split: str
    light: str
    t_ns: Ints
    """(F,) rig time of the instants, ascending."""
    epoch_ns: int
    """Rig time of the truth's epoch."""
    stretches: tuple[tuple[Stretch, ...], ...]
    """(K,) when each violation of the scene lasts; in order, apart from each other."""
    hidden: Floats
    """(F,) share of what is hidden, 0..1: the mean over workers and cameras; outside of the image is hidden too."""
    seen_by: Ints
    """(F, K) how many cameras see all who take part in the violation, of several violations the one that most see;
    -1 where there is none."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, t_ns=(None,), seen_by=(len(self.t_ns), len(KINDS)))
        freeze(self, np.float64, hidden=(len(self.t_ns),))

    @property
    def t_s(self) -> Floats:
        """(F,) seconds after the epoch."""
        return np.asarray((self.t_ns - self.epoch_ns) * 1e-9)

    @property
    def period_s(self) -> float:
        """Usual time between instants."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def active(self) -> Bools:
        """(F, K) whether the violation holds."""
        return self._each(lambda t_s, s: (t_s >= s.start_s) & (t_s < s.end_s))

    @property
    def near(self) -> Bools:
        """(F, K) whether the instant is within :data:`NEAR_S` of the violation's start or end.

        What lasts from before the first instant, or to after the last, has no start or end there.
        """
        first_s, last_s = float(self.t_s[0]), float(self.t_s[-1])

        def close(t_s: Floats, s: Stretch) -> Bools:
            borders = [b for b, there in ((s.start_s, s.start_s > first_s), (s.end_s, s.end_s <= last_s)) if there]
            return np.asarray(np.any([np.abs(t_s - b) <= NEAR_S for b in borders] or [t_s < first_s], axis=0))

        return self._each(close)

    def _each(self, test: Callable[[Floats, Stretch], Bools]) -> Bools:
        t_s, result = self.t_s, np.zeros((len(self.t_ns), len(KINDS)), dtype=np.bool_)
        for kind, stretches in enumerate(self.stretches):
            for stretch in stretches:
                result[:, kind] |= test(t_s, stretch)
        return result


def read_scene_truth(folder: Path) -> SceneTruth:
    """Read ``truth.json`` and ``truth.npz`` of a sequence, as tools/sicsg writes them.

    Raises:
        DatasetError: where a file cannot be read or has another form.
    """
    path = folder / "truth.json"
    facts = _facts(path)
    try:
        epoch_ns = round(facts["epoch_s"] * 1e9)
        t_s = np.array(facts["instants_s"], dtype=np.float64)
        violations = [_Violation.of(each) for each in facts["violations"]]
        workers = list(facts["workers"])
        things = [each["id"] for each in facts["objects"]]
        split, light = str(facts["split"]), str(facts["light"])
    except (KeyError, TypeError, ValueError) as error:
        raise _another_form(path, error) from error
    if len(t_s) < 2 or (np.diff(t_s) <= 0).any():
        raise _error(path, "instants_s does not ascend", expected="two times or more", got=f"{len(t_s)} times")
    share = _shares(folder / "truth.npz", len(t_s), len(workers), len(things))
    return SceneTruth(
        name=folder.name,
        split=split,
        light=light,
        t_ns=epoch_ns + np.rint(t_s * 1e9).astype(np.int64),
        epoch_ns=epoch_ns,
        stretches=tuple(_joined(v for v in violations if v.kind == kind) for kind in KINDS),
        hidden=1.0 - share[:, :, : len(workers)].mean(axis=(1, 2)),
        seen_by=_seen_by(t_s, violations, share, {name: n for n, name in enumerate([*workers, *things])}, path),
    )


@dataclass(frozen=True, slots=True)
class Violations:
    """When the violations of a sequence last, which is known without its pixels."""

    epoch_ns: int
    """Rig time of the truth's epoch."""
    stretches: tuple[tuple[Stretch, ...], ...]
    """(K,) as of :class:`SceneTruth`."""


def read_violations(folder: Path) -> Violations:
    """Read ``truth.json`` of a sequence.

    Raises:
        DatasetError: where it cannot be read or has another form.
    """
    path = folder / "truth.json"
    facts = _facts(path)
    try:
        violations = [_Violation.of(each) for each in facts["violations"]]
        return Violations(
            round(facts["epoch_s"] * 1e9), tuple(_joined(v for v in violations if v.kind == kind) for kind in KINDS)
        )
    except (KeyError, TypeError, ValueError) as error:
        raise _another_form(path, error) from error


@dataclass(frozen=True, slots=True)
class _Violation:
    kind: str
    stretch: Stretch
    actors: tuple[str, ...]

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> _Violation:
        stretch = Stretch(float(given["start_s"]), float(given["end_s"]))
        if given["kind"] not in KINDS or not stretch.start_s < stretch.end_s:
            raise ValueError(f"{given['kind']} from {stretch.start_s} to {stretch.end_s} s")
        return cls(given["kind"], stretch, (*given["workers"], *given["things"]))


def _joined(violations: Iterable[_Violation]) -> tuple[Stretch, ...]:
    """The times in which any of them lasts."""
    result: list[Stretch] = []
    for start_s, end_s in sorted(each.stretch for each in violations):
        if result and start_s <= result[-1].end_s:
            result[-1] = Stretch(result[-1].start_s, max(end_s, result[-1].end_s))
        else:
            result.append(Stretch(start_s, end_s))
    return tuple(result)


def _seen_by(
    t_s: Floats, violations: list[_Violation], share: Floats, number: Mapping[str, int], path: Path
) -> NDArray[np.int64]:
    result = np.full((len(t_s), len(KINDS)), -1, dtype=np.int64)
    for each in violations:
        unknown = [name for name in each.actors if name not in number]
        if unknown:
            got = ", ".join(unknown)
            raise _error(path, "a violation names nobody of the scene", expected="workers and objects", got=got)
        during = (t_s >= each.stretch.start_s) & (t_s < each.stretch.end_s)
        cameras = (share[:, :, [number[name] for name in each.actors]] >= SEES_SHARE).all(axis=2).sum(axis=1)
        column = result[:, KINDS.index(each.kind)]
        column[during] = np.maximum(column, cameras)[during]
    return result


def _shares(path: Path, instants: int, workers: int, things: int) -> Floats:
    """(F, V, W + T) share of each worker and object that each camera shows, 0..1."""
    names = [f"{what}_{kind}" for what in ("worker", "object") for kind in ("pixels", "full_pixels")]
    try:
        with np.load(path, allow_pickle=False) as stored:
            worker, worker_full, thing, thing_full = (np.asarray(stored[name], dtype=np.float64) for name in names)
    except (OSError, ValueError, EOFError, TypeError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise _error(path, "cannot read this file", expected=f"arrays {', '.join(names)}", got=repr(error)) from error
    shown, full = np.concatenate([worker, thing], axis=2), np.concatenate([worker_full, thing_full], axis=2)
    if shown.shape != full.shape or (len(shown), shown.shape[2]) != (instants, workers + things):
        expected = f"(F, V, W) and (F, V, T): {instants} instants, {workers} workers, {things} objects"
        raise _error(path, "pixels have another shape", expected=expected, got=f"{shown.shape} and {full.shape}")
    return np.asarray(np.clip(shown / np.maximum(full, 1.0), 0.0, 1.0))


def _facts(path: Path) -> Mapping[str, Any]:
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _error(path, "cannot read this file", expected="JSON", got=error) from error
    form = (facts.get("format"), facts.get("version")) if isinstance(facts, dict) else type(facts).__name__
    if form != ("sicsg.sequence", 1):
        raise _error(path, "the truth has another form", expected="sicsg.sequence, version 1", got=form)
    return dict(facts)


def _another_form(path: Path, error: Exception) -> DatasetError:
    return _error(path, "the truth has another form", expected="sicsg.sequence, version 1", got=repr(error))


def _error(path: Path, what: str, *, expected: str, got: object) -> DatasetError:
    return DatasetError(
        what, where=path, expected=expected, got=got, do_next="render the sequence again: python -m tools.sicsg --help"
    )


def borders(active: Bools) -> list[tuple[int, int]]:
    """First and past-last index of every run of true values (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(np.int8)))
    return list(pairwise(edges.tolist()))[::2]
