"""All checks of a log, in the order of their codes, and what they find."""

from collections.abc import Callable

from pfcli.checks import (
    backward_stamps,
    clock_lag,
    coarse_stamps,
    compass_turns,
    different_clocks,
    far_beams,
    few_beams,
    free_grey,
    frozen_motion,
    frozen_pose,
    gaps,
    gyroscope_turns,
    laser_mount,
    mirrored_scans,
    no_return_value,
    not_numbers,
    odometry_jumps,
    point_units,
    range_limits,
    range_units,
    repeated_scans,
    stamp_units,
    stamps_stand_still,
    turns,
    twist_against_pose,
    ways,
)
from pfcli.checks.evidence import Evidence
from pfcli.findings import Finding

CHECKS: tuple[Callable[[Evidence], Finding | None], ...] = (
    stamps_stand_still.check,
    coarse_stamps.check,
    stamp_units.check,
    different_clocks.check,
    backward_stamps.check,
    gaps.check,
    clock_lag.check,
    frozen_pose.check,
    odometry_jumps.check,
    turns.check,
    ways.check,
    twist_against_pose.check,
    compass_turns.check,
    frozen_motion.check,
    gyroscope_turns.check,
    not_numbers.check,
    range_units.check,
    far_beams.check,
    range_limits.check,
    mirrored_scans.check,
    laser_mount.check,
    no_return_value.check,
    repeated_scans.check,
    few_beams.check,
    point_units.check,
    free_grey.check,
)


def judged(evidence: Evidence) -> list[Finding]:
    """What the checks find. Every check sees all evidence; a check that has too little of it finds nothing."""
    return [found for check in CHECKS if (found := check(evidence)) is not None]
