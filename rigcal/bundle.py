"""Bundle adjustment with boards as the world: the one solver behind intrinsics, pairs and the joint solve.

In the frame of a board its corners are constants and the cameras move, so a board's rigidity holds by construction.
Unknowns are each camera's coefficients and ``cam_from_rig``, and one ``rig_from_board`` per board position. The normal
equations have a small block for the cameras and a 6x6 block per board; the boards are eliminated (Schur complement),
and the inverse of the reduced system is the covariance of the cameras (Triggs et al., Bundle Adjustment - A Modern
Synthesis, 2000, sections 4 and 6).

Why a solver of our own beside pycolmap: it takes a weight per corner, priors, single held coefficients and the lens
with five coefficients, and it gives the covariance. Derivatives of the lens are OpenCV's (``cv2.projectPoints``); those
of the poses are left perturbations, see :mod:`rigcal.geometry`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from rigcal.camera import Camera
from rigcal.corners import Observations
from rigcal.geometry import Bools, Floats, Pose

POSE = 6  # rotation (3) then translation (3)
BOW = 2  # along x and along y
SHORTEST_FOCAL = 0.1
"""Focal length over the image's longer side, below which none is looked for: half that of a circular fisheye lens."""
_EXACT_PX = 1e-7  # residual below which there is nothing left to gain: a thousandth of the rounding in a detector


@dataclass(frozen=True, slots=True)
class State:
    """Cameras and boards: what the solver moves."""

    cameras: tuple[Camera, ...]
    cam_from_rig: tuple[Pose, ...]
    rig_from_board: tuple[Pose, ...]
    bow_m: tuple[float, float] = (0.0, 0.0)
    """How far the board's middle stands out from its edges, along x and along y: see :func:`bow_basis`."""


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """What the solver may change, and what is known beforehand."""

    params: tuple[Bools, ...]
    """Per camera (P,): coefficients that are free."""
    poses: Bools
    """(C,) cameras whose ``cam_from_rig`` is free; at least one is held, which fixes the frame."""
    prior_mean: tuple[Floats, ...] = ()
    """Per camera (P,): prior of each coefficient; empty: no priors."""
    prior_information: tuple[Floats, ...] = ()
    """Per camera (P, P): inverse of the prior's covariance; zero where there is no prior."""
    bow: bool = False
    """Whether the board may bend."""


@dataclass(frozen=True, slots=True)
class SolveOptions:
    """How to solve.

    Raises:
        ValueError: for values outside their range.
    """

    sigma_px: float = 0.25
    """Expected noise of a corner per axis: weighs data against priors, and scales the robust loss."""
    robust: bool = False
    """Use the Cauchy loss at ``3 sigma_px`` instead of least squares."""
    max_iterations: int = 100
    """Iterations at the most."""
    tolerance: float = 1e-10
    """Converged when the cost falls by less than this, relatively."""
    covariance: bool = True
    """Whether the covariance and what rests on it are wanted; without, every unknown counts as held in it."""

    def __post_init__(self) -> None:
        if not (self.sigma_px > 0 and self.max_iterations > 0 and self.tolerance > 0):
            raise ValueError(f"solver options must be positive: {self}")


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A solved bundle and its evidence."""

    state: State
    residuals_px: Floats
    """(N, 2) observed minus projected pixels."""
    covariance: Floats
    """(D, D) of the free camera unknowns for unit noise of 1 px per axis, priors as given; order of ``index``."""
    index: tuple[tuple[int, int], ...]
    """(D) (camera, unknown) of each row: unknowns 0-5 are the pose, 6 and up the coefficients. A free bow counts as one
    more camera, whose unknowns 0 and 1 it is."""
    sigma_px: float
    """Noise per axis estimated from the residuals and the degrees of freedom."""
    inflation: float
    """Variance of the unknowns over what it would be if the corners of a board erred independently; at least 1."""
    pull: Floats
    """(B,) how hard each board pulls at the cameras: the chi-square of its share of their gradient over its degrees of
    freedom, 1 on average for boards that err by noise alone. Zero for boards that no free unknown depends on."""
    iterations: int
    converged: bool

    def camera_covariance(self, camera_idx: int, unknowns: Sequence[int]) -> Floats:
        """(n, n) covariance of a camera's unknowns, noise and inflation as estimated; zeros where one was held."""
        return self.joint_covariance([(camera_idx, unknown) for unknown in unknowns])

    def joint_covariance(self, wanted: Sequence[tuple[int, int]]) -> Floats:
        """(n, n) covariance of (camera, unknown) pairs, noise and inflation as estimated; zeros where held."""
        where = {key: row for row, key in enumerate(self.index)}
        rows = np.array([where.get(key, -1) for key in wanted], dtype=np.int64)
        known = rows >= 0
        result = np.zeros((len(rows), len(rows)))
        result[np.ix_(known, known)] = self.covariance[np.ix_(rows[known], rows[known])]
        return result * self.sigma_px**2 * self.inflation


def solve(observations: Observations, start: State, freedom: Freedom, options: SolveOptions) -> Solution:
    """Minimise the reprojection error by Levenberg-Marquardt with the boards eliminated.

    Args:
        observations: Corners; each board index below ``len(start.rig_from_board)`` should be seen at least once.
        start: Where to begin; corners that lie behind their camera there are given no weight.
        freedom: What may move.
        options: Loss and limits.

    Returns:
        The solution. Deterministic: the same input gives the same bits.
    """
    system = _System(observations, freedom, options)
    linear = system.linearise(_Working.of(start))
    damping, iterations, converged = 1e-4, 0, False
    while iterations < options.max_iterations and not converged:
        iterations += 1
        moved = system.moved(linear.at, system.step(linear, damping))
        candidate = system.linearise(moved) if moved else None  # rarely in vain: nearly every step is taken
        if candidate is not None and candidate.cost <= linear.cost:
            exact = candidate.cost <= _EXACT_PX**2 * len(observations)
            converged = exact or linear.cost - candidate.cost <= options.tolerance * linear.cost
            linear = candidate
            damping = max(damping / 10, 1e-12)
            continue
        damping *= 10
        converged = damping > 1e8
    return system.finish(linear, iterations, converged)


@dataclass(frozen=True, slots=True, eq=False)
class _Working:
    """A state as arrays: what the inner loop moves."""

    cameras: tuple[Camera, ...]
    Rc: Floats  # (C, 3, 3), (C, 3): cam_from_rig
    tc: Floats
    Rb: Floats  # (B, 3, 3), (B, 3): rig_from_board
    tb: Floats
    bow: Floats  # (2,)

    @classmethod
    def of(cls, state: State) -> _Working:
        def stacked(poses: Sequence[Pose]) -> tuple[Floats, Floats]:
            R = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
            return R, np.array([pose.translation_m for pose in poses]).reshape(-1, 3)

        return cls(state.cameras, *stacked(state.cam_from_rig), *stacked(state.rig_from_board), np.array(state.bow_m))

    @property
    def state(self) -> State:
        return State(
            self.cameras,
            tuple(Pose(R, t) for R, t in zip(self.Rc, self.tc, strict=True)),
            tuple(Pose(R, t) for R, t in zip(self.Rb, self.tb, strict=True)),
            (float(self.bow[0]), float(self.bow[1])),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """The normal equations at a state."""

    at: _Working
    cost: float
    residuals: Floats
    A: Floats  # (C', D, D): the diagonal blocks; C' counts the bow as one more camera where it is free
    A_bow: Floats  # (C, D, 2): what couples cameras and bow; nothing couples camera and camera
    E: Floats  # (B, C', D, 6)
    Cb: Floats  # (B, 6, 6)
    gc: Floats  # (C', D)
    gb: Floats  # (B, 6)
    by_view: Floats  # (W, D + 9, D + 9) of each view: camera, bow, board, right side


class _System:
    """Arrays that stay the same over the iterations."""

    def __init__(self, obs: Observations, freedom: Freedom, options: SolveOptions) -> None:
        self.obs, self.freedom, self.options = obs, freedom, options
        self.points, self.basis = obs.points_in_board, bow_basis(obs.corners_in_board)[obs.corner_ids]
        self.n_cameras = len(freedom.params)
        self.blocks = self.n_cameras + freedom.bow
        widest = max(len(free) for free in freedom.params)
        self.width = POSE + widest
        free = np.zeros((self.blocks, self.width), dtype=bool)
        free[: self.n_cameras, :POSE] = freedom.poses[:, None]
        free[self.n_cameras :, :BOW] = True
        for c, params in enumerate(freedom.params):
            free[c, POSE : POSE + len(params)] = params
        self.free = free.ravel()
        starts = obs.view_starts
        self.view_camera, self.view_board = obs.camera_idx[starts], obs.board_idx[starts]
        sizes = np.diff(np.append(starts, len(obs)))
        self.view_of = np.repeat(np.arange(len(starts)), sizes)
        self.slot = np.arange(len(obs)) - np.repeat(starts, sizes)
        self.deepest = int(sizes.max(initial=1))
        self.slices = [slice(*np.searchsorted(obs.camera_idx, [c, c + 1]).tolist()) for c in range(self.n_cameras)]
        self.prior_weight = np.zeros((self.blocks, self.width, self.width))
        self.prior_mean = np.zeros((self.blocks, self.width))
        for c, (mean, information) in enumerate(zip(freedom.prior_mean, freedom.prior_information, strict=True)):
            lens = slice(POSE, POSE + len(mean))
            self.prior_mean[c, lens] = mean
            self.prior_weight[c, lens, lens] = options.sigma_px**2 * information

    def _points_in_cam(self, at: _Working) -> tuple[Floats, Floats, Floats]:
        """Points (N, 3) in the camera, turned into the rig (N, 3) and turned into the camera (N, 3)."""
        b, c = self.obs.board_idx, self.obs.camera_idx
        bent = self.points + (self.basis @ at.bow)[:, None] * [0.0, 0.0, 1.0]
        turned_in_rig = np.einsum("nij,nj->ni", at.Rb[b], bent)
        turned_in_cam = np.einsum("nij,nj->ni", at.Rc[c], turned_in_rig + at.tb[b])
        return turned_in_cam + at.tc[c], turned_in_rig, turned_in_cam

    def _loss(self, residuals: Floats, seen: Bools) -> tuple[float, Floats]:
        """Cost and the weight (N,) of each corner; corners behind a camera cost as if far away."""
        weights = self.obs.weights
        squared = weights * (residuals**2).sum(axis=1)
        if self.options.robust:
            scale = (3 * self.options.sigma_px) ** 2
            squared = np.where(seen, squared, 1e4 * scale)
            return float(scale * np.log1p(squared / scale).sum()), np.where(seen, weights / (1 + squared / scale), 0.0)
        return float(np.where(seen, squared, 1e6).sum()), np.where(seen, weights, 0.0)

    def _prior_gap(self, cameras: Sequence[Camera]) -> Floats:
        gap = np.zeros((self.blocks, self.width))
        for c, camera in enumerate(cameras):
            gap[c, POSE : POSE + len(camera.params)] = camera.params
        return self.prior_mean - gap

    def linearise(self, at: _Working) -> _Linear:
        points, turned_in_rig, turned_in_cam = self._points_in_cam(at)
        in_front = np.isfinite(points).all(axis=1) & (points[:, 2] > 0)
        points = np.where(in_front[:, None], points, [0.0, 0.0, 1.0])
        residuals = np.zeros((len(self.obs), 2))
        board = self.width + BOW
        J = np.zeros((len(self.obs), 2, board + POSE + 1))
        for c, rows in enumerate(self.slices):
            if rows.stop == rows.start:
                continue
            pixels, by_point, by_params = at.cameras[c].project_with_jacobians(points[rows])
            residuals[rows] = self.obs.pixels[rows] - pixels
            by_turned = by_point @ at.Rc[c]
            J[rows, :, 0:3] = _minus_cross(by_point, turned_in_cam[rows])
            J[rows, :, 3:6] = by_point
            J[rows, :, POSE : POSE + by_params.shape[2]] = by_params
            if self.freedom.bow:
                along_normal = np.einsum("nij,nj->ni", by_turned, at.Rb[self.obs.board_idx[rows], :, 2])
                J[rows, :, self.width : board] = along_normal[:, :, None] * self.basis[rows, None]
            J[rows, :, board : board + 3] = _minus_cross(by_turned, turned_in_rig[rows])
            J[rows, :, board + 3 : -1] = by_turned
        seen = in_front & np.isfinite(residuals).all(axis=1)
        residuals = np.where(seen[:, None], residuals, 0.0)
        cost, weights = self._loss(residuals, seen)
        J[:, :, -1] = residuals
        J[:, :, : self.width] *= self.free.reshape(self.blocks, self.width)[self.obs.camera_idx][:, None]
        stacked = np.zeros((len(self.view_camera), self.deepest, 2, J.shape[2]))
        stacked[self.view_of, self.slot] = J * np.sqrt(weights)[:, None, None]
        flat = stacked.reshape(len(self.view_camera), self.deepest * 2, -1)
        normal = flat.transpose(0, 2, 1) @ flat
        return self._gather(normal, cost, residuals, at)

    def _gather(self, normal: Floats, cost: float, residuals: Floats, at: _Working) -> _Linear:
        D, boards, C = self.width, len(at.Rb), self.n_cameras
        camera, bow, board = slice(0, D), slice(D, D + BOW), slice(D + BOW, -1)
        gap = self._prior_gap(at.cameras)
        cost += float(np.einsum("ci,cij,cj->", gap, self.prior_weight, gap))
        A, A_bow = self.prior_weight.copy(), np.zeros((C, D, BOW))
        np.add.at(A, self.view_camera, normal[:, camera, camera])
        np.add.at(A_bow, self.view_camera, normal[:, camera, bow])
        gc = np.einsum("cij,cj->ci", self.prior_weight, gap)
        np.add.at(gc, self.view_camera, normal[:, camera, -1])
        E = np.zeros((boards, self.blocks, D, POSE))
        E[self.view_board, self.view_camera] = normal[:, camera, board]
        Cb = np.zeros((boards, POSE, POSE))
        np.add.at(Cb, self.view_board, normal[:, board, board])
        gb = np.zeros((boards, POSE))
        np.add.at(gb, self.view_board, normal[:, board, -1])
        if self.freedom.bow:
            A[C, :BOW, :BOW] = normal[:, bow, bow].sum(axis=0)
            gc[C, :BOW] = normal[:, bow, -1].sum(axis=0)
            np.add.at(E[:, C, :BOW], self.view_board, normal[:, bow, board])
        return _Linear(at, cost, residuals, A, A_bow, E, Cb, gc, gb, normal)

    def _reduced(self, linear: _Linear, damping: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Reduced system S (D', D') and its right side over the free camera unknowns; L^-1 and L^-1 E^T per board."""
        held = max(damping, 1e-12)  # so that a board of which too little is seen has a step and a covariance too
        Cb = linear.Cb + held * np.eye(POSE) * (linear.Cb.diagonal(axis1=1, axis2=2)[:, :, None] + 1e-12)
        Cb = np.where((linear.Cb.trace(axis1=1, axis2=2) > 0)[:, None, None], Cb, np.eye(POSE))
        inverse_root = np.linalg.inv(np.linalg.cholesky(Cb))
        E = linear.E.reshape(len(Cb), -1, POSE)[:, self.free]
        whitened = E @ inverse_root.transpose(0, 2, 1)  # (B, D', 6)
        wide = whitened.transpose(1, 0, 2).reshape(E.shape[1], len(Cb) * POSE)
        A = block_diag(*linear.A)
        if self.freedom.bow:
            border = linear.A_bow.reshape(-1, BOW)
            A[: len(border), len(border) : len(border) + BOW] = border
            A[len(border) : len(border) + BOW, : len(border)] = border.T
        A = A[np.ix_(self.free, self.free)]
        A[np.diag_indices_from(A)] *= 1 + damping
        rhs = np.einsum("bij,bj->bi", inverse_root, linear.gb)
        return A - wide @ wide.T, linear.gc.ravel()[self.free] - wide @ rhs.ravel(), inverse_root, whitened

    def step(self, linear: _Linear, damping: float) -> tuple[Floats, Floats]:
        """Camera step (C', D) and board step (B, 6)."""
        S, rhs, inverse_root, whitened = self._reduced(linear, damping)
        free_step = np.zeros(len(rhs))
        if len(rhs):
            scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
            try:
                factor = cho_factor(S * scale[:, None] * scale[None])
            except np.linalg.LinAlgError:
                return np.full((self.blocks, self.width), np.nan), np.zeros((len(linear.gb), POSE))
            free_step = scale * cho_solve(factor, scale * rhs)
        camera_step = np.zeros(len(self.free))
        camera_step[self.free] = free_step
        whitened_rhs = np.einsum("bij,bj->bi", inverse_root, linear.gb) - np.einsum("bdi,d->bi", whitened, free_step)
        board_step = np.einsum("bji,bj->bi", inverse_root, whitened_rhs)
        return camera_step.reshape(self.blocks, self.width), board_step

    def moved(self, at: _Working, step: tuple[Floats, Floats]) -> _Working | None:
        """The state after a step; None where a step is not finite or a focal length would be too short."""
        camera_step, board_step = step
        bow_step = camera_step[self.n_cameras :, :BOW].sum(axis=0)  # zero where it is held
        camera_step = camera_step[: self.n_cameras]
        if not (np.isfinite(camera_step).all() and np.isfinite(board_step).all() and np.isfinite(bow_step).all()):
            return None
        params = [
            camera.params + delta[POSE : POSE + len(camera.params)]
            for camera, delta in zip(at.cameras, camera_step, strict=True)
        ]
        if any(p[:2].min() < SHORTEST_FOCAL * max(c.size_wh) for p, c in zip(params, at.cameras, strict=True)):
            return None
        return _Working(
            tuple(camera.with_params(p) for camera, p in zip(at.cameras, params, strict=True)),
            Rotation.from_rotvec(camera_step[:, :3]).as_matrix() @ at.Rc,
            at.tc + camera_step[:, 3:POSE],
            Rotation.from_rotvec(board_step[:, :3]).as_matrix() @ at.Rb,
            at.tb + board_step[:, 3:],
            at.bow + bow_step,
        )

    def finish(self, linear: _Linear, iterations: int, converged: bool) -> Solution:
        index = tuple(divmod(int(i), self.width) for i in np.flatnonzero(self.free))
        boards_seen = int((linear.Cb.trace(axis1=1, axis2=2) > 0).sum())
        freedom = max(2 * len(self.obs) - len(index) - POSE * boards_seen, 1)
        sigma_px = float(np.sqrt((self.obs.weights @ (linear.residuals**2).sum(axis=1)) / freedom))
        if not self.options.covariance:
            nothing = (np.zeros((0, 0)), (), sigma_px, 1.0, np.zeros(len(linear.Cb)))
            return Solution(linear.at.state, linear.residuals, *nothing, iterations, converged)
        S = self._reduced(linear, 0.0)[0]
        covariance = np.asarray(np.linalg.pinv(S, hermitian=True), dtype=np.float64) if index else np.zeros((0, 0))
        inflation, pull = self._shares(linear, covariance, sigma_px)
        evidence = (linear.residuals, covariance, index, sigma_px, inflation, pull)
        return Solution(linear.at.state, *evidence, iterations, converged)

    def _shares(self, linear: _Linear, covariance: Floats, sigma_px: float) -> tuple[float, Floats]:
        """How much the gradients of whole boards vary beyond what independent corners would let them; each one's pull.

        At the solution each board's share ``g_b`` of the cameras' gradient should have the variance
        ``sigma^2 H_b``, with ``H_b`` its share of the reduced system, less what the fit took away:
        ``sum g_b^T C g_b`` is then ``sigma^2 (tr(C S) - sum tr(C H_b C H_b))`` on average, ``C`` being the inverse
        of ``S``. Errors that all corners of a view share (a bent board, blur, a detector's bias on oblique squares)
        make it larger; the ratio is the variance inflation, as in cluster-robust covariances (Liang and Zeger 1986).
        """
        pull = np.zeros(len(linear.Cb))
        if not len(covariance) or sigma_px == 0:
            return 1.0, pull
        D = self.width
        board_columns = slice(D + BOW, -1)
        normal = linear.by_view
        column = np.cumsum(self.free) - 1
        observed = expected = 0.0
        order = np.argsort(self.view_board, kind="stable")
        for views in np.split(order, np.flatnonzero(np.diff(self.view_board[order])) + 1):
            board = self.view_board[views[0]]
            unknowns = [np.flatnonzero(self.free[c * D : (c + 1) * D]) for c in self.view_camera[views]]
            rows = np.concatenate([column[c * D + u] for c, u in zip(self.view_camera[views], unknowns, strict=True)])
            if not len(rows):
                continue
            A = block_diag(*[normal[v][np.ix_(u, u)] for v, u in zip(views, unknowns, strict=True)])
            E = np.concatenate([normal[v][u, board_columns] for v, u in zip(views, unknowns, strict=True)])
            g = np.concatenate([normal[v][u, -1] for v, u in zip(views, unknowns, strict=True)])
            solved = np.linalg.solve(linear.Cb[board], np.column_stack([E.T, linear.gb[board]]))
            C = covariance[np.ix_(rows, rows)]
            H = A - E @ solved[:, :-1]
            g = g - E @ solved[:, -1]
            CH = C @ H
            observed += float(g @ C @ g)
            expected += float(np.trace(CH) - np.trace(CH @ CH))
            pull[board] = _reduced_chi_square(g / sigma_px, H - H @ CH, np.diag(A))
        return (max(observed / (sigma_px**2 * expected), 1.0) if expected > 1e-9 else 1.0), pull


def _reduced_chi_square(values: Floats, covariance: Floats, information: Floats) -> float:
    """``values^T covariance^-1 values`` over the rank; directions with hardly any of the information are left out."""
    scale = 1 / np.sqrt(np.maximum(information, 1e-300))
    variances, directions = np.linalg.eigh(covariance * scale[:, None] * scale)
    kept = variances > 1e-8
    return float(((directions.T @ (values * scale))[kept] ** 2 / variances[kept]).mean()) if kept.any() else 0.0


def bow_basis(corners_in_board: Floats) -> Floats:
    """(K, 2) how much each corner stands out when the middle of the board does, bent along x and along y.

    ``1 - u^2`` with ``u`` from -1 to 1 across the corners: the two terms of mrcal's board deflection.
    """
    low, high = corners_in_board[:, :2].min(axis=0), corners_in_board[:, :2].max(axis=0)
    return np.asarray(1 - (2 * (corners_in_board[:, :2] - low) / (high - low) - 1) ** 2)


def bent(corners_in_board: Floats, bow_m: tuple[float, float]) -> Floats:
    """(K, 3) corners of a board with that bow."""
    return np.asarray(corners_in_board + (bow_basis(corners_in_board) @ bow_m)[:, None] * [0.0, 0.0, 1.0])


def _minus_cross(rows: Floats, points: Floats) -> Floats:
    """``-rows @ [points]_x``: (N, 2, 3) rows times the cross-product matrix of (N, 3) points."""
    return np.cross(points[:, None, :], rows)


def rmse_px(residuals_px: Floats) -> float | None:
    """``sqrt(mean(dx^2 + dy^2))`` over corners, as OpenCV reports it; None for no corners."""
    return float(np.sqrt((residuals_px**2).sum(axis=1).mean())) if len(residuals_px) else None
