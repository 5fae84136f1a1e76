"""The model card, written from the manifests and from figures that other commands measured; none is typed by hand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from recognition.detectors.bundled.geometry import SITE_WH, WORKER_WH
from tools.train.coco import DataError
from tools.train.facts import NETWORKS, PRECISIONS, digests, read_facts, stem
from tools.train.package import read_toml

NAME = "MODEL_CARD.md"
PARTS = ("thresholds", "measure", "gap", "saving")
"""Files of figures, each written by the command of its name."""

_INTRODUCTION = f"""\
# The bundled networks

Two small networks that come with the package, so that it can be tried without any other: workers with 17 joints, and
the objects that its rules are about.

- `site` looks at the whole image, shrunk to {SITE_WH[0]} x {SITE_WH[1]} pixels: people with coarse joints, objects with
  up to four keypoints.
- `worker` looks at each person that `site` finds, in a crop of {WORKER_WH[0]} x {WORKER_WH[1]} pixels from the full
  image: joints, and hard hats, which are often too small to be seen in the whole image.

Each is there in fp32 and in int8 (static QDQ, calibrated on validation pictures); the package loads int8. Inputs are
uint8 images in BGR order; `recognition/detectors/bundled/decode.py` defines what goes in and comes out.
"""

_NOT_FOR = """\
## What they are not good for

- **Real people.** They were trained on rendered workers only, and nobody has validated them on real ones; the section
  on the gap says what they miss. A site with real people needs a pose network trained on them:
  `recognition run --pose-model FILE` (YOLOv7-pose, YOLOv8 to 11-pose, MoveNet, RTMPose).
- **Safety decisions.** Nobody's safety may depend on what they find or do not find. Recordings made with them carry a
  notice that says so.
- Objects that are not of the classes listed, outdoor sites, crowds, people who lie, sit or are cut off by the border
  of the image, cameras that look straight down, images in infra-red.
- Telling who somebody is; they know nothing of faces or identities.
"""

_LICENCE = """\
## Licence

MIT, as the package. The networks, their weights and the pictures that they were trained on were made by this project;
no weights, pictures or meshes of others went into them.
"""


def write_card(models: Path, figures: Path) -> Path:
    """Write the card of the networks of a folder.

    Args:
        models: with networks and manifests.
        figures: with the files of :data:`PARTS`; what was not measured the card says.

    Raises:
        DataError: where networks or manifests are missing, or figures are of other networks than these.
    """
    files = digests(models)
    known = {name: read_facts(figures / f"{name}.json") for name in PARTS}
    for name in ("thresholds", "measure", "gap"):
        facts = known[name]
        if facts is not None and facts["models"] != files:
            raise DataError(
                "the figures are of other networks", where=figures / f"{name}.json", expected=files,
                got=facts["models"], do_next=f"Measure again: python -m tools.train {name} --help.",
            )  # fmt: skip
    path = models / NAME
    path.write_text("\n".join(_sections(models, files, known)), encoding="utf-8")
    return path


def _sections(models: Path, files: dict[str, str], known: dict[str, dict[str, Any] | None]) -> Iterable[str]:
    manifests = {name: read_toml(models / f"{stem(name, 'int8')}.toml") for name in NETWORKS}
    yield _INTRODUCTION
    yield _files(models, files)
    yield _NOT_FOR
    yield _training(manifests)
    yield _thresholds(models, known["thresholds"])
    yield from _measured(known["measure"])
    yield _gap(known["gap"])
    yield _saving(known["saving"])
    yield _again(manifests)
    yield _LICENCE


def _files(models: Path, files: dict[str, str]) -> str:
    rows = [[f"`{name}`", (models / name).stat().st_size, f"`{value}`"] for name, value in files.items()]
    return "## Files\n\n" + _table(("file", "bytes", "SHA-256"), rows)


def _training(manifests: dict[str, dict[str, Any]]) -> str:
    classes = ", ".join(manifests["site"]["classes"])
    lines = [
        f"- `{name}`, {entry['trained']['date']}: {entry['trained']['data']}." for name, entry in manifests.items()
    ]
    return (
        "## Training data\n\nRendered pictures of an indoor construction site, made by the project's own generator "
        "(`tools/sicsg`); rooms, bodies, clothes, textures, variants of objects, motions and light rigs of the test "
        f"half occur neither in training nor in validation.\n\n{chr(10).join(lines)}\n\nClasses: {classes}.\n\n"
        f"Joints of `worker`: {', '.join(manifests['worker']['joints'])}.\n"
    )


def _thresholds(models: Path, facts: dict[str, Any] | None) -> str:
    head = "## Thresholds\n\n"
    if facts is None:
        return head + _not_measured("thresholds")
    rows: list[list[Any]] = []
    for group, title in (("classes", "{}"), ("others", "{} (crops or joints)")):
        for name in facts["int8"][group]:
            row: list[Any] = [title.format(name)]
            for precision in PRECISIONS:
                choice = facts[precision][group][name]
                row += [_number(choice and choice["threshold"]), _number(choice and choice["f1"])]
            rows.append(row)
    text = (
        f"Chosen on {facts['int8']['pictures']} validation pictures at the best F1: of boxes that overlap the truth by "
        "half, of joints whose similarity is one half or more. Where nothing is given, 0.5 stands.\n\n"
    )
    joints = read_toml(models / f"{stem('site', 'int8')}.toml")["min_joints"]
    tail = f"\nSomebody with fewer than {joints} joints is not reported.\n"
    return head + text + _table(("what", "fp32", "F1", "int8", "F1"), rows) + tail


def _measured(facts: dict[str, Any] | None) -> Iterable[str]:
    head = "## Measured on rendered sequences\n"
    if facts is None:
        yield f"{head}\n{_not_measured('measure')}"
        return
    pictures = facts["int8"]["pictures"]["all"]["pictures"]
    yield (
        f"{head}\n{len(facts['sequences'])} sequences of the {facts['split']} half, {pictures} pictures, four cameras "
        "each. Not asked for, as in training: people lower than 20/720 and objects narrower or lower than 5/720 of the "
        "image's height, and what shows less than 15 % of itself. Detections of such are no errors.\n\n"
        "What was asked of the networks:\n"
    )
    rows = [
        [bar["what"], f"{'at least' if bar['least'] else 'at most'} {bar['bound']:g}", _number(bar["value"]),
         "yes" if bar["met"] else "**no**"]
        for bar in facts["bars"]
    ]  # fmt: skip
    yield _table(("", "asked", "int8", "met"), rows)
    yield _classes(facts)
    yield _groups(facts)
    yield _world(facts)
    yield _keypoints(facts)


def _classes(facts: dict[str, Any]) -> str:
    rows = []
    for name, row in facts["int8"]["pictures"]["all"]["classes"].items():
        plain = facts["fp32"]["pictures"]["all"]["classes"][name]
        sizes = ", ".join(
            f"{key.removeprefix('ap50 ')}: {_number(value)} ({row['asked ' + key.removeprefix('ap50 ')]})"
            for key, value in row.items()
            if key.startswith("ap50 ")
        )
        rows.append([name, row["asked"], _number(row["ap50"]), _number(plain["ap50"]), _number(row["ap"]), sizes])
    text = (
        "### Boxes\n\nSizes are pixels of the site network's input: widths of hard hats; of all else the root of the "
        "area, small below 16, large from 48 on. In brackets how many were asked for.\n\n"
    )
    return text + _table(("class", "asked", "AP50 int8", "AP50 fp32", "AP int8", "AP50 int8 by size"), rows)


def _groups(facts: dict[str, Any]) -> str:
    rows = []
    for name, group in facts["int8"]["pictures"].items():
        asked = [row["ap50"] for row in group["classes"].values() if row["asked"]]
        mean = sum(asked) / len(asked) if asked else None
        plain = facts["fp32"]["pictures"][name]
        joints = group["joints"].get("visible", {})
        rows.append(
            [name, group["pictures"], _number(group["classes"]["person"]["ap50"]), _number(mean),
             _number(group["oks_ap50"]), _number(plain["oks_ap50"]), _number(group["oks_ap"]),
             _number(joints.get("median_px"), 1)]
        )  # fmt: skip
    heads = ("", "pictures", "person AP50", "mean AP50", "OKS-AP50", "fp32", "OKS-AP", "visible joints, median px")
    text = "### Light and renderer\n\nOf int8; joints in pixels of the videos. Every joint counts, however unsure.\n\n"
    return text + _table(heads, rows)


def _world(facts: dict[str, Any]) -> str:
    rows = []
    for precision in PRECISIONS:
        for name, group in facts[precision]["world"].items():
            rows.append(
                [precision, name, group["workers"], _number(group.get("worker_recall")),
                 _number(group.get("false_workers_per_instant"), 2), _number(group.get("median_mm"), 0),
                 _number(group.get("p90_mm"), 0), _number(group.get("recall")), _number(group.get("recall_near"))]
            )  # fmt: skip
    text = (
        "### Joints in the world\n\nThe whole pipeline of `recognition run` on the four videos with the true "
        "calibration and clocks, against the true joints at the nearest instant; errors of all joints that it gave, "
        "recall of joints that two cameras or more see, and of these within 150 mm. Recall counts the instants before "
        "the tracker has confirmed a worker.\n\n"
    )
    heads = ("", "", "workers", "found", "false per instant", "median mm", "90 % mm", "recall", "within 150 mm")
    return text + _table(heads, rows)


def _keypoints(facts: dict[str, Any]) -> str:
    found = facts["int8"]["pictures"]["all"]["keypoints"]
    rows = [[name, _number(row.get("median_px"), 1), _number(row.get("p90_px"), 1)] for name, row in found.items()]
    text = "### Keypoints of objects\n\nOf boxes that are found, in pixels of the videos, hidden ones too.\n\n"
    return text + _table(("class", "median px", "90 % px"), rows)


def _gap(facts: dict[str, Any] | None) -> str:
    head = "## The gap to real people\n\n"
    if facts is None:
        return head + _not_measured("gap")
    rows = []
    for precision in PRECISIONS:
        row = facts[precision]
        joints = row["joints"]
        rows.append(
            [precision, row["images"], row["people"], _number(row["recall"]), _number(row["false_people_per_image"], 2),
             _number(joints["median_px"], 1), _number(joints["median_of_height"]), _number(joints["recall"]),
             _number(joints["recall_near"])]
        )  # fmt: skip
    heads = ("", "images", "people", "found", "false per image", "median px", "of height", "joints", "near")
    by_joint = [
        [name, *(_number(row[key], digits) for key, digits in _GAP_COLUMNS)]
        for name, row in facts["int8"]["by_joint"].items()
    ]
    return (
        f"{head}Videos of `{facts['capture']}` (a laboratory, four cameras in upright format: somebody in shorts, "
        "bystanders at the back, and in front a figure that looks rendered itself) against OpenPose's detections, "
        "which have errors of their own. No hard hats, no clothes of a site. People of whom OpenPose has 8 joints or "
        "more are asked "
        f"for, {_number(facts['int8']['median_height_px'], 0)} px high in the median; near is within a tenth of the "
        "height. At the detector's own thresholds:\n\n"
        f"{_table(heads, rows)}\nint8, by joint:\n\n"
        f"{_table(('joint', 'median px', 'of height', 'given', 'near'), by_joint)}"
    )


_GAP_COLUMNS = (("median_px", 1), ("median_of_height", 3), ("recall", 3), ("recall_near", 3))


def _saving(facts: dict[str, Any] | None) -> str:
    head = "## Fewer joints\n\nWhat a worker network saves that knows only the joints that rules look at.\n\n"
    if facts is None:
        return head + _not_measured("saving")
    rows = [
        [f"{row['joints']} joints", row["epochs"], row["parameters"], row["bytes"], _number(row["ms_per_crop"], 3),
         _number(row["median_visible"], 4), _number(row["recall_near"])]
        for row in (facts["all"], facts["rules"])
    ]  # fmt: skip
    heads = ("", "epochs", "parameters", "bytes int8", "ms a crop", "median error", "near")
    tail = (
        f"\nOf the {len(facts['shared_joints'])} joints that both know, in {facts['crops']} validation crops around "
        "true boxes, int8, one thread; errors are shares of the crop's height, near is within a tenth of it. Both were "
        "trained alike, for this comparison.\n"
    )
    return head + _table(heads, rows) + tail


def _again(manifests: dict[str, dict[str, Any]]) -> str:
    commands = [line for entry in manifests.values() for line in entry["trained"]["command"].split("; ")]
    commands += [
        "python -m tools.train package --site OUT_SITE --worker OUT_WORKER --data DATA",
        "python -m tools.train thresholds --data DATA",
        "python -m tools.train measure --sequences SEQUENCES",
        "python -m tools.train gap",
        "python -m tools.train saving --all OUT_WORKER --rules OUT_RULES --data DATA",
        "python -m tools.train card",
    ]
    body = "\n".join(commands)
    return (
        "## Training them again\n\n`fit` and `export` in the environment `.venv-train`, which `make train-env` "
        f"sets up, the others in the project's own:\n\n```\n{body}\n```\n"
    )


def _not_measured(command: str) -> str:
    return f"Not measured: `python -m tools.train {command}`.\n"


def _number(value: Any, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)
