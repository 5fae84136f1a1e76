"""What the lines of the calibration benchmark say together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

Line = dict[str, Any]
_RIG = ("rig", "cameras", "noise_px")


def summaries(lines: Sequence[Line]) -> Iterator[Line]:
    """Per rig, data and method its errors; ours beside each other method, seed by seed; ours with bad views or without.

    Errors over seeds and cameras are root-mean-squares, since the Fisher bound is one; times and growth are medians.
    Of few seeds an error over the bound says little, for most of it is one turn of camera 0, three numbers a seed:
    over 20 seeds even least squares from the truth came to 0.76, 1.01, 1.15 and 1.21 of it on four rigs. Ours over
    ``ideal``, which shares the luck of the seed, says what is lost.
    """
    groups: dict[tuple[Any, ...], dict[int, Line]] = defaultdict(dict)
    for line in lines:
        if "rms_mm" in line:  # else it failed or was skipped
            groups[*[line[name] for name in _RIG], line["data"], line["method"]][line["seed"]] = line
    for key, by_seed in groups.items():
        yield {"summary": "method"} | _named(key) | _method(list(by_seed.values()))
    for key, theirs in groups.items():
        ours = groups.get((*key[:-1], "ours"), {})
        if key[-1] != "ours" and (paired := _paired(ours, theirs)):
            yield {"summary": "ours over theirs"} | _named(key) | _ratios(paired)
    for key, bad in groups.items():
        clean = groups.get((*key[:-2], "clean", key[-1]), {})
        if key[-2] == "bad" and (paired := _paired(bad, clean)):
            ratio = _rms([b["rms_mm"] for b, _ in paired]) / _rms([c["rms_mm"] for _, c in paired])
            yield {"summary": "bad over clean"} | _named(key) | {"seeds": len(paired), "rms_ratio": ratio}


def _named(key: tuple[Any, ...]) -> Line:
    return dict(zip((*_RIG, "data", "method"), key, strict=True))


def _paired(first: dict[int, Line], second: dict[int, Line]) -> list[tuple[Line, Line]]:
    return [(first[seed], second[seed]) for seed in sorted(first.keys() & second.keys())]


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _method(lines: Sequence[Line]) -> Line:
    rms_mm, bound_mm = (_rms([line[name] for line in lines]) for name in ("rms_mm", "bound_mm"))
    median = (
        "worst_mm",
        "aligned_mm",
        "held_out_px",
        "wall_s",
        "cpu_s",
        "joint_cpu_s",
        "bare_cpu_s",
        "ours_bare_cpu_s",
    )
    return (
        {"seeds": len(lines), "rms_mm": rms_mm, "bound_mm": bound_mm, "over_bound": rms_mm / bound_mm}
        | {name: float(np.median([line[name] for line in lines])) for name in median if name in lines[0]}
        | {f"mean_{name}": _mean(lines, name) for name in ("nees", "told", "pairs", "good_dropped") if name in lines[0]}
        | {"growth_mm": np.median([line["by_camera_mm"] for line in lines], axis=0).tolist()}
    )


def _mean(lines: Sequence[Line], name: str) -> float | None:
    values = [line[name] for line in lines if line.get(name) is not None]
    return float(np.mean(values)) if values else None


def _ratios(paired: Sequence[tuple[Line, Line]]) -> Line:
    ours_mm, theirs_mm = ([pair[k]["rms_mm"] for pair in paired] for k in (0, 1))
    ratios: Line = {"seeds": len(paired), "rms_mm_ratio": _rms(ours_mm) / _rms(theirs_mm)}
    for name in ("rms_mm", "cpu_s", "wall_s"):
        ratios[f"median_{name}_ratio"] = float(np.median([ours[name] / theirs[name] for ours, theirs in paired]))
    joint = [ours["joint_cpu_s"] / theirs["cpu_s"] for ours, theirs in paired if "joint_cpu_s" in ours]
    if joint:
        ratios["median_joint_solve_cpu_s_ratio"] = float(np.median(joint))
    if "bare_cpu_s" in paired[0][1]:
        same = [theirs["ours_bare_cpu_s"] / theirs["bare_cpu_s"] for _, theirs in paired]
        ratios["median_bare_solve_cpu_s_ratio"] = float(np.median(same))
    return ratios
