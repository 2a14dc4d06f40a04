"""What is collected over hours comes back as it was."""

from typing import NamedTuple

import numpy as np
import pytest

from pfcli.core import rows
from pfcli.runs.info_rows import InfoRows


@pytest.mark.parametrize("count", [0, 1, rows._BLOCK - 1, rows._BLOCK, rows._BLOCK + 1, 3 * rows._BLOCK])
def test_rows_come_back_in_their_order(count: int) -> None:
    wanted = np.arange(3 * count, dtype=float).reshape(-1, 3)
    kept = rows.Rows((3,))
    kept.extend(wanted)
    assert len(kept) == count
    assert np.array_equal(kept.array(), wanted)
    if count:
        assert np.array_equal(kept.last(), wanted[-1])
        kept.set_last((7.0, 8.0, 9.0))
        assert kept.array()[-1].tolist() == [7.0, 8.0, 9.0]


class _Info(NamedTuple):
    t_ns: int
    x_m: float
    flag: bool
    name: str
    maybe: float | None


def test_infos_are_the_tuples_that_were_given() -> None:
    given = [_Info(1 << 62, np.nan, True, "a", None), _Info(-1, 1e300, np.bool_(False), "b", 2.5)]
    kept = InfoRows(_Info)
    for row in given:
        kept.append(row)
    assert len(kept) == 2
    assert repr(next(iter(kept))) == repr(given[0])
    assert kept[-1] == given[1]
    assert kept[:1][0].t_ns == 1 << 62
    assert isinstance(kept[1].flag, bool)
