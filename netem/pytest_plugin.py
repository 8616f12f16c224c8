"""pytest's fixture ``tis_netem``: a bad network for a test of any Zenoh program, with the proof of what it did.

pytest finds it by itself once ``tis-testbed`` is installed; until a test asks for it, nothing else is imported.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

if TYPE_CHECKING:
    from tis.netem.bridge.between import Between

    Start = Callable[..., Between]

_CURE: Final = (
    "let programs be clients (mode: client) or switch their scouting off, and connect each to one network; "
    "tis_netem(..., may_bypass=True) accepts it"
)
_JUDGED: Final = {True: "as requested", False: "not as requested", None: "not decidable"}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for the folder of the proofs."""
    group = parser.getgroup("tis_netem", "networks of tis_netem")
    group.addoption(
        "--tis-netem-dir",
        metavar="DIR",
        type=Path,
        help="Folder for logs and summaries of the networks, by test; by default in the test's temporary folder.",
    )


@pytest.fixture(scope="session")
def tis_netem_shared(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> "Iterator[Start]":
    """Return a function as `tis_netem` is, whose networks last as long as pytest's session (with xdist, a worker's).

    Equal arguments start one network. It is for fixtures of the session, such as a program that runs all the time; a
    test asks for the same network by ``tis_netem(..., shared=True)``.
    """
    from tis.netem.bridge.between import between

    parent: Path | None = request.config.getoption("--tis-netem-dir")
    worker = os.environ.get("PYTEST_XDIST_WORKER", "of_all_tests")
    base = tmp_path_factory.mktemp("tis_netem") if parent is None else parent / worker
    started: dict[str, Between] = {}
    with ExitStack() as stack:

        def start(profile: str | None = None, may_bypass: bool = False, **arguments: Any) -> "Between":
            asked = repr((profile, sorted(arguments.items())))
            if asked not in started:
                started[asked] = stack.enter_context(between(profile, run_dir=_free(base), **arguments))
            started[asked].may_bypass |= may_bypass
            return started[asked]

        yield start
    if found := [text for net in started.values() for text in _bypassed(net)]:
        pytest.fail("\n".join(found), pytrace=False)


@pytest.fixture
def tis_netem(request: pytest.FixtureRequest, tmp_path: Path) -> "Iterator[Start]":
    """Return a function that starts a network: ``west, east = tis_netem("wifi_bad", seed=3)``.

    It takes the arguments of `tis.netem.bridge.between.between` but ``run_dir``, and may be called several times. The
    networks end with the test; the test's report then has a section on what each one did. A network that programs got
    round fails the test when it ends, unless it was asked for with ``may_bypass=True``.

    With ``shared=True`` the network is that of all tests of the session that ask for it by the same arguments: it
    starts once, ``counts()`` begins at zero with each test, and what a test has changed ends with the test.
    """
    from tis.netem.bridge.between import between

    parent: Path | None = request.config.getoption("--tis-netem-dir")
    base = tmp_path if parent is None else parent / _folder_name(request.node.nodeid)
    started: list[Between] = []
    found: list[str] = []
    with ExitStack() as stack:

        def start(
            profile: str | None = None, shared: bool = False, may_bypass: bool = False, **arguments: Any
        ) -> "Between":
            if shared:
                net: Between = request.getfixturevalue("tis_netem_shared")(profile, may_bypass, **arguments)
                net.count_anew()
                stack.callback(_leave, net, request.node, found)
            else:
                net = stack.enter_context(between(profile, run_dir=_free(base), **arguments))
                net.may_bypass = may_bypass
                started.append(net)
            request.node.user_properties.append(("tis_netem", str(net.run_dir)))
            return net

        yield start
    for net in started:
        request.node.add_report_section("teardown", "tis_netem", _proof(net))
        found += _bypassed(net)
    if found:
        pytest.fail("\n".join(found), pytrace=False)


def _leave(net: "Between", test: pytest.Item, found: list[str]) -> None:
    """Report what a shared network did in a test, add the ways past it to ``found``, and end the test's changes."""
    lines = [f"log, of all tests: {net.run_dir}"]
    for direction, counts in net.counts().items():
        causes = {name.removeprefix("dropped."): n for name, n in counts.items() if name.startswith("dropped.")}
        lines.append(f"{direction}: {_offered(counts['offered'], causes)}")
    test.add_report_section("teardown", "tis_netem", "\n".join(lines))
    if net.n_bypasses():
        found += _bypassed(net)
        net.may_bypass = True  # one test tells it
    net.reset()


def _bypassed(net: "Between") -> list[str]:
    """Return the ways past a network and their cure, unless they are accepted."""
    from tis.common.errors import problem

    return [] if net.may_bypass else [problem(text, _CURE) for text in net.bypasses]


def _folder_name(node_id: str) -> str:
    return "".join(char if char.isalnum() or char in "-_." else "_" for char in node_id)


def _free(base: Path) -> Path:
    """Return the first folder that does not exist yet."""
    number = 1
    while (base / f"netem_{number}").exists():
        number += 1
    return base / f"netem_{number}"


def _proof(net: "Between") -> str:
    """Return what a network did, a line for each direction."""
    lines = [f"log and summary: {net.run_dir}"]
    for direction, link in net.summary.get("links", {}).items():
        delay = link["delay_ms"]["realised"]["p50"]
        median = "" if delay is None else f", median delay {delay:.2f} ms"
        happened = _offered(link["offered"], link["dropped_by"])
        lines.append(f"{direction}: {_JUDGED[net.faithful[direction]]}, {happened}{median}")
    lines += [f"asked for while it ran: {text}" for text in net.summary.get("changes", ())]
    return "\n".join([*lines, *(f"problem: {text}" for text in net.summary.get("problems", ()))])


def _offered(n_offered: int, n_dropped: Mapping[str, int]) -> str:
    causes = ", ".join(f"{cause} {n}" for cause, n in n_dropped.items() if n)
    return f"{n_offered} messages offered, {sum(n_dropped.values())} dropped{f' ({causes})' if causes else ''}"
