"""The whole product on a simulated site: board videos in; a rig, clocks, workers in 3D, violations and a page out.

Runs the commands that a technician and an operator would run on what they would bring home (``rig_configs/demo``), and
ends with how far the results are from the truth, which is known because the site is simulated.

    python -m tools.demo out/demo
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

from recognition.evaluation.found import compare_events
from recognition.evaluation.violations import read_violations
from recognition.events import read_events
from recognition.recording import SPEAKER, iter_messages
from rigcal.rigfile import read_rigfile
from rigcal.sync.log import read_exchanges
from tools.demo_page import Results, Step, ground_tracks, shown_instants, write_page
from tools.demo_pictures import pictures_at
from tools.demo_truth import camera_errors, clock_errors, floor_error, objects_found, read_truth, workers_found

SITE = Path("rig_configs/demo")
FLOOR_BOARD = "5mm"
"""Thickness of the board's plate."""


def main(folder: Path) -> int:
    """Run the demo in a folder, which is emptied first; returns the exit code."""
    started = time.monotonic()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rig, recording, poses, page = (folder / name for name in ("demo.rig.json", "demo.mcap", "poses.npz", "index.html"))
    site, log, work = SITE / "demo.site.toml", SITE / "clock_probes.csv", SITE / "work"
    rules, events = SITE.parent / "site.rules.toml", folder / "demo.events.json"
    steps = [
        command("rigcal", "calibrate", SITE / "boards", "--site", site, "-o", rig),
        command("rigcal", "world", rig, "--floor-board", SITE / "floor", "--thickness", FLOOR_BOARD, "-o", rig),
        command("rigcal", "sync", "probe", site, "--rig", rig, "--from-log", log),
        command("rigcal", "validate", rig),
        command("rigcal", "report", rig, "-o", folder / "demo.report.html"),
        command(
            "rigcal", "sync", "report", work, "--rig", rig, "--site", site, "--log", log,
            "-o", folder / "clocks.html",
        ),
        command(
            "recognition", "run", rig, "--source", work, "-o", recording, "--poses", poses,
            "--rules", rules, "--events", events,
        ),
        command("recognition", "evidence", recording),
        command("recognition", "check", recording),
    ]  # fmt: skip
    say("Comparing with the truth")
    compared = time.monotonic()
    results = evaluate(rig, recording, poses, events, steps)
    instants = [at for at, _ in shown_instants(results.truth)]
    write_page(results, pictures_at(results.truth, work, recording, instants), page)
    tell(results)
    print(f"  comparing and drawing the page took {time.monotonic() - compared:.0f} s")
    say(f"Done in {time.monotonic() - started:.0f} s. Look at:")
    print(f"  everything in one page  {page}   (any browser)")
    print(f"  the calibration         {folder / 'demo.report.html'}")
    print(f"  the clocks              {folder / 'clocks.html'}")
    print(f"  the violations          {folder / 'demo.evidence'}   (a folder each: video, pictures, margins)")
    print(f"  the recording           {recording}   (Foxglove)")
    return 0


def evaluate(rig: Path, recording: Path, poses: Path, events: Path, steps: list[Step]) -> Results:
    """The demo's results beside the truth."""
    truth, document = read_truth(SITE / "work"), read_rigfile(rig)
    logged = [one.message for one in iter_messages(recording, ["/log"])]
    found = compare_events(read_violations(SITE / "work"), read_events(events).events)
    return Results(
        document=document,
        truth=truth,
        cameras=camera_errors(document, truth.rig),
        floor=floor_error(document, truth.rig),
        clocks=clock_errors(document, truth),
        workers=workers_found(truth, poses),
        objects=objects_found(truth, recording),
        tracks=ground_tracks(poses),
        probed_s=probed_s(SITE / "clock_probes.csv"),
        violations=found,
        warnings=[message.message for message in logged if message.name != SPEAKER],
        steps=steps,
    )


def probed_s(log: Path) -> float:
    """How long a probe lasted, by its log."""
    answers = read_exchanges(log).values()
    return (max(int(one.returned_ns[-1]) for one in answers) - min(int(one.sent_ns[0]) for one in answers)) * 1e-9


def tell(results: Results) -> None:
    """Print the figures that the page shows."""
    for one in results.cameras[1:]:
        print(
            f"  {one.camera_id} stands {one.position_mm:.2f} mm (limit {one.position_limit_mm:.2f}) and is turned "
            f"{one.rotation_deg:.4f} degrees (limit {one.rotation_limit_deg:.4f}) from the truth"
        )
    print(
        f"  the floor is {results.floor.tilt_deg:.3f} degrees tilted, its origin {results.floor.origin_mm:.1f} mm off"
    )
    for clock in results.clocks:
        print(f"  the clock of {clock.camera_id} is wrong by {clock.error_ms:+.3f} ms (bound {clock.bound_ms:.3f})")
    found = results.violations
    print(
        f"  {found.in_time} of {len(found.sought)} violations found within 1 s of their start, {len(found.false)} false"
    )
    for one in (results.workers, *results.objects):
        errors = ", ".join("-" if mm is None else f"{mm:.0f}" for mm in (one.error_mm(50), one.error_mm(90)))
        print(
            f"  {one.name}: {one.found} of {one.there} found, {one.false} false; off by {errors} mm (half, nine in ten)"
        )


def command(program: str, *arguments: object) -> Step:
    """Run one of the project's own commands, as a user would; stop where it fails."""
    words = " ".join([program, *map(str, arguments)])
    say("$ " + words)
    started = time.monotonic()
    executable = Path(sys.executable).parent / program
    done = subprocess.run([str(executable), *map(str, arguments)], check=False)
    if done.returncode:
        raise SystemExit(f"{program} ended with exit code {done.returncode}")
    return Step(words, time.monotonic() - started)


def say(text: str) -> None:
    """A line of the demo's own, set apart from the commands' output."""
    print(f"\n== {text}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/demo")))
