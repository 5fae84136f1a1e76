"""Lens models: agreement with OpenCV, inversion, derivatives, NaN and refusals."""

import cv2
import numpy as np
import pytest

from rigcal.camera import MODELS, Camera
from rigcal.synthetic import random_camera

SIZE = (1920, 1080)


def camera_of(model):
    return random_camera(model, SIZE, np.random.default_rng(3))


def points(count=40, spread=0.3):
    return np.random.default_rng(1).normal(0, spread, (count, 3)) + [0, 0, 1.5]


@pytest.mark.parametrize("model", [m for m in MODELS if m != "fisheye4"])
def test_projection_equals_opencv(model):
    camera, X = camera_of(model), points()
    expected, _ = cv2.projectPoints(X, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert np.abs(camera.project(X) - expected.reshape(-1, 2)).max() < 1e-9


def test_fisheye_projection_follows_the_equidistant_model():
    camera, X = camera_of("fisheye4"), points(spread=0.8)
    X = X[X[:, 2] > 0]
    radius = np.hypot(X[:, 0], X[:, 1])
    theta = np.arctan2(radius, X[:, 2])
    k1, k2, k3, k4 = camera.distortion
    bent = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    fx, fy, cx, cy = camera.params[:4]
    expected = np.stack([fx * bent * X[:, 0] / radius + cx, fy * bent * X[:, 1] / radius + cy], -1)
    assert np.abs(camera.project(X) - expected).max() < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_undistortion_inverts_projection(model):
    camera, X = camera_of(model), points()
    assert np.abs(camera.undistort(camera.project(X)) - X[:, :2] / X[:, 2:]).max() < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_agree_with_differences(model):
    camera, X = camera_of(model), points()
    _, by_point, by_params = camera.project_with_jacobians(X)
    step = 1e-6
    for axis in range(3):
        d = step * np.eye(3)[axis]
        numeric = (camera.project(X + d) - camera.project(X - d)) / (2 * step)
        assert np.allclose(by_point[:, :, axis], numeric, atol=1e-5 * np.abs(by_point).max())
    for i, value in enumerate(camera.params):
        d = 1e-6 * max(1.0, abs(value)) * np.eye(len(camera.params))[i]
        numeric = (
            camera.with_params(camera.params + d).project(X) - camera.with_params(camera.params - d).project(X)
        ) / (2 * d[i])
        assert np.allclose(by_params[:, :, i], numeric, atol=1e-5 * max(np.abs(numeric).max(), 1.0))


@pytest.mark.parametrize("model", MODELS)
def test_unknown_and_hidden_points_stay_nan(model):
    camera = camera_of(model)
    X = np.array([[0, 0, 1.0], [np.nan, 0, 1], [0, 0, -1], [0, 0, 0]])
    pixels = camera.project(X)
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()
    assert np.isnan(camera.undistort(pixels)[1:]).all()
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.project(np.ones((2, 5, 3))).shape == (2, 5, 2)


def test_rays_have_unit_length_and_point_through_their_pixel():
    camera = camera_of("opencv5")
    pixels = np.array([[100.0, 80.0], [1800.0, 1000.0]])
    rays = camera.rays(pixels)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    assert np.allclose(camera.project(rays * 3.7), pixels, atol=1e-6)


@pytest.mark.parametrize(
    ("model", "params", "message"),
    [
        ("pinhole", [1, 1, 0, 0], "unknown lens model"),
        ("opencv4", [1, 1, 0, 0], "expected shape"),
        ("opencv4", [-1, 1, 0, 0, 0, 0, 0, 0], "positive"),
        ("opencv4", [1, 1, np.nan, 0, 0, 0, 0, 0], "finite"),
    ],
)
def test_impossible_lenses_are_refused(model, params, message):
    with pytest.raises(ValueError, match=message):
        Camera(model, SIZE, np.array(params))


def test_no_distortion_coefficient_is_dropped_silently():
    with pytest.raises(ValueError, match="4 distortion coefficients"):
        Camera.from_matrix("opencv4", SIZE, np.diag([1000.0, 1000.0, 1.0]), [0.1, 0, 0, 0, 0.2])
