"""Where everything has its place in a picture: a header, the views in a grid, the floor plan beside them."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

from recognition.viewing.drawing import Image
from rigcal.rig import RigCamera

WIDTH = 1920
"""Widest picture."""
VIEWS_WH = WIDTH * 3 // 4, 1024
"""What the views may take of it; they are as large as fits, and the plan takes the rest."""
LEAST_WIDTH = 320
"""Of a view: labels need as much, so that smaller images are shown larger."""
TITLE, HEADER = 20, 28
"""Heights of the band over each view and over the whole picture."""


@dataclass(frozen=True, slots=True)
class Mosaic:
    """The places of V views."""

    columns: int
    cell_wh: tuple[int, int]
    """Of a view with its title."""
    plan_wh: tuple[int, int]
    size_wh: tuple[int, int]
    """Of the whole; even numbers, as video needs."""
    scales: tuple[float, ...]
    """(V,) by which each view's image is scaled."""

    @classmethod
    def of(cls, cameras: tuple[RigCamera, ...]) -> Mosaic:
        """For cameras, in order."""
        sizes = [camera.camera.size_wh for camera in cameras]
        count, aspect = len(cameras), max(h / w for w, h in sizes)

        def width_of(columns: int) -> float:
            rows = ceil(count / columns)
            return min(VIEWS_WH[0] / columns, (VIEWS_WH[1] / rows - TITLE) / aspect)

        columns = max(range(1, count + 1), key=lambda columns: (width_of(columns), -columns))
        wanted = max(LEAST_WIDTH, *(w for w, _ in sizes))
        width = int(min(width_of(columns), wanted)) // 2 * 2
        cell_wh = width, ceil(aspect * width / 2) * 2 + TITLE
        views_height = ceil(count / columns) * cell_wh[1]
        plan_wh = max(LEAST_WIDTH, min(WIDTH - columns * width, views_height)) // 2 * 2, views_height
        return cls(
            columns,
            cell_wh,
            plan_wh,
            size_wh=(columns * width + plan_wh[0], views_height + HEADER),
            scales=tuple(min(width / w, (cell_wh[1] - TITLE) / h) for w, h in sizes),
        )

    def title(self, picture: Image, view: int) -> Image:
        """The band over a view, a part of the picture."""
        x, y = self._corner(view)
        return picture[y : y + TITLE, x : x + self.cell_wh[0]]

    def place(self, picture: Image, view: int, image: Image) -> None:
        """Put a view's image in the middle of its place."""
        x, y = self._corner(view)
        width, height = self.cell_wh[0], self.cell_wh[1] - TITLE
        left, top = x + (width - image.shape[1]) // 2, y + TITLE + (height - image.shape[0]) // 2
        picture[top : top + image.shape[0], left : left + image.shape[1]] = image

    def place_plan(self, picture: Image, plan: Image) -> None:
        """Put the floor plan beside the views."""
        picture[HEADER:, self.size_wh[0] - self.plan_wh[0] :] = plan

    def _corner(self, view: int) -> tuple[int, int]:
        row, column = divmod(view, self.columns)
        return column * self.cell_wh[0], HEADER + row * self.cell_wh[1]
