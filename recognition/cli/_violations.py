"""``recognition evaluate`` of violations: the paper's evaluation, as tables or one JSON object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import typer

from recognition.cli._app import print_json
from recognition.cli._chosen import detector_of, require_runnable, used_cameras
from recognition.cli._show import progress
from rigcal.errors import OptionsError

SITE_RULES, PAPER_RULES = Path("rig_configs/site.rules.toml"), "paper.rules.toml"
_TITLE, _CELL = "{:<42}", "{:>22}"


class Half(StrEnum):
    """A half of the sequences."""

    validation = "validation"
    test = "test"


def holds_sequences(dataset: Path) -> bool:
    """Whether a folder is one of sequences, and no data set itself."""
    if any((dataset / name).exists() for name in ("data.npz", "truth.npz")):
        return False
    return any(next(dataset.glob(pattern), None) for pattern in ("*/truth.json", "*/*/truth.json"))


def refuse_given(options: Mapping[str, object]) -> None:
    """Refuse options that say nothing about violations of sequences.

    Raises:
        OptionsError: where one is given.
    """
    for name, value in options.items():
        if value is not None:
            raise OptionsError(
                name,
                expected="a data set of tracks; here violations of sequences are judged",
                got=str(value),
                do_next=f"leave {name} out",
            )


def judge_violations(
    dataset: Path, half: Half, rule_file: Path | None, views: str | None, cache: Path, *, as_json: bool
) -> None:
    """Evaluate and tell; a run on the sealed half is written down before anything is told."""
    from recognition.evaluation.violations import (
        LOG,
        SEALED,
        Rules,
        document_of,
        evaluate_violations,
        find_sequences,
        observe,
        require_committed,
        write_down,
    )
    from recognition.rules import load_rules

    ours = rule_file or SITE_RULES
    paper = ours.with_name(PAPER_RULES)
    rules = Rules(load_rules(ours), load_rules(paper))
    code = require_committed((ours, paper)) if half.value == SEALED else None
    folders = find_sequences(dataset, half.value)
    detector = detector_of(None, None, needed=True)
    if detector is None:
        raise ValueError("the bundled networks are needed")
    observed = []
    with progress(len(folders), quiet=as_json) as bar:
        for folder in folders:
            observed.append(observe(folder, half.value, detector, cache))
            require_runnable(folder, observed[-1].rig)
            if bar:
                bar(len(observed))
    rig = observed[0].rig
    use = used_cameras(rig, views)
    found = evaluate_violations(observed, rules, use)
    document = {
        "dataset": str(dataset),
        "split": half.value,
        "views": [camera_id for camera_id, is_used in zip(rig.camera_ids, use, strict=True) if is_used],
        "networks": {network.name: network.sha256 for network in detector.model_info},
        "recordings": {sequence.truth.name: str(sequence.recording) for sequence in observed},
        **document_of(found, rig.camera_ids),
    }
    if code is not None:
        utc = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        write_down(ours.with_name(LOG), code, utc, document)
    if as_json:
        print_json(document)
        return
    for line in _lines(document):
        typer.echo(line)


def _lines(document: Mapping[str, Any]) -> Iterator[str]:
    sequences, kinds = document["sequences"], document["violations"]
    seconds = sum(sequence["seconds"] for sequence in sequences)
    yield f"{document['dataset']}: {len(sequences)} sequences of {document['split']}, {seconds:g} s; {document['unit']}"
    yield from (f"rules     {who}: {own['name']} {own['digest']}" for who, own in document["rules"].items())
    for part, title in (
        ("outside_transitions", f"more than {document['transition_s']:g} s from a start or an end"),
        ("raw", "every instant"),
    ):
        yield ""
        yield _TITLE.format(title) + "".join(_CELL.format(kind) for kind in kinds)
        yield _TITLE.format("") + _CELL.format("accuracy bal. F1") * len(kinds)
        for row in document["rows"]:
            cells = (row[part][kind] for kind in kinds)
            yield _TITLE.format(row["title"]) + "".join(_CELL.format(_figures(cell)) for cell in cells)
    yield from _alarms(document)
    yield from _differences(document)
    yield ""
    yield f"failures of {document['main_row']} outside of transitions: {len(document['failures'])}"
    for failure in document["failures"]:
        span = f"{failure['start_s']:g} to {failure['end_s']:g} s"
        yield f"  {failure['sequence']}  {failure['violation']}  {span}  {failure['kind']}"
    table = document["paper_table"]
    yield ""
    yield _TITLE.format(f"the paper's accuracies ({table['note']})") + "".join(_CELL.format(kind) for kind in kinds)
    for name, accuracies in table["accuracy_percent"].items():
        yield _TITLE.format(name) + "".join(_CELL.format(f"{accuracies[kind]:.1f}") for kind in kinds)


def _alarms(document: Mapping[str, Any]) -> Iterator[str]:
    yield ""
    yield (
        _TITLE.format("violations found, median delay s")
        + _CELL.format("") * len(document["violations"])
        + ("  false alarms an hour of safe work")
    )
    for row in document["rows"]:
        cells = "".join(_CELL.format(_found(row["alarms"][kind])) for kind in document["violations"])
        yield _TITLE.format(row["title"]) + cells + f"  {_text(row['false_alarms_per_hour'], 1)}"
    main = next(row for row in document["rows"] if row["name"] == document["main_row"])
    for kind, own in main["alarms"].items():
        if own["not_excluded_per_hour"] is not None:
            yield (
                f"  {kind}: no false alarm in {own['safe_s']:.0f} s of safe work, which does not exclude "
                f"{own['not_excluded_per_hour']:.0f} an hour (95 %)"
            )


def _differences(document: Mapping[str, Any]) -> Iterator[str]:
    yield ""
    yield "balanced accuracy, mean of the violations: differences in points, 95 % interval paired by sequence"
    for each in document["differences"]:
        own = each["balanced_accuracy_points"]["mean"]
        interval = f"{_text(own['low'], 1)} to {_text(own['high'], 1)}"
        yield f"  {each['row']} - {each['than']}: {_text(own['value'], 1)} ({interval}; {each['sequences']} sequences)"


def _figures(cell: Mapping[str, Any]) -> str:
    shares = (_text(cell[name], 1) for name in ("accuracy_percent", "balanced_accuracy_percent"))
    return " ".join([*shares, _text(cell["f1"], 3)])


def _found(cell: Mapping[str, Any]) -> str:
    return f"{cell['found']}/{cell['violations']} {_text(cell['median_delay_s'], 2)}"


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
