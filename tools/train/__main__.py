"""``python -m tools.train``: fit, export, evaluate; package, thresholds, measure, gap, saving, card."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from tools.train.coco import DataError
from tools.train.facts import FIGURES, MODELS, NETWORKS, PRECISIONS, REAL, stem

if TYPE_CHECKING:
    from tools.train.predict import Networks, SiteAlone

EPOCHS = {"site": 24, "worker": 16}
BATCH = {"site": 8, "worker": 32}
SEQUENCES = Path("out/sicsg/sequences/test")


def _fit(given: argparse.Namespace) -> None:
    from tools.train.fit import FitOptions, fit

    options = FitOptions(
        given.network,
        given.joints,
        given.epochs or EPOCHS[given.network],
        given.batch or BATCH[given.network],
        given.rate,
        seed=given.seed,
    )
    _say(f"trained: {fit(options, given.data, given.out, _say)}")


def _export(given: argparse.Namespace) -> None:
    from tools.train.export import export

    _say(json.dumps(export(given.data, given.out, _say), indent=1))


def _evaluate(given: argparse.Namespace) -> None:
    from tools.train.coco import read_split
    from tools.train.evaluate import decoded, report, run, summary, table
    from tools.train.facts import write_facts

    data = read_split(given.data, given.split)
    results, spent_ms = run(_exported(given), decoded(data), _say)
    figures = report(results, data.categories)
    if given.json is not None:
        write_facts(figures | {"ms_per_picture": spent_ms}, given.json)
    _say(f"{table(figures['all'])}\n\n{summary(figures)}\n{spent_ms:.1f} ms a picture after decoding, one thread")


def _exported(given: argparse.Namespace) -> Networks | SiteAlone:
    from tools.train.package import package
    from tools.train.predict import SiteAlone, load_networks, open_thresholds

    if given.worker is None:
        return SiteAlone(given.site / f"{stem('site', given.precision)}.onnx")
    with TemporaryDirectory() as folder:
        models = Path(folder)
        package({name: getattr(given, name) for name in NETWORKS}, given.data, models)
        return load_networks(models, given.precision, open_thresholds(models, given.precision))


def _package(given: argparse.Namespace) -> None:
    from tools.train.package import package

    written = package({name: getattr(given, name) for name in NETWORKS}, given.data, given.models)
    _say(f"{', '.join(path.name for path in written)} in {given.models}; now choose thresholds")


def _thresholds(given: argparse.Namespace) -> None:
    from tools.train.coco import read_split
    from tools.train.facts import digests, write_facts
    from tools.train.package import write_thresholds
    from tools.train.thresholds import choose

    data = read_split(given.data, "validation")
    figures: dict[str, object] = {"models": digests(given.models)}
    for precision in PRECISIONS:
        chosen, figures[precision] = choose(given.models, precision, data, _say)
        write_thresholds(given.models, precision, chosen)
        _say(f"{precision}: {chosen}")
    write_facts(figures, given.figures / "thresholds.json")


def _measure(given: argparse.Namespace) -> None:
    from tools.train.evaluate import summary, table
    from tools.train.facts import write_facts
    from tools.train.measure import measure

    figures = measure(given.sequences, given.models, _say)
    write_facts(figures, given.figures / "measure.json")
    pictures = figures["int8"]["pictures"]
    _say(f"{table(pictures['all'])}\n\n{summary(pictures)}\n")
    for bar in figures["bars"]:
        sign = ">=" if bar["least"] else "<="
        _say(f"{'met    ' if bar['met'] else 'NOT MET'} {bar['what']}: {bar['value']:.3f} ({sign} {bar['bound']:g})")


def _gap(given: argparse.Namespace) -> None:
    from tools.train.facts import write_facts
    from tools.train.gap import gap

    figures = gap(given.capture, given.models, _say)
    if figures is not None:
        write_facts(figures, given.figures / "gap.json")


def _saving(given: argparse.Namespace) -> None:
    from tools.train.coco import read_split
    from tools.train.facts import write_facts
    from tools.train.saving import saving

    figures = saving(given.all, given.rules, read_split(given.data, "validation"), _say)
    write_facts(figures, given.figures / "saving.json")
    _say(json.dumps(figures, indent=1))


def _card(given: argparse.Namespace) -> None:
    from tools.train.card import write_card

    _say(str(write_card(given.models, given.figures)))


def _say(line: str) -> None:
    print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.train", description="Trains the bundled networks.")
    commands = parser.add_subparsers(dest="command", required=True)
    _add_training(commands)
    _add_shipping(commands)
    return parser


def _add_training(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    fit = commands.add_parser("fit", help="train a network, or go on training it")
    fit.add_argument("--network", choices=NETWORKS, required=True)
    fit.add_argument("--joints", choices=("all", "rules"), default="all", help="of the worker network")
    fit.add_argument("--data", type=Path, required=True, help="folder with coco_train.json and images")
    fit.add_argument("--out", type=Path, required=True, help="folder for checkpoint and log")
    fit.add_argument("--epochs", type=int, help=f"default: {EPOCHS}; may change when a run goes on")
    fit.add_argument("--batch", type=int, help=f"samples per thread; default: {BATCH}")
    fit.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
    fit.add_argument("--seed", type=int, default=0)
    fit.set_defaults(run=_fit)
    export = commands.add_parser("export", help="write a trained network as ONNX, fp32 and int8")
    export.add_argument("--data", type=Path, required=True, help="folder with coco_validation.json and images")
    export.add_argument("--out", type=Path, required=True, help="folder of the checkpoint")
    export.set_defaults(run=_export)
    evaluate = commands.add_parser("evaluate", help="measure exported networks on pictures of the data")
    evaluate.add_argument("--site", type=Path, required=True, help="folder of the exported network")
    evaluate.add_argument("--worker", type=Path, help="without it joints and hats are the site network's")
    evaluate.add_argument("--data", type=Path, required=True, help="folder of the data")
    evaluate.add_argument("--split", default="validation")
    evaluate.add_argument("--precision", choices=PRECISIONS, default="int8")
    evaluate.add_argument("--json", type=Path, help="where to write all figures")
    evaluate.set_defaults(run=_evaluate)


def _add_shipping(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    package = commands.add_parser("package", help="copy exported networks into the package, with manifests")
    for name in NETWORKS:
        package.add_argument(f"--{name}", type=Path, required=True, help="folder of the exported network")
    package.add_argument("--data", type=Path, required=True, help="folder of the data that they were trained on")
    package.set_defaults(run=_package)
    thresholds = commands.add_parser(
        "thresholds", help="choose the packaged networks' thresholds on validation pictures"
    )
    thresholds.add_argument("--data", type=Path, required=True)
    thresholds.set_defaults(run=_thresholds)
    measure = commands.add_parser("measure", help="measure the packaged networks on evaluation sequences")
    measure.add_argument("--sequences", type=Path, default=SEQUENCES, help="folder of sequences' folders")
    measure.set_defaults(run=_measure)
    gap = commands.add_parser("gap", help="measure the packaged networks on videos of real people")
    gap.add_argument("--capture", type=Path, default=REAL)
    gap.set_defaults(run=_gap)
    saving = commands.add_parser("saving", help="compare worker networks of all joints and of those of rules")
    saving.add_argument("--all", type=Path, required=True, help="folder of the export")
    saving.add_argument("--rules", type=Path, required=True, help="folder of the export")
    saving.add_argument("--data", type=Path, required=True)
    saving.set_defaults(run=_saving)
    card = commands.add_parser("card", help="write the model card from all figures")
    card.set_defaults(run=_card)
    for command in (package, thresholds, measure, gap, card):
        command.add_argument("--models", type=Path, default=MODELS, help="folder of the packaged networks")
    for command in (thresholds, measure, gap, saving, card):
        command.add_argument("--figures", type=Path, default=FIGURES, help="folder of the figures")


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 0 where it did what was asked."""
    given = _parser().parse_args(arguments)
    try:
        given.run(given)
    except DataError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
