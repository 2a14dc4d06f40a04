"""Submaps: how sure the chain is of the step from one to the next."""

import numpy as np

from pfcli.core.geometry import between, compose
from pfcli.core.graph.pose_graph import Edges
from pfcli.core.graph.submaps import Submap, Way, chained, cut
from pfcli.core.grid.tiles import Beams


def test_scans_far_apart_make_one_submap_each() -> None:
    """Steps of 2.6 m, as outdoors at one scan a second and more, and a gap of 9 m: no submap twice."""
    along = np.array([0.0, 2.6, 5.2, 14.2, 16.8, 19.4])
    scan = Beams(np.zeros(2), np.array([[3.0, 0.0], [3.0, 1.0]]), np.ones(2, np.uint8), np.zeros(2))
    poses = np.stack([along, np.zeros(6), np.zeros(6)], axis=1)
    way = Way([scan] * 6, poses, along, np.ones(6, bool))
    middles = [s.middle for s in cut(way)]
    assert middles == sorted(set(middles)) == [0, 1, 2, 3, 4, 5]
    steps = Edges(np.arange(5), np.arange(1, 6), between(poses[:-1], poses[1:]), np.tile(np.eye(3) * 1e4, (5, 1, 1)))
    assert np.isfinite(chained(way, steps, cut(way)).information).all()


def test_an_error_of_a_step_swings_all_that_follows() -> None:
    """Against 20 000 chains drawn with those errors; standard error of a variance: sqrt(2 / n) of it."""
    rng, count, n = np.random.default_rng(0), 12, 20_000
    steps = np.tile(np.array([0.4, 0.0, 0.15]), (count - 1, 1))
    covariance = np.diag([0.01, 0.02, 0.01]) ** 2
    poses = np.zeros((count, 3))
    for k in range(1, count):
        poses[k] = compose(poses[k - 1 : k], steps[k - 1 : k])[0]
    first = np.arange(count - 1)
    edges = Edges(first, first + 1, steps, np.tile(np.linalg.inv(covariance), (count - 1, 1, 1)))
    way = Way([], poses, np.arange(count) * 0.4, np.ones(count, bool))
    submaps = [Submap(m, np.array([m]), np.zeros((1, 2))) for m in (1, count - 1)]
    told = chained(way, edges, submaps)
    assert np.allclose(told.measured, between(poses[1:2], poses[-1:]))
    drawn = np.zeros((n, 3))
    for k in range(1, count - 1):
        noise = rng.multivariate_normal(np.zeros(3), covariance, n)
        drawn = compose(drawn, steps[k] + noise)
    expected, got = np.cov((drawn - told.measured).T), np.linalg.inv(told.information[0])
    assert (np.abs(got - expected) < 6 * np.sqrt(2 / n) * np.sqrt(np.outer(np.diag(expected), np.diag(expected)))).all()
