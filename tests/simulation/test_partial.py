import numpy as np

from pfcli.simulation import scenario
from pfcli.simulation.indoor_world import WORLDS, known_part, rasterize


def test_a_carried_robot_is_put_down_and_its_wheels_notice_nothing() -> None:
    readings = list(scenario.play(scenario.SCENARIOS["partial-kidnap"], 0))
    truth = np.array([r.truth for r in readings])
    odometry = np.array([r.odometry for r in readings])
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    assert (steps > 0.5).sum() == 1
    assert steps.max() > 15.0
    assert np.hypot(*np.diff(odometry[:, :2], axis=0).T).max() < 0.05


def test_the_known_part_is_what_can_be_reached_west_of_the_cut() -> None:
    world = WORLDS["partial-leave"](1)
    whole = rasterize(world, 0.05)
    part = known_part(whole, world, 0.5)
    known = part.cells >= 0
    assert (part.cells[known] == whole.cells[known]).all()
    columns = part.origin.x_m + (np.flatnonzero(known.any(axis=0)) + 0.5) * 0.05
    west, east = world.walls[:, [0, 2]].min(), world.walls[:, [0, 2]].max()
    assert columns.max() < west + 0.5 * (east - west)
    row, col = int((0.0 - part.origin.y_m) / 0.05), int((3.0 - part.origin.x_m) / 0.05)
    assert part.cells[row, col] == 0
    assert part.cells[0, 0] == -1


def test_polite_people_keep_their_distance() -> None:
    crowded = scenario.SCENARIOS["partial-crowd"]
    nearest = min(
        float(np.min(r.ranges_m)) for r in scenario.play(crowded._replace(duration_s=20.0), 0) if r.ranges_m is not None
    )
    assert nearest > 0.7
