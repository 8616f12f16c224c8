"""Requests to `tis host` on a host, and its answers: one line of JSON each, checked on both sides.

A request names all that it needs, so that a host keeps no state between two of them. An answer may come from anybody
who has taken the host over: sizes, names and types are checked before use.
"""

import json
import re
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from tis.common.channels import Side
from tis.common.errors import Fault, InputError
from tis.common.yaml_text import MAX_YAML_BYTES
from tis.deploy.hosts.log_offer import LogName, OfferedLog
from tis.deploy.shell.outcome import Event

MAX_REQUEST_BYTES: Final = 2 * MAX_YAML_BYTES
MAX_LINE_BYTES: Final = 1 << 16
ALIVE: Final = "alive"
INTERRUPT: Final = "interrupt"
ALIVE_EVERY_S: Final = 5.0
MAX_SILENCE_S: Final = 30.0
"""After it a side takes the connection to `tis up` for gone, and ends; outages of a run are shorter."""

_MAX_TEXT_CHARS: Final = 500
_MAX_REASONS: Final = 20
_MAX_COUNTERS: Final = 200

RUN_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,199}")
RunName = Annotated[str, StringConstraints(pattern=f"^{RUN_NAME.pattern}$")]
_Text = Annotated[str, StringConstraints(max_length=MAX_YAML_BYTES)]


class _Request(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class CheckRequest(_Request):
    """Asks for the faults of all that a side needs on its host."""

    action: Literal["check"] = "check"
    folder: str
    side: Side
    scenario: _Text


class RunRequest(_Request):
    """Starts a side, which ends with the connection that started it."""

    action: Literal["run"] = "run"
    folder: str
    side: Side
    scenario: _Text
    run: RunName
    wait_s: float = Field(ge=0, le=86_400)
    insecure: bool = False


class RunsRequest(_Request):
    """Asks for the runs of which the host has a side's folder."""

    action: Literal["runs"] = "runs"
    folder: str
    side: Side


class ListRequest(_Request):
    """Asks for the logs of a run; ``parts`` are the sizes of what was fetched before, by name."""

    action: Literal["list"] = "list"
    folder: str
    side: Side
    run: RunName
    parts: dict[LogName, Annotated[int, Field(ge=0)]] = Field(default={}, max_length=100)


class ReadRequest(_Request):
    """Asks for the bytes of a log from ``begin`` to before ``end``."""

    action: Literal["read"] = "read"
    folder: str
    side: Side
    run: RunName
    name: LogName
    begin: int = Field(ge=0)
    end: int = Field(ge=0)


AnyRequest = CheckRequest | RunRequest | RunsRequest | ListRequest | ReadRequest
_REQUEST: Final[TypeAdapter[AnyRequest]] = TypeAdapter(Annotated[AnyRequest, Field(discriminator="action")])


class _Answer(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class CheckAnswer(_Answer):
    """The version of a host's `tis`, and the faults that it found."""

    version: Annotated[str, StringConstraints(max_length=_MAX_TEXT_CHARS)]
    faults: tuple[Annotated[str, StringConstraints(max_length=2000)], ...] = Field(max_length=500)


class RunsAnswer(_Answer):
    """Names of runs, the oldest first."""

    runs: tuple[RunName, ...] = Field(max_length=100_000)


class ListAnswer(_Answer):
    """The logs of a run on a host."""

    logs: tuple[OfferedLog, ...] = Field(max_length=100)


def request_of(line: bytes) -> AnyRequest:
    """Return the request in a line; raises `InputError`."""
    try:
        return _REQUEST.validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"]))
        raise InputError(Fault("tis host", field, f"is no request of this version: {first['msg']}")) from None


class _Status(_Answer):
    """An event of a side, whatever else a line holds."""

    event: Literal[
        "waiting", "ready", "running", "warning", "progress", "ended", "failed", "output", "exit"
    ]  # fmt: skip
    whom: str = ""
    duration_s: float = Field(0.0, ge=0, le=1e6, allow_inf_nan=False)
    warning: str = ""
    kind: Literal["bypass"] | None = None
    now_s: float = Field(0.0, allow_inf_nan=False)
    counters: dict[str, int] = Field(default={}, max_length=_MAX_COUNTERS)
    reasons: tuple[str, ...] = Field((), max_length=_MAX_REASONS)
    text: str = ""
    code: int = Field(0, ge=-255, le=255)


def event_in(line: bytes, side: Side) -> Event | None:
    """Return the event of a side in a line of its host; None for any other output.

    Texts are one printable line of limited length each.
    """
    try:
        found = _Status.model_validate_json(line)
    except ValidationError:
        return None
    event: dict[str, Any] = found.model_dump(exclude_unset=True) | {"side": side}
    for name in ("whom", "warning", "text"):
        if name in event:
            event[name] = printable(event[name])
    if found.event == "failed":
        event["reasons"] = [printable(reason) for reason in found.reasons]
    if found.event == "progress":
        event["counters"] = found.counters
        event["now_s"] = found.now_s
    return event


def printable(text: str) -> str:
    """Return foreign text as one line of limited length, without control characters."""
    line = "".join(letter if letter.isprintable() else " " for letter in text[: 4 * _MAX_TEXT_CHARS])
    return " ".join(line.split())[:_MAX_TEXT_CHARS]


def line_of(message: BaseModel | dict[str, Any]) -> bytes:
    """Return a message as its line."""
    text = message.model_dump_json() if isinstance(message, BaseModel) else json.dumps(message)
    return text.encode() + b"\n"
