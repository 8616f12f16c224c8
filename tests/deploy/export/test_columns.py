"""No column of an export is without its meaning, whatever was recorded."""

from pathlib import Path

import pytest

from tis.common import host_records, records
from tis.common.messages import Message
from tis.deploy.export.tables import columns_of, readme, table_meaning, tables
from tis.deploy.report import load

_RECORDS: dict[str, type[Message]] = {
    "patient_rejected": records.Rejected,
    "netem_queues": records.QueueNote,
    "netem_control": records.ControlNote,
    "patient_tick_phases": records.PhaseNote,
    "surgeon_counters": records.CounterNote,
    "surgeon_clock": host_records.ClockNote,
    "surgeon_clock_exchanges": host_records.ExchangeNote,
    "surgeon_clock_discipline": host_records.DisciplineNote,
    "netem_processors": host_records.ProcessorNote,
    "prompt_estimates": records.PromptNote,
}
_SPLIT = ("position_m", "std_m", "orientation", "turn_std_rad")
"""Fields that become a column for each axis."""
_TOPICS = {
    "rejected": records.REJECTED,
    "queues": records.QUEUES,
    "control": records.CONTROL,
    "tick_phases": records.PHASES,
    "counters": records.COUNTERS,
    "clock": host_records.CLOCK,
    "clock_exchanges": host_records.EXCHANGES,
    "clock_discipline": host_records.DISCIPLINE,
    "processors": host_records.PROCESSORS,
}


def test_every_column_of_a_run_is_explained(run_dir: Path, touch_dir: Path) -> None:
    found = {**dict(tables(load(run_dir))), **dict(tables(load(touch_dir)))}
    assert len(found) > 8
    for name, table in found.items():
        assert table_meaning(name), name
        assert [column.name for column in columns_of(name, list(table[0]())) if not column.meaning] == [], name


@pytest.mark.parametrize("table", _RECORDS)
def test_every_field_of_a_record_that_becomes_a_table_is_explained(table: str) -> None:
    names = [name for name in _RECORDS[table].__struct_fields__ if name not in _SPLIT]
    assert table_meaning(table)
    assert [column.name for column in columns_of(table, names) if not column.meaning] == []


def test_tables_are_named_after_the_topics_of_their_records() -> None:
    """As `tis.deploy.export.tables` does it: SIDE_TOPIC without /tis/."""
    for kind, topic in _TOPICS.items():
        assert topic.removeprefix("/tis/").replace("/", "_") == kind


def test_units_come_from_the_names() -> None:
    names = (
        "t_ns",
        "hold_x_m",
        "hold_error_mm",
        "n_bytes",
        "seq",
        "frequency_ppm",
        "maximum_error_us",
        "n",
        "force_x_n",
    )
    assert [column.unit for column in columns_of("x", names)] == ["ns", "m", "mm", "bytes", "", "ppm", "us", "", "N"]


def test_a_readme_says_what_is_lacking_and_what_the_trials_are() -> None:
    text = readme("Run of x", ["netem: log is missing"], {"ticks": ("tick",)}, (".csv", ".parquet"), True)
    for words in (
        "# Run of x",
        "incomplete: netem: log is missing",
        "## ticks.csv and ticks.parquet",
    ):
        assert words in text
    assert "| `tick` |  | Number of the tick, from 0. |" in text
    assert "`R002` has the same masters" in text
