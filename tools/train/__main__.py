"""``python -m tools.train``: fit, export, evaluate."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from tools.train.coco import DataError

EPOCHS = {"site": 24, "worker": 16}
BATCH = {"site": 8, "worker": 32}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.train", description="Trains the bundled networks.")
    commands = parser.add_subparsers(dest="command", required=True)
    fit = commands.add_parser("fit", help="train a network, or go on training it")
    fit.add_argument("--network", choices=("site", "worker"), required=True)
    fit.add_argument("--joints", choices=("all", "rules"), default="all", help="of the worker network")
    fit.add_argument("--data", type=Path, required=True, help="folder with coco_train.json and images")
    fit.add_argument("--out", type=Path, required=True, help="folder for checkpoint and log")
    fit.add_argument("--epochs", type=int, help=f"default: {EPOCHS}; may change when a run goes on")
    fit.add_argument("--batch", type=int, help=f"samples per thread; default: {BATCH}")
    fit.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
    fit.add_argument("--seed", type=int, default=0)
    export = commands.add_parser("export", help="write a trained network as ONNX, fp32 and int8")
    export.add_argument("--data", type=Path, required=True, help="folder with coco_validation.json and images")
    export.add_argument("--out", type=Path, required=True, help="folder of the checkpoint")
    evaluate = commands.add_parser("evaluate", help="measure exported networks on validation pictures")
    evaluate.add_argument("--site", type=Path, required=True, help="ONNX file")
    evaluate.add_argument("--worker", type=Path, help="ONNX file; without it joints and hats are the site network's")
    evaluate.add_argument("--data", type=Path, required=True)
    evaluate.add_argument("--split", default="validation")
    evaluate.add_argument("--json", type=Path, help="where to write all figures")
    return parser


def _evaluate(given: argparse.Namespace) -> None:
    from tools.train.coco import read_split
    from tools.train.evaluate import report, run, summary, table
    from tools.train.predict import Networks

    data = read_split(given.data, given.split)
    results, spent_ms = run(Networks(given.site, given.worker), data, _say)
    figures = report(results, data)
    if given.json is not None:
        given.json.write_text(json.dumps(figures | {"ms_per_picture": spent_ms}, indent=1) + "\n", encoding="utf-8")
    _say(f"{table(figures['all'])}\n\n{summary(figures)}\n{spent_ms:.1f} ms a picture after decoding, one thread")


def _say(line: str) -> None:
    print(line, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 0 where it did what was asked."""
    given = _parser().parse_args(arguments)
    try:
        if given.command == "fit":
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
        elif given.command == "export":
            from tools.train.export import export

            _say(json.dumps(export(given.data, given.out, _say), indent=1))
        else:
            _evaluate(given)
    except DataError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
