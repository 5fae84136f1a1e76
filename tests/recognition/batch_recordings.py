"""Small recordings for batches: detections of simulated workers, each of another part of the same site's day."""

from pathlib import Path

from recognition.batch import Results, find_recordings, run_batch
from recognition.crews import Crew
from recognition.observations import FrameSet, Instant
from recognition.options import options_text
from recognition.placing import PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

FPS, T0 = 10.0, 1_800_000_000_000_000_000
RULES = """
format = "recognition.rules"
version = 1
name = "walks"

[[rules]]
name = "hurry"
sentence = "a worker hurries"
when = "each w: speed(w.torso) > 0.55 m/s"
for_s = 0.2
clear_s = 0.2

[[rules]]
name = "together"
sentence = "two workers are near each other"
when = "each v: exists w != v: dist(v.torso, w.torso) < 4 m"
for_s = 0.2
"""
FLOOR_RULE = """
[[rules]]
name = "up"
sentence = "a worker is up"
when = "each w: clearance(w.feet) > 0.15 H"
"""


class Site:
    """A rig as read from its file, and what detectors report of two workers.

    Args:
        folder: For the rig file.
        frames: How many instants there are to choose from.
    """

    def __init__(self, folder: Path, frames: int) -> None:
        self.rig_path = folder / "site.rig.json"
        rig = semicircle_rig()
        write_rigfile(document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64), self.rig_path)
        self.rig = rig_of(read_rigfile(self.rig_path))
        simulated = simulate(self.rig, workers=2, frames=frames, fps=FPS, seed=4)
        self.views = [tuple(view.detections for view in observe(simulated, k)) for k in range(frames)]

    def record(self, path: Path, first: int, count: int, **options) -> Path:
        """Record these instants; ``options`` are the recorder's."""
        path.parent.mkdir(parents=True, exist_ok=True)
        metadata = {PLACING_KEY: options_text(PlacingOptions())}
        with Recorder(
            path, rig=self.rig, rig_json=self.rig_path.read_bytes(), metadata=metadata, **options
        ) as recorder:
            for k in range(first, first + count):
                instant = Instant(FrameSet(k, T0 + round(k * 1e9 / FPS), (None,) * len(self.views[k])), self.views[k])
                recorder.write_detections(instant.frame_set, instant.views)
        return path


def judged(inputs, output, orders, crew: Crew, **options):
    """A batch from the names of recordings to its result."""
    with Results(Path(output)) as results:
        return run_batch(find_recordings([str(given) for given in inputs]), orders, results, crew, **options)


def content(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}
