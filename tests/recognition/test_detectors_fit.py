"""A region of an image in a network's input, and the way back."""

from __future__ import annotations

import numpy as np
import pytest

from recognition.detectors.fit import fit_region, whole_image
from recognition.detectors.manifest import InputSpec

LAYOUT = {"name": "x", "size_wh": (96, 64), "layout": "nhwc", "dtype": "uint8", "colour": "bgr", "resize": "letterbox"}


def spec(**changes):
    return InputSpec.model_validate(LAYOUT | changes)


def blob(size_wh, centre_px, sigma_px):
    """A grey image with a soft dot; pixel (0, 0) is the centre of the top-left pixel."""
    x, y = np.meshgrid(np.arange(size_wh[0]), np.arange(size_wh[1]))
    grey = 250 * np.exp(-((x - centre_px[0]) ** 2 + (y - centre_px[1]) ** 2) / (2 * sigma_px**2))
    return np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, axis=2)


def brightest_edges(tensor_hwc):
    """Centre of mass of a dot, counted from the left and top edge of the tensor."""
    weight = tensor_hwc[..., 0].astype(float)
    rows, columns = np.indices(weight.shape)
    return np.array([(weight * (columns + 0.5)).sum(), (weight * (rows + 0.5)).sum()]) / weight.sum()


@pytest.mark.parametrize(
    ("resize", "align"), [("letterbox", "top_left"), ("letterbox", "centre"), ("stretch", "top_left")]
)
@pytest.mark.parametrize(
    "region",
    [
        None,
        (200, 150, 520, 440),
        (-90, -60, 411, 399),
        (240, 150, 840, 650),
        (270, 180, 337, 243),
        (250, 190, 347, 231),
    ],
    ids=["whole", "inside", "beyond top left", "beyond bottom right", "enlarged", "one axis shrunk"],
)
def test_a_dot_comes_back_to_where_it_was_in_the_image(region, align, resize):
    image, truth = blob((641, 479), (303.3, 211.7), 6.0), np.array([303.3, 211.7])
    region = whole_image(image) if region is None else np.array(region)
    fit = fit_region(image, region, spec(pad=0, align=align, resize=resize))
    # Grey values are rounded: 0.05 px at most, measured. Half a pixel of the image or of the network is 0.3 to 3.5 px.
    assert fit.image_px(brightest_edges(fit.tensor[0])) == pytest.approx(truth, abs=0.06)


def test_the_edges_of_the_image_are_half_a_pixel_beyond_its_outer_centres():
    fit = fit_region(np.zeros((128, 192, 3), np.uint8), np.array([0, 0, 192, 128]), spec())
    assert fit.image_xyxy(np.array([[0.0, 0.0, 96.0, 64.0]])) == pytest.approx(np.array([[-0.5, -0.5, 191.5, 127.5]]))


@pytest.mark.parametrize(("align", "grey_rows"), [("top_left", slice(32, 64)), ("centre", slice(0, 16))])
def test_a_letterbox_keeps_the_aspect_and_pads_the_rest(align, grey_rows):
    fit = fit_region(np.full((100, 300, 3), 200, np.uint8), np.array([0, 0, 300, 100]), spec(align=align))
    values = fit.tensor[0, :, :, 0]
    assert (values[grey_rows] == 114).all()
    assert (values == 200).sum() == 96 * 32
    assert fit.scale_xy == pytest.approx([0.32, 0.32])


def test_a_region_outside_the_image_is_padding():
    fit = fit_region(np.full((50, 50, 3), 200, np.uint8), np.array([60, -90, 160, -10]), spec(pad=7))
    assert (fit.tensor == 7).all()


def test_channels_values_and_axes_follow_the_manifest():
    image = np.empty((64, 96, 3), np.uint8)
    image[...] = (51, 102, 255)
    fit = fit_region(
        image,
        whole_image(image),
        spec(layout="nchw", dtype="float32", colour="rgb", scale=1 / 255, mean=(0.5, 0.2, 0.1), std=(0.5, 0.4, 0.2)),
    )
    assert fit.tensor.shape == (1, 3, 64, 96)
    assert fit.tensor.dtype == np.float32
    assert fit.tensor.flags.c_contiguous
    assert fit.tensor[0, :, 30, 40] == pytest.approx([1.0, 0.5, 0.5], abs=1e-6)


def test_shrinking_averages_instead_of_picking_pixels():
    stripes = np.zeros((640, 960, 3), np.uint8)
    stripes[:, ::2] = 200
    fit = fit_region(stripes, whole_image(stripes), spec())
    assert np.abs(fit.tensor.astype(int) - 100).max() <= 51  # picking pixels would give 0 or 200


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((4, 4, 4), np.uint8)])
def test_another_form_of_image_is_refused(image):
    with pytest.raises(ValueError, match=r"image_bgr: expected \(H, W, 3\) uint8, got"):
        fit_region(image, np.array([0, 0, 4, 4]), spec())


def test_an_empty_region_is_refused():
    with pytest.raises(ValueError, match=r"region_ltrb: empty region \[2, 1, 2, 3\]"):
        fit_region(np.zeros((4, 4, 3), np.uint8), np.array([2, 1, 2, 3]), spec())
