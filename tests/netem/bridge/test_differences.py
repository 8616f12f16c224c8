"""The bridge and the carriage of bytes beside a native router: what differs is what the manual's table says."""

import json
import os
import re
import subprocess
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from tests.common.runtime.live_zenoh import a_client, a_router
from tests.netem.bridge.live_bridge import a_bridge, bridging, carrying, delays
from tests.netem.bridge.scenarios import SCENARIOS, Between, crosses_after, outcomes
from tis.common.channels import Network
from tis.common.runtime.ports import free_endpoints

pytestmark = pytest.mark.live

_ROOT = Path(__file__).resolve().parents[3]
_PAGE = _ROOT / "docs" / "emulator" / "transparency.md"
_ATTEMPTS = 3
_ROW = re.compile(r"^\| `(\w+)` \|", re.MULTILINE)


class _Router:
    """A router that can be started again."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self._stack = ExitStack()
        self._stack.enter_context(a_router(endpoint))

    def restart(self) -> None:
        self.close()
        self._stack.enter_context(a_router(self.endpoint))

    def close(self) -> None:
        self._stack.close()


@contextmanager
def _routed(endpoint: str) -> Iterator[_Router]:
    router = _Router(endpoint)
    try:
        yield router
    finally:
        router.close()


@contextmanager
def _native() -> Iterator[tuple[Between, _Router]]:
    endpoint, _ = free_endpoints()
    with _routed(endpoint) as router, a_client(endpoint) as west, a_client(endpoint) as east:
        yield Between(west, east, endpoint, endpoint), router


@contextmanager
def _bridged(delay_ms: float) -> Iterator[Between]:
    with a_bridge(**delays(delay_ms)) as there:
        yield Between(there.west, there.east, there.endpoints["west"], there.endpoints["east"])


@contextmanager
def _bridged_to_a_router() -> Iterator[tuple[Between, _Router]]:
    """A bridge that is a client of the router in the east."""
    west_end, east_end = free_endpoints()
    with a_router(west_end) as west, _routed(east_end) as router, a_client(east_end) as east:
        ends: dict[Network, str] = {"west": west_end, "east": east_end}
        with bridging({"west": west, "east": east}, ends, probes=False) as there:
            yield Between(there.west, there.east, west_end, east_end), router


@contextmanager
def _carried(delay_ms: float) -> Iterator[tuple[Between, _Router]]:
    _, east_end = free_endpoints()
    host, port = east_end.removeprefix("tcp/").split(":")
    with _routed(east_end) as router, carrying((host, int(port)), **delays(delay_ms)) as (_, _, ours):
        west_end = f"tcp/{ours[0]}:{ours[1]}"
        with a_client(west_end) as west, a_client(east_end) as east:
            yield Between(west, east, west_end, east_end), router


Outcomes = Callable[[Between, Collection[str]], dict[str, Any]]


@pytest.fixture(scope="module")
def native() -> dict[str, Any]:
    return _reference(outcomes)


@pytest.fixture(scope="module")
def others() -> Outcomes:
    """Return what runs the scenarios with clients of another version of Zenoh."""
    python = os.environ.get("TIS_ZENOH_OTHER")
    if python is None:
        pytest.skip("TIS_ZENOH_OTHER names no Python that has another version of Zenoh")

    def run(there: Between, names: Collection[str]) -> dict[str, Any]:
        words = [python, "-m", "tests.netem.bridge.scenarios", there.west_end, there.east_end, *names]
        done = subprocess.run(words, capture_output=True, text=True, cwd=_ROOT, check=True)
        told = json.loads(done.stdout)
        assert told["zenoh"] != version("eclipse-zenoh"), "it should be another version"
        found: dict[str, Any] = told["outcomes"]
        return found

    return run


def _reference(run: Outcomes, names: Collection[str] = SCENARIOS) -> dict[str, Any]:
    with _native() as (there, _):
        return run(there, names)


def _differing(
    native: dict[str, Any],
    expected: set[str],
    network: Callable[[], AbstractContextManager[Between]],
    run: Outcomes = outcomes,
) -> dict[str, Any]:
    """Return what differs from the native router; the unexpected thrice: a busy machine may be late once."""
    differing: dict[str, Any] = {}
    names: Collection[str] = SCENARIOS
    for _ in range(_ATTEMPTS):
        with network() as there:
            found = run(there, names)
        late = {name: (native[name], found[name]) for name in names if native[name] != found[name]}
        differing = {name: told for name, told in differing.items() if name not in names} | late
        names = differing.keys() - expected
        if not names:
            break
        native = _reference(run, names)
    return differing


def test_there_is_enough_to_compare(native: dict[str, Any]) -> None:
    assert len(SCENARIOS) == 32  # the manual gives their number
    failed = {name: told for name, told in native.items() if isinstance(told, str)}
    assert not failed


@pytest.mark.parametrize("delay_ms", [0.0, 50.0])
def test_the_bridge_differs_where_the_manual_says_so(native: dict[str, Any], delay_ms: float) -> None:
    expected = set(_ROW.findall(_PAGE.read_text()))
    differing = _differing(native, expected, lambda: _bridged(delay_ms))
    unexpected = {name: differing[name] for name in differing.keys() - expected}
    assert not unexpected
    assert set(differing) == expected


@contextmanager
def _carried_alone(delay_ms: float) -> Iterator[Between]:
    with _carried(delay_ms) as (there, _):
        yield there


@pytest.mark.parametrize("delay_ms", [0.0, 50.0])
def test_bytes_that_are_carried_differ_in_nothing(native: dict[str, Any], delay_ms: float) -> None:
    assert _differing(native, set(), lambda: _carried_alone(delay_ms)) == {}


def test_clients_of_another_version_find_the_same_differences(others: Outcomes) -> None:
    """Their router is this version's, as the bridge is."""
    native, expected = _reference(others), set(_ROW.findall(_PAGE.read_text()))
    assert not {name: told for name, told in native.items() if isinstance(told, str)}
    assert set(_differing(native, expected, lambda: _bridged(50.0), others)) == expected
    assert _differing(native, set(), lambda: _carried_alone(50.0), others) == {}


@pytest.mark.parametrize(
    "network", [_native, _bridged_to_a_router, lambda: _carried(0.0)], ids=["native", "bridge", "carry"]
)
def test_everything_crosses_again_after_a_router_has_restarted(
    network: Callable[[], AbstractContextManager[tuple[Between, _Router]]],
) -> None:
    with network() as (there, router):
        assert crosses_after(there, router.restart) == (True, True, True)
