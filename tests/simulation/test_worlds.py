import numpy as np
import pytest

from pfcli.simulation.indoor_world import WORLDS
from pfcli.simulation.robot import ROBOTS, drive
from pfcli.simulation.scenario import SCENARIOS

PLANS = {s.world: s for s in SCENARIOS.values()}


@pytest.mark.parametrize("name", PLANS)
def test_no_robot_drives_through_what_stands_there(name: str) -> None:
    """From within a box the scanner sees its inside, where the true map has nothing: no filter could explain that."""
    scenario = PLANS[name]
    world = WORLDS[name](scenario.world_seed)
    standing = np.concatenate([world.walls, world.unmapped])
    start, along = standing[:, :2], standing[:, 2:] - standing[:, :2]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    path = np.array(list(drive(world.route, ROBOTS[scenario.robot])))[::10, :2]
    nearest = np.inf
    for x, y in path.tolist():
        off = np.array([x, y]) - start
        share = np.clip((off * along).sum(axis=1) / square, 0, 1)
        nearest = min(nearest, float(np.hypot(*(off - share[:, None] * along).T).min()))
    assert nearest > 0.3
