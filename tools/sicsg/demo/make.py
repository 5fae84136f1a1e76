"""Makes the demo site's captures with their truth; what is there already is kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tools.sicsg.demo.boards import make_boards
from tools.sicsg.demo.probes import write_probes
from tools.sicsg.demo.scene import demo_scene
from tools.sicsg.demo.work import make_work
from tools.sicsg.scene import read_scene, write_scene


def make_demo(folder: Path, kept: Path, *, jobs: int, say: Callable[[str], None]) -> None:
    """Write scene, boards, floor, probe log and work into the folder; a scene that is there is rendered.

    Args:
        folder: beside the site and rule files, which are written by hand.
        kept: where pictures of the work are kept until all are there.
        jobs: processes that render at the same time.
        say: told what is being made.

    Raises:
        GlUnavailableError: where there is no OpenGL.
        ValueError: where ``kept`` holds pictures of another scene.
    """
    told = folder / "work" / "scene.json"
    if not told.exists():
        told.parent.mkdir(parents=True, exist_ok=True)
        write_scene(demo_scene(), told)
    scene = read_scene(told)
    write_probes(scene, folder / "clock_probes.csv")
    make_boards(scene, folder, jobs=jobs, say=say)
    make_work(scene, folder / "work", kept, jobs=jobs, say=say)
    total = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    say(f"{folder}: {total / 1e6:.1f} MB")
