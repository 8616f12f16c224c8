"""Who had the processors, as a table."""

from typing import Any

from msgspec import to_builtins

from tests.deploy.report.outline import Outline
from tests.deploy.report.partial import part
from tis.common.host_records import ProcessorNote
from tis.common.metrics.processor_shares import processor_shares
from tis.deploy.report.subjects.processors import ProcessorFigures, processor_table

S = 1_000_000_000
NOTE = ProcessorNote(
    from_ns=0, to_ns=10 * S, processors="0-1", own_ns=S, busy_ns=6 * S, idle_ns=8 * S, iowait_ns=S, steal_ns=5 * S,
)  # fmt: skip


def _entry(**changes: object) -> Any:
    shares = processor_shares(to_builtins(NOTE) | changes)
    assert shares is not None
    return part(ProcessorFigures, shares)


def test_a_side_without_a_note_has_dashes() -> None:
    page = Outline(processor_table({"surgeon": None, "netem": _entry()}).html())
    rows = [text for _, text in page.all("tr")]
    assert rows[1] == "surgeon" + "-" * 7
    assert rows[2] == "netem2" + "5.00" + "25.00" + "25.00" + "40.00" + "5.00" + "10.00"
    assert "quota" not in page.text.lower()


def test_what_is_not_counted_is_a_dash_and_no_zero() -> None:
    [_, row] = [text for _, text in Outline(processor_table({"netem": _entry(steal_ns=None)}).html()).all("tr")]
    assert row == "netem2" + "6.67" + "33.33" + "-" + "53.33" + "6.67" + "10.00"


def test_a_quota_has_columns_where_there_is_one() -> None:
    quota = _entry(quota_processors=0.5, n_periods=100, n_throttled=80, throttled_ns=S)
    page = Outline(processor_table({"netem": quota, "patient": _entry()}).html())
    rows = [text for _, text in page.all("tr")]
    assert rows[0].endswith("quotaheld back")
    assert rows[1].endswith("10.00" + "0.500" + "80.00")
    assert rows[2].endswith("10.00--")
    assert "Quota: the processor time" in page.text


def test_nothing_noted_needs_no_table() -> None:
    assert not processor_table({"surgeon": None, "netem": None, "patient": None}).rows
    assert not processor_table({}).rows
