"""Pictures of a recording: nobody's face in them by default, everybody's name where he stands, and bad input told."""

import json
import sys
from dataclasses import replace

import av
import av.codec
import cv2
import numpy as np
import pytest
from av.video.reformatter import Colorspace
from typer.testing import CliRunner

from recognition.cli import app, main
from recognition.errors import RecognitionError, RecordingError
from recognition.observations import FrameSet, Instant, ViewDetections, ViewFrame
from recognition.options import options_text
from recognition.placing import Placer, PlacingOptions
from recognition.recording import Recorder
from recognition.replay import PLACING_KEY, VIEWS_KEY
from recognition.sources.recording import open_recording
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from recognition.viewing import VideoWriter, foxglove_layout, read_footage, video
from recognition.viewing.drawing import AMBER, GROUND, RED, Label, text, write
from recognition.viewing.floor import FloorPlan
from recognition.viewing.heads import HOLD_S, LOOKED_S, Heads, blur, blur_all, head_discs
from recognition.viewing.mosaic import WIDTH, Mosaic
from recognition.viewing.render import Rendering, RenderOptions
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, read_rigfile, rig_of, write_rigfile

SIZE_WH, FPS, FRAMES = (320, 180), 10.0, 12
T0 = 1_800_000_000_000_000_000
T0_UTC = "2027-01-15 08:00:00.000 UTC"
NOISE = np.random.default_rng(3)


def noisy_image():
    """Pixels that no blur leaves alone."""
    return NOISE.integers(0, 256, (SIZE_WH[1], SIZE_WH[0], 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewing")
    made = document_of_rig(semicircle_rig(size_wh=SIZE_WH), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(made, folder / "s.rig.json")
    rig = rig_of(read_rigfile(folder / "s.rig.json"))
    simulated = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1)
    views = [tuple(view.detections for view in observe(simulated, k)) for k in range(FRAMES)]
    images = [[cv2.imencode(".png", noisy_image())[1].tobytes() for _ in rig.cameras] for _ in range(FRAMES)]
    return folder, rig, views, images


def record(site, name, *, absent=(), skipped=(), frames=True, fps=FPS, blind=(), earlier=0):
    """A recording; ``absent``: (instant, camera) without a frame, ``skipped``: instants that were not looked at,
    ``blind``: cameras that see nobody, ``earlier``: how many tracks the run had before."""
    folder, rig, views, images = site
    metadata = {PLACING_KEY: options_text(PlacingOptions()), VIEWS_KEY: ",".join(rig.camera_ids)}
    made = []
    rig_json = (folder / "s.rig.json").read_bytes()
    with Recorder(folder / name, rig=rig, rig_json=rig_json, metadata=metadata) as recorder:
        for k, seen in enumerate(views):
            t_ns = T0 + round(k * 1e9 / fps)
            there = [(k, v) not in absent for v in range(len(rig.cameras))]
            encoded = [
                ViewFrame(k, t_ns, np.zeros((2, 2, 3), np.uint8), images[k][v], "png") if is_there else None
                for v, is_there in enumerate(there)
            ]
            frame_set = FrameSet(k, t_ns, tuple(encoded))
            if frames and k in skipped:
                recorder.write_frames(frame_set)
            elif k not in skipped:
                times = tuple(t_ns if is_there else None for is_there in there)
                of_frames = frame_set if frames else FrameSet(k, t_ns, (None,) * len(times), times)
                sees = [here and v not in blind for v, here in enumerate(there)]
                known = tuple(one if here else ViewDetections.empty() for one, here in zip(seen, sees, strict=True))
                made.append(Instant(of_frames, known))
                if frames:
                    recorder.write_frames(frame_set)
        placer = Placer(rig)
        for instant in made:
            recorder.write_detections(instant.frame_set, instant.views)
            if (scene := placer.place(instant)) is not None:
                workers = tuple(replace(worker, track_id=worker.track_id + earlier) for worker in scene.workers)
                recorder.write_scene(replace(scene, workers=workers))
    return folder / name


@pytest.fixture(scope="module")
def recording(site):
    return record(site, "r.mcap", absent={(k, 1) for k in range(6)}, skipped={4, 9})


def rendering(path, **options):
    opened = open_recording(path)
    footage = read_footage(opened, from_s=options.get("from_s", 0.0), to_s=options.get("to_s"))
    use = options.pop("use", (True,) * len(opened.rig.cameras))
    return Rendering(footage, RenderOptions(use, **options))


def invoke(*arguments):
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def error_of(*arguments):
    found = invoke(*arguments).exception
    assert found is not None
    return found


# --- heads ----------------------------------------------------------------------------------------------------------


def person(size_px=400.0, x=160.0, y=20.0):
    """Joints (17, 2) of a standing person whose face is at (x, y): a torso is 0.3 of the height."""
    joints = np.zeros((17, 2))
    joints[:5] = [[0, 0], [5, -4], [-5, -4], [10, 0], [-10, 0]]
    joints[5:] = [[30, 40], [-30, 40], [45, 90], [-45, 90], [50, 140], [-50, 140],
                  [20, 160], [-20, 160], [22, 260], [-22, 260], [24, 360], [-24, 360]]  # fmt: skip
    return joints * size_px / 400 + [x, y]


def seen(*people, score=0.9, objects=()):
    joints = np.array(people, dtype=float).reshape(-1, 17, 2)
    scores = np.where(np.isfinite(joints).all(axis=2), score, 0.0)
    classes, boxes = tuple(name for name, _ in objects), np.array([box for _, box in objects], dtype=float)
    return ViewDetections(joints, scores, classes, boxes.reshape(-1, 4), np.ones(len(classes)))


def covers(discs, points):
    gaps = np.linalg.norm(np.asarray(points)[:, None] - discs[None, :, :2], axis=2)
    return bool((gaps <= discs[None, :, 2]).any(axis=1).all())


FACE = [(160.0, 20.0), (160.0, -15.0), (160.0, 45.0), (140.0, 20.0), (180.0, 20.0)]
"""From crown to chin, ear to ear of :func:`person`."""


@pytest.mark.parametrize(
    "lost",
    [
        [],
        [0, 1, 2, 4],
        list(range(5)),
        [*range(5), 5],
        [*range(5), 5, 6],
        [*range(5), *range(7, 17)],
    ],
    ids=["all joints", "an ear alone", "no head", "one shoulder", "no shoulder", "shoulders alone"],
)
def test_a_head_is_covered_whichever_joints_are_known(lost):
    joints = person()
    joints[lost] = np.nan
    assert covers(head_discs(seen(joints), (1920, 1080)), FACE)


def test_a_head_of_doubtful_joints_is_covered_where_the_body_says_that_it_is():
    joints = person()
    joints[:5] += 300.0
    assert covers(head_discs(seen(joints, score=0.1), (1920, 1080)), FACE)


def test_a_head_lying_sideways_is_covered():
    joints = person(y=0.0, x=0.0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    joints[:5] = np.nan
    assert covers(head_discs(seen(joints), (1920, 1080)), np.array([(0.0, 0.0), (0.0, -15.0)]) @ [[0, 1], [-1, 0]])


def test_an_ear_that_is_elsewhere_makes_no_giant_of_its_head():
    joints = person()
    joints[3] += [0.0, 500.0]
    discs = head_discs(seen(joints), (1920, 1080))
    assert covers(discs, FACE)
    assert discs[:, 2].max() < 150.0, "of a person who is 400 px tall"


def test_somebody_of_whom_a_hat_is_all_that_is_seen_is_covered():
    discs = head_discs(seen(objects=[("hat", (100.0, 50.0, 140.0, 80.0)), ("ladder", (0, 0, 9, 9))]), (1920, 1080))
    assert len(discs) == 1
    assert covers(discs, [(120.0, 55.0), (120.0, 100.0)])


def test_nobody_is_no_disc():
    assert head_discs(seen(np.full((17, 2), np.nan)), (640, 480)).shape == (0, 4)


def test_heads_are_held_grown_and_at_last_unknown():
    heads = Heads([(0, seen(person())), (10**9, seen(person(x=300.0)))], (1920, 1080))
    looked = heads.at(0)
    assert covers(looked, FACE)
    alone = Heads([(0, seen(person()))], (1920, 1080))
    near, far = alone.at(round(0.1e9)), alone.at(round(0.45e9))
    assert near[:, 2].max() < far[:, 2].max()
    assert covers(far, [(160.0 + 0.45 * 400, 20.0)]), "2 m/s away, where 400 px are 1.7 m"
    assert heads.at(round((1.0 + LOOKED_S) * 1e9) + 1) is None
    assert Heads([], (640, 480)).at(0) is None


def test_a_head_that_one_look_misses_stays_covered():
    heads = Heads([(0, seen(person())), (round(HOLD_S * 1e9 / 2), seen())], (1920, 1080))
    assert covers(heads.at(round(HOLD_S * 1e9 / 2)), FACE)


def test_a_blurred_disc_keeps_no_detail_and_the_rest_stays():
    image = noisy_image()
    before = image.copy()
    blur(image, np.array([[100.0, 90.0, 40.0], [-500.0, 3.0, 20.0], [np.nan, 1.0, 1.0]]))
    rows, columns = np.ogrid[: SIZE_WH[1], : SIZE_WH[0]]
    distance = np.hypot(columns - 100, rows - 90)
    assert np.abs(np.diff(image[distance <= 20].astype(int), axis=0)).mean() < 8
    assert image[distance <= 38].std() < 0.25 * before[distance <= 38].std()
    np.testing.assert_array_equal(image[distance > 43], before[distance > 43])
    blur_all(image)
    assert image.std() < 0.25 * before.std()


# --- pictures -------------------------------------------------------------------------------------------------------


def view_of(picture, rig, view):
    """A camera's part of a picture."""
    mosaic = Mosaic.of(rig.cameras)
    height, width = mosaic.cell_wh[1] - 20, mosaic.cell_wh[0]
    row, column = divmod(view, mosaic.columns)
    y = 28 + row * mosaic.cell_wh[1] + 20
    return picture.image_bgr[y : y + height, column * width : (column + 1) * width]


def test_a_picture_for_each_frame_with_heads_blurred_by_default(site, recording):
    _, rig, views, _ = site
    blurred, shown = (list(rendering(recording, show_faces=faces).pictures()) for faces in (False, True))
    assert [p.t_ns for p in blurred] == [T0 + round(k * 1e9 / FPS) for k in range(FRAMES)]
    scale = Mosaic.of(rig.cameras).scales[0]
    for k in (0, 4, 7):  # 4 was not looked at
        x, y = np.nanmean(views[k][0].people_px[0, :5], axis=0) * scale
        part = np.s_[max(0, round(y) - 3) : round(y) + 4, max(0, round(x) - 3) : round(x) + 4]
        parts = [view_of(pictures[k], rig, 0)[part] for pictures in (blurred, shown)]
        assert not np.array_equal(*parts), k
    far = np.s_[-8:, :8]
    np.testing.assert_array_equal(view_of(blurred[7], rig, 3)[far], view_of(shown[7], rig, 3)[far])


def test_a_view_that_nobody_looked_at_is_blurred_as_a_whole(site):
    _, rig, _, _ = site
    path = record(site, "blind.mcap", absent={(k, 2) for k in range(1, FRAMES)})
    parts = (rendering(path, from_s=0.75, to_s=0.85, show_faces=faces) for faces in (False, True))
    seen_once, shown = (next(part.pictures()) for part in parts)
    assert not view_of(seen_once, rig, 2).any(), "it has no frame that is near"
    path = record(site, "unlooked.mcap", skipped=set(range(1, FRAMES)))
    blurred, shown = (next(rendering(path, from_s=1.1, show_faces=faces).pictures()) for faces in (False, True))
    for view in range(4):
        assert view_of(blurred, rig, view).std() < 0.25 * view_of(shown, rig, view).std()


def band_of(picture):
    """The colour of the band on top, blue, green and red."""
    return tuple(picture.image_bgr[1, -1].tolist())


def test_a_camera_without_a_frame_is_said_and_the_scene_degraded(site, recording):
    pictures = list(rendering(recording).pictures())
    assert pictures[0].headline.startswith("DEGRADED: 3 of 4 cameras (cam1: no frame)  |  2 workers, 0 objects")
    assert T0_UTC in pictures[0].headline
    assert "+0.700 s" in pictures[7].headline
    assert pictures[7].headline.startswith("MONITORED  |  2 workers, ")
    assert (pictures[0].scene.status, pictures[7].scene.status) == ("DEGRADED", "MONITORED")
    assert [band_of(pictures[k]) for k in (0, 7)] == [AMBER, GROUND]
    assert not view_of(pictures[0], site[1], 1).any()


def test_instants_of_one_camera_are_not_monitored_and_say_so_in_red(site):
    alone = {(k, v) for k in range(6, FRAMES) for v in (1, 2, 3)}
    path = record(site, "alone.mcap", absent=alone)
    pictures = list(rendering(path, from_s=0.5, to_s=0.6, show_faces=True).pictures())
    assert pictures[0].headline.startswith("MONITORED  |  2 workers")
    why = "NOT MONITORED: 1 of 4 cameras (cam1: no frame; cam2: no frame; cam3: no frame)  |  20"
    assert pictures[1].headline.startswith(why), "nobody is counted where nobody can be told"
    assert band_of(pictures[1]) == RED


def test_where_nothing_was_looked_at_for_long_nothing_is_monitored_and_a_late_result_says_so(site):
    path = record(site, "rest.mcap", skipped=set(range(2, FRAMES)))
    told = [picture.headline for picture in rendering(path, from_s=0.25, every_s=0.5).pictures()]
    assert "(0.20 s before)" in told[0]
    assert told[1].startswith("NOT MONITORED: no result within 0.5 s of this time")


def test_a_recording_without_detections_is_shown_blurred_as_a_whole(site, tmp_path):
    path = record(site, "unseen.mcap", skipped=set(range(FRAMES)))
    hidden, shown = (next(rendering(path, show_faces=faces).pictures()) for faces in (False, True))
    assert hidden.headline.startswith("NO DETECTIONS in this recording: views are blurred as a whole")
    assert shown.headline.startswith("NO DETECTIONS in this recording  |")
    assert band_of(hidden) == RED
    for view in range(4):
        assert view_of(hidden, site[1], view).std() < 0.25 * view_of(shown, site[1], view).std()
    told = invoke(path, "--png", tmp_path / "png")
    assert "warning: the recording holds no detections" in told.stdout
    assert "every view is blurred as a whole" in told.stdout


def test_somebody_whom_one_camera_saw_and_nobody_tracked_is_blurred(site):
    _, rig, views, _ = site
    path = record(site, "lone.mcap", blind={1, 2, 3})
    blurred, shown = (list(rendering(path, show_faces=faces).pictures()) for faces in (False, True))
    scale = Mosaic.of(rig.cameras).scales[0]
    for k in range(FRAMES):
        assert not blurred[k].scene.workers
        for joints in views[k][0].people_px:
            x, y = np.nanmean(joints[:5], axis=0) * scale
            part = np.s_[max(0, round(y) - 3) : round(y) + 4, max(0, round(x) - 3) : round(x) + 4]
            hidden, seen_px = (view_of(pictures[k], rig, 0)[part].astype(int) for pictures in (blurred, shown))
            assert np.abs(hidden - seen_px).mean() > 5, (k, x, y)


def test_a_part_is_found_by_the_index_and_shown_as_in_the_whole(site):
    path = record(site, "long.mcap", fps=0.2, earlier=40)
    whole = list(rendering(path).pictures())
    with path.open("r+b") as file:  # 8 MB over 55 s: this is of about 14 s, and nothing of it is read
        file.seek(path.stat().st_size // 4)
        file.write(bytes(2000))
    part = rendering(path, from_s=45.0)
    assert [picture.t_ns for picture in part.pictures()] == [picture.t_ns for picture in whole[9:]]
    for one, other in zip(part.pictures(), whole[9:], strict=True):
        named, expected = ({w.track_id: w.joints_m for w in each.scene.workers} for each in (one, other))
        assert one.scene.index == other.scene.index
        assert named.keys() == {41, 42}, "as the run had numbered them"
        assert max(np.nanmax(np.abs(named[n] - expected[n - 40])) for n in named) < 0.01
    with pytest.raises(RecordingError, match="unfinished or damaged"):
        rendering(path)


def test_labels_of_one_place_are_written_beside_each_other():
    labels = [Label(words, (40.0, 160.0), (255, 255, 255)) for words in ("worker 1", "hard_hat 7", "ladder 12")]

    def drawn(*shown):
        image = np.full((320, 320, 3), 90, np.uint8)
        write(image, shown)
        return int((image != 90).sum())

    assert drawn(*labels) == sum(drawn(label) for label in labels)
    crowd = [Label(f"worker {n}", (40.0, 160.0), (255, 255, 255)) for n in range(30)]
    assert drawn(*crowd) == sum(map(drawn, crowd[:13])), "what finds no place is left out"


def test_letters_stand_out_from_their_ground():
    image = np.full((40, 200, 3), 90, np.uint8)
    text(image, "MMMM", (10, 30), (255, 0, 0), size=1.0)
    blue, green, red = image.reshape(-1, 3).max(axis=0).tolist()
    assert 0.114 * blue + 0.587 * green + 0.299 * red > 140


def test_ranges_steps_and_views_are_kept(recording):
    made = rendering(recording, from_s=0.25, to_s=0.95, every_s=0.3)
    assert [round(p.after_s, 3) for p in made.pictures()] == [0.3, 0.6, 0.9]
    one = rendering(recording, use=(True, False, False, False))
    assert one.size_wh[0] < made.size_wh[0]
    assert next(one.pictures()).image_bgr.shape == (*one.size_wh[::-1], 3)


@pytest.mark.parametrize("size_wh", [(1920, 1080), (1080, 1920), (160, 90), (1295, 971)])
@pytest.mark.parametrize("count", [2, 3, 4, 7, 16])
def test_mosaics_are_even_and_no_wider_than_a_screen(count, size_wh):
    rig = semicircle_rig(count, size_wh=size_wh)
    mosaic = Mosaic.of(rig.cameras)
    assert mosaic.size_wh[0] <= max(WIDTH, 320 * (mosaic.columns + 1))
    assert all(side % 2 == 0 for side in mosaic.size_wh)
    picture = np.zeros((*mosaic.size_wh[::-1], 3), np.uint8)
    for view, scale in enumerate(mosaic.scales):
        width, height = (max(1, int(side * scale)) for side in size_wh)
        mosaic.place(picture, view, np.full((height, width, 3), 9, np.uint8))
    mosaic.place_plan(picture, np.full((*mosaic.plan_wh[::-1], 3), 9, np.uint8))


def test_the_plan_shows_every_camera_and_worker_in_metres(site, recording):
    scenes = rendering(recording).scenes
    plan = FloorPlan(site[1], scenes, (480, 400))
    cameras = [camera.cam_from_rig.inverse().translation_m for camera in site[1].cameras]
    workers = [np.nanmean(worker.joints_m, axis=0) for worker in scenes[-1].workers]
    places = np.array([plan.pixel_of(point) for point in (*cameras, *workers)])
    assert len(places) == 6
    assert ((places > 0) & (places < [480, 400])).all()
    flat = site[1].world_from_rig.apply(np.array(cameras))[:, :2]
    gaps, drawn = (np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (flat, places[:4]))
    np.testing.assert_allclose(drawn / gaps, drawn[0] / gaps[0], rtol=0.03)
    assert drawn[0] / gaps[0] > 20


# --- video ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("codec", ["h264", "mpeg4"])
def test_a_video_has_its_pictures_at_their_own_times_and_no_b_frames(tmp_path, codec):
    if codec == "h264" and not {"libx264", "libopenh264"} & av.codec.codecs_available:
        pytest.skip("this build of PyAV has no H.264 encoder")
    times_ns = [T0, T0 + 100_000_000, T0 + 400_000_000]
    with VideoWriter(tmp_path / "o.mp4", (320, 180), 10.0, codec) as writer:
        for t_ns in times_ns:
            writer.write(np.full((180, 320, 3), 100, np.uint8), t_ns)
        assert not (tmp_path / "o.mp4").exists()
    written = (tmp_path / "o.mp4").read_bytes()
    assert written.index(b"moov") < written.index(b"mdat"), "a browser shows it while it loads"
    with av.open(str(tmp_path / "o.mp4")) as read:
        context = read.streams.video[0].codec_context
        assert (context.has_b_frames, context.pix_fmt) == (0, "yuv420p")
        assert context.colorspace == Colorspace.ITU709 or codec == "mpeg4"
        assert [round(frame.time, 3) for frame in read.decode(video=0)] == [0.0, 0.1, 0.4]
    assert [path.name for path in tmp_path.iterdir()] == ["o.mp4"]


def test_a_failed_video_leaves_what_was_there(tmp_path):
    (tmp_path / "o.mp4").write_bytes(b"earlier")
    writer = VideoWriter(tmp_path / "o.mp4", (64, 64), 10.0, "mpeg4")
    writer.write(np.zeros((64, 64, 3), np.uint8), 0)
    writer.__exit__(RuntimeError, RuntimeError("the run failed"), None)
    assert (tmp_path / "o.mp4").read_bytes() == b"earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["o.mp4"]


def test_without_an_h264_encoder_the_other_codec_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(video.av.codec, "codecs_available", {"mpeg4"})
    with pytest.raises(RecognitionError, match="has no encoder for h264 here") as caught:
        VideoWriter(tmp_path / "o.mp4", (64, 64), 10.0)
    assert "--codec mpeg4" in caught.value.do_next


# --- the command ----------------------------------------------------------------------------------------------------


def test_the_command_writes_video_pictures_and_layout(recording, tmp_path):
    done = invoke(
        recording, "-o", tmp_path / "o.mp4", "--png", tmp_path / "png", "--every", "0.5s", "--layout",
        tmp_path / "l.json", "--codec", "mpeg4", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["frames"], told["pictures"], told["faces"], told["warnings"]) == (FRAMES, 3, "blurred", [])
    names = sorted(path.name for path in (tmp_path / "png").iterdir())
    assert names == ["000000.000s.png", "000000.500s.png", "000001.000s.png"]
    assert cv2.imread(str(tmp_path / "png" / names[0])).shape[1] <= WIDTH
    assert "configById" in json.loads((tmp_path / "l.json").read_text())
    told = invoke(recording, "--png", tmp_path / "png2", "--every", "1s", "--show-faces", "--views", "cam0,cam3")
    assert "2 files, faces shown" in told.stdout
    assert told.stderr == "", "no bar where there is no terminal"


def test_the_layout_names_topics_that_the_recording_has(site, recording):
    footage = read_footage(open_recording(recording))
    layout = foxglove_layout(site[1], footage.topics)
    panels = layout["configById"]
    for camera_id in site[1].camera_ids:
        mode = panels[f"Image!{camera_id}"]["imageMode"]
        assert (mode["imageTopic"], mode["calibrationTopic"]) == (f"/{camera_id}/image", f"/{camera_id}/calibration")
        assert mode["annotations"] == {f"/{camera_id}/annotations": {"visible": True}}

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    assert panels["3D!scene"]["topics"]["/scene"] == {"visible": True}


def test_help_says_whose_faces_are_not_blurred():
    words = " ".join(invoke("--help").stdout.split())
    assert "faces of people whom no network saw are NOT blurred" in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "option -o is out of range"),
        (("-o", "O", "--from", "-1"), "option --from is out of range"),
        (("-o", "O", "--from", "3", "--to", "2"), "option --to is out of range"),
        (("-o", "O", "--every", "5"), "option --every is out of range"),
        (("-o", "O", "--views", "cam9"), "the rig has no camera cam9"),
        (("-o", "O", "--from", "60"), "there are no frames to show"),
        (("-o", "run.mcap"), "expected: a name that ends in .mp4"),
        (("--layout", "run.mcap"), "expected: a name that ends in .json"),
    ],
)
def test_what_cannot_be_rendered_is_told(recording, tmp_path, arguments, words):
    output = tmp_path / "o.mp4"
    found = error_of(recording, *(output if each == "O" else each for each in arguments))
    assert words in str(found)
    assert "do next:" in str(found)
    assert list(tmp_path.iterdir()) == []


def test_a_range_without_frames_says_which_there_are(recording):
    with pytest.raises(RecordingError, match=r"times within 0 to 1\.100 s"):
        rendering(recording, from_s=60.0)


def test_outputs_are_made_or_refused_before_anything_takes_long(recording, tmp_path):
    done = invoke(recording, "-o", tmp_path / "new" / "o.mp4", "--to", "0.05", "--codec", "mpeg4")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "new" / "o.mp4").stat().st_size > 1000
    (tmp_path / "folder.mp4").mkdir()
    assert "a folder" in str(error_of(recording, "-o", tmp_path / "folder.mp4", "--codec", "mpeg4"))
    (tmp_path / "file").write_text("x")
    assert "cannot write this file" in str(error_of(recording, "--png", tmp_path / "file"))


def test_a_cut_recording_and_an_absent_one_are_told(recording, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(recording.read_bytes()[:100_000])
    assert "recognition recover" in str(error_of(tmp_path / "cut.mcap", "-o", tmp_path / "o.mp4"))
    assert "cannot open the recording" in str(error_of(tmp_path / "none.mcap", "-o", tmp_path / "o.mp4"))


def test_a_recording_without_video_is_told(site, tmp_path):
    found = error_of(record(site, "blank.mcap", frames=False), "-o", tmp_path / "o.mp4")
    assert "the recording holds no video" in str(found)


def test_what_is_no_recording_is_told_at_the_command_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "x.mcap").write_text("hello")
    monkeypatch.setattr(sys, "argv", ["recognition", "render", str(tmp_path / "x.mcap"), "-o", str(tmp_path / "o.mp4")])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_smoothing_the_papers_tracks_is_refused(site, recording):
    footage = read_footage(open_recording(recording))
    metadata = {**footage.run.metadata, PLACING_KEY: options_text(PlacingOptions(method="paper"))}
    changed = replace(footage, run=replace(footage.run, metadata=metadata))
    with pytest.raises(OptionError, match="method"):
        Rendering(changed, RenderOptions((True,) * 4, smooth=True))
