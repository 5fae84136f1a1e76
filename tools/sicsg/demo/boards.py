"""The captures of the calibration board: held up in many places, and lying on the floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats, Pose
from tools.sicsg.demo.painting import BoardPainter
from tools.sicsg.demo.places import Seen, frames, places
from tools.sicsg.demo.scene import BOARD, SEED, THICKNESS_M, empty
from tools.sicsg.moment import instances, moment
from tools.sicsg.rendering.gl import GlRenderer
from tools.sicsg.rendering.lens import LensMap
from tools.sicsg.rendering.sensor import expose, metered_exposure
from tools.sicsg.scene import Scene, SceneCamera
from tools.sicsg.sequences import Video, true_rig, write_stamps

FPS = 5.0
STARTS_S = -600.0
"""True time of the film's first frame: ten minutes before work begins."""
CRF, KEY_S = 29, 20.0
"""Of the videos: how coarse, and how often a picture stands alone; both keep them small."""
FLOOR = (((0.0, 0.0), 0.0), ((1.3, -0.9), 0.9), ((-1.6, 0.6), -0.5))
"""Where the board's first corner lies on the floor, x and y in metres, and how it is turned about it, in radians."""
FLOOR_STARTS_S, FLOOR_FPS = -300.0, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """What all cameras film of the board."""

    folder: Path
    places: list[list[Pose]]
    """Of each frame ``world_from_board``, in equal parts of the exposure."""
    starts_s: float
    """True time of the first frame."""
    fps: float

    @property
    def times_s(self) -> Floats:
        """(F,) true times of the frames."""
        return self.starts_s + np.arange(len(self.places)) / self.fps

    def path(self, camera: SceneCamera) -> Path:
        """The video of a camera."""
        return self.folder / f"{camera.id}.mp4"


class EmptyRoom:
    """A camera's view of the empty room, into which boards are painted.

    Args:
        scene: the empty scene.
        camera: one of its cameras.
        renderer: draws the room.
    """

    def __init__(self, scene: Scene, camera: SceneCamera, renderer: GlRenderer) -> None:
        self._camera, self._light = camera, scene.light
        warp = LensMap(camera)
        drawn = instances(scene, moment(scene, 0.0))
        self._radiance = warp.distort(renderer.render(drawn, scene.light, warp.view))
        self._exposure = metered_exposure(self._radiance, scene.light, camera)
        self._painter = BoardPainter(camera, BOARD, scene.light)
        self._number = scene.cameras.index(camera)

    def picture(self, world_from_board: list[Pose], frame: tuple[int, ...]) -> NDArray[np.uint8]:
        """(H, W, 3) BGR; the numbers of ``frame``, none of them negative, make the noise."""
        light = self._painter.paint(self._radiance, world_from_board)
        rng = np.random.default_rng((SEED, self._number, *frame))
        return expose(light, self._light, self._camera, rng, exposure=self._exposure)


def make_boards(scene: Scene, folder: Path, *, jobs: int, say: Callable[[str], None]) -> None:
    """Write ``boards`` and ``floor``; films that are there are kept.

    Args:
        scene: the scene of the work.
        folder: the demo's.
        jobs: processes.
        say: told what is being made.
    """
    vacant = empty(scene)
    held = frames(places(vacant, _seen(vacant)), FPS, scene.cameras[0].exposure_s)
    captures = (
        Film(folder / "boards", held, STARTS_S, FPS),
        Film(folder / "floor", [[pose] for pose in floor_poses()], FLOOR_STARTS_S, FLOOR_FPS),
    )
    for film in captures:
        film.folder.mkdir(parents=True, exist_ok=True)
        write_stamps(film.folder / "timestamps.csv", scene, {camera.id: film.times_s for camera in scene.cameras})
    missing = [one for one in vacant.cameras if not all(film.path(one).exists() for film in captures)]
    say(f"{folder}: boards of {len(missing)} cameras are to be made, {len(held)} frames each")
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for done in [pool.submit(_film, vacant, camera, captures) for camera in missing]:
            done.result()


def _seen(vacant: Scene) -> list[Seen]:
    """What each camera sees of the room alone."""
    found, drawn = [], instances(vacant, moment(vacant, 0.0))
    with GlRenderer() as renderer:
        for member, camera in zip(true_rig(vacant, vacant.story).cameras, vacant.cameras, strict=True):
            warp = LensMap(camera)
            found.append(Seen(member, warp.distort_nearest(renderer.passes(drawn, warp.view)[1])))
    return found


def _film(vacant: Scene, camera: SceneCamera, films: Sequence[Film]) -> None:
    cv2.setNumThreads(1)
    with GlRenderer() as renderer:
        room = EmptyRoom(vacant, camera, renderer)
    for number, film in enumerate(films):
        path = film.path(camera)
        if path.exists():
            continue
        unfinished = path.with_name(f"unfinished-{path.name}")
        video = Video(unfinished, camera.model_copy(update={"fps": film.fps}), CRF, key_s=KEY_S)
        for frame, parts in enumerate(film.places):
            video.add(room.picture(parts, (number, frame)))
        video.close()
        unfinished.rename(path)


def floor_poses() -> list[Pose]:
    """``world_from_board`` of the board on the floor, printed side up; not turned, its columns are along x."""
    poses = []
    for (x, y), turn in FLOOR:
        c, s = np.cos(turn), np.sin(turn)
        poses.append(Pose(np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]), np.array([x, y, THICKNESS_M])))
    return poses
