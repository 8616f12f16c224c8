import pytest

from tis.common.errors import DataError
from tis.common.sources.table_text import read_columns, split_table


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;b\n1,5;-2,25e3\n0,123;4\n", [[1.5, 0.123], [-2250.0, 4.0]]),
        ("a\tb\n1,5\t2\n3\t4\n", [[1.5, 3.0], [2.0, 4.0]]),
        ("a;b\n1.5;2\n3;4\n", [[1.5, 3.0], [2.0, 4.0]]),
    ],
)
def test_decimals_have_a_point_or_a_comma(text: str, expected: list[list[float]]) -> None:
    found = read_columns(split_table(text, "t.csv"), ["a", "b"], "t.csv")
    assert [found["a"].tolist(), found["b"].tolist()] == expected


def test_a_point_in_a_date_is_no_decimal_mark() -> None:
    text = "t;x\n2026-03-29T01:59:59.5Z;-0,25\n2026-03-29T02:00:00.0Z;1,5\n"
    found = read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t")
    assert (found["t"].tolist(), found["x"].tolist()) == ([0.0, 0.5], [-0.25, 1.5])


@pytest.mark.parametrize(
    "text",
    [
        "t;x;note\n0,5;-0,25;v1.2\n1,5;1,5;ok\n",
        '"t";"x";"note"\n"0,5";"-0,25";"21.5; and more"\n"1,5";"1,5";"10.0.0.1"\n',
        "t;note;x\n2026-03-29T01:59:59.5Z;v1.2;-0,25\n2026-03-29T02:00:00.5Z;;1,5\n",
    ],
)
def test_a_point_in_a_column_that_is_not_read_decides_nothing(text: str) -> None:
    found = read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t")
    assert found["t"][1] - found["t"][0] == 1.0
    assert found["x"].tolist() == [-0.25, 1.5]


def test_the_cell_that_has_another_mark_is_told_and_no_other() -> None:
    text = "t;x\n0,5;-1.038,089\n1,5;1,5\n2,5;2.5\n"
    mark = "must be a number (decimals must all have points, or all commas)"
    assert faults_of(text, "t", "x") == [
        f"t.csv: line 2, column x: {mark} (got '-1.038,089')",
        f"t.csv: line 4, column x: {mark} (got '2.5')",
    ]


def test_dates_of_a_country_are_told_beside_decimal_commas() -> None:
    text = "t;x\n01.05.2026 14:00:00.000;0,5\n01.05.2026 14:00:00.010;1,5\n"
    with pytest.raises(DataError) as caught:
        read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t")
    assert [str(fault) for fault in caught.value.faults] == [
        "t.csv: line 2, column t: must be a number, or a time like 2026-03-29T14:00:00.5+02:00 "
        "(got '01.05.2026 14:00:00.000')"
    ]


def test_where_the_decimal_mark_is_not_known_it_is_told_what_to_do() -> None:
    [fault] = faults_of("a;b\n1,5;2.5\n3;4\n", "a", "b")
    assert (
        fault
        == "t.csv: line 2, column a: must be a number (decimals must all have points, or all commas) (got '1,5')"
    )
    found = faults_of("a,b\n1,5,2,5\n3,0,4,0\n", "a", "b")
    assert (
        "must have 2 cells, as line 1 (where the comma is the decimal mark, separate cells by semicolons)" in found[0]
    )


@pytest.mark.parametrize("offset", ["", "Z", "+02:00", "-0530"])
def test_times_may_be_dates(offset: str) -> None:
    dates = [
        f"2026-03-29T01:59:59.9{offset}",
        f"2026-03-29T02:00:00{offset}",
        f"2026-03-29 02:00:00.000000001{offset}",
    ]
    text = "\n".join(["t,x", *(f"{date},{k}" for k, date in enumerate(dates))])
    found = read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t")
    assert found["t"].tolist() == pytest.approx([0.0, 0.1, 0.100000001], abs=1e-12)
    in_ms = read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t", 1e-3)
    assert in_ms["t"].tolist() == pytest.approx([0.0, 100.0, 100.000001], abs=1e-9)
    assert found["x"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "second", ["2026-03-29T02:00:00+01:00", "now", "3", "2026-03-29", "29.03.2026 02:00:00", "9999-01-01T00:00:00Z"]
)
def test_dates_that_do_not_go_together_are_told(second: str) -> None:
    text = f"t,x\n2026-03-29T01:59:59Z,1\n{second},2\n"
    with pytest.raises(DataError, match=r"line 3, column t: must be a time like 2026-03-29T01:59:59Z, with the same"):
        read_columns(split_table(text, "t.csv"), ["t", "x"], "t.csv", "t")


@pytest.mark.parametrize(
    ("first", "expected"),
    [("2026-02-30T00:00:00Z", "times that there are"), ("29.03.2026", "must be a number")],
)
def test_times_that_are_no_dates_are_told(first: str, expected: str) -> None:
    with pytest.raises(DataError, match=f"column t: .*{expected}"):
        read_columns(split_table(f"t,x\n{first},1\n{first},2\n", "t.csv"), ["t", "x"], "t.csv", "t")
