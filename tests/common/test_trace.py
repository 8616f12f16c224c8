import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import DataError
from tis.common.trace import LOST, MAX_DELAY_NS, MAX_SENT_NS, Trace, parse_opportunities, parse_trace, render_trace


def _trace(sent_ns: list[int], delay_ns: list[int]) -> Trace:
    return Trace("walk", np.array(sent_ns, np.int64), np.array(delay_ns, np.int64))


def test_a_trace_may_lie_anywhere_within_its_bounds() -> None:
    trace = _trace([0, 5, 5, MAX_SENT_NS], [LOST, 0, MAX_DELAY_NS, LOST])
    assert trace.label == "walk"
    assert trace.about == {}
    assert len(_trace([0], [LOST]).sent_ns) == 1  # nothing came: a fact, though no scenario's trace


@pytest.mark.parametrize(
    ("sent_ns", "delay_ns", "fault"),
    [
        ([], [], "walk: must have at least one row"),
        ([0, 1], [5], "walk: must have as many delays as send times"),
        ([0, -1], [5, 5], "walk: row 1: sent_ns: must be between 0 and 1000000000000000 (got -1)"),
        ([MAX_SENT_NS + 1], [5], "row 0: sent_ns: must be between"),
        ([0, 7, 6], [5, 5, 5], "walk: row 2: sent_ns: must be at least that of the row before (got 6)"),
        ([0], [-2], "walk: row 0: delay_ns: must be between 0 and 3600000000000, or -1 where lost (got -2)"),
        ([0], [MAX_DELAY_NS + 1], "row 0: delay_ns: must be between"),
    ],
)
def test_what_is_no_trace_is_refused(sent_ns: list[int], delay_ns: list[int], fault: str) -> None:
    with pytest.raises(DataError, match=re.escape(fault)):
        _trace(sent_ns, delay_ns)


def test_faults_come_in_the_order_of_rows_and_only_the_first() -> None:
    with pytest.raises(DataError) as caught:
        _trace([0, *range(1000, 980, -1)], [-5] + [5] * 19 + [-9])
    lines = str(caught.value).split("\n")
    assert lines[0].startswith("walk: row 0: delay_ns")
    assert lines[1].startswith("walk: row 2: sent_ns")
    assert len(lines) == 11
    assert lines[-1] == "walk: ... and 11 more"


TEXT = """\
# host: west
# started: 2025-01-02T03:04:05Z
# path: tcp/127.0.0.1:7447, through one router

# a word to the reader
sent_s,delay_ms,seq
0,12.25,0
0.001,,1
 0.002 , 1.25e1 ,2
0.002,0
"""


def test_a_text_by_hand() -> None:
    trace = parse_trace(TEXT, "walk.csv")
    assert trace.label == "walk.csv"
    assert trace.sent_ns.tolist() == [0, 1_000_000, 2_000_000, 2_000_000]
    assert trace.delay_ns.tolist() == [12_250_000, LOST, 12_500_000, 0]
    assert trace.about == {
        "host": "west",
        "started": "2025-01-02T03:04:05Z",
        "path": "tcp/127.0.0.1:7447, through one router",
    }


def test_line_ends_and_marks_of_other_systems_are_read() -> None:
    assert parse_trace("\ufeff" + TEXT.replace("\n", "\r\n"), "w").delay_ns.tolist() == [
        12_250_000,
        LOST,
        12_500_000,
        0,
    ]


def test_a_rendered_text_by_hand() -> None:
    trace = Trace("w", np.array([0, 1_000_001]), np.array([LOST, 12_250_000]), {"rate_hz": "30", "path": "a\nb\x00c"})
    assert render_trace(trace) == "# rate_hz: 30\n# path: a b c\nsent_s,delay_ms\n0,\n0.001000001,12.25\n"


@given(
    rows=st.lists(
        st.tuples(st.integers(0, MAX_SENT_NS), st.one_of(st.just(LOST), st.integers(0, MAX_DELAY_NS))),
        max_size=20,
    ),
    about=st.dictionaries(
        st.from_regex(r"[a-z][a-z0-9_]{0,9}", fullmatch=True), st.text(st.characters(codec="utf-8"), max_size=20)
    ),
)
def test_what_was_rendered_is_read_back_to_the_ns(rows: list[tuple[int, int]], about: dict[str, str]) -> None:
    rows = [*sorted(rows), (MAX_SENT_NS, MAX_DELAY_NS)]
    sent_ns, delay_ns = np.array(rows, np.int64).T
    trace = Trace("w", sent_ns, delay_ns, about)
    read = parse_trace(render_trace(trace), "w")
    assert np.array_equal(read.sent_ns, trace.sent_ns)
    assert np.array_equal(read.delay_ns, trace.delay_ns)
    assert read.about.keys() == about.keys()
    assert render_trace(read) == render_trace(trace)


HEAD = "sent_s,delay_ms\n"


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", ["w: must have a line that names the columns: sent_s,delay_ms"]),
        ("# host: west\n", ["w: must have a line that names the columns: sent_s,delay_ms"]),
        ("0,1\n", ["w: line 1: must name the columns: sent_s,delay_ms (got '0,1')"]),
        ("delay_ms,sent_s\n0,1\n", ["w: line 1: must name the columns: sent_s,delay_ms (got 'delay_ms,sent_s')"]),
        ("# a: 1\n# a: 2\n" + HEAD + "0,1", ["w: line 2: must not repeat a key (got 'a')"]),
        (HEAD, ["w: must have at least one row"]),
        (HEAD + "0,\n1,\n", ["w: must have a delay_ms in at least one row: all messages are lost"]),
        (HEAD + "0,-0.5\n", ["w: line 2: delay_ms must be between 0 and 3600000 (got -0.5)"]),
        (HEAD + "0,-1e-6\n", ["w: line 2: delay_ms must be between 0 and 3600000 (got -1e-06)"]),
        (HEAD + "0,3600000.1\n", ["w: line 2: delay_ms must be between 0 and 3600000 (got 3600000.1)"]),
        (HEAD + "0,1e999\n", ["w: line 2: delay_ms must be between 0 and 3600000 (got inf)"]),
        (HEAD + "-1,5\n", ["w: line 2: sent_s must be between 0 and 1000000 (got -1.0)"]),
        (HEAD + "1000001,5\n", ["w: line 2: sent_s must be between 0 and 1000000 (got 1000001.0)"]),
        (HEAD + "1,5\n2,5\n1.5,5\n", ["w: line 4: sent_s must be at least 2, that of the row before (got 1.5)"]),
        (
            HEAD + "0,5\nnan,5\n0,inf\n0\n,5\n0,1_0\n0,5 ms\n0;5\n٣,5\n# host: x\n",
            [
                f"w: line {line}: must be two finite numbers, {HEAD[:-1]}, the second empty where lost (got {got!r})"
                for line, got in enumerate(
                    ["nan,5", "0,inf", "0", ",5", "0,1_0", "0,5 ms", "0;5", "٣,5", "# host: x"], start=3
                )
            ],
        ),
        (HEAD + "0,5\x00\n", ["w: line 2: must not have control characters (got '0,5\\x00')"]),
        (
            "# host: a\x1bb\n" + HEAD + "0,5\n",
            ["w: line 1: must not have control characters (got '# host: a\\x1bb')"],
        ),
    ],
)
def test_all_that_is_wrong_is_said_line_by_line(text: str, faults: list[str]) -> None:
    with pytest.raises(DataError) as caught:
        parse_trace(text, "w")
    assert str(caught.value).split("\n") == faults


@pytest.mark.parametrize("place", ["about", "head", "row"])
def test_a_megabyte_line_is_refused_in_few_words_and_at_once(place: str) -> None:
    long = "9" * 10_000_000
    text = {"about": f"# host: {long}\n{HEAD}0,1\n", "head": f"{long}\n", "row": f"{HEAD}0,1\n{long},{long}\n"}[place]
    begin = time.process_time()
    with pytest.raises(DataError, match=r"must have at most 5000 characters \(got \d+\)") as caught:
        parse_trace(text, "w")
    assert time.process_time() - begin < 2
    assert len(str(caught.value)) < 300


def test_of_many_faults_the_first_ten_are_named_and_the_others_counted() -> None:
    with pytest.raises(DataError) as caught:
        parse_trace(HEAD + "x,1\n" * 100_000, "w")
    lines = str(caught.value).split("\n")
    assert len(lines) == 11
    assert lines[9].startswith("w: line 11: ")
    assert lines[10] == "w: ... and 99990 more"


@given(st.text(alphabet="0123456789,.-+e \t\r\n#:snaif\x00delay_ms", max_size=80))
def test_whatever_the_text_the_answer_is_a_trace_or_a_data_error(rows: str) -> None:
    for text in (rows, HEAD + rows):
        try:
            trace = parse_trace(text, "w")
        except DataError as error:
            words = str(error)
            assert all(line.startswith("w: ") for line in words.split("\n"))
        else:
            assert (np.diff(trace.sent_ns) >= 0).all()
            assert (trace.delay_ns >= LOST).all()


def test_a_text_of_too_many_lines_is_refused() -> None:
    with pytest.raises(DataError, match="must have at most 5000000 rows"):
        parse_trace("\n" * 6_000_000, "a.csv")
    with pytest.raises(DataError, match="must have a line that names the columns"):
        parse_trace("# a\n" * 2000 + "sent_s,delay_ms\n0,1\n", "a.csv")


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
