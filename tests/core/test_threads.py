import numpy as np
import pytest

from pfcli.core import threads


@pytest.fixture
def two_threads():
    threads.set_threads(2)
    yield
    threads.set_threads(0)


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_every_row_is_done_once_whatever_the_number_of_threads(count: int) -> None:
    done = np.zeros(13, int)

    def rows(low: int, high: int, out: np.ndarray) -> None:
        out[low:high] += 1

    threads.set_threads(count)
    threads.spread(rows, 13, done)
    threads.spread(rows, 13, done, least=5)
    threads.spread(rows, 13, done, least=100)
    threads.set_threads(0)
    assert (done == 3).all()


@pytest.mark.usefixtures("two_threads")
def test_an_error_in_another_thread_is_raised_here_and_the_next_call_works() -> None:
    def rows(low: int, high: int) -> None:
        if low > 0:
            raise ValueError(f"row {low}")

    with pytest.raises(ValueError, match="row 5"):
        threads.spread(rows, 10)
    threads.spread(lambda low, high: None, 10)
