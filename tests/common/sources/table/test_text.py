import pytest

from tis.common.errors import DataError
from tis.common.sources.table.text import read_columns, split_table


def faults_of(text: str, *wanted: str) -> list[str]:
    with pytest.raises(DataError) as caught:
        read_columns(split_table(text, "t.csv"), wanted, "t.csv")
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_numbers_by_name_whatever_separates_them(separator: str, end: str) -> None:
    lines = [
        "a, b,name".replace(",", separator),
        "1,2.5,x".replace(",", separator),
        "-3e2,nan,y".replace(",", separator),
    ]
    table = split_table(end.join(lines) + end + end, "t.csv")
    found = read_columns(table, ["b", "a"], "t.csv")
    assert table.names == ("a", "b", "name")
    assert found["a"].tolist() == [1.0, -300.0]
    assert found["b"][0] == 2.5


def test_quoted_cells_may_hold_separators() -> None:
    table = split_table('a,"b, c"\n1,"2"\n"3",4\n', "t.csv")
    assert read_columns(table, ["b, c"], "t.csv")["b, c"].tolist() == [2.0, 4.0]


def test_numbers_keep_all_digits() -> None:
    values = [0.1 + 0.2, 1e-300, 123456789.12345678]
    text = "a\n" + "\n".join(map(repr, values))
    assert read_columns(split_table(text, "t.csv"), ["a"], "t.csv")["a"].tolist() == values


def test_every_kind_of_damage_is_told_at_once() -> None:
    text = "a,b\n1,2\n1\n3,x\n1_0,4\n\n5,6,7\n"
    assert faults_of(text, "a", "b") == [
        "t.csv: line 3: must have 2 cells, as line 1 (got 1)",
        "t.csv: line 6: must have 2 cells, as line 1 (got 0)",
        "t.csv: line 7: must have 2 cells, as line 1 (got 3)",
        "t.csv: line 4, column b: must be a number (got 'x')",
        "t.csv: line 5, column a: must be a number (got '1_0')",
    ]


def test_many_faults_are_counted() -> None:
    found = faults_of("a\n" + "x\n" * 9, "a")
    assert len(found) == 6
    assert found[-1] == "t.csv: and 4 more rows: must be a number"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "t.csv: line 1: must hold the names of the columns (got '')"),
        ("a,b\n1,2\n", "t.csv: must have at least 2 rows (got 1)"),
        ("1,2\n3,4\n5,6\n", "t.csv: line 1: must hold the names of the columns, not numbers (got '1,2')"),
        ("a\n" + "1" * 300_000 + "\n2\n", "t.csv: line 2: must have at most 200000 characters (got 300000)"),
        ("\n" * 8_000_001, "t.csv: must have at most 4000000 rows (got 8000001)"),
    ],
)
def test_what_is_no_table_is_refused(text: str, expected: str) -> None:
    with pytest.raises(DataError) as caught:
        split_table(text, "t.csv")
    assert [str(fault) for fault in caught.value.faults] == [expected]
