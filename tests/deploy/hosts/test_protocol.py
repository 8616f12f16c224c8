"""Requests and answers as bytes that anybody may have made."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tis.common.errors import InputError
from tis.deploy.hosts.protocol import ListAnswer, ListRequest, RunRequest, event_in, line_of, printable, request_of

_SHA = "0" * 64


def test_a_request_is_read_as_it_was_sent() -> None:
    for request in (
        RunRequest(folder="~/w", side="netem", scenario="a: 1\n", run="20260102_030405_s", wait_s=3.0, insecure=True),
        ListRequest(folder=".", side="patient", run="r", parts={"patient.mcap": 5}),
    ):
        assert request_of(line_of(request)) == request


@pytest.mark.parametrize("run", ["..", "a/b", "", "-x", ".hidden", "a\n", "x" * 201])
def test_a_run_whose_name_leaves_its_folder_is_refused(run: str) -> None:
    line = json.dumps({"action": "list", "folder": ".", "side": "patient", "run": run}).encode()
    with pytest.raises(InputError, match="no request of this version"):
        request_of(line)


@given(
    st.binary(max_size=200) | st.recursive(st.none() | st.integers() | st.text(), st.lists).map(repr).map(str.encode)
)
def test_other_bytes_are_no_request_and_no_event(line: bytes) -> None:
    with pytest.raises(InputError):
        request_of(line)
    assert event_in(line, "netem") is None


def test_an_event_is_of_the_side_whose_host_sent_it_and_its_texts_are_one_line() -> None:
    line = json.dumps({"side": "netem", "event": "failed", "exit_code": 3, "reasons": ["a\x1b[2J\nb", "c"]}).encode()
    assert event_in(line, "patient") == {"side": "patient", "event": "failed", "reasons": ["a [2J b", "c"]}
    long = json.dumps({"event": "warning", "warning": "x" * 10_000}).encode()
    found = event_in(long, "patient")
    assert found is not None
    assert len(found["warning"]) == 500


@pytest.mark.parametrize(
    "more",
    [
        {"event": "progress", "now_s": "nan"},
        {"event": "progress", "now_s": 1e400},
        {"event": "progress", "now_s": 1, "counters": {"a": "b"}},
        {"event": "progress", "counters": {str(n): n for n in range(1000)}},
        {"event": "failed", "reasons": "x"},
        {"event": "exit", "code": 10**6},
        {"event": "unknown"},
        {},
    ],
)
def test_an_event_of_another_form_is_none(more: dict[str, Any]) -> None:
    assert event_in(json.dumps(more).encode(), "patient") is None


def test_a_progress_has_its_time_and_counters_even_when_the_line_has_not() -> None:
    assert event_in(b'{"event": "progress"}', "netem") == {
        "side": "netem", "event": "progress", "now_s": 0.0, "counters": {},
    }  # fmt: skip


@pytest.mark.parametrize(
    "log",
    [
        {"name": "../x.mcap", "n_bytes": 1, "sha256": _SHA},
        {"name": "netem.mcap", "n_bytes": -1, "sha256": _SHA},
        {"name": "netem.mcap", "n_bytes": 1 << 50, "sha256": _SHA},
        {"name": "netem.mcap", "n_bytes": 1, "sha256": "x"},
    ],
)
def test_an_offer_of_no_log_is_refused(log: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ListAnswer.model_validate_json(json.dumps({"logs": [log]}))


@given(st.text())
def test_printable_text_is_one_line_of_limited_length(text: str) -> None:
    line = printable(text)
    assert line.isprintable()
    assert len(line) <= 500
