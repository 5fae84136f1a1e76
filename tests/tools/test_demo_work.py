"""Claims about the demo's work sequence: it goes on where it stopped, and mixes no two scenes."""

import json
import pickle

import av
import cv2
import numpy as np
import pytest

from rigcal.camera import MODELS
from rigcal.rigfile import read_rigfile
from tools.sicsg.demo.work import make_work
from tools.sicsg.photograph import Picture
from tools.sicsg.scene import Light, Room, Scene, SceneCamera

INSTANTS = 3


def scene(seed=1):
    values = (300.0, 300.0, 159.5, 89.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    cameras = tuple(
        SceneCamera(
            id=f"cam{number}", size_wh=(320, 180), coefficients=dict(zip(MODELS["opencv5"], values, strict=True)),
            quat_wxyz=(1.0, 0.0, 0.0, 0.0), translation_m=(0.1 * number, 0.0, 4.0), fps=10.0, clock_offset_s=0.01,
        )
        for number in range(2)
    )  # fmt: skip
    room = Room(
        name="0300", size_m=(8, 8, 3), wall_texture="", floor_texture="", ceiling_texture="", wall_colour=(1, 1, 1),
        floor_colour=(1, 1, 1), openings=(), props=(),
    )  # fmt: skip
    light = Light(
        name="0000", kind="indoor", lamps=(), sun_direction=(0, 0, 1), sun=0, sky=0, ambient=(1, 1, 1), exposure_ev=0
    )
    return Scene(
        seed=seed, split="validation", story="shift", duration_s=0.1 * INSTANTS, room=room, light=light, things=(),
        workers=(), cameras=cameras, violations=(),
    )  # fmt: skip


@pytest.fixture
def kept(tmp_path):
    """What a run that was stopped just before it wrote the videos left behind."""
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "scene.json").write_text(scene().model_dump_json(indent=1) + "\n")
    for number in range(INSTANTS):
        pictures = []
        for camera in scene().cameras:
            image = np.full((180, 320, 3), 60 + 60 * number, np.uint8)
            assert cv2.imwrite(str(folder / f"{number:04d}_{camera.id}.jpg"), image)
            pictures.append(Picture(camera, 0.1 * number, np.zeros((0, 0, 3), np.uint8), [], [], {}))
        (folder / f"{number:04d}.truth").write_bytes(pickle.dumps(pictures))
    return folder


def test_what_is_kept_is_not_rendered_again_and_becomes_videos_with_their_truth(tmp_path, kept):
    folder, told = tmp_path / "work", []
    folder.mkdir()
    (folder / "scene.json").write_text("{}")
    make_work(scene(), folder, kept, jobs=2, say=told.append)
    assert told == [f"{folder}: 0 of {INSTANTS} instants are to be rendered"]
    for camera in ("cam0", "cam1"):
        with av.open(str(folder / f"{camera}.mp4")) as video:
            means = [frame.to_ndarray(format="gray").mean() for frame in video.decode(video=0)]
        assert means == pytest.approx([60, 120, 180], abs=6)
    assert json.loads((folder / "truth.json").read_text())["instants_s"] == [0.0, 0.1, 0.2]
    assert read_rigfile(folder / "true.rig.json").site == "demo"
    assert len((folder / "timestamps.csv").read_text().splitlines()) == 1 + 2 * INSTANTS
    before = (folder / "cam0.mp4").stat().st_mtime_ns
    make_work(scene(), folder, tmp_path / "nothing", jobs=1, say=told.append)
    assert (folder / "cam0.mp4").stat().st_mtime_ns == before
    assert len(told) == 1


def test_pictures_of_another_scene_are_refused(tmp_path, kept):
    with pytest.raises(ValueError, match="holds pictures of another scene; delete it, or name another folder"):
        make_work(scene(seed=2), tmp_path / "work", kept, jobs=1, say=print)
    assert not (tmp_path / "work").exists()


def test_a_kept_picture_that_is_broken_is_named(tmp_path, kept):
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "scene.json").write_text("{}")
    (kept / "0001_cam0.jpg").write_bytes(b"")
    with pytest.raises(ValueError, match=r"0001_cam0\.jpg: the kept picture cannot be read"):
        make_work(scene(), folder, kept, jobs=1, say=print)
    assert not (folder / "truth.json").exists()
