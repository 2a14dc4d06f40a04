"""The offset between the clocks of scans and motion, estimated from the log itself."""

from pfcli.core.motion import clock_offset
from pfcli.core.motion.clock_offset import ClockOffset
from pfcli.replay.align import ROLES as MOTION_ROLES
from pfcli.replay.drive_record import DriveRecord, record, turns_of
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive

SURE_S = 0.02
"""An offset whose standard deviation is more is not known."""


def offset_of(drive: DriveRecord) -> ClockOffset | None:
    """Seconds to add to the stamps of the scans, by turns; None where the drive does not tell."""
    found = clock_offset.offset(turns_of(drive), drive.motion_s, drive.odometry[:, 2])
    return found if found is not None and found.sd_s < SURE_S else None


def scan_offset(log: Log, motion: str, drive: Drive) -> ClockOffset | None:
    """The offset of a log's scans against its motion (s), over the one that its settings have: first by when the messages were
    recorded, then by the turns."""
    coarse = log.clock_lag_s("scan", MOTION_ROLES[motion][0])
    before = log.settings
    log.settings = before._replace(offsets_s={**before.offsets_s, "scan": before.offsets_s.get("scan", 0.0) + coarse})
    try:
        found = offset_of(record(log, motion, drive))
    finally:
        log.settings = before
    return None if found is None else found._replace(seconds=found.seconds + coarse)
