"""The brightness of frames, measured from images on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from rigcal.captures import open_capture
from rigcal.stamps import FrameStamps
from rigcal.sync.content.light.brightness import (
    BANDS,
    COLUMNS,
    BrightnessSeries,
    brightness_of_frames,
    measure_brightness,
)


def capture_of(folder: Path, *, frames: int = 3) -> Path:
    for camera in ("cam0", "cam1"):
        (folder / camera).mkdir()
        for index in range(frames):
            image = np.full((96, 160), 40 + 20 * index, dtype=np.uint8)
            cv2.imwrite(str(folder / camera / f"{index:03d}.png"), image)
    return folder


def test_cells_are_the_mean_grey_of_their_part_of_the_image() -> None:
    image = np.repeat(np.arange(96, dtype=np.uint8)[:, None], 160, axis=1)
    series = brightness_of_frames("cam0", np.array([0.0]), [image])
    assert series.cells.shape == (1, BANDS, COLUMNS)
    np.testing.assert_allclose(series.cells[0, :, 0], np.arange(BANDS) * 3 + 1, atol=1e-4)


def test_large_images_are_sampled_to_the_same_means() -> None:
    image = np.repeat(np.linspace(0, 255, 1080).astype(np.uint8)[:, None], 1920, axis=1)
    series = brightness_of_frames("cam0", np.array([0.0]), [image])
    bands = image[:, 0].astype(np.float64).reshape(BANDS // 4, -1).mean(axis=1)
    np.testing.assert_allclose(series.cells[0, :, 3].reshape(BANDS // 4, 4).mean(axis=1), bands, atol=0.5)


def test_bands_know_which_rows_they_are() -> None:
    rows = brightness_of_frames("cam0", np.array([0.0]), [np.zeros((96, 160), dtype=np.uint8)]).rows
    np.testing.assert_allclose(rows[[0, -1]], [1 / 95 - 0.5, 94 / 95 - 0.5])
    np.testing.assert_allclose(rows, -rows[::-1], atol=1e-12)


def test_cells_that_were_ever_white_are_known() -> None:
    image = np.zeros((96, 160), dtype=np.uint8)
    image[:3, :20] = 255
    series = brightness_of_frames("cam0", np.array([0.0, 1.0]), [image, np.zeros_like(image)])
    assert series.clipped[0, 0] == pytest.approx(1.0)
    assert series.clipped.sum() == pytest.approx(1.0)


def test_a_capture_is_measured_camera_by_camera_with_progress(tmp_path: Path) -> None:
    capture = open_capture(capture_of(tmp_path))
    stamps = FrameStamps("file times", (np.array([0.0, 1.0, 2.0]), np.array([0.5, 1.5, 2.5])))
    told: list[tuple[int, int]] = []
    series = measure_brightness(capture, stamps, progress=lambda done, total: told.append((done, total)))
    assert [one.camera_id for one in series] == ["cam0", "cam1"]
    np.testing.assert_allclose(series[1].cells.mean(axis=(1, 2)), [40, 60, 80])
    assert (series[1].height_px, series[1].period_s, series[1].coded) == (96, 1.0, False)
    assert told == [(k, 6) for k in range(1, 7)]


def test_stamps_of_another_capture_are_refused(tmp_path: Path) -> None:
    capture = open_capture(capture_of(tmp_path))
    stamps = FrameStamps("file times", (np.zeros(3), np.zeros(2)))
    with pytest.raises(ValueError, match=r"stamps of \[3, 2\] frames for a capture of \[3, 3\]"):
        measure_brightness(capture, stamps)


def test_a_series_without_frames_has_no_brightness() -> None:
    with pytest.raises(ValueError, match="cells"):
        BrightnessSeries("cam0", np.zeros(3), np.zeros((2, BANDS, COLUMNS)), np.zeros((BANDS, COLUMNS)), 96)
