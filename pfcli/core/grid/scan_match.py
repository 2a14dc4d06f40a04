"""Scan matching against each particle's own map: Gauss-Newton on point-to-line residuals with a motion prior.

The normals come from the scan, once for all particles, or where it tells none and it is asked for, from the map; the
surface points are the mean end points of occupied cells, so the match is not quantised by the grid. `coarse_search`
offers a second start where the refinement fails (wheel slip, a pushed robot).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfcli.core.geometry import cholesky3, solve3, wrap
from pfcli.core.grid.normals import map_normal, scan_normals
from pfcli.core.grid.tiles import SIDE, Tiles, nearest_surface
from pfcli.core.jit import inline_kernel, kernel, put, reduction_kernel
from pfcli.core.threads import spread

_SLIPPED = 2.0
"""A pose counts as slipped where the uniform part is half of the motion prior or more."""
_CONVERGED, _SAME = 1e-3, 2e-3
"""A step (m, a radian counts two) after which a match stands still, and within which two matches are the same."""


class Matcher(NamedTuple):
    """Constants of the match.

    sigma_m: standard deviation of an end point across the surface; wide_m: scale of the robust cost at the start;
    gain: how many independent beams one beam is worth; tangent: weight of the residual along the surface;
    z_rand: floor of a beam's likelihood; z_unknown: likelihood of a beam that ends in unknown cells;
    iterations: at most, in both stages together; coarse_xy_m, coarse_yaw_rad: half widths of the coarse search;
    slip: probability that the odometry says nothing; beam_width_rad: spot of a beam, which blurs a surface seen at
    grazing incidence; map_normals: end points without a normal of their own take that of the map; alone: their weight where
    the map has no surface around the nearest one.
    """

    sigma_m: float = 0.03
    wide_m: float = 0.3
    gain: float = 0.3
    tangent: float = 0.01
    z_rand: float = 0.05
    z_unknown: float = 0.3
    iterations: int = 20
    coarse_xy_m: float = 0.3
    coarse_yaw_rad: float = 0.35
    slip: float = 1e-4
    beam_width_rad: float = 0.01
    map_normals: bool = False
    alone: float = 0.1


class Match(NamedTuple):
    """Per particle: pose (n, 3), information (n, 3, 3) of the posterior, log likelihood, log prior and inlier share
    (n,; -1 where the scan fell on unknown map), and whether the second start won (n,)."""

    pose: NDArray[np.float64]
    information: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    inliers: NDArray[np.float64]
    second: NDArray[np.float64]


@kernel
def _line_in_map(tiles, i, mx, my, alone):
    """What `_correspond` wants of an end point whose normal the map tells: normal, whether it is certain, weight."""
    nx, ny, around = map_normal(tiles, i, mx, my)
    return nx, ny, 1.0 if around > 1 else 0.0, 1.0 if around > 0 else alone


@kernel
def _correspond(tiles, i, pose, points, normals, stride, m, work):
    """Look up the surface point of every stride-th end point.

    work: (9, b), filled with error x, y; lever x, y; normal x, y; whether the normal is certain; weight. Returns (pairs,
    end points on known map).
    """
    per_cell, cell_m = 1.0 / tiles.resolution_m, tiles.resolution_m
    ox, oy = tiles.corner[0] * SIDE, tiles.corner[1] * SIDE
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    known, count = 0, 0
    for b in range(0, points.shape[0], stride):
        rx = cos * points[b, 0] - sin * points[b, 1]
        ry = sin * points[b, 0] + cos * points[b, 1]
        wx, wy = pose[0] + rx, pose[1] + ry
        state, mx, my = nearest_surface(tiles, i, wx * per_cell - ox, wy * per_cell - oy)
        known += state > 0
        if state < 2:
            continue
        work[0, count], work[1, count] = (mx + ox) * cell_m - wx, (my + oy) * cell_m - wy
        work[2, count], work[3, count] = rx, ry
        work[4, count] = cos * normals[b, 0] - sin * normals[b, 1]
        work[5, count] = sin * normals[b, 0] + cos * normals[b, 1]
        work[6, count], work[7, count] = normals[b, 2], normals[b, 3]
        if m.map_normals and normals[b, 2] == 0.0:
            work[4, count], work[5, count], work[6, count], work[7, count] = _line_in_map(tiles, i, mx, my, m.alone)
        count += 1
    return count, known


@reduction_kernel
def _accumulate(work, count, scale_m, sigma_m, tangent, sums):
    """Normal equations of the robust cost (Geman-McClure): six sums of the Hessian, three of the gradient, inliers."""
    c2, near = scale_m * scale_m, 4.0 * sigma_m * sigma_m
    h00 = h01 = h02 = h11 = h12 = h22 = g0 = g1 = g2 = inliers = 0.0
    for k in range(count):
        ex, ey, rx, ry, nx, ny = work[0, k], work[1, k], work[2, k], work[3, k], work[4, k], work[5, k]
        line = work[6, k]
        nx = nx + (1.0 - line)
        along = tangent * line + (1.0 - line)
        en, et = nx * ex + ny * ey, nx * ey - ny * ex
        r2 = en * en + along * et * et
        inliers += 1.0 if r2 < near else 0.0
        w = c2 / (c2 + r2)
        a = w * w * work[7, k]
        c = a * along
        jn, jt = nx * ry * -1.0 + ny * rx, ny * ry + nx * rx
        h00 += a * nx * nx + c * ny * ny
        h01 += (a - c) * nx * ny
        h11 += a * ny * ny + c * nx * nx
        h02 += a * nx * jn - c * ny * jt
        h12 += a * ny * jn + c * nx * jt
        h22 += a * jn * jn + c * jt * jt
        g0 += a * nx * en - c * ny * et
        g1 += a * ny * en + c * nx * et
        g2 += a * jn * en + c * jt * et
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5] = h00, h01, h02, h11, h12, h22
    sums[6], sums[7], sums[8], sums[9] = g0, g1, g2, inliers


@kernel
def _linearise(tiles, i, pose, points, normals, stride, scale_m, m, work, hessian, gradient):
    """Normal equations at `pose`, scaled to information; returns the inlier share (-1 where all is unknown)."""
    count, known = _correspond(tiles, i, pose, points, normals, stride, m, work)
    sums = work[8]
    _accumulate(work, count, scale_m, m.sigma_m, m.tangent, sums)
    s = stride * m.gain / (m.sigma_m * m.sigma_m)
    hessian[0, 0], hessian[1, 1], hessian[2, 2] = s * sums[0], s * sums[3], s * sums[5]
    hessian[0, 1] = hessian[1, 0] = s * sums[1]
    hessian[0, 2] = hessian[2, 0] = s * sums[2]
    hessian[1, 2] = hessian[2, 1] = s * sums[4]
    gradient[0], gradient[1], gradient[2] = s * sums[6], s * sums[7], s * sums[8]
    return sums[9] / known if known > 0 else -1.0


@kernel
def log_likelihood(tiles, i, pose, points, normals, scale_m, m, stride):
    """Tempered log likelihood of a scan at `pose` in the map of particle i; every `stride`-th beam speaks for all."""
    per_cell, cell_m = 1.0 / tiles.resolution_m, tiles.resolution_m
    ox, oy = tiles.corner[0] * SIDE, tiles.corner[1] * SIDE
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    half_precision = 0.5 / (scale_m * scale_m)
    total, product = 0.0, 1.0  # a logarithm a beam would cost half of the whole
    for b in range(0, points.shape[0], stride):
        wx = pose[0] + cos * points[b, 0] - sin * points[b, 1]
        wy = pose[1] + sin * points[b, 0] + cos * points[b, 1]
        state, mx, my = nearest_surface(tiles, i, wx * per_cell - ox, wy * per_cell - oy)
        if product < 1e-200:
            total += np.log(product)
            product = 1.0
        if state < 2:
            product *= m.z_rand if state else m.z_unknown
            continue
        ex, ey = (mx + ox) * cell_m - wx, (my + oy) * cell_m - wy
        nx = cos * normals[b, 0] - sin * normals[b, 1]
        ny = sin * normals[b, 0] + cos * normals[b, 1]
        along, weight = m.tangent, normals[b, 3]
        if normals[b, 2] == 0.0:
            nx, ny, along = 1.0, 0.0, 1.0
            if m.map_normals:
                nx, ny, line, weight = _line_in_map(tiles, i, mx, my, m.alone)
                along = m.tangent if line > 0.0 else 1.0
        en, et = nx * ex + ny * ey, -ny * ex + nx * ey
        q = (en * en + along * et * et) * half_precision * weight
        product *= (1.0 - m.z_rand) * np.exp(-q) + m.z_rand
    return m.gain * stride * (total + np.log(product))


@kernel
def known_share(tiles, i, pose, points):
    """Share of the end points (b, 2) that lie on known map of particle i at `pose` (3,)."""
    per_cell = 1.0 / tiles.resolution_m
    ox, oy = tiles.corner[0] * SIDE, tiles.corner[1] * SIDE
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    known = 0
    for b in range(points.shape[0]):
        wx = pose[0] + cos * points[b, 0] - sin * points[b, 1]
        wy = pose[1] + sin * points[b, 0] + cos * points[b, 1]
        state, _, _ = nearest_surface(tiles, i, wx * per_cell - ox, wy * per_cell - oy)
        known += state > 0
    return known / points.shape[0]


@inline_kernel
def _apart(pose, other):
    """How far from each other (m, a radian counts two)."""
    return abs(pose[0] - other[0]) + abs(pose[1] - other[1]) + 2.0 * abs(wrap(pose[2] - other[2]))


@kernel
def _refine(tiles, i, pose, prior, prior_information, trust, points, normals, m, rival, work, hessian):
    """Move `pose` to the maximum of likelihood x prior^trust: wide robust cost first, then narrow.

    rival: where another match has ended; a pose that comes as near as `_SAME` stops. Leaves the information of the posterior
    in `hessian`; returns the inlier share.
    """
    step, gradient, low = np.empty(3), np.empty(3), np.zeros((3, 3))
    inliers, wide = -1.0, True
    for k in range(m.iterations):
        scale = m.wide_m if wide else 2 * m.sigma_m
        inliers = _linearise(tiles, i, pose, points, normals, 2 if wide else 1, scale, m, work, hessian, gradient)
        step[0], step[1], step[2] = prior[0] - pose[0], prior[1] - pose[1], wrap(prior[2] - pose[2])
        for r in range(3):
            for c in range(3):
                gradient[r] += trust * prior_information[r, c] * step[c]
                hessian[r, c] += trust * prior_information[r, c]
        cholesky3(hessian, low)
        solve3(low, gradient, step)
        pose[0] += step[0]
        pose[1] += step[1]
        pose[2] = wrap(pose[2] + step[2])
        moved = abs(step[0]) + abs(step[1]) + 2.0 * abs(step[2])
        if wide:
            wide = moved >= 0.02 and k < m.iterations // 2
        elif moved < _CONVERGED or _apart(pose, rival) < _SAME:
            break
    return inliers


@kernel
def _volume(m):
    """Volume of the window in which a slip can end (m^2 rad)."""
    return 8 * m.coarse_xy_m * m.coarse_xy_m * m.coarse_yaw_rad


@kernel
def log_prior(pose, prior, information, m):
    """Log density of the motion prior: Gaussian, or with probability `slip` uniform over the coarse window."""
    d0, d1, d2 = pose[0] - prior[0], pose[1] - prior[1], wrap(pose[2] - prior[2])
    q = (
        information[0, 0] * d0 * d0
        + information[1, 1] * d1 * d1
        + information[2, 2] * d2 * d2
        + 2 * (information[0, 1] * d0 * d1 + information[0, 2] * d0 * d2 + information[1, 2] * d1 * d2)
    )
    gauss = np.exp(0.5 * cholesky3(information, np.zeros((3, 3))) - 0.5 * q) / (2 * np.pi) ** 1.5
    return np.log((1 - m.slip) * gauss + m.slip / _volume(m))


@kernel
def _match_one(tiles, i, prior, information, correction, points, normals, m, pose, hessian, out):
    """Refine from the odometry and, where a correction is offered, from there; keep what explains scan and motion best."""
    work = np.empty((9, max(10, points.shape[0])))
    nowhere = np.full(3, 1e9)
    put(pose, prior)
    out[2] = _refine(tiles, i, pose, prior, information, 1.0, points, normals, m, nowhere, work, hessian)
    out[0] = log_likelihood(tiles, i, pose, points, normals, m.sigma_m, m, 1)
    out[1] = log_prior(pose, prior, information, m)
    out[3] = 0.0
    if correction[0] == 0.0 and correction[1] == 0.0 and correction[2] == 0.0:
        return
    other, anchor, other_hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    cos, sin = np.cos(prior[2]), np.sin(prior[2])
    anchor[0] = prior[0] + cos * correction[0] - sin * correction[1]
    anchor[1] = prior[1] + sin * correction[0] + cos * correction[1]
    anchor[2] = wrap(prior[2] + correction[2])
    put(other, anchor)
    if log_prior(anchor, prior, information, m) > np.log(_SLIPPED * m.slip / _volume(m)):
        # within reach of the odometry: only the start differs, the prior stays where it is
        inliers = _refine(tiles, i, other, prior, information, 1.0, points, normals, m, pose, work, other_hessian)
    else:
        inliers = _refine(tiles, i, other, anchor, information, 0.25, points, normals, m, pose, work, other_hessian)
    if _apart(other, pose) < _SAME:
        return
    found = log_likelihood(tiles, i, other, points, normals, m.sigma_m, m, 1)
    before = log_prior(other, prior, information, m)
    if found + before > out[0] + out[1]:
        put(pose, other)
        put(hessian, other_hessian)
        out[0], out[1], out[2], out[3] = found, before, inliers, 1.0


@kernel
def _match_rows(low, high, tiles, priors, information, corrections, points, normals, m, poses, hessians, out):
    for i in range(low, high):
        _match_one(tiles, i, priors[i], information, corrections[i], points, normals, m, poses[i], hessians[i], out[i])


def match(
    tiles: Tiles,
    priors: NDArray[np.float64],
    information: NDArray[np.float64],
    corrections: NDArray[np.float64],
    points: NDArray[np.float64],
    m: Matcher,
) -> Match:
    """Maximum of p(scan | pose, map) p(pose | odometry) for each particle.

    priors: (n, 3) poses predicted by odometry (m, rad); information: (3, 3) of that prediction; corrections: (n, 3),
    second starts in the frames of the first, all zero for none; points: (b, 2) end points in the base frame.
    """
    n = priors.shape[0]
    normals = scan_normals(points, m.beam_width_rad / m.sigma_m)
    poses, hessians, out = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 4))
    spread(_match_rows, n, tiles, priors, information, corrections, points, normals, m, poses, hessians, out)
    return Match(poses, hessians, out[:, 0], out[:, 1], out[:, 2], out[:, 3])


def across(tiles: Tiles, pose: NDArray[np.float64], points: NDArray[np.float64], m: Matcher) -> NDArray[np.float64]:
    """Distances (c,) across surfaces (m), in the map of the first particle, of those end points that lie on lines and have a
    surface in reach.

    pose: (3,) m, rad; points: (b, 2) end points in the base frame (m).
    """
    work = np.empty((9, max(10, points.shape[0])))
    count, _ = _correspond(tiles, 0, pose, points, scan_normals(points, 0.0), 1, m, work)
    off = np.abs(work[4, :count] * work[0, :count] + work[5, :count] * work[1, :count])
    return np.asarray(off[work[6, :count] > 0.0])
