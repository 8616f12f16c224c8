"""Commands ``tis net show``, ``set``, ``outage`` and ``reset``."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

from rich.console import Console

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.scenario.control import CLEARING, Acknowledgement, DirectionState, EmulatorState, profile_requests
from tis.deploy.net.control.change import check_paths, read_change
from tis.deploy.net.control.state_table import print_state
from tis.deploy.net.library.profiles import profile_path, read_profile
from tis.netem.expected.figures import direction_label

_BOTH: Final = ("both", *get_args(Direction))


def show(address: EmulatorAddress, out: Console, as_json: bool) -> int:
    """Print the state of a running emulator."""
    with connected(address) as remote:
        state = remote.state()
    if as_json:
        print(state.model_dump_json(exclude_none=True))  # noqa: T201
    else:
        print_state(state, address, out)
    return EXIT_OK


def set_change(
    address: EmulatorAddress, direction: str, settings: Sequence[str], yaml_text: str | None, times: dict[str, float],
    out: Console, as_json: bool,
) -> int:  # fmt: skip
    """Change one direction or both; partial stages are completed from the state in force."""
    check_direction(direction)
    check_paths(settings)
    with connected(address) as remote:
        requests = change_requests(remote.state(), direction, settings, yaml_text, times)
        return _report(remote.request("set", requests), out, as_json)


def change_requests(
    state: EmulatorState, direction: str, settings: Sequence[str], yaml_text: str | None = None,
    times: Mapping[str, float] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Return the requests that change one direction or both, completed from ``state``; raises `InputError`."""
    ways: dict[str, DirectionState | None] = {"forward": state.forward, "feedback": state.feedback}
    requests = []
    for named, now in ways.items():
        if now is not None and direction in (named, "both"):
            change = read_change(settings, yaml_text, now.now, f"tis net set: {named}")
            content = change.model_dump(mode="json", exclude_unset=True)
            requests.append({"direction": named, "change": content, **(times or {})})
    return requests


def set_profile(address: EmulatorAddress, name: str, out: Console, as_json: bool) -> int:
    """Apply a profile to both directions; the lookup happens here, so the emulator needs no library."""
    return request(address, "profile", profile_request(name), out, as_json)


def profile_request(name: str) -> dict[str, Any]:
    """Return the request that applies a profile to both directions; raises `InputError`."""
    try:
        path = profile_path(name)
    except LookupError as error:
        raise InputError(Fault("tis net set", "--profile", str(error.args[0]), name)) from None
    profile = read_profile(path)
    network = profile.partial()
    profile_requests(profile.name, network)  # raises for a profile that a running emulator refuses
    return {"profile": profile.name, "network": network}


def request(address: EmulatorAddress, operation: str, content: dict[str, Any], out: Console, as_json: bool) -> int:
    """Send a request and print the answer."""
    with connected(address) as remote:
        return _report(remote.request(operation, content), out, as_json)


def check_direction(direction: str) -> None:
    """Raise `InputError` unless it is a direction or ``both``."""
    if direction not in _BOTH:
        raise InputError(Fault("tis net", "direction", f"must be one of {', '.join(_BOTH)}", direction))


def _report(answer: Acknowledgement, out: Console, as_json: bool) -> int:
    if as_json:
        print(answer.model_dump_json(exclude_none=True))  # noqa: T201
        return EXIT_OK if answer.accepted else InputError.exit_code
    if not answer.accepted:
        raise InputError([Fault("netem", "", reason.removeprefix("control: ")) for reason in answer.reasons])
    out.print(f"accepted at {_s(answer.at_ns)} of run time")
    for one in answer.held:
        until = "" if one.until_ns is None else f" until {_s(one.until_ns)}"
        out.print(f"{direction_label(one.direction)}: in force from {_s(one.from_ns)}{until}")
    if answer.operation in CLEARING:
        out.print(f"earlier changes end at {_s(answer.from_ns)}")
    return EXIT_OK


def _s(instant_ns: int | None) -> str:
    return "?" if instant_ns is None else f"{instant_ns * 1e-9:.3f} s"
