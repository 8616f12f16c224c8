"""Cells beside each other: equal, within what was stated before, or told as different."""

import pytest

from tis.deploy.studies.reproduce.compared import agree, compare, counted, n_keys
from tis.deploy.studies.tables import Table, tables_in

PAGE = """# Delay

| estimator | 33 | 100 |
|---|---:|---:|
| hold | 1.000 | 1.000 |
| innovations_kf | 0.219 (0.21-0.23) | 0.330 (0.31-0.34) |
| old_kf | 0.3 | 0.4 |

| estimator | 33 | 100 |
|---|---:|---:|
| hold | 1.0 2.0 3.0 | 1.0 2.0 3.0 |
| innovations_kf | 1.0 2.0 3.0 | 1.0 2.0 3.0 |
| old_kf | 1.0 2.0 3.0 | 1.0 2.0 3.0 |

| estimator | µs a step, p50 |
|---|---:|
| hold | 1.36 |
"""


def never(table: Table, row: str, column: str) -> bool:
    return False


def in_us(table: Table, row: str, column: str) -> bool:
    return "µs" in column


@pytest.mark.parametrize(
    ("committed", "computed", "verdict"),
    [
        ("0.219", "0.219", "equal"),
        ("0.219", "0.220", "within"),  # a unit of the last digit
        ("0.219", "0.221", "differs"),
        ("59.4 (50.2-65.4)", "59.6 (50.3-65.4)", "within"),  # half a per cent
        ("59.4 (50.2-65.4)", "59.9 (50.3-65.4)", "differs"),
        ("1.000 (1.00-1.00)", "1.001 (1.00-1.00)", "differs"),  # never above the interval, which is none
        ("9.00 (8.99-9.01)", "9.02 (8.99-9.01)", "differs"),
        ("93.9-96.0", "93.9-96.1", "within"),
        ("93.9-96.0", "93.9", "differs"),
        ("-16.88 18.69 -7.10", "-16.88 18.69 7.10", "differs"),
        ("-1e+07 -3e+05 99.14", "-1e+07 -3e+05 99.14", "equal"),
        ("yes", "no", "differs"),
        ("none", "12", "differs"),
    ],
)
def test_two_cells(committed: str, computed: str, verdict: str) -> None:
    assert agree(committed, computed) == verdict


def _falsified(tables: list[Table], table: int, row: int, column: int, text: str) -> list[Table]:
    changed = [{**one, "rows": [list(each) for each in one["rows"]]} for one in tables]
    changed[table]["rows"][row][column] = text
    return changed


def test_one_falsified_cell_is_found_with_its_place() -> None:
    tables = tables_in(PAGE)
    committed = _falsified(tables, 0, 1, 2, "0.325 (0.31-0.34)")
    (found,) = [cell for cell in compare(committed, tables, in_us) if cell.verdict == "differs"]
    assert (found.table, found.heading, found.row, found.column) == (1, "Delay", "innovations_kf", "100")
    assert (found.committed, found.computed) == ("0.325 (0.31-0.34)", "0.330 (0.31-0.34)")


def test_machine_bound_cells_gone_estimators_and_what_was_not_computed_stand_apart() -> None:
    tables = tables_in(PAGE)
    cells = list(compare(tables, tables, in_us))
    assert counted(cells) == {"equal": 8, "gone": 4, "machine": 1}
    (part,) = tables_in("# Delay\n\n| estimator | 33 |\n|---|---:|\n| hold | 1.000 |\n")
    assert counted(list(compare(tables, [part], never))) == {"equal": 1, "left out": 8, "gone": 4}


def test_tables_of_one_heading_do_not_stand_for_each_other() -> None:
    tables = tables_in(PAGE)
    of_axes = list(compare(tables, tables[1:2], never))
    assert {cell.table for cell in of_axes if cell.verdict == "equal"} == {2}


def test_two_columns_of_one_name_are_compared_each_with_its_own() -> None:
    (table,) = tables_in(
        "## Turns\n\n| method | ratio | rad | ratio |\n|---|---|---|---|\n| a | 0.25 | 0.1 | 0.05 |\n"
    )
    assert [cell.verdict for cell in compare([table], [table], never)] == ["equal"] * 3


def test_rows_are_told_apart_by_as_few_cells_as_do() -> None:
    (table,) = tables_in("# A\n\n| row | reading | value |\n|---|---|---|\n| 1 | ms | 2 |\n| 1 | samples | 3 |\n")
    assert n_keys(table) == 2
