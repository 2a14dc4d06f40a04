"""A path that agrees best with what poses say of each other: sparse least squares on SE(2).

Lu and Milios 1997; Grisetti 2010 (tutorial on graph-based SLAM). Edges count by Geman-McClure weights, so that a
wrong closure is outvoted; they start flat and become narrow (Yang 2020, graduated non-convexity), so that a right one that is
far off at first is not. Covariances from draws that perturb every measurement and solve again (Papandreou 2010).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from pfcli.core.geometry import wrap

_ITERATIONS, _ENOUGH = 40, 1e-4
_DOUBT, _BREAKS = 9.0, 36.0
"""Squared Mahalanobis distance at which a doubtful edge counts a quarter, and one of the chain: a slip breaks it, where several
closures agree that it does."""
_ENOUGH_TOLD, _UNIT = 30.0, (0.1, 4.0)
"""From so many more measured values than poses want on, the variance of the unit is known; and how far it may be off one."""
_NOTHING = 1e-3
"""Information (1 / m^2, 1 / rad^2) that counts as none."""
_NARROWER = 4.0
"""That distance starts where all edges count, and is divided by this in each iteration."""


class Edges(NamedTuple):
    """Pose second (e,) as seen from pose first (e,), measured (e, 3) m, m, rad, with information (e, 3, 3), positive
    definite."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    measured: NDArray[np.float64]
    information: NDArray[np.float64]


def no_edges() -> Edges:
    """None at all."""
    return Edges(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))


def joined(parts: Sequence[Edges]) -> Edges:
    """All edges of the parts, in their order."""
    return Edges(*(np.concatenate(columns) for columns in zip(no_edges(), *parts, strict=True)))


def softened(information: NDArray[np.float64], sd: tuple[float, float, float]) -> NDArray[np.float64]:
    """Information (e, 3, 3) after errors of that standard deviation (m, m, rad) were added. What it has of a direction may be
    nothing, as along a plain wall; it comes out positive definite."""
    values, axes = np.linalg.eigh((information + information.swapaxes(1, 2)) / 2)
    covariance = (axes / np.maximum(values, _NOTHING)[:, None, :]) @ axes.swapaxes(1, 2)
    return np.asarray(np.linalg.inv(covariance + np.diag(np.square(sd))))


def seen_from(headings: NDArray[np.float64], information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information (e, 3, 3) in the map frame as in the frames of poses with such headings (e,), rad."""
    cos, sin, turn = np.cos(headings), np.sin(headings), np.zeros((headings.size, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cos, -sin, sin, cos, 1.0
    return np.asarray(turn.swapaxes(1, 2) @ information @ turn)


class Relaxed(NamedTuple):
    """poses (t, 3); draws (n, t, 3), how far off they may be, the first staying where it is; weights (d,) of the doubtful
    edges, 0 .. 1; unit_variance: of what edges are off, over what their information says, 1 where nothing tells."""

    poses: NDArray[np.float64]
    draws: NDArray[np.float64]
    weights: NDArray[np.float64]
    unit_variance: float = 1.0

    def covariance(self) -> NDArray[np.float64]:
        """Covariances (t, 3, 3) of the poses, seen from the first, scaled by how well the edges agree (a posteriori)."""
        of_draws = np.einsum("nta,ntb->tab", self.draws, self.draws) / max(1, self.draws.shape[0])
        return np.asarray(of_draws * np.clip(self.unit_variance, *_UNIT))

    def relative_sd(self, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.float64]:
        """(p, 2): standard deviations of position (m, a coordinate) and heading (rad) of poses second (p,) seen from first."""
        cos, sin = np.cos(self.poses[first, 2]), np.sin(self.poses[first, 2])
        dx, dy = (self.poses[second] - self.poses[first])[:, :2].T
        off = self.draws[:, second] - self.draws[:, first]
        turned = self.draws[:, first, 2]  # swings what is seen from there
        x, y = off[..., 0] + turned * dy, off[..., 1] - turned * dx
        x, y = cos * x + sin * y, cos * y - sin * x
        return np.stack([np.sqrt((x * x + y * y).mean(axis=0) / 2), np.sqrt((off[..., 2] ** 2).mean(axis=0))], axis=1)


class _Linear(NamedTuple):
    """residual (e, 3), its derivatives by the two poses (e, 3, 3), and the weighted information (e, 3, 3)."""

    residual: NDArray[np.float64]
    by_first: NDArray[np.float64]
    by_second: NDArray[np.float64]
    information: NDArray[np.float64]


def relax(
    poses: NDArray[np.float64], chain: Edges, doubtful: Edges, rng: np.random.Generator | None = None, draws: int = 0
) -> Relaxed:
    """Gauss-Newton from `poses` (t, 3); every pose hangs on the first by edges of the `chain`.

    draws: how many to make, from `rng`.
    """
    edges = joined((chain, doubtful))
    known, poses, scale = chain.first.size, poses.copy(), np.inf
    off = np.zeros((draws, poses.shape[0], 3))
    if poses.shape[0] < 2:
        return Relaxed(poses, off, np.ones(doubtful.first.size))
    for _ in range(_ITERATIONS):
        linear, weights, farthest = _linearise(poses, edges, known, scale)
        step = _factor(linear, edges, poses.shape[0]).solve(-_gradient(linear, edges, poses.shape[0]))
        poses[1:] += step.reshape(-1, 3)
        poses[:, 2] = wrap(poses[:, 2])
        if scale == 1.0 and np.abs(step).max() < _ENOUGH:
            break
        scale = max(1.0, min(scale, 4.0 * farthest / _DOUBT) / _NARROWER)
    linear, weights, _ = _linearise(poses, edges, known, 1.0)
    if rng is not None and draws:
        factor = _factor(linear, edges, poses.shape[0])
        low = np.linalg.cholesky(linear.information)
        for one in off:
            # information x noise of that information: L z
            noise = np.einsum("eij,ej->ei", low, rng.standard_normal(linear.residual.shape))
            one[1:] = factor.solve(_pulled(linear, edges, noise, poses.shape[0])).reshape(-1, 3)
    square = float(np.einsum("ei,eij,ej->", linear.residual, linear.information, linear.residual))
    redundancy = 3.0 * float(weights[known:].sum())
    return Relaxed(poses, off, weights[known:], square / redundancy if redundancy >= _ENOUGH_TOLD else 1.0)


def _linearise(
    poses: NDArray[np.float64], edges: Edges, known: int, scale: float
) -> tuple[_Linear, NDArray[np.float64], float]:
    """Residuals and derivatives at `poses`, weights (e,), and the largest square of a doubtful residual, all but the first
    `known`. scale: of the squares at which edges count a quarter."""
    p, q = poses[edges.first], poses[edges.second]
    cos, sin, dx, dy = np.cos(p[:, 2]), np.sin(p[:, 2]), q[:, 0] - p[:, 0], q[:, 1] - p[:, 1]
    seen = np.stack([cos * dx + sin * dy, -sin * dx + cos * dy, q[:, 2] - p[:, 2]], axis=1)
    residual = seen - edges.measured
    residual[:, 2] = wrap(residual[:, 2])
    first, second = np.zeros((2, p.shape[0], 3, 3))
    second[:, 0, 0], second[:, 0, 1], second[:, 1, 0], second[:, 1, 1], second[:, 2, 2] = cos, sin, -sin, cos, 1.0
    first[:] = -second
    first[:, 0, 2], first[:, 1, 2] = seen[:, 1], -seen[:, 0]
    square = np.einsum("ei,eij,ej->e", residual, edges.information, residual)
    quarter = np.where(np.arange(square.size) < known, _BREAKS, _DOUBT)
    weights = 1.0 / (1.0 + square / (quarter * scale)) ** 2
    return (
        _Linear(residual, first, second, edges.information * weights[:, None, None]),
        weights,
        float(square[known:].max(initial=0.0)),
    )


def _gradient(linear: _Linear, edges: Edges, n: int) -> NDArray[np.float64]:
    return _pulled(linear, edges, np.einsum("eij,ej->ei", linear.information, linear.residual), n)


def _pulled(linear: _Linear, edges: Edges, force: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Forces (e, 3) on edges as forces on all poses but the first, flat."""
    out = np.zeros((n, 3))
    np.add.at(out, edges.first, np.einsum("eji,ej->ei", linear.by_first, force))
    np.add.at(out, edges.second, np.einsum("eji,ej->ei", linear.by_second, force))
    return out[1:].ravel()


def _factor(linear: _Linear, edges: Edges, n: int) -> SuperLU:
    """The normal equations without the first pose, factorised."""
    rows, columns, values = [], [], []
    three = np.arange(3)
    sides = ((edges.first, linear.by_first), (edges.second, linear.by_second))
    for at, left in sides:
        for to, right in sides:
            block = np.einsum("eki,ekl,elj->eij", left, linear.information, right)
            rows.append(np.broadcast_to((3 * at[:, None] + three)[:, :, None], block.shape).ravel())
            columns.append(np.broadcast_to((3 * to[:, None] + three)[:, None, :], block.shape).ravel())
            values.append(block.ravel())
    where = (np.concatenate(rows), np.concatenate(columns))
    whole = sparse.csc_matrix((np.concatenate(values), where), shape=(3 * n, 3 * n))
    return splu(whole[3:, 3:].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
