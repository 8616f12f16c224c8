"""A summary.json and a manifest.json that somebody else wrote: any value in any place is shown, or is one line."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.deploy.commands import call
from tests.deploy.hold_only import HOLD

ODD: tuple[Any, ...] = (
    None, "x", "[/red] <script>", -1e308, 10**40, 0, True, [], [1], [None], {}, {"a": 1}, [["x"]], "9" * 500,
)  # fmt: skip


def _places(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value within a tree, of lists the first and the last item's only."""
    keys = tree if isinstance(tree, dict) else {0, len(tree) - 1} if isinstance(tree, list) and tree else ()
    for key in keys:
        yield (*path, key)
        yield from _places(tree[key], (*path, key))


def _with(tree: Any, path: tuple[Any, ...], value: Any) -> Any:
    changed = json.loads(json.dumps(tree))
    here = changed
    for key in path[:-1]:
        here = here[key]
    here[path[-1]] = value
    return changed


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run_dir = tmp_path_factory.mktemp("hostile") / "run"
    words = (*(f"--set={setting}" for setting in HOLD), "--no-report", "--no-merge")
    assert call("twin", "default", "--duration-s", "2.5", "--run-dir", str(run_dir), *words)[0] == 0
    return run_dir


@pytest.mark.parametrize("name", ["summary.json", "manifest.json"])
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_value_in_any_place_is_shown_or_is_one_line(name: str, copied: Path, data: st.DataObject) -> None:
    file = copied / name
    whole = file.read_text()
    tree = json.loads(whole)
    place = data.draw(st.sampled_from(sorted(_places(tree), key=repr)))
    changed = _with(tree, place, data.draw(st.sampled_from(ODD)))
    try:
        file.write_text(json.dumps(changed))
        for words in (("info", str(copied)), ("info", "-v", str(copied)), ("runs", str(copied.parent))):
            code, _, err = call(*words)
            assert code in (0, 4), (words, place, err)
            assert "Traceback" not in err
    finally:
        file.write_text(whole)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("latency_ms",), "x"),
        (("links", "forward", "verdict"), [1]),
        (("accuracy", "hold", "rmse_3d_mm"), "x"),
        (("problems",), [None]),
        (("verdicts",), {"a": 1}),
        (("identification",), "x"),
    ],
)
def test_a_report_and_a_merge_of_it_are_made_or_are_one_line(
    copied: Path, place: tuple[str, ...], value: object
) -> None:
    file = copied / "summary.json"
    whole = file.read_text()
    try:
        file.write_text(json.dumps(_with(json.loads(whole), place, value)))
        for command in ("report", "merge"):
            code, _, err = call(command, str(copied))
            assert code in (0, 4), err
            assert "Traceback" not in err
    finally:
        file.write_text(whole)
