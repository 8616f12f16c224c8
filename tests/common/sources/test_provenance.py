from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.provenance import (
    RecordedRows,
    dump_played,
    in_words,
    parse_played,
    played_rows,
    training_rows,
)
from tis.common.sources.synthetic import synthesise, unmade_movement

_ROWS = st.builds(
    RecordedRows,
    label=st.just("Suturing_D002"),
    digest=st.sampled_from(["a", "b"]),
    first_row=st.integers(0, 30),
    n_rows=st.integers(1, 30),
    rate_hz=st.just(30),
)


@given(_ROWS, _ROWS)
def test_shared_rows_are_those_in_both(one: RecordedRows, other: RecordedRows) -> None:
    def numbers(rows: RecordedRows) -> set[tuple[str, int]]:
        return {(rows.digest, i) for i in range(rows.first_row, rows.first_row + rows.n_rows)}

    both = one.shared(other)
    assert (set() if both is None else numbers(both)) == numbers(one) & numbers(other)


def test_rows_in_words() -> None:
    rows = [RecordedRows(f"Suturing_B00{i}", str(i), 0, 100, 30) for i in range(8)]
    assert in_words(rows[:1]) == "rows 0-99 of Suturing_B000"
    assert in_words(rows[:2]) == "200 rows of 2 recordings: Suturing_B000, Suturing_B001"
    assert in_words(rows).endswith("Suturing_B005 and 2 more")
    assert in_words([]) == "rows that the file does not name"


def test_what_a_run_plays_and_what_it_was_trained_on_lie_side_by_side() -> None:
    recording = synthesise(SyntheticSource(kind="synthetic"), 3, 50, 161, 100)
    assert played_rows(recording, 60) == RecordedRows("synthetic surgeon, seed 3", "", 100, 61, 50)
    [trained] = training_rows([recording.head(100)])
    assert trained == RecordedRows("synthetic surgeon, seed 3", "", 0, 100, 50)
    assert trained.shared(played_rows(recording, 60)) is None
    rows, told = parse_played(dump_played(recording, 60).encode(), "a.mcap")
    assert rows == played_rows(recording, 60)
    assert (told["file"], told["warnings"]) == (None, list(recording.warnings))


def test_a_device_plays_no_rows() -> None:
    device = unmade_movement(LiveSource(kind="live"), 30)
    rows, _ = parse_played(dump_played(device, 60).encode(), "a.mcap")
    assert rows == RecordedRows("live device", "", 0, 0, 30)
