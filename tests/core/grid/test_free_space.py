"""Free-space features: where they lie, and that matching them gives the pose back."""

import numpy as np

from pfcli.core.grid import free_space


def _room(width: float, height: float) -> np.ndarray:
    """Walls of a room with a niche, 0.05 m cells."""
    cells = np.ones((int(height / 0.05) + 2, int(width / 0.05) + 2), bool)
    cells[1:-1, 1:-1] = False
    cells[1 : int(1.2 / 0.05), 1 : int(1.5 / 0.05)] = True
    return cells


def test_the_middle_of_a_room_is_a_maximum() -> None:
    cells = np.ones((60, 60), bool)
    cells[1:-1, 1:-1] = False
    found = free_space.features_of(cells, ~cells, 0.05, (0.0, 0.0))
    centre = np.hypot(*(found.xy_m - 1.5).T)
    assert centre.min() < 0.15
    assert found.kind[np.argmin(centre)] == 0
    assert abs(found.room_m[np.argmin(centre)] - 1.45) < 0.1


def test_a_map_without_open_space_has_no_key_point() -> None:
    cells = np.ones((40, 40), bool)
    cells[10:14, 2:38] = False
    assert free_space.features_of(cells, ~cells, 0.05, (0.0, 0.0)).kind.size == 0


def test_matching_a_turned_view_gives_the_pose_back() -> None:
    walls = _room(6.0, 4.0)
    known = free_space.features_of(walls, ~walls, 0.05, (0.0, 0.0))
    edge = np.argwhere(walls & ~_eroded(walls))
    points = (edge[:, ::-1] + 0.5) * 0.05
    for pose in (np.array([3.5, 2.2, 0.6]), np.array([2.6, 2.6, -2.0])):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        off = points - pose[:2]
        mine = np.column_stack([c * off[:, 0] + s * off[:, 1], -s * off[:, 0] + c * off[:, 1]])
        seen = free_space.local_features([mine], np.zeros((1, 2)), 0.05, 6.0)
        found = free_space.match(seen, known, 500)
        turn = np.abs(np.angle(np.exp(1j * (found.pose[:, 2] - pose[2]))))
        assert ((np.hypot(*(found.pose - pose)[:, :2].T) < 0.4) & (turn < 0.25)).any()


def _eroded(cells: np.ndarray) -> np.ndarray:
    from scipy import ndimage

    return np.asarray(ndimage.binary_erosion(cells, np.ones((3, 3))))
