"""The study's commands; see :mod:`tools.study`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from pathlib import Path

import numpy as np

from recognition.detectors import load_bundled
from recognition.evaluation.violations import KINDS, find_sequences, observe
from recognition.rules import RuleSet, load_rules
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import read_scene
from tools.sicsg.sequences import SCENES, name_of
from tools.study.compress import AXIS, COMPRESSION, NETWORKS, compressed, kbit_per_s, tally_compressed
from tools.study.errors import measured_errors
from tools.study.faults import AXES, misplaced, scene_error_m
from tools.study.figures import (
    Curve,
    Line,
    Study,
    curves_of,
    key_of,
    key_to_be,
    line_of,
    method_digest,
    newest,
    read_lines,
)
from tools.study.gates import gate_sentences
from tools.study.measured import MeasuredDetector
from tools.study.plot import RATE, study_plot
from tools.study.safe import SAFE, false_alarms_of, make_safe, told
from tools.study.trial import Tally, Trial, decided, fault_rng, tally
from tools.study.unrendered import write_unrendered
from tools.study.world import World, read_world

ALL = {**AXES, AXIS: COMPRESSION}
_CALIBRATION = ("position", "orbit", "rotation")
_WHOLE = ("joints", 17.0)
"""Axis and level without error; all axes begin there."""


def trials(seeds: int) -> Iterator[Trial]:
    """All that is tried; a whole seed before the next, so that a study that is stopped has curves."""
    for seed in range(seeds):
        for axis, about in AXES.items():
            for detector in about.detectors:
                yield from (Trial(axis, float(level), detector, seed) for level in about.levels)


class Bench:
    """What the commands share.

    Args:
        sequences: Folder of the rendered sequences of the validation half.
        rules: What is judged.
        out: Folder of results.
    """

    def __init__(self, sequences: Path, rules: RuleSet, out: Path) -> None:
        self.rules, self.out, self.study = rules, out, Study(rules.digest, method_digest())
        self.rendered = find_sequences(sequences, "validation")
        self.cache = out / "cache"
        """Where what the networks saw is kept."""
        out.mkdir(parents=True, exist_ok=True)

    @cached_property
    def worlds(self) -> tuple[World, ...]:
        """Of the rendered sequences, and of those that :func:`complete` made."""
        folders = {folder.name: folder for folder in self.rendered}
        folders |= {truth.parent.name: truth.parent for truth in (self.out / "unrendered").glob("*/truth.json")}
        return tuple(read_world(folders[name]) for name in sorted(folders))

    @cached_property
    def measured(self) -> MeasuredDetector:
        """A detector with the errors that the bundled networks have on the rendered sequences."""
        networks, worlds = load_bundled(), {world.truth.name: world for world in self.worlds}
        seen = [(worlds[own.name], observe(own, "validation", networks, self.cache)) for own in self.rendered]
        return MeasuredDetector(measured_errors(seen))

    def add(
        self, name: str, tried: Iterable[tuple[Trial, str, Callable[[], tuple[Tally, Mapping[str, float]]]]]
    ) -> None:
        """Write the lines that a file lacks: of a trial on a sequence, by what works them out."""
        path = self.out / name
        done = {key_of(line) for line in read_lines(path)}
        with path.open("a", encoding="utf-8") as file:
            last: tuple[object, ...] = ()
            for trial, sequence, work in tried:
                if key_to_be(self.study, trial, sequence) in done:
                    continue
                file.write(json.dumps(line_of(self.study, trial, sequence, *work())) + "\n")
                file.flush()
                if last != (trial.seed, trial.axis, trial.detector):
                    last = (trial.seed, trial.axis, trial.detector)
                    print(f"seed {trial.seed}  {trial.axis}, {trial.detector}", flush=True)


@dataclass(slots=True)
class _Runner:
    """Trials on worlds; what has no error is worked out once for all axes."""

    bench: Bench
    kept: dict[tuple[Trial, str], Tally]

    def work(self, trial: Trial, world: World) -> tuple[Tally, Mapping[str, float]]:
        """A trial's tally, and by how much the scene is misplaced."""
        same = _plainest(trial)
        key = same, world.truth.name
        found = self.kept.get(key)
        if found is None:
            found = tally(world.truth, decided(world, same, self.bench.measured, self.bench.rules))
            if same != trial or same.level == AXES[same.axis].levels[0]:
                self.kept[key] = found
        if trial.axis not in _CALIBRATION:
            return found, {}
        rig = misplaced(trial.axis, trial.level, world, fault_rng(world, trial))
        return found, {"scene_mm": round(1e3 * scene_error_m(rig, world), 3)}


def _plainest(trial: Trial) -> Trial:
    """The trial that is the same: without error on any axis, and of what is exact with any seed."""
    axis, level = (trial.axis, trial.level) if trial.level != AXES[trial.axis].levels[0] else _WHOLE
    has_luck = trial.detector == "measured" or axis != "joints"
    return Trial(axis, level, trial.detector, trial.seed if has_luck else 0)


def complete(bench: Bench) -> None:
    """Make the committed scenes of the half that nobody rendered, without pictures."""
    names = {folder.name for folder in bench.rendered}
    missing = [path for path in sorted((SCENES / "validation").glob("*.scene.json")) if name_of(path) not in names]
    with GlRenderer() as passes:
        for path in missing:
            write_unrendered(read_scene(path), bench.out / "unrendered" / name_of(path), passes)
            print(f"{name_of(path)} without pictures", flush=True)


def run(bench: Bench, seeds: int) -> None:
    """Inject errors."""
    runner = _Runner(bench, {})
    bench.add(
        "study.jsonl",
        (
            (trial, world.truth.name, partial(runner.work, trial, world))
            for trial, world in product(trials(seeds), bench.worlds)
        ),
    )


def compress(bench: Bench) -> None:
    """Let the networks look at every quality."""
    networks = load_bundled()

    def work(folder: Path, crf: float) -> tuple[Tally, Mapping[str, float]]:
        made = compressed(folder, crf, bench.out / "h264")
        return tally_compressed(made, networks, bench.rules, bench.cache), {RATE: kbit_per_s(made)}

    bench.add(
        "compression.jsonl",
        (
            (Trial(AXIS, crf, NETWORKS, 0), folder.name, partial(work, folder, crf))
            for crf, folder in product(COMPRESSION.levels, bench.rendered)
        ),
    )


def safe(bench: Bench, seeds: int, minutes: float) -> None:
    """Look for false alarms in safe work."""
    worlds = [read_world(folder, at_instants=True) for folder in make_safe(bench.out / "safe", minutes)]

    def work(trial: Trial, world: World) -> tuple[Tally, Mapping[str, float]]:
        return tally(world.truth, decided(world, trial, bench.measured, bench.rules)), {}

    bench.add(
        "safe.jsonl",
        (
            (trial, world.truth.name, partial(work, trial, world))
            for seed, world in product(range(seeds), worlds)
            for trial in (Trial(SAFE, 17.0, "seen", 0), Trial(SAFE, 17.0, "measured", seed))
            if seed == 0 or trial.detector == "measured"
        ),
    )


def report(out: Path) -> None:
    """Draw the curves of the newest study, and write down and print what they say."""
    lines = newest(read_lines(out / "study.jsonl")) + newest(read_lines(out / "compression.jsonl"))
    if not lines:
        raise SystemExit(f"{out}: no study.jsonl; run the study first: python -m tools.study run --help")
    curves = sorted(curves_of(lines), key=lambda curve: (list(ALL).index(curve.axis), curve.detector != "open"))
    (out / "study.svg").write_text(study_plot(curves, ALL), encoding="utf-8")
    text = "\n".join(_report(lines, curves, newest(read_lines(out / "safe.jsonl"))))
    (out / "study.txt").write_text(text + "\n", encoding="utf-8")
    print(text)


def _report(lines: list[Line], curves: list[Curve], safe_lines: list[Line]) -> Iterator[str]:
    yield f"rules {lines[0]['rules']}, method {lines[0]['method']}; curves in study.svg"
    for curve in curves:
        yield from _table(curve)
    yield "\nGates of rigcal:"
    yield from (f"  {sentence}" for sentence in gate_sentences(curves, ALL))
    yield "\nFalse alarms in simulated safe work:"
    yield from (f"  {told(found)}" for found in false_alarms_of(safe_lines))


def _table(curve: Curve) -> Iterator[str]:
    axis = ALL[curve.axis]
    last, first = curve.bearable
    said = f"none of these costs 2 points, up to {last:g}" if first == float("inf") else f"from {first:g} on 2 points"
    yield f"\n{axis.title} ({axis.unit or 'count'}), {curve.detector}, {curve.trials} trials a level: {said}"
    behind = ", ".join(f"{kind} {own[0]} + {own[1]}" for kind, own in zip(KINDS, curve.decisions.tolist(), strict=True))
    yield f"  decisions behind each point, of violations and of none: {behind}"
    more = "".join(f"{name:>12}" for name in curve.about)
    unknown = " ".join(f"{kind[:6]:>6}" for kind in KINDS)
    yield (
        "  level     "
        + "".join(f"{k:>10}" for k in KINDS)
        + f"      mean   cost (95 %)           unknown % {unknown}{more}"
    )
    for number, level in enumerate(curve.levels):
        each = "".join(f"{100 * share:10.1f}" for share in curve.accuracy[number])
        value, low, high = 100 * curve.cost[number]
        interval = f"{value:+5.1f} ({low:+5.1f} to {high:+5.1f})"
        unknown = " ".join(f"{100 * share:6.1f}" for share in curve.unknown[number])
        about = "".join(
            f"{own[number]:12.1f}" if np.isfinite(own[number]) else " " * 12 for own in curve.about.values()
        )
        yield f"  {level:<10g}{each}{100 * curve.mean[number]:10.1f}   {interval}            {unknown}{about}"


def main() -> None:
    """One command of the study."""
    parser = argparse.ArgumentParser(prog="python -m tools.study", description="accuracy against injected errors")
    commands = parser.add_subparsers(dest="command", required=True)
    texts = {
        "all": "complete, run, compress, safe and report",
        "complete": "make what the study asks of the half's scenes that nobody rendered",
        "run": "try every error that was not tried yet",
        "compress": "the same of compressed pictures, by the networks",
        "safe": "count false alarms in simulated safe work",
    }
    for name, text in texts.items():
        command = commands.add_parser(name, help=text)
        command.add_argument("sequences", type=Path, help="folder of sequences of the validation half")
        command.add_argument("--rules", type=Path, default=Path("rig_configs/site.rules.toml"))
        command.add_argument("--seeds", type=int, default=5)
        command.add_argument("--safe-minutes", type=float, default=6.0, help="of different safe work")
        command.add_argument("--out", type=Path, default=Path("out/study"))
    drawn = commands.add_parser("report", help="draw the curves and say what they mean")
    drawn.add_argument("--out", type=Path, default=Path("out/study"))
    asked = parser.parse_args()
    if asked.command != "report":
        bench = Bench(asked.sequences, load_rules(asked.rules), asked.out)
        if asked.command in ("all", "complete"):
            complete(bench)
        if asked.command in ("all", "run"):
            run(bench, asked.seeds)
        if asked.command in ("all", "compress"):
            compress(bench)
        if asked.command in ("all", "safe"):
            safe(bench, asked.seeds, asked.safe_minutes)
    if asked.command in ("all", "report"):
        report(asked.out)


if __name__ == "__main__":
    main()
