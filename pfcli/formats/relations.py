"""Relations of the SLAM benchmark of Kuemmerle et al. 2009: `t1 t2 x y z roll pitch yaw`, keyed by stamp text."""

import math
from pathlib import Path

from pfcli.core.evaluation.relation_error import Relation
from pfcli.errors import LogError
from pfcli.formats import text_files


def read(path: Path) -> list[Relation]:
    """All relations of a file. Raises LogError naming the line that is wrong."""
    found = []
    for number, line in enumerate(text_files.lines(path, "relations"), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            x, y, yaw = float(words[2]), float(words[3]), float(words[7])
            if not math.isfinite(float(words[0]) + float(words[1]) + x + y + yaw):
                raise ValueError
        except (ValueError, IndexError):
            raise LogError(f"{path}: line {number} is not `t1 t2 x y z roll pitch yaw`") from None
        found.append(Relation(words[0], words[1], x, y, yaw))
    if not found:
        raise LogError(f"{path}: holds no relation")
    return found
