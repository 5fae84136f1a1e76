"""What the packaged networks find on evaluation sequences: boxes, joints, joints in the world; fp32 and int8; bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from recognition.detectors import load_bundled
from recognition.detectors.bundled.manifests import HARD_HAT
from tools.sicsg.catalog import CATEGORIES
from tools.train.coco import DataError
from tools.train.evaluate import asked_in, mean_of, report, run
from tools.train.facts import PRECISIONS, digests
from tools.train.joints3d import Distances, distances, joint_facts, run_pipeline
from tools.train.predict import classes_of, load_networks, open_thresholds
from tools.train.sequences import SITE_CATEGORIES, EvaluationSequence, find_sequences, pictures, read_sequence


@dataclass(frozen=True, slots=True)
class Bar:
    """A figure that the networks were asked to reach."""

    what: str
    value: float
    bound: float
    least: bool
    """Whether the bound is the least that will do, not the most."""

    @property
    def met(self) -> bool:
        """Whether it is reached; not where there is no figure."""
        return self.value >= self.bound if self.least else self.value <= self.bound


def measure(folder: Path, models: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """All figures of the packaged networks on the sequences of a folder.

    Raises:
        DataError: where there are no sequences or networks, or the networks know other classes.
    """
    files = digests(models)
    expected = tuple(category.name for category in SITE_CATEGORIES)
    for precision in PRECISIONS:
        if classes_of(models, precision) != expected:
            raise DataError(
                "the networks know other classes than the catalogue", where=models, expected=", ".join(expected),
                got=", ".join(classes_of(models, precision)), do_next="Train with data of this catalogue.",
            )  # fmt: skip
    sequences = [read_sequence(path) for path in find_sequences(folder)]
    figures = {precision: _figures(sequences, models, precision, say) for precision in PRECISIONS}
    return {
        "models": files,
        "split": ", ".join(sorted({str(sequence.facts["split"]) for sequence in sequences})),
        "sequences": [sequence.folder.name for sequence in sequences],
        **figures,
        "bars": [
            {"what": bar.what, "value": bar.value, "bound": bar.bound, "least": bar.least, "met": bar.met}
            for bar in bars(figures["int8"], figures["fp32"])
        ],
    }


def _figures(
    sequences: Sequence[EvaluationSequence], models: Path, precision: str, say: Callable[[str], None]
) -> dict[str, Any]:
    say(f"{precision}: boxes and joints in the pictures of {len(sequences)} sequences")
    networks = load_networks(models, precision, open_thresholds(models, precision))
    frames = chain.from_iterable(pictures(sequence) for sequence in sequences)
    results, _ = run(networks, frames, say)
    say(f"{precision}: joints in the world")
    detector = load_bundled("int8" if precision == "int8" else "fp32", folder=models)
    parts = [distances(sequence, run_pipeline(sequence, detector)) for sequence in sequences]
    return {
        "pictures": report(results, SITE_CATEGORIES),
        "world": {name: joint_facts(chosen) for name, chosen in _groups(sequences, parts)},
    }


def _groups(
    sequences: Sequence[EvaluationSequence], parts: Sequence[Distances]
) -> Iterator[tuple[str, list[Distances]]]:
    yield "all", list(parts)
    for field in ("light", "renderer"):
        for value in sorted({getattr(sequence, field) for sequence in sequences}):
            chosen = [p for s, p in zip(sequences, parts, strict=True) if getattr(s, field) == value]
            yield f"{field} {value}", chosen


def bars(small: dict[str, Any], plain: dict[str, Any]) -> Iterator[Bar]:
    """What was asked of the networks as they are shipped, in int8.

    Args:
        small: figures of int8.
        plain: figures of fp32.
    """
    whole, world = small["pictures"]["all"], small["world"]["all"]
    classes = whole["classes"]
    yield Bar("AP50 of person", classes["person"]["ap50"], 0.85, True)
    for category in CATEGORIES:
        row = classes[category.name]
        if category.name == HARD_HAT:
            yield Bar("AP50 of hard_hat, 12 px and wider", row["ap50 >=12"], 0.85, True)
            yield Bar("AP50 of hard_hat, 8 to 12 px wide", row["ap50 8-12"], 0.60, True)
        else:
            yield Bar(f"AP50 of {category.name}", row["ap50"], 0.85 if category.critical else 0.60, True)
    yield Bar("OKS-AP50", whole["oks_ap50"], 0.85, True)
    yield Bar("joints from four views, median in mm", world.get("median_mm", float("nan")), 60.0, False)
    yield Bar("joints from four views, 90 % in mm", world.get("p90_mm", float("nan")), 150.0, False)
    yield from _less("fp32", plain["pictures"]["all"], "int8", whole, 0.02)
    lights = [small["pictures"].get(f"light {kind}") for kind in ("indoor", "overexposed")]
    if all(lights):
        yield from _less("indoor", lights[0], "over-exposed", lights[1], 0.08)


def _less(name: str, figures: dict[str, Any], other: str, others: dict[str, Any], bound: float) -> Iterator[Bar]:
    """How much worse one group is than another, in the classes that both have."""
    names = asked_in(figures, others)
    for key, title in (("ap50", "mean AP50"), ("ap", "mean AP")):
        yield Bar(
            f"{name} less {other}, {title}", mean_of(figures, names, key) - mean_of(others, names, key), bound, False
        )
    yield Bar(f"{name} less {other}, OKS-AP50", figures["oks_ap50"] - others["oks_ap50"], bound, False)
