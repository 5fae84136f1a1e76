"""A contact sheet: one page of small pictures, to see at a glance what a data set looks like."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

_CELL_WH = (240, 135)


def contact_sheet(images: list[Path], columns: int, rows: int) -> np.ndarray:
    """(rows * 135, columns * 240, 3) BGR of evenly chosen images.

    Raises:
        ValueError: where there are fewer images than places.
    """
    if len(images) < columns * rows:
        raise ValueError(f"contact sheet: expected at least {columns * rows} images, got {len(images)}")
    chosen = [images[k] for k in np.linspace(0, len(images) - 1, columns * rows).astype(int)]
    cells = [cv2.resize(cv2.imread(str(path)), _CELL_WH, interpolation=cv2.INTER_AREA) for path in chosen]
    return np.vstack([np.hstack(cells[k * columns : (k + 1) * columns]) for k in range(rows)])
