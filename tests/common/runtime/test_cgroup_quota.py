"""Literal cpu.max and cpu.stat, and groups within groups as folders."""

from pathlib import Path

import pytest

from tis.common.runtime.processor_watch import Quota, held_back, parse_quota, read_quotas

STAT = "usage_usec 5000\nuser_usec 3000\nsystem_usec 2000\nnr_periods 40\nnr_throttled 30\nthrottled_usec 2500\n"


def test_a_quota_is_so_many_processors() -> None:
    assert parse_quota("50000 100000\n", STAT) == Quota(0.5, 40, 30, 2_500_000)
    assert parse_quota("300000 100000\n", "usage_usec 1\n") == Quota(3.0, 0, 0, 0)


@pytest.mark.parametrize("limit", ["max 100000\n", "", "50000\n", "50000 0\n", "a b\n"])
def test_what_is_no_quota_limits_nothing(limit: str) -> None:
    assert parse_quota(limit, STAT) is None


def _group(folder: Path, limit: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cpu.max").write_text(limit)
    (folder / "cpu.stat").write_text(STAT)


def test_the_groups_around_a_process_limit_it_too(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("2:cpu:/elsewhere\n0::/slice/unit/inner\n")
    root = tmp_path / "fs"
    _group(root / "slice", "150000 100000")
    _group(root / "slice" / "unit", "max 100000")
    (root / "slice" / "unit" / "inner").mkdir()
    _group(root / "beside", "10000 100000")
    assert {name: quota.processors for name, quota in read_quotas(root, own).items()} == {"slice": 1.5}
    own.write_text("0::/\n")  # a container sees its own group as the outermost
    _group(root, "50000 100000")
    assert [quota.processors for quota in read_quotas(root, own).values()] == [0.5]


@pytest.mark.parametrize("text", [None, "1:cpu:/\n", "0::/gone\n", "0::/../outside\n", ""])
def test_where_no_group_is_seen_there_is_no_quota(tmp_path: Path, text: str | None) -> None:
    own = tmp_path / "own"
    if text is not None:
        own.write_text(text)
    assert read_quotas(tmp_path / "fs", own) == {}


def test_the_group_that_held_back_most_often_counts() -> None:
    before = {"a": Quota(2.0, 100, 10, 50), "b": Quota(0.5, 100, 10, 50), "gone": Quota(0.1, 0, 0, 0)}
    after = {"a": Quota(2.0, 140, 40, 950), "b": Quota(0.5, 140, 12, 60), "new": Quota(0.1, 9, 9, 9)}
    assert held_back(before, after) == Quota(2.0, 40, 30, 900)
    assert held_back(before, before) == Quota(0.1, 0, 0, 0)  # none did: the tightest
    assert held_back({}, after) is None
