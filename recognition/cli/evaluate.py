"""``recognition evaluate``: how near the tracks are to a known truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recognition.cli._app import InterpolateOption, JsonOption, ViewsOption, app, print_json
from recognition.cli._chosen import (
    DEFAULT_FPS,
    AssociationMethod,
    declared_fps,
    detector_of,
    require_runnable,
    used_cameras,
)
from recognition.cli._show import progress
from recognition.cli._violations import Half, holds_sequences, judge_violations, refuse_given

if TYPE_CHECKING:
    from recognition.evaluation import Evaluation
    from recognition.metrics import PersonScore, Scores

_ROW = "{:>8}{:>10}{:>9}{:>10}{:>9}{:>10}"


@app.command()
def evaluate(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of detections or videos, and the truth.")],
    rig: Annotated[Path | None, typer.Option(metavar="RIG", help="Rig file, instead of the one in the folder.")] = None,
    detections: Annotated[
        Path | None, typer.Option(metavar="FILE.npz", help="2D detections, instead of data.npz in the folder.")
    ] = None,
    views: ViewsOption = None,
    association: Annotated[
        AssociationMethod,
        typer.Option(help="Whether tracks claim detections first, or views are matched as the paper does."),
    ] = AssociationMethod.tracked,
    interpolate: InterpolateOption = False,
    split: Annotated[
        Half | None, typer.Option(help="Half of a data set of sequences whose violations are judged [validation].")
    ] = None,
    rules: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Rules to judge violations by; paper.rules.toml lies beside [site's]."),
    ] = None,
    cache: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where what the networks saw in sequences is kept.")
    ] = Path(".cache/evaluation"),
    as_json: JsonOption = False,
) -> None:
    """Track the workers of a data set, and score them against its truth: PCP3D, MPJPE, recall, switches, IDF1.

    DATASET holds a rig file, NAME.rig.json; data.npz with 2D detections (as for run --detections) and the truth;
    and dataset.json where it is needed:

    \b
    data.npz      gt_frame (G,)         integers, counted as det_frame is
                  gt_person (G,)        integers: which worker
                  gt_joints (G, J, 3)   metres, NaN: not known; in the world of the
                                        rig file, or its rig frame without one
    dataset.json  gt_joints             names of the J joints; COCO-17's of them
                                        are scored (not needed for these 17)
                  gt_actors_scored      of whom PCP3D is the mean (all)
                  frames.evaluation     [[first, last], ...] that count (all)

    Without detections the networks that come with the package look at the videos in the folder. Or DATASET is a
    sequence of the generator: videos, truth.json and truth.npz.

    Exit code 0: done; 2: bad input, no truth, or a rig file that must not be run.

    With --split or --rules, or where DATASET is a folder of sequences, violations are judged instead: by one, two and
    all views, by the single-view baseline and by the paper's method. On --split test only by rule files that are
    committed, and every run is appended to evaluations.jsonl beside them.
    """
    from recognition.evaluation import evaluate_people, open_dataset
    from recognition.feeds import FeedOptions, open_feed
    from recognition.placing import Placer, PlacingOptions
    from rigcal.rigfile import read_rigfile, rig_of

    if split is not None or rules is not None or holds_sequences(dataset):
        method = None if association is AssociationMethod.tracked else association.value  # rows are of both
        refuse_given(
            {"--rig": rig, "--detections": detections, "--association": method, "--interpolate": interpolate or None}
        )
        judge_violations(dataset, split or Half.validation, rules, views, cache, as_json=as_json)
        return
    opened = open_dataset(dataset, rig=rig, detections=detections)
    document = read_rigfile(opened.rig)
    loaded = rig_of(document)
    require_runnable(opened.rig, loaded)
    use = used_cameras(loaded, views)
    rate = declared_fps(document, None) or DEFAULT_FPS
    detector = detector_of(None, None, needed=opened.detections is None)
    feed = open_feed(loaded, opened.capture, opened.detections, detector, FeedOptions(use, rate, interpolate))
    placer = Placer(loaded, PlacingOptions(method=association.value))
    with progress(feed.total, quiet=as_json) as bar:
        found = evaluate_people(
            feed.instants,
            placer.place,
            opened.truth,
            world_from_rig=loaded.world_from_rig,
            scored=opened.scored,
            progress=bar,
        )
    used = [camera_id for camera_id, wanted in zip(loaded.camera_ids, use, strict=True) if wanted]
    setting = {"dataset": str(dataset), "rig": str(opened.rig), "association": association.value, "views": used}
    warnings = (*feed.warnings, *opened.warnings, *found.warnings)
    if as_json:
        print_json({**setting, "warnings": list(warnings), **_document(found)})
        return
    typer.echo(f"{dataset}: association {association.value}, views {','.join(used)}, rig {opened.rig}")
    for warning in warnings:
        typer.echo(f"warning: {warning}")
    for line in _table(found):
        typer.echo(line)


def _document(found: Evaluation) -> dict[str, Any]:
    from recognition.metrics import PROTOCOL

    scores = found.scores
    return {
        "instants": found.instants,
        "scenes": found.scenes,
        "truth_instants": found.truth_instants,
        "pcp3d_percent": _percent(scores.pcp3d),
        "pcp3d_parts_percent": {name: _percent(share) for name, share in scores.pcp3d_parts.items()},
        "mpjpe_mm": _known(1e3 * scores.mpjpe_m),
        "recall_percent": _percent(scores.recall),
        "joints_found_percent": _percent(scores.joints_found),
        "precision_percent": _percent(scores.precision),
        "switches": scores.switches,
        "switches_per_worker_minute": _known(scores.switches_per_worker_minute),
        "idf1_percent": _percent(scores.idf1),
        "mota_percent": _percent(scores.mota),
        "protocol": dict(PROTOCOL),
        "workers": [
            {
                "worker": person.person,
                "instants": person.instants,
                "pcp3d_percent": _percent(person.pcp3d),
                "recall_percent": _percent(person.recall),
                "mpjpe_mm": _known(1e3 * person.mpjpe_m),
                "switches": person.switches,
            }
            for person in scores.people
        ],
    }


def _table(found: Evaluation) -> list[str]:
    from recognition.metrics import PROTOCOL

    scores = found.scores
    total = sum(person.instants for person in scores.people)
    return [
        f"{found.instants} instants, {found.scenes} of them in 3D; the truth knows {found.truth_instants}",
        _ROW.format("worker", "instants", "PCP3D %", "recall %", "MPJPE mm", "switches"),
        *(_row(str(person.person), person.instants, person) for person in scores.people),
        _row("all", total, scores),
        "parts     " + ", ".join(f"{name} {_text(_percent(share))} %" for name, share in scores.pcp3d_parts.items()),
        f"joints    {_text(_percent(scores.joints_found))} % within 15 cm",
        f"precision {_text(_percent(scores.precision))} %, IDF1 {_text(_percent(scores.idf1))} %, "
        f"MOTA {_text(_percent(scores.mota))} %",
        f"switches  {_text(_known(scores.switches_per_worker_minute), 2)} per worker and minute",
        *(f"{name}: {what}" for name, what in PROTOCOL.items()),
    ]


def _row(name: str, instants: int, scores: PersonScore | Scores) -> str:
    shares = (_text(_percent(share)) for share in (scores.pcp3d, scores.recall))
    return _ROW.format(name, instants, *shares, _text(_known(1e3 * scores.mpjpe_m)), scores.switches)


def _known(value: float) -> float | None:
    """What JSON can hold."""
    return value if math.isfinite(value) else None


def _percent(share: float) -> float | None:
    return _known(100 * share)


def _text(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
