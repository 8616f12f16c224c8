"""From netem's log to traces: hand-made batches, matched by sequence number."""

from pathlib import Path
from typing import Any

import pytest

from common.errors import DataError
from common.records import FATES, RELEASES, FateBatch, ReleaseBatch
from deploy.net import run_traces
from deploy.report.load import SideLog


def fates(key: str, seq: tuple[int, ...], offered_ns: tuple[int, ...], outcome: tuple[str, ...], **more: Any) -> Any:
    return FateBatch(
        direction="forward", key=key, seq=seq, offered_ns=offered_ns, outcome=outcome, **more
    ).model_dump(mode="json")


def releases(key: str, seq: tuple[int, ...], released_ns: tuple[int, ...], copies: tuple[int, ...]) -> Any:
    return ReleaseBatch(direction="forward", key=key, seq=seq, released_ns=released_ns, copy_index=copies).model_dump(
        mode="json"
    )


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    rows: dict[str, list[Any]] = {FATES: [], RELEASES: []}
    (tmp_path / "netem.mcap").touch()
    monkeypatch.setattr(run_traces, "load_side", lambda *_: SideLog("netem", None, {}, {}, rows))
    return rows


def test_delays_are_the_realised_ones_and_what_was_dropped_is_lost(tmp_path: Path, log: dict[str, list[Any]]) -> None:
    log[FATES] += [
        fates("k", (0, 1, 2), (100, 200, 300), ("deliver", "loss", "deliver")),
        fates("k", (3, 4, 5), (400, 500, 600), ("deliver", "outage", "deliver")),
    ]
    # 0 left, 2 left with a copy that left earlier, 3 was overtaken and dropped, 5 is still held
    log[RELEASES] += [releases("k", (0, 2, 2, 3), (150, 320, 390, 0), (0, 1, 0, 0))]
    found = run_traces.run_traces(tmp_path)
    assert list(found) == ["forward"]
    assert found["forward"].sent_ns.tolist() == [0, 100, 200, 300, 400]
    assert found["forward"].delay_ns.tolist() == [50, -1, 90, -1, -1]


def test_the_busiest_key_stands_for_its_direction_and_foreign_messages_for_nothing(
    tmp_path: Path, log: dict[str, list[Any]]
) -> None:
    log[FATES] += [
        fates("a", (0,), (10,), ("deliver",)),
        fates("b", (0, 1), (20, 30), ("deliver", "loss")),
        fates("c", (0, 1, 2), (20, 30, 40), ("deliver",) * 3, foreign=True),
    ]
    log[RELEASES] += [releases("a", (0,), (11,), (0,)), releases("b", (0,), (25,), (0,))]
    assert run_traces.run_traces(tmp_path)["forward"].delay_ns.tolist() == [5, -1]


def test_a_run_in_which_nothing_was_delivered_has_nothing_to_fit(tmp_path: Path, log: dict[str, list[Any]]) -> None:
    log[FATES] += [fates("k", (0, 1), (1, 2), ("loss", "outage"))]
    with pytest.raises(DataError, match="must have messages that netem delivered"):
        run_traces.run_traces(tmp_path)


def test_a_folder_without_a_log_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        run_traces.run_traces(tmp_path)
