"""The rejection rule: what it drops, what it keeps, and how it says so."""

import numpy as np

from rigcal.agreement import Names
from rigcal.corners import Observations
from rigcal.detections import BoardView
from rigcal.outliers import RejectionRule, reject

NAMES = Names(("cam0",), (tuple(f"f{i}" for i in range(6)),))


def observations(views=6, corners=50):
    entries = [(0, v, BoardView(v, np.arange(corners), np.zeros((corners, 2)))) for v in range(views)]
    return Observations.of(np.zeros((corners, 3)), entries)


def noise(count, sigma=0.2, seed=0):
    return np.random.default_rng(seed).normal(0, sigma, (count, 2))


def test_gaussian_noise_loses_nothing():
    obs = observations()
    for seed in range(50):
        result = reject(obs, noise(len(obs), seed=seed), NAMES, RejectionRule())
        assert result.keep.all()
        assert result.findings == ()


def test_a_bad_view_is_dropped_with_its_figure():
    obs = observations()
    residuals = noise(len(obs))
    residuals[100:150] += [4.0, 0.0]
    result = reject(obs, residuals, NAMES, RejectionRule())
    assert not result.keep[100:150].any()
    assert result.keep.sum() == len(obs) - 50
    ((camera, finding),) = result.findings
    assert (camera, finding.frame, finding.action) == (0, "f2", "dropped")
    assert finding.reason.startswith("residual 3.94 px, 16.9 times")


def test_a_bad_corner_is_dropped_and_its_view_is_kept():
    obs = observations()
    residuals = noise(len(obs))
    residuals[7] = [3.0, -3.0]
    result = reject(obs, residuals, NAMES, RejectionRule())
    assert np.flatnonzero(~result.keep).tolist() == [7]
    ((_, finding),) = result.findings
    assert (finding.frame, finding.action) == ("f0", "downweighted")
    assert finding.reason == "1 of 50 corners, residual up to 4.24 px"


def test_residuals_below_the_floor_are_never_rejected():
    obs = observations()
    residuals = noise(len(obs), sigma=1e-6)
    residuals[3] = [0.1, 0.1]
    assert reject(obs, residuals, NAMES, RejectionRule()).keep.all()
