import numpy as np

from pfcli.core.grid import local_history as lh


def test_a_wall_is_explained_by_the_last_metres_and_a_passer_by_is_not() -> None:
    history = lh.empty()
    for k in range(30):
        way = 0.1 * k
        pose = np.array([way, 0.0, 0.0])
        wall = np.stack([np.linspace(-2, 6, 60) - way, np.full(60, 1.0)])
        walker = np.array([[3.0 - 0.3 * k - way], [0.2]])
        points = np.concatenate([wall, walker], axis=1).astype(np.float32)
        if k == 29:
            away = lh.explained_m(history, pose, points, np.float32(way), 15.0)
            assert np.median(away[0, :60]) <= 0.1
            assert (away[1, :60] <= 0.1).mean() > 0.8
            assert np.isinf(away[1, 60])
        lh.remember(history, pose, points, np.float32(way), 15.0)


def test_what_lies_too_far_behind_is_forgotten() -> None:
    history = lh.empty()
    point = np.array([[1.0], [0.0]], np.float32)
    for way in (0.0, 0.5, 1.0, 1.5):
        lh.remember(history, np.zeros(3), point, np.float32(way), 5.0)
    assert lh.explained_m(history, np.zeros(3), point, np.float32(2.0), 5.0)[1, 0] == 0.0
    assert np.isinf(lh.explained_m(history, np.zeros(3), point, np.float32(9.0), 5.0)).all()
