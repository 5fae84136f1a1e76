"""The parts that need torch: assignment, losses, lanes, training that goes on, export."""

import json
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch has an environment of its own: see tools/train/__init__.py")

from recognition.detectors.bundled.decode import decode_site, site_cells  # noqa: E402
from recognition.detectors.bundled.geometry import SITE_WH, WORKER_WH  # noqa: E402
from recognition.observations import JOINTS  # noqa: E402
from tools.train.assign import assign, generalised_iou, ignored_cells, pair_iou  # noqa: E402
from tools.train.cache import CACHED_WH, CROP_WH, Cache  # noqa: E402
from tools.train.coco import Category, DataError, Truth  # noqa: E402
from tools.train.fit import FitOptions, fit, learning_rate  # noqa: E402
from tools.train.lanes import Lanes  # noqa: E402
from tools.train.losses import SiteLoss, WorkerLoss  # noqa: E402
from tools.train.networks import SiteNetwork, WorkerNetwork, boxes_from  # noqa: E402
from tools.train.samples import BARE_TIMES, Shuffled, SiteSamples, WorkerSamples, collate  # noqa: E402
from tools.train.warp import Mirror  # noqa: E402

CENTRES, STRIDES = (torch.from_numpy(values).float() for values in site_cells())
CATEGORIES = (Category("person", JOINTS), Category("hard_hat", ("centre",)))


def truth(boxes, classes=None, ignore=None, flag=0.0):
    boxes = np.array(boxes, float).reshape(-1, 4)
    points = np.zeros((len(boxes), 17, 3))
    points[..., :2] = ((boxes[:, :2] + boxes[:, 2:]) / 2)[:, None]
    points[..., 2] = flag
    classes = np.zeros(len(boxes), int) if classes is None else np.array(classes)
    return Truth(classes, boxes, points, np.zeros(len(boxes), bool) if ignore is None else np.array(ignore))


def batch_of(*truths, size_wh=SITE_WH):
    image = np.random.default_rng(4).integers(0, 256, (size_wh[1], size_wh[0], 3)).astype(np.uint8)
    return collate([(image, one) for one in truths])


def flat_outputs(images, classes=2, log_distance=1.0):
    boxes = boxes_from(torch.full((images, 3024, 4), log_distance), CENTRES, STRIDES)
    return torch.full((images, 3024, classes), 0.1), boxes


def test_overlaps_by_hand():
    first, second = torch.tensor([0.0, 0.0, 2.0, 2.0]), torch.tensor([1.0, 1.0, 3.0, 3.0])
    assert float(pair_iou(first, second)) == pytest.approx(1 / 7)
    assert float(generalised_iou(first, second)) == pytest.approx(1 / 7 - 2 / 9)


def test_cells_answer_only_for_boxes_they_lie_in_and_for_one_each():
    boxes = [[100, 100, 140, 180], [120, 100, 170, 180], [300, 50, 480, 280]]
    batch = batch_of(truth(boxes), truth([[10, 10, 60, 60]]))
    found = assign(*flat_outputs(2), CENTRES, STRIDES, batch)
    place = batch.image_idx[found.annotation] * 3024 + found.cell
    assert len(set(place.tolist())) == len(place)
    assert set(found.annotation.tolist()) == {0, 1, 2, 3}
    box = batch.boxes[found.annotation]
    assert (CENTRES[found.cell] >= box[:, :2]).all()
    assert (CENTRES[found.cell] <= box[:, 2:]).all()
    assert ((found.quality >= 0) & (found.quality <= 1)).all()


def test_a_box_smaller_than_a_cell_still_has_one():
    found = assign(*flat_outputs(1), CENTRES, STRIDES, batch_of(truth([[30, 30, 34, 34]])))
    assert len(found.cell) > 0
    assert (STRIDES[found.cell] == 8).all()


def test_nobody_answers_for_what_is_ignored_and_nothing_is_asked_there():
    batch = batch_of(truth([[100, 100, 140, 180]], ignore=[True]))
    assert len(assign(*flat_outputs(1), CENTRES, STRIDES, batch).cell) == 0
    images, cells, classes = ignored_cells(CENTRES, STRIDES, batch)
    assert set(images.tolist()) == set(classes.tolist()) == {0}
    assert 4 in CENTRES[cells][:, 0] % 8
    assert (CENTRES[cells] >= torch.tensor([100, 100])).all()


def perfect_places(box, point):
    distance = torch.cat([CENTRES - torch.tensor(box[:2]), torch.tensor(box[2:]) - CENTRES], 1)
    offset = (torch.tensor(point) - CENTRES) / STRIDES
    logs = (distance.clamp(min=0.1) / STRIDES).log()
    return torch.cat([logs, offset.repeat(1, 17), torch.full((3024, 17), 20.0), offset.repeat(1, 4)], 1)[None]


def test_what_is_right_costs_nothing_and_decodes_to_the_truth():
    box, point = [200.0, 80.0, 280.0, 240.0], [240.0, 160.0]
    batch = batch_of(truth([box], flag=2.0))
    places = perfect_places(box, point)
    low, high = torch.tensor(box).chunk(2)
    inside = ((low < CENTRES) & (high > CENTRES)).all(1)
    logits = torch.where(inside[:, None] & torch.tensor([True, False]), 3.0, -20.0)[None]
    parts = SiteLoss()((logits, places), batch)
    for name in ("box", "joints", "keypoints", "visible"):
        assert float(parts[name]) == pytest.approx(0.0, abs=1e-5)
    found = decode_site(logits[0].sigmoid().numpy(), places[0].numpy())
    assert np.allclose(found.boxes, [box], atol=1e-3)
    assert np.allclose(found.joints[0, :, :2], point, atol=1e-3)
    worse = SiteLoss()((logits, places + 0.2), batch)
    assert all(float(worse[name]) > float(parts[name]) + 0.01 for name in ("box", "joints"))


def test_the_cells_of_the_network_stand_where_the_decoder_reads_them():
    torch.manual_seed(1)
    network = SiteNetwork(2).eval()
    image = torch.zeros(1, 3, SITE_WH[1], SITE_WH[0])
    marked = image.clone()
    marked[:, :, 96:104, 296:304] = 1.0
    with torch.no_grad():
        change = (network(marked)[1] - network(image)[1])[0].abs().sum(1)
    for stride in (8, 16, 32):
        cell = torch.where(STRIDES[:, 0] == stride, change, 0.0).argmax()
        assert ((CENTRES[cell] - torch.tensor([300.0, 100.0])).abs() <= 1.5 * stride).all()


def test_worker_loss_falls_where_the_heat_is_right():
    batch = batch_of(truth([[20, 20, 70, 120], [40, 20, 56, 31]], classes=[0, 1], flag=2.0), size_wh=WORKER_WH)
    loss = WorkerLoss(tuple(range(17)))
    flat = [torch.zeros(1, 17, 32, 24), torch.zeros(1, 5, 32, 24), torch.zeros(1, 17, 2)]
    before = loss(tuple(flat), batch)
    x, y = batch.points[0, 0, :2]
    flat[0][:, :, int(y) // 4, int(x) // 4] = 3.0
    flat[1][:, 0] = -4.0
    flat[1][:, 0, int(25.5) // 4, 48 // 4] = 4.0
    flat[2][:] = 4.0
    after = loss(tuple(flat), batch)
    assert all(float(after[name]) < float(before[name]) for name in ("joints", "states", "hats"))


def test_two_lanes_with_one_batch_have_the_gradient_of_one():
    batch = batch_of(truth([[20, 20, 70, 120]], flag=2.0), size_wh=WORKER_WH)
    gradients = []
    for count in (1, 2):
        torch.manual_seed(0)
        network = WorkerNetwork(17)
        Lanes(network, WorkerLoss(tuple(range(17))), count).gradients([batch] * count)
        gradients.append(torch.cat([value.grad.flatten() for value in network.parameters()]))
    assert torch.allclose(*gradients, rtol=1e-4, atol=1e-6)


def test_samples_follow_from_their_key():
    rng = np.random.default_rng(2)
    mirror = Mirror.of(CATEGORIES)
    wholes = rng.integers(0, 256, (3, CACHED_WH[1], CACHED_WH[0], 3)).astype(np.uint8)
    crops = rng.integers(0, 256, (3, CROP_WH[1], CROP_WH[0], 3)).astype(np.uint8)
    whole = Cache(wholes, (truth([[100, 100, 200, 300]], flag=2.0),) * 3)
    crop = Cache(crops, (truth([[60, 60, 120, 200], [70, 60, 90, 72]], classes=[0, 1], flag=2.0),) * 3)
    for samples, size in ((SiteSamples(whole, mirror, 5), SITE_WH), (WorkerSamples(crop, mirror, 5), WORKER_WH)):
        for index in range(3):
            image, found = samples[(7, index)]
            again, _ = samples[(7, index)]
            assert np.array_equal(image, again)
            assert not np.array_equal(image, samples[(8, index)][0])
            assert image.shape == (size[1], size[0], 3)
            assert (found.boxes >= 0).all()
            assert (found.boxes <= np.tile(size, 2)).all()
    assert samples[(0, 0)][1].classes[0] == 0
    assert sorted(Shuffled(5, 1)) == [(0, index) for index in range(5)]


def test_bare_heads_come_several_times_an_epoch_and_never_alike():
    images = np.random.default_rng(2).integers(0, 256, (3, CROP_WH[1], CROP_WH[0], 3)).astype(np.uint8)
    hatted, bare = (
        truth([[60, 60, 120, 200], [80, 120, 100, 140]], classes=[0, 1], flag=2.0),
        truth([[60, 60, 120, 200]], flag=2.0),
    )
    samples = WorkerSamples(Cache(images, (hatted, bare, hatted)), Mirror.of(CATEGORIES), 5)
    assert len(samples) == 3 + BARE_TIMES - 1
    shown = [samples[4, number] for number in range(len(samples))]
    assert [len(found.classes) for _, found in shown] == [2, 1, 2] + [1] * (BARE_TIMES - 1)
    assert len({image.tobytes() for image, _ in shown}) == len(samples)


def test_the_rate_rises_and_falls():
    rates = [learning_rate(step, 1000, 2.0) for step in range(1000)]
    assert max(rates) == pytest.approx(2.0, rel=1e-3)
    assert int(np.argmax(rates)) in range(28, 32)
    assert rates[-1] == pytest.approx(0.02, rel=0.01)


@pytest.fixture
def folder(tmp_path):
    cv2 = pytest.importorskip("cv2")
    (tmp_path / "images").mkdir()
    keypoints = [100.0, 100.0, 2] * 17
    notes = [
        {"id": k, "image_id": k, "category_id": 1, "bbox": [80, 60, 60, 150], "keypoints": keypoints, "ignore": 0}
        for k in range(4)
    ]
    images = [
        {"id": k, "file_name": f"{k}.png", "width": 320, "height": 180, "light": "dusk", "renderer": "gl"}
        for k in range(4)
    ]
    for image in images:
        cv2.imwrite(str(tmp_path / "images" / image["file_name"]), np.full((180, 320, 3), 90, np.uint8))
    names = [{"id": k, "name": c.name, "keypoints": list(c.keypoints)} for k, c in enumerate(CATEGORIES, 1)]
    content = json.dumps({"images": images, "annotations": notes, "categories": names})
    for split in ("train", "validation"):
        (tmp_path / f"coco_{split}.json").write_text(content)
    return tmp_path


@pytest.mark.filterwarnings("default")
def test_training_goes_on_where_it_stopped_and_ends_as_if_it_had_not(folder):
    options = FitOptions("worker", epochs=2, batch=2, lanes=2, processes=0)
    whole = torch.load(fit(options, folder, folder / "whole", lambda _: None), weights_only=True)
    out = folder / "parts"

    def stop(line):
        if line.startswith("epoch 1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(options, folder, out, stop)
    parts = torch.load(fit(options, folder, out, lambda _: None), weights_only=True)
    for name, value in whole["average"].items():
        assert torch.allclose(value, parts["average"][name], rtol=1e-3, atol=1e-5)
    assert [json.loads(line)["epoch"] for line in (out / "log.jsonl").read_text().splitlines()] == [0, 1]
    more = torch.load(fit(replace(options, epochs=3), folder, out, lambda _: None), weights_only=True)
    assert more["epochs_done"] == 3
    assert more["plans"] == [[0, 2], [2, 3]]
    with pytest.raises(DataError, match="the checkpoint is of a run with other options"):
        fit(replace(options, seed=1), folder, out, lambda _: None)


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("network", ["site", "worker"])
def test_the_exported_network_has_the_outputs_of_the_definition(folder, network):
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    from tools.train.export import export

    out = folder / network
    fit(FitOptions(network, "rules", epochs=1, batch=2, processes=0), folder, out, lambda _: None)
    assert export(folder, out, lambda _: None)["largest_difference_to_torch"] < 1e-3
    count = 1 if network == "site" else 2
    size = SITE_WH if network == "site" else WORKER_WH
    image = np.random.default_rng(1).integers(0, 256, (count, size[1], size[0], 3)).astype(np.uint8)
    wanted = [(1, 3024, 2), (1, 3024, 63)] if network == "site" else [(2, 11, 32, 24), (2, 11, 2), (2, 5, 32, 24)]
    results = []
    for name in (f"{network}.onnx", f"{network}_int8.onnx"):
        session = onnxruntime.InferenceSession(str(out / name), providers=["CPUExecutionProvider"])
        results.append(session.run(None, {"image": image}))
        assert [output.shape for output in results[-1]] == wanted
    assert np.abs(results[0][0] - results[1][0]).max() < 0.1
