"""The work sequence, made an instant at a time, so that a stopped run goes on where it was.

Pictures and their truth are kept in a folder for the time being; when the last is there the videos are written.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.photograph import Photographer, Picture
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.scene import Scene, write_scene
from tools.sicsg.sequences import Video, arrays_of, facts_of, frame_times, write_truth

CRF, KEY_S = 28, 7.0
_KEPT_QUALITY = 97
"""Of the pictures that are kept for the time being."""
_NO_IMAGE = np.zeros((0, 0, 3), np.uint8)


def make_work(scene: Scene, folder: Path, kept: Path, *, jobs: int, say: Callable[[str], None]) -> None:
    """Write the sequence's folder, ``truth.json`` last: a folder that has it is left as it is.

    Args:
        scene: the scene.
        folder: the sequence; it holds the scene's file.
        kept: where pictures are kept until all are there; those of another scene are refused.
        jobs: processes.
        say: told how far it is.

    Raises:
        ValueError: where ``kept`` holds pictures of another scene.
    """
    if (folder / "truth.json").exists():
        return
    times = frame_times(scene, scene.cameras[0])
    _keep_scene(scene, kept)
    missing = [number for number in range(len(times)) if not _truth_file(kept, number).exists()]
    say(f"{folder}: {len(missing)} of {len(times)} instants are to be rendered")
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for part in [pool.submit(_render, scene, missing[k::jobs], kept) for k in range(min(jobs, len(missing)))]:
            part.result()
    _write(scene, folder, kept, len(times))


def _keep_scene(scene: Scene, kept: Path) -> None:
    kept.mkdir(parents=True, exist_ok=True)
    told = kept / "scene.json"
    if told.exists() and told.read_text(encoding="utf-8") != scene.model_dump_json(indent=1) + "\n":
        raise ValueError(f"{kept} holds pictures of another scene; delete it, or name another folder with --kept")
    write_scene(scene, told)


def _truth_file(kept: Path, number: int) -> Path:
    """Written after an instant's pictures: an instant that has it is finished."""
    return kept / f"{number:04d}.truth"


def _image_file(kept: Path, number: int, camera_id: str) -> Path:
    return kept / f"{number:04d}_{camera_id}.jpg"


def _render(scene: Scene, numbers: list[int], kept: Path) -> None:
    cv2.setNumThreads(1)
    times = frame_times(scene, scene.cameras[0])
    with GlRenderer() as renderer:
        photographer = Photographer(scene, renderer, renderer)
        photographer.take(scene.cameras, float(times[0]))  # each camera meters at the first instant, whoever goes on
        for number in numbers:
            pictures = photographer.take(scene.cameras, float(times[number]))
            for picture in pictures:
                quality = [cv2.IMWRITE_JPEG_QUALITY, _KEPT_QUALITY]
                cv2.imwrite(str(_image_file(kept, number, picture.camera.id)), picture.image_bgr, quality)
            truths = [replace(picture, image_bgr=_NO_IMAGE) for picture in pictures]
            _truth_file(kept, number).write_bytes(pickle.dumps(truths))


def _write(scene: Scene, folder: Path, kept: Path, count: int) -> None:
    for camera in scene.cameras:
        video = Video(folder / f"{camera.id}.mp4", camera, CRF, key_s=KEY_S)
        for number in range(count):
            video.add(_read_image(_image_file(kept, number, camera.id)))
        video.close()
    times = {camera.id: frame_times(scene, camera) for camera in scene.cameras}
    taken: list[list[Picture]] = [pickle.loads(_truth_file(kept, number).read_bytes()) for number in range(count)]
    arrays = {name: _small(values) for name, values in arrays_of(scene, taken).items()}
    write_truth(folder, scene, "demo", times, facts_of(scene, taken), arrays)


def _read_image(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path))
    if image is None:
        raise ValueError(f"{path}: the kept picture cannot be read; delete the .truth file of its instant and go on")
    return np.asarray(image, np.uint8)


def _small(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Positions to 1e-7 of their size, counts as they are; times keep their digits."""
    return values.astype(np.float32) if values.dtype == np.float64 and values.ndim > 2 else values
