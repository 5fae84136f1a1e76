"""`make bench-sync`: everything that measures clocks, beside its peers, one JSON object per line; fixed seeds.

python tools/bench/sync.py [estimator probing board people light interpolation sites]
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from sync_board import lines as board_lines
from sync_estimator import sync_estimator
from sync_interpolation import interpolation
from sync_light import bench_light
from sync_people import people_lines
from sync_probing import bench as probing
from sync_sites import sites

PARTS: Mapping[str, Callable[[], Iterable[Mapping[str, Any]]]] = {
    "estimator": sync_estimator,
    "probing": probing,
    "board": board_lines,
    "people": people_lines,
    "light": bench_light,
    "interpolation": interpolation,
    "sites": sites,
}


def main() -> None:
    chosen = sys.argv[1:] or list(PARTS)
    if unknown := [name for name in chosen if name not in PARTS]:
        raise SystemExit(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    for name in chosen:
        for line in PARTS[name]():
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
