"""pytest's fixture ``tis_netem``: a bad network for a test of any Zenoh program, with the proof of what it did.

pytest finds it by itself once ``tis-testbed`` is installed; until a test asks for it, nothing else is imported.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

if TYPE_CHECKING:
    from tis.netem.bridge.between import Between

    Start = Callable[..., Between]

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


@pytest.fixture
def tis_netem(request: pytest.FixtureRequest, tmp_path: Path) -> "Iterator[Start]":
    """Return a function that starts a network: ``west, east = tis_netem("wifi_bad", seed=3)``.

    It takes the arguments of `tis.netem.bridge.between.between` but ``run_dir``, and may be called several times. The
    networks end with the test; the test's report then has a section on what each one did.
    """
    from tis.netem.bridge.between import between

    parent: Path | None = request.config.getoption("--tis-netem-dir")
    base = tmp_path if parent is None else parent / _folder_name(request.node.nodeid)
    started: list[Between] = []
    with ExitStack() as stack:

        def start(profile: str | None = None, **arguments: Any) -> "Between":
            net = stack.enter_context(between(profile, run_dir=_free(base), **arguments))
            started.append(net)
            request.node.user_properties.append(("tis_netem", str(net.run_dir)))
            return net

        yield start
    for net in started:
        request.node.add_report_section("teardown", "tis_netem", _proof(net))


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
        causes = ", ".join(f"{cause} {n}" for cause, n in link["dropped_by"].items() if n)
        lines.append(
            f"{direction}: {_JUDGED[net.faithful[direction]]}, {link['offered']} messages offered, "
            f"{link['dropped']} dropped{f' ({causes})' if causes else ''}{median}"
        )
    lines += [f"asked for while it ran: {text}" for text in net.summary.get("changes", ())]
    return "\n".join([*lines, *(f"problem: {text}" for text in net.summary.get("problems", ()))])
