import pytest

from tis.common.errors import DataError
from tis.common.trace import parse_opportunities

MS = 1_000_000


def test_a_line_is_an_opportunity() -> None:
    found = parse_opportunities("0\n5\n 5 \r\n12\n", "cell.down")
    assert found.sent_ns.tolist() == [0, 5 * MS, 5 * MS, 12 * MS]
    assert found.delay_ns.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", ["cell.down: must have an opportunity later than 0 ms, for it repeats from there"]),
        ("0\n0\n", ["cell.down: must have an opportunity later than 0 ms, for it repeats from there"]),
        (
            "1\nx\n\n-4\n3.5\n",
            [f"cell.down: line {n}: must be a number of whole ms (got {got!r})" for n, got in
             ((2, "x"), (3, ""), (4, "-4"), (5, "3.5"))],
        ),
        ("7\n6\n8\n", ["cell.down: line 2: must be at least that of the line before (got '6')"]),
        ("9999999999999\n", ["cell.down: line 1: must be at most 1000000000 (got '9999999999999')"]),
    ],
)  # fmt: skip
def test_faults_are_told_together(text: str, faults: list[str]) -> None:
    with pytest.raises(DataError) as error:
        parse_opportunities(text, "cell.down")
    assert [str(fault) for fault in error.value.faults] == faults


def test_of_many_faults_the_first_are_told_and_the_others_counted() -> None:
    with pytest.raises(DataError) as error:
        parse_opportunities("x\n" * 1000, "cell.down")
    assert [str(fault) for fault in error.value.faults][10:] == ["cell.down: ... and 990 more"]
