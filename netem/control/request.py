"""Reading of a request: from bytes to valid changes, or the reasons of its refusal. Nothing is changed.

The bytes are not trusted: JSON has a bounded size and depth, unique keys and no NaN.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any, Final, NamedTuple, NoReturn, get_args

from pydantic import ValidationError

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError, TisError
from tis.common.scenario.control import (
    SCHEMA,
    STATE,
    Operation,
    OutageRequest,
    ProfileRequest,
    ResetRequest,
    SetRequest,
    profile_requests,
)
from tis.common.scenario.faults import faults
from tis.common.scenario.network.capacity import RecordedRate
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.delay import TraceDelay
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.scenario.reading import Profiles
from tis.common.streams import Address
from tis.common.trace import OpportunityTrace, Trace
from tis.netem.conditions.conditions import merged
from tis.netem.link.link import Link
from tis.netem.stages.pipeline_draws import Draws

MAX_CHANGES: Final = 32
_MAX_REASONS: Final = 20
_MAX_REASON: Final = 300
_MAX_TEXT: Final = 200
_MAX_ID: Final = 100
_WHERE: Final = "control"


Adapt = Callable[[Change], Change]
MAX_BYTES: Final = 64 * 1024
_MAX_DEPTH: Final = 20


class Request(NamedTuple):
    """A parsed request: its changes, or the reasons of its refusal. ``text`` is its JSON for the log."""

    operation: str
    text: str
    id: str | None = None
    sets: tuple[SetRequest, ...] = ()
    reasons: tuple[str, ...] = ()


class Reader:
    """Reads requests to the links of an emulator. It needs no lock, since it reads only constant members.

    ``adapt`` returns a change as the emulator can make it, or raises `InputError`.
    """

    def __init__(self, links: Mapping[Direction, Link], library: Profiles | None, adapt: Adapt | None = None) -> None:
        self._links = links
        self._library = library
        self._adapt = adapt

    def read(self, operation: str, payload: bytes) -> Request:
        """Return a parsed request, or the reasons of its refusal (no payload raises: test_control)."""
        text = _shortened(payload)
        request_id = None
        try:
            _refuse_unknown(operation)
            raw = parse_request(payload or (b"{}" if operation == "reset" else b""))
            request_id = _id_of(raw)
            sets = self._sets(operation, raw)
            if self._adapt is not None:
                sets = tuple(one.model_copy(update={"change": self._adapt(one.change)}) for one in sets)
            _refuse_contradictions(sets)
            self._draw_once(sets)
        except InputError as error:
            return Request(operation, text, request_id, reasons=_reasons(error.faults))
        except RecursionError:
            return Request(operation, text, request_id, reasons=("control: is nested too deeply",))
        return Request(operation, text, request_id, sets)

    @staticmethod
    def unread(operation: str, n_bytes: int) -> Request:
        """Return the refusal of a request that is too large to read."""
        return Request(operation, "", reasons=_reasons(too_large(n_bytes).faults))

    def _sets(self, operation: str, raw: Any) -> tuple[SetRequest, ...]:
        match operation:
            case "set" if isinstance(raw, list):
                if not 1 <= len(raw) <= MAX_CHANGES:
                    raise InputError(Fault(_WHERE, "", f"must hold 1 to {MAX_CHANGES} changes", len(raw)))
                return _validated_list(raw)
            case "set":
                return (_validated(SetRequest, raw),)
            case "outage":
                return (_validated(OutageRequest, raw).as_set(),)
            case "reset":
                _validated(ResetRequest, raw)
                return ()
        return self._profile(_validated(ProfileRequest, raw))

    def _profile(self, request: ProfileRequest) -> tuple[SetRequest, ...]:
        if request.network is not None:
            return profile_requests(request.profile, request.network, request.id)
        if self._library is None:
            raise InputError(Fault(_WHERE, "profile", "cannot be looked up: this emulator has no library"))
        try:
            network = self._library(request.profile)
        except LookupError as error:
            raise InputError(Fault(_WHERE, "profile", str(error.args[0]), request.profile)) from None
        return profile_requests(request.profile, network, request.id)

    def _draw_once(self, sets: Sequence[SetRequest]) -> None:
        """Draw once from every pipeline after the changes, so that an error shows now and not at a packet."""
        self._refuse_unknown_traces(sets)
        for one in sets:
            for direction in directions_of(one.direction):
                rules = self._links[direction].rules
                for pipeline in {rules.default, Pipeline(), *(pipeline for _, pipeline in rules.rules)}:
                    self._draw(pipeline, one.change, direction)

    def _refuse_unknown_traces(self, sets: Sequence[SetRequest]) -> None:
        found = []
        for place, one in enumerate(sets):
            known = set.intersection(*(set(self._links[name].traces) for name in directions_of(one.direction)))
            traces = self._links[directions_of(one.direction)[0]].traces
            for field, path, kind in _files_of(one.change):
                if path not in known or type(traces[path]) is not kind:
                    rule = "must be a trace that the scenario names: no file is read while it runs"
                    found.append(Fault(_WHERE, f"{place}." * (len(sets) > 1) + f"change.{field}", rule, path))
        if found:
            raise InputError(found)

    def _draw(self, pipeline: Pipeline, change: Change, direction: Direction) -> None:
        stages = merged(pipeline, (change,))
        try:
            Draws(stages, Address(0, direction, _WHERE), self._links[direction].traces).decide(0, 0, 1)
        except (ArithmeticError, ValueError, RuntimeWarning, TisError) as error:
            raise InputError(Fault(_WHERE, "change", f"cannot be drawn from: {error}")) from None


def directions_of(direction: str) -> tuple[Direction, ...]:
    """Return the directions of ``forward``, ``feedback`` or ``both``."""
    return tuple(name for name in get_args(Direction) if direction in (name, "both"))


def _files_of(change: Change) -> list[tuple[str, str, type[Trace]]]:
    """Return the field, the path and the format of each recording that a change names."""
    models = {"delay": change.delay, "loss": change.loss}
    found: list[tuple[str, str, type[Trace]]] = [
        (f"{stage}.path", model.path, Trace)
        for stage, model in models.items()
        if isinstance(model, TraceDelay | TraceLoss)
    ]
    if isinstance(change.rate, RecordedRate):
        found.append(("rate.opportunities", change.rate.opportunities, OpportunityTrace))
    return found


def _refuse_unknown(operation: str) -> None:
    if operation not in get_args(Operation):
        rule = f"must be one of {', '.join(get_args(Operation))}; {STATE} and {SCHEMA} tell more"
        raise InputError(Fault(_WHERE, "operation", rule, operation))


def _validated(model: type[Any], raw: Any) -> Any:
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        raise InputError(faults(error, model, _WHERE)) from None


def _validated_list(raw: Sequence[Any]) -> tuple[SetRequest, ...]:
    found: list[Fault] = []
    sets: list[SetRequest] = []
    for place, item in enumerate(raw):
        try:
            sets.append(_validated(SetRequest, item))
        except InputError as error:
            found += [
                Fault(fault.where, f"{place}.{fault.field}".rstrip("."), fault.rule, fault.got)
                for fault in error.faults
            ]
    if found:
        raise InputError(found)
    return tuple(sets)


def _refuse_contradictions(sets: Sequence[SetRequest]) -> None:
    found = []
    for (i, one), (j, two) in combinations(enumerate(sets), 2):
        shared = set(directions_of(one.direction)) & set(directions_of(two.direction))
        twice = sorted(one.change.model_fields_set & two.change.model_fields_set)
        if shared and twice and one.at_s == two.at_s:
            what = " and ".join(twice)
            found.append(Fault(_WHERE, f"{j}.change", f"must not set {what} at the same time as change {i} does"))
    if found:
        raise InputError(found)


def _id_of(raw: Any) -> str | None:
    """Return the id of a request, or of its first change that has one, also for a refusal."""
    candidates = raw if isinstance(raw, list) else [raw]
    ids = (item.get("id") for item in candidates if isinstance(item, dict))
    found = next((one for one in ids if isinstance(one, str)), None)
    return None if found is None or len(found) > _MAX_ID or not found.isprintable() else found


def _reasons(found: Sequence[Fault]) -> tuple[str, ...]:
    lines = [_clean(str(fault))[:_MAX_REASON] for fault in found[:_MAX_REASONS]]
    left = len(found) - len(lines)
    return (*lines, f"control: and {left} more") if left else tuple(lines)


def _shortened(payload: bytes) -> str:
    text = _clean(payload[: 4 * _MAX_TEXT].decode("utf-8", "backslashreplace"))
    return text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]}..."


def _clean(text: str) -> str:
    """Return text that JSON can carry: without unpaired surrogates."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def parse_request(payload: bytes) -> Any:
    """Return the value of a request's JSON; raises `InputError` with the reason, and no other error."""
    if len(payload) > MAX_BYTES:
        raise too_large(len(payload))
    try:
        value = json.loads(payload.decode("utf-8"), object_pairs_hook=_mapping, parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be UTF-8; byte {error.start} is not")) from None
    except json.JSONDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be JSON: {error.msg} at character {error.pos}")) from None
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # an integer of thousands of digits, or a duplicate key
        reason, _, _ = str(error).partition(";")
        raise InputError(Fault(_WHERE, "", f"must be JSON: {reason}")) from None
    _check_depth(value)
    return value


def too_large(n_bytes: int) -> InputError:
    """Return the error for a request of ``n_bytes``, which need not be read."""
    return InputError(Fault(_WHERE, "", f"must have at most {MAX_BYTES} bytes", n_bytes))


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"key {key[:80]!r} stands twice")
        found[key] = value
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _check_depth(value: Any) -> None:
    level, depth = [value], 0
    while level:
        depth += 1
        if depth > _MAX_DEPTH:
            raise _too_deep()
        below = (item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list))
        level = [item for items in below for item in items]


def _too_deep() -> InputError:
    return InputError(Fault(_WHERE, "", f"must be nested at most {_MAX_DEPTH} levels deep"))
