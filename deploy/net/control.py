"""Commands ``tis net show``, ``set``, ``outage`` and ``reset``: parsing of settings, requests, state shown."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import dropwhile
from types import MappingProxyType
from typing import Any, Final, get_args

from pydantic import ValidationError
from rich.console import Console
from rich.markup import escape

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.scenario.control import (
    CLEARING,
    Acknowledgement,
    DirectionState,
    EmulatorState,
    RecentDelays,
    RuleState,
    profile_requests,
)
from tis.common.scenario.faults import faults
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.delay import QuantileDelay
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.scenario.overrides import KINDS, complete_stage
from tis.common.scenario.reading import apply_settings, parse_yaml
from tis.common.units import NS_PER_MS
from tis.deploy.net.profiles import profile_path, read_profile
from tis.deploy.present.table import PLAIN, Column, Table
from tis.netem.control.replay import entry_in_words, value_in_words, ways_past
from tis.netem.expected.synopsis import direction_label
from tis.netem.stages.delay import latency_of

_NONE: Final = "-"
_CHANGED: Final = " *"


def print_state(state: EmulatorState, address: EmulatorAddress, out: Console) -> None:
    """Print both directions side by side, the changes made while running, and the rules."""
    out.print(escape(f"{address}: run time {state.at_s or 0.0:.3f} s"), soft_wrap=True)
    out.print(state_table(state).terminal(PLAIN))
    for line in notes_on(state):
        out.print(escape(line), soft_wrap=True)


def state_table(state: EmulatorState) -> Table:
    """Return both directions side by side."""
    ways = _ways(state)
    columns = [Column(head, words=True, wraps=True) for head in ("", *map(direction_label, ways))]
    rows = [(name, *(_stage(of.pipeline, of.now, name) for of in ways.values())) for name in _names(ways.values())]
    rows += [(name, *cells) for name, cells in _rows(list(ways.values()))]
    return Table("", columns, rows)


def notes_on(state: EmulatorState) -> list[str]:
    """Return what stands below the table: ways past netem, marks, the changes made while running, and the rules."""
    ways = _ways(state)
    n_past = state.counters.get("leaks", 0)
    lines = [ways_past(n_past)] if n_past else []
    lines += ["* differs from what it began with"] if any(of.pipeline != of.now for of in ways.values()) else []
    lines += [f"changed, {name}: {entry_in_words(entry)}" for name, of in ways.items() for entry in of.added]
    return lines + [f"rule, {name}: {rule.key}: {_rule(rule)}" for name, of in ways.items() for rule in of.rules]


def _ways(state: EmulatorState) -> dict[Direction, DirectionState]:
    both: tuple[tuple[Direction, DirectionState | None], ...]
    both = (("forward", state.forward), ("feedback", state.feedback))
    return {name: of for name, of in both if of is not None}


def _names(ways: Iterable[DirectionState]) -> list[str]:
    pipelines = [pipeline for way in ways for pipeline in (way.pipeline, way.now)]
    return [name for name in Pipeline.model_fields if any(getattr(one, name) is not None for one in pipelines)]


def _rows(ways: list[DirectionState]) -> list[tuple[str, list[str]]]:
    rows = [("outage", ["yes" if way.outage else "no" for way in ways])]
    if any(way.stall for way in ways):
        rows.append(("stall", ["yes" if way.stall else "no" for way in ways]))
    if any(way.state for way in ways):
        rows.append(("state", [way.state or _NONE for way in ways]))
    if any(way.scale_rate != 1.0 for way in ways):
        rows.append(("bit rate", [f"x {way.scale_rate:g}" for way in ways]))
    if any((way.scale_delay, way.add_delay_ms) != (1.0, 0.0) for way in ways):
        rows.append(("each delay", [f"x {way.scale_delay:g} + {way.add_delay_ms:g} ms" for way in ways]))
    if any(way.add_p_loss for way in ways):
        rows.append(("further loss", [f"{way.add_p_loss:g}" for way in ways]))
    if any(way.until_s is not None for way in ways):
        rows.append(("next change", [_NONE if way.until_s is None else f"{way.until_s:.3f} s" for way in ways]))
    counts = {"offered": "offered", "released": "released", "held": "held_at_end"}
    counted = [(name, [str(way.counters.get(count, 0)) for way in ways]) for name, count in counts.items()]
    rows += [*counted, ("dropped", [_dropped(way.counters) for way in ways])]
    if within_s := next((way.delays.within_s for way in ways if way.delays), None):
        rows.append((f"p50 / p99, last {within_s:g} s", [_quantiles(way.delays) for way in ways]))
    return rows


def _quantiles(found: RecentDelays | None) -> str:
    return _NONE if found is None else f"{found.p50_ms:.2f} / {found.p99_ms:.2f} ms"


def _dropped(counters: Mapping[str, int]) -> str:
    found = [
        f"{name.removeprefix('dropped.')} {n}" for name, n in counters.items() if name.startswith("dropped.") and n
    ]
    return ", ".join(found) or "0"


def _stage(scenario: Pipeline, now: Pipeline, name: str) -> str:
    before, after = getattr(scenario, name), getattr(now, name)
    told = f" ({_figures(after)})" if isinstance(after, QuantileDelay) else ""
    return value_in_words(_plain(now).get(name)) + told + ("" if before == after else _CHANGED)


def _figures(delay: QuantileDelay) -> str:
    """Return what the points of a delay come to, before jitter."""
    latency = latency_of(Pipeline(delay=delay), {})
    mean_ms, p50_ms, p99_ms = (ns / NS_PER_MS for ns in (latency.mean_ns, *latency.quantiles_ns((0.5, 0.99))))
    return f"mean {mean_ms:.3g}, p50 {p50_ms:.3g}, p99 {p99_ms:.3g} ms"


def _rule(rule: RuleState) -> str:
    stages = [f"{name} {value_in_words(value)}" for name, value in _plain(rule.now).items() if name != "ordering"]
    return (", ".join(stages) or "no stage of its own") + ("" if rule.now == rule.pipeline else _CHANGED)


def _plain(pipeline: Pipeline) -> dict[str, Any]:
    return pipeline.model_dump(mode="json", exclude_defaults=True) | {"ordering": pipeline.ordering}


_LENGTH: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)(us|ms|s|min|h|)")
_ABOVE: Final = ("network", *get_args(Direction))
_SECONDS: Final = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "": 1.0, "min": 60.0, "h": 3600.0}


def seconds(text: str, option: str) -> float:
    """Return a duration in s, of a number of s or a text such as 500ms or 1.5min; raises `InputError`."""
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise InputError(
            Fault("tis net", option, "must be a duration in s, or with its unit such as 500ms or 1.5min", text)
        )
    return float(found[1]) * _SECONDS[found[2]]


def read_change(settings: Sequence[str], yaml_text: str | None, now: Pipeline, where: str = "tis net set") -> Change:
    """Return the change requested by ``yaml_text`` and the settings, which override it; raises `InputError`.

    A partial stage is completed from the one in force (``now``, `complete_stage`). All faults come at once.
    """
    check_paths(settings)
    raw = {} if yaml_text is None else parse_yaml(yaml_text, "--yaml")
    try:
        requested = apply_settings(raw, settings)
    except InputError as error:
        raise InputError([Fault(where, fault.field, fault.rule) for fault in error.faults]) from None
    current = now.model_dump(mode="json", exclude_none=True)
    whole = {
        stage: _completed(stage, given, current.get(stage), where) if isinstance(given, Mapping) else given
        for stage, given in requested.items()
    }
    try:
        return Change.model_validate(whole)
    except ValidationError as error:
        raise InputError(faults(error, Change, where)) from None


def check_paths(settings: Sequence[str]) -> None:
    """Raise `InputError` for settings that begin with the network or a direction, as in a scenario."""
    found = []
    for setting in settings:
        path, equals, _ = setting.partition("=")
        steps = path.split(".")
        rest = list(dropwhile(lambda step: step in _ABOVE, steps))
        if steps[0] in _ABOVE and rest and equals:
            rule = (
                f"must begin with the stage, did you mean {'.'.join(rest)!r}? The direction is an argument of its own"
            )
            found.append(Fault("tis net set", path, rule))
    if found:
        raise InputError(found)


def _completed(stage: str, given: Mapping[str, Any], current: Any, where: str) -> Mapping[str, Any]:
    if stage in KINDS:
        return complete_stage(stage, given, current, where)
    if stage == "rate" and isinstance(current, Mapping):  # one form replaces the other, and keeps the queue
        replaced = {"opportunities": {"kbit_s"}, "kbit_s": {"opportunities", "opportunity_bytes"}}
        gone = {name for form in given for name in replaced.get(form, ())}
        current = {name: value for name, value in current.items() if name not in gone}
    return _overlaid(current if isinstance(current, Mapping) else {}, given)


def _overlaid(beneath: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(beneath)
    for name, value in above.items():
        below = merged.get(name)
        both = isinstance(below, Mapping) and isinstance(value, Mapping)
        same_kind = both and value.get("kind", below.get("kind")) == below.get("kind")  # type: ignore[union-attr]
        merged[name] = _overlaid(below, value) if same_kind else value  # type: ignore[arg-type]
    return merged


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
        said = {one["direction"]: _in_words(one["change"]) for one in requests}
        return _report(remote.request("set", requests), address, out, as_json, said)


def _in_words(change: Mapping[str, Any]) -> str:
    return ": " + ", ".join(f"{name} {value_in_words(_without_null(value))}" for name, value in change.items())


def _without_null(value: Any) -> Any:
    return {name: one for name, one in value.items() if one is not None} if isinstance(value, Mapping) else value


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
        return _report(remote.request(operation, content), address, out, as_json)


def check_direction(direction: str) -> None:
    """Raise `InputError` unless it is a direction or ``both``."""
    if direction not in _BOTH:
        raise InputError(Fault("tis net", "direction", f"must be one of {', '.join(_BOTH)}", direction))


def _report(
    answer: Acknowledgement, address: EmulatorAddress, out: Console, as_json: bool,
    said: Mapping[str, str] = MappingProxyType({}),
) -> int:  # fmt: skip
    """Print an answer with who gave it, and of each direction what is ``said`` of its change."""
    if as_json:
        print(answer.model_dump_json(exclude_none=True))  # noqa: T201
        return EXIT_OK if answer.accepted else InputError.exit_code
    if not answer.accepted:
        raise InputError([Fault("netem", "", reason.removeprefix("control: ")) for reason in answer.reasons])
    out.print(escape(f"{address}: accepted at {_s(answer.at_ns)} of run time"), soft_wrap=True)
    for one in answer.held:
        until = "" if one.until_ns is None else f" until {_s(one.until_ns)}"
        words = f"in force from {_s(one.from_ns)}{until}{said.get(one.direction, '')}"
        out.print(escape(f"{direction_label(one.direction)}: {words}"), soft_wrap=True)
    if answer.operation in CLEARING:
        out.print(f"earlier changes end at {_s(answer.from_ns)}")
    return EXIT_OK


def _s(instant_ns: int | None) -> str:
    return "?" if instant_ns is None else f"{instant_ns * 1e-9:.3f} s"
