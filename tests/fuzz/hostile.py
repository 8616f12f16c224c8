"""Structured hostile messages: a valid one with odd values, fields, types, order, text or header."""

import json
import random
from collections.abc import Callable
from typing import Any, Final

from tests.fuzz.mutations import mutated
from tis.common.messages import Header

MAX_TEXT: Final = 3000


class Raw(str):
    """A piece of JSON that is written as it stands."""

    __slots__ = ()


_NUMBERS: Final = (
    "0 -0.0 1 -1 0.5 5e-324 -5e-324 1e-300 -1e-160 1e-12 1e-7 1e-6 1e-3 6.3 -6.3 1e3 1e6 1e8 -1e8 5e8 1e9 -1e9 "
    "999999999.9999999 1000000000.0000001 1000000001 1e18 1e154 1e300 -1e308 1e400 NaN Infinity -Infinity "
    "2147483648 4294967295 4294967296 9007199254740993 4611686018427387904 4611686018427387905 "
    "-4611686018427387904 9223372036854775807 9223372036854775808 -9223372036854775808 18446744073709551616"
)
_OTHERS: Final = 'null true false "" "0" "1e9" "NaN" [] {} [0] [[]] {"x":0} "\\ud800" "\\u0000" "\xe9\U0001f600"'
_PARTS: Final = "0 -0.0 1 -1 0.7 5e-324 1e-300 1e-162 2e-162 1e-160 1e-9 9e-7 1e-6 2e-6 1e9 -1e9"

NUMBERS: Final = [
    *map(Raw, _NUMBERS.split()),
    *(Raw("9" * n) for n in (400, 4300, 4301)),
    Raw("0." + "3" * 2000),
]
OTHERS: Final = [
    *map(Raw, _OTHERS.split()),
    Raw(f'"{"x" * MAX_TEXT}"'),
    Raw("[" * 300 + "]" * 300),
    Raw('{"a":' * 300 + "1" + "}" * 300),
    Raw("[" * 100_000),
]
PARTS: Final = [*map(Raw, _PARTS.split())]
"""Parts of quaternions."""


def text_of(value: Any) -> str:
    """Return JSON of a value that may hold `Raw` pieces; a list of pairs in a dict's place repeats keys."""
    if isinstance(value, Raw):
        return value
    if isinstance(value, dict):
        return text_of(list(value.items())) if value else "{}"
    if isinstance(value, list | tuple):
        if value and all(isinstance(item, tuple) and isinstance(item[0], str) for item in value):
            return "{" + ",".join(f"{json.dumps(key)}:{text_of(item)}" for key, item in value) + "}"
        return "[" + ",".join(text_of(item) for item in value) + "]"
    return json.dumps(value)


def bytes_of(value: Any) -> bytes:
    """Return `text_of` as UTF-8."""
    return text_of(value).encode("utf-8", "surrogatepass")


def places(value: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all leaves of a nested value."""
    if isinstance(value, dict) and value:
        return [path for key, item in value.items() for path in places(item, (*above, key))]
    if isinstance(value, list) and value:
        return [path for at, item in enumerate(value) for path in places(item, (*above, at))]
    return [above] if above else []


def value_at(value: Any, path: tuple[Any, ...]) -> Any:
    """Return the value at a path."""
    for step in path:
        value = value[step]
    return value


def put(value: Any, path: tuple[Any, ...], new: Any) -> None:
    """Replace the value at a path."""
    for step in path[:-1]:
        value = value[step]
    value[path[-1]] = new


def an_extreme(rng: random.Random) -> Raw:
    """Return a number at the end of some range; seldom no number."""
    return rng.choice(NUMBERS if rng.random() < 0.85 else OTHERS)


def with_extremes(value: Any, rng: random.Random, chosen: Callable[[random.Random], Any] = an_extreme) -> Any:
    """Return a copy with one to three leaves replaced."""
    found = json.loads(json.dumps(value))
    paths = places(found)
    for _ in range(rng.choice((1, 1, 2, 3))):
        put(found, rng.choice(paths), chosen(rng))
    return found


_MANY: Final = b'{"history":[' + b"{}," * 80_000 + b"0]}"
"""More faults than anybody wants to know."""


def damaged(payload: bytes, rng: random.Random) -> bytes:
    """Return a payload that is cut, doubled, of another encoding, or mutated."""
    way = rng.randrange(6)
    if way == 0:
        return payload[: rng.randint(0, len(payload))]
    if way == 1:
        return payload + payload
    if way == 2:
        return b"\xff\xfe" + payload.decode("utf-8", "replace").encode("utf-16-le")
    if way == 3:
        return rng.choice(
            (b"", b"null", b"[]", b"0", b'""', b"\x00" * 40, b"[" * 50_000, b'{"sample_ns":' * 20_000, _MANY)
        )
    return mutated(payload, rng)


def odd_fields(value: dict[str, Any], rng: random.Random) -> Any:
    """Return a message with a field too few, too many, twice, or of another kind."""
    names = list(value)
    way = rng.randrange(4)
    if way == 0:
        return {name: item for name, item in value.items() if name != rng.choice(names)}
    if way == 1:
        return {**value, rng.choice(("extra", "", "x" * MAX_TEXT, "__class__", "sample_ns ")): 1}
    if way == 2:
        name = rng.choice(names)
        return [*value.items(), (name, rng.choice((value[name], an_extreme(rng))))]
    return {**value, rng.choice(names): rng.choice(OTHERS)}


def odd_header(header: Header, rng: random.Random) -> bytes:
    """Return the attachment of a message: wrong, ahead, behind, at an end, of another run, cut or extended."""
    seq, sent_ns, run_id = header
    way = rng.randrange(9)
    if way == 0:
        return Header(rng.choice((0, 1, 2**31, 2**32 - 1)), sent_ns, run_id).pack()
    if way == 1:
        return Header(max(0, seq + rng.choice((-1000, -1, 1, 2, 30, 40_000))), sent_ns, run_id).pack()
    if way in (2, 3):
        ends = (0, -1, 1, -(2**63), 2**63 - 1, 2**62, -(10**18))
        return Header(seq, rng.choice(ends), run_id).pack()
    if way == 4:
        return Header(seq, sent_ns, rng.choice((1, 2**32 - 1, run_id ^ 1))).pack()
    whole = header.pack()
    if way == 5:
        return whole[: rng.randint(0, len(whole))]
    if way == 6:
        return whole + b"\x00" * rng.choice((1, 4, 100_000))
    if way == 7:
        return mutated(whole, rng)
    return rng.choice((b"", b"tis", b"\x00" * 20, b"\xff" * 20))


def odd_rotation(rng: random.Random) -> dict[str, Any]:
    """Return a quaternion that is none, tiny, huge, of another length, or the opposite one."""
    if rng.random() < 0.5:
        return {name: rng.choice(PARTS) for name in "xyzw"}
    return {**dict.fromkeys("xyzw", Raw("0")), rng.choice("xyzw"): rng.choice(PARTS)}
