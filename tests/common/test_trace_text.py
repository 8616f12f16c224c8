import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import DataError
from tis.common.trace import LOST, MAX_DELAY_NS, MAX_SENT_NS, Trace, parse_trace, render_trace

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
