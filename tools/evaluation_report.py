"""The evaluation of violations as a page that works offline, with a clip of every failure beside it.

    recognition evaluate out/sicsg/sequences --split validation --json > out/evaluation.json
    python -m tools.evaluation_report out/evaluation.json -o out/evaluation --study out/study

Clips are made of the recordings that the evaluation names, with heads blurred; they lie in the page's folder and
nowhere else. With ``--study`` the page holds the curves of :mod:`tools.study`, and what they say.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, FileSystemLoader
from markupsafe import Markup

from recognition.evaluation.violations import SEES_NOTE, Failure, write_clips
from recognition.sources.recording import open_recording
from rigcal.report.templates import page_environment

BALANCED_PERCENT, F1, FALSE_PER_HOUR = 95.0, 0.93, 1.0
"""What each violation must reach outside of transitions with all views, and how many false alarms there may be."""
ORDERED = (("all_views", "two_views"), ("two_views", "baseline"), ("all_views", "paper_all_views"))
"""Rows of which the first must be better, with an interval that excludes 0."""
WORDS = {
    "no_hat": "no hard hat",
    "ladder": "ladder that nobody holds",
    "window": "large window carried alone",
    "platform": "two on a platform",
}


@dataclass(frozen=True, slots=True)
class Bar:
    """Something that the method must reach."""

    what: str
    got: str
    holds: bool


@dataclass(frozen=True, slots=True)
class Lane:
    """A violation in the timeline of a sequence, in percent of its length."""

    words: str
    true: tuple[tuple[float, float], ...]
    """Start and width of what is true."""
    decided: tuple[tuple[float, float], ...]
    """Start and width of what was decided."""


def bars_of(document: Mapping[str, Any]) -> tuple[Bar, ...]:
    """What must be reached, and what was; what could not be measured was not reached."""
    main = main_row(document)
    found = []
    for kind in document["violations"]:
        figures = main["outside_transitions"][kind]
        balanced, f1 = figures["balanced_accuracy_percent"], figures["f1"]
        found.append(_at_least(f"balanced accuracy, {WORDS[kind]}", balanced, BALANCED_PERCENT, " %"))
        found.append(_at_least(f"F1, {WORDS[kind]}", f1, F1, ""))
    rate = main["false_alarms_per_hour"]
    safe_s = min(own["safe_s"] for own in main["alarms"].values())
    said = "-" if rate is None else f"{rate:.1f}, in {safe_s:.0f} s of it"
    what = f"false alarms per hour of safe work, at most {FALSE_PER_HOUR:g}"
    found.append(Bar(what, said, rate is not None and rate <= FALSE_PER_HOUR))
    for first, second in ORDERED:
        each = next((d for d in document["differences"] if (d["row"], d["than"]) == (first, second)), None)
        own = each["balanced_accuracy_points"]["mean"] if each else {"value": None, "low": None, "high": None}
        title = f"{_title(document, first)} better than {_title(document, second)}, points of balanced accuracy"
        found.append(Bar(title, interval(own), own["low"] is not None and own["low"] > 0))
    return tuple(found)


def main_row(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The row whose failures are told."""
    return next(row for row in document["rows"] if row["name"] == document["main_row"])


def interval(difference: Mapping[str, float | None]) -> str:
    """A difference with its 95 % interval, in words."""
    value, low, high = (difference[name] for name in ("value", "low", "high"))
    if value is None:
        return "-"
    return f"{value:+.1f}" + ("" if low is None or high is None else f" ({low:+.1f} to {high:+.1f})")


def lanes_of(sequence: Mapping[str, Any]) -> tuple[Lane, ...]:
    """The timeline of a sequence; violations that neither were nor were decided are left out."""
    whole = sequence["seconds"]

    def part(spans: Sequence[Sequence[float]]) -> tuple[tuple[float, float], ...]:
        return tuple((100 * start / whole, 100 * (min(end, whole) - start) / whole) for start, end in spans)

    lanes = [Lane(WORDS[k], part(sequence["true_s"][k]), part(sequence["decided_s"][k])) for k in sequence["true_s"]]
    return tuple(lane for lane in lanes if lane.true or lane.decided)


@dataclass(frozen=True, slots=True)
class StudyPart:
    """What the page says of injected errors."""

    curves: Markup
    """SVG."""
    said: str
    """The study's report."""


def read_study(folder: Path) -> StudyPart:
    """Read what ``python -m tools.study report`` wrote."""
    curves, said = ((folder / name).read_text(encoding="utf-8") for name in ("study.svg", "study.txt"))
    return StudyPart(Markup(curves), said)


def write_page(
    document: Mapping[str, Any], clips: Sequence[str], path: Path, *, study: StudyPart | None = None
) -> None:
    """Write the page.

    Args:
        document: What ``recognition evaluate --json`` printed.
        clips: Name of the clip of each failure, relative to the page; empty where there are none.
        path: Where to.
        study: What injected errors cost; the page has no such part without it.
    """
    environment = page_environment()
    environment.loader = ChoiceLoader(
        [FileSystemLoader(Path(__file__).parent), environment.loader or FileSystemLoader([])]
    )
    bars = bars_of(document)
    page = environment.get_template("evaluation_report.html.j2").render(
        document=document,
        main=main_row(document),
        titles={row["name"]: row["title"] for row in document["rows"]},
        words=WORDS,
        bars=bars,
        kept=sum(bar.holds for bar in bars),
        seconds=sum(sequence["seconds"] for sequence in document["sequences"]),
        lanes=[(sequence, lanes_of(sequence)) for sequence in document["sequences"]],
        failures=[(f, clips[n] if clips else None) for n, f in enumerate(document["failures"])],
        interval=interval,
        sees_note=SEES_NOTE,
        study=study,
        figure=lambda value, digits=1: "-" if value is None else f"{value:.{digits}f}",
    )
    path.write_text(page, encoding="utf-8")


def make_clips(document: Mapping[str, Any], folder: Path) -> tuple[str, ...]:
    """Clips of all failures, in an emptied folder ``clips`` of the page's; their names relative to the page."""
    shutil.rmtree(folder / "clips", ignore_errors=True)
    failures = [Failure(**failure) for failure in document["failures"]]
    if not failures:
        return ()
    recordings = {name: Path(path) for name, path in document["recordings"].items()}
    ids = open_recording(recordings[failures[0].sequence]).rig.camera_ids
    use = [camera_id in document["views"] for camera_id in ids]
    paths = write_clips(failures, recordings.__getitem__, use, folder / "clips")
    return tuple(str(path.relative_to(folder)) for path in paths)


def _at_least(what: str, value: float | None, limit: float, unit: str) -> Bar:
    said = "-" if value is None else f"{value:.3g}{unit}"
    return Bar(f"{what}, at least {limit:g}{unit}", said, value is not None and value >= limit)


def _title(document: Mapping[str, Any], name: str) -> str:
    return next((row["title"] for row in document["rows"] if row["name"] == name), name)


def main() -> None:
    """Read the evaluation, write the page, its figures and its clips."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("evaluation", type=Path, help="what `recognition evaluate --json` printed")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the page")
    parser.add_argument("--study", type=Path, help="folder of the study of errors, once its report is written")
    parser.add_argument("--no-clips", action="store_true", help="leave the clips out")
    asked = parser.parse_args()
    text = asked.evaluation.read_text(encoding="utf-8")
    document = json.loads(text)
    asked.output.mkdir(parents=True, exist_ok=True)
    clips = () if asked.no_clips else make_clips(document, asked.output)
    study = read_study(asked.study) if asked.study else None
    write_page(document, clips, asked.output / "index.html", study=study)
    (asked.output / "evaluation.json").write_text(text, encoding="utf-8")
    print(f"page      {asked.output / 'index.html'} ({len(clips)} clips)")


if __name__ == "__main__":
    main()
