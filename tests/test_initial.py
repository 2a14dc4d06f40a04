import pytest

from pfcli.errors import UsageError
from pfcli.initial import Initial, parse


def test_a_pose_with_and_without_its_spread() -> None:
    assert parse("1,2,0.5") == Initial("pose", (1.0, 2.0, 0.5))
    assert parse("1,2,0.5,0.1").sd == (0.1, 0.25, 0.1)
    assert parse("1,2,0.5,0.1,0.2,0.3").sd == (0.1, 0.2, 0.3)


def test_words_regions_and_heading_priors() -> None:
    assert parse("outside").kind == "outside"
    assert str(parse("region:rooms/a.yaml").region) == "rooms/a.yaml"
    assert parse("unknown", "1.5").heading == (1.5, 0.2)
    assert parse("inside", "1.5,0.1").heading == (1.5, 0.1)


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "1,2,nan", "1,2,3,-1", "somewhere", "1,2,3,4,5,6,7"])
def test_nonsense_is_refused_with_the_flag(text: str) -> None:
    with pytest.raises(UsageError, match="--initial"):
        parse(text)


def test_a_pose_has_its_heading_already() -> None:
    with pytest.raises(UsageError, match="--heading-prior"):
        parse("1,2,3", "0.5")
