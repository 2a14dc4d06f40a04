"""Which topics of a log play which role in a run, where motion comes from, and by which clock the scans count."""

from pathlib import Path

from pfcli.dropped import Dropped
from pfcli.errors import LogError, UsageError, printable
from pfcli.findings import Finding
from pfcli.replay import align
from pfcli.replay.log import Log
from pfcli.replay.settings import Drive
from pfcli.systems.shared.contract import System


def set_clock(log: Log, motion: str, drive: Drive, dropped: Dropped) -> None:
    """Estimate the offset of the scans' clock, and use it. Raises LogError where the drive does not tell it."""
    from pfcli.replay.clock_check import scan_offset

    found = scan_offset(log, motion, drive)
    if found is None:
        raise LogError(
            f"{log.path}: --time-offset scan=auto: the drive turns too little, or its scans fit too badly, to tell the offset;"
            " give seconds"
        )
    seconds = round(found.seconds, 3)
    log.settings = log.settings._replace(offsets_s={**log.settings.offsets_s, "scan": seconds})
    seen = (
        f"the scans' stamps are {-seconds:.3f} s late against the motion, +- {found.sd_s:.4f} s by {found.turns} turns"
    )
    dropped.find(
        Finding(
            code="W107",
            severity="note",
            where="",
            seen=seen,
            effect="corrected",
            way_out=f"--time-offset scan={seconds}",
        )
    )


def motion_source(log: Log, wanted: str) -> str:
    """Where motion comes from: as asked, else the first of odometry, encoders, twist that the log has; transforms on /tf where
    it has nothing else but commands."""
    found = next((role for role in ("odometry", "encoders", "twist") if log.choose(role)), None)
    if wanted == "odometry" or (wanted == "auto" and (found is None or (found == "twist" and log.only_commands()))):
        return "odometry" if log.take_transforms() or wanted != "auto" else found or "odometry"
    return wanted if wanted != "auto" else found or "odometry"


def _reading(system: System, log: Log) -> str:
    """Which sensor of the system's needs is read: the one that --topic names, else the first that the log has."""
    kinds = [kind for need in system.needs for kind in need if kind != "motion"]
    named = [kind for kind in kinds if kind in log.settings.topics]
    return next((kind for kind in named or kinds if log.choose(kind)), kinds[0])


def roles_of(system: System, log: Log, motion: str, truth: str | None) -> list[str]:
    """Roles that a run reads. Raises UsageError that names what is missing, what the log has and the flag that maps one."""
    reading = _reading(system, log)
    roles = [*align.ROLES[motion], reading]
    if motion == "imu":
        roles += [r for r in ("twist", "odometry") if log.choose(r)][:1]
    for role in roles:
        if log.choose(role) is None:
            have = (
                ", ".join(f"{printable(t)} ({printable(s) or 'no schema'})" for t, s in log.topics().items())
                or "nothing"
            )
            raise UsageError(
                f"{log.path}: {system.name} needs {_NOUNS.get(role, role)}, and the log has {have}{log.damage};"
                f" map a topic with --topic {role}=TOPIC"
                + (" or choose --motion" if role in align.ROLES[motion] else "")
            )
    roles += [r for r in (*system.wants, "source_stamp") if r != reading and log.choose(r)]
    if truth is not None and not Path(truth).is_file():
        if truth not in ("auto", ""):
            _name_truth(log, truth)
        if log.choose("truth") is None:
            raise UsageError(
                f"{log.path}: --truth: the log has no truth topic; name one, or a file (TUM, EuRoC, KITTI, CSV)"
            )
        roles.append("truth")
    return roles


_NOUNS = {
    "odometry": "odometry",
    "scan": "laser scans",
    "range": "range finders",
    "imu": "an IMU",
    "encoders": "wheel encoders",
    "lines": "points of field lines or landmarks",
}


def _name_truth(log: Log, name: str) -> None:
    """Read truth from this topic; what is none may have been meant as a file."""
    topic = "/tf" if name.lstrip("/").startswith("tf:") else name
    if topic not in log.topics():
        have = ", ".join(printable(t) for t in log.topics()) or "none"
        raise UsageError(
            f"{log.path}: --truth {printable(name)} is neither a file nor a topic; the log has {have}{log.damage}"
        )
    log.settings = log.settings._replace(topics={**log.settings.topics, "truth": name})
