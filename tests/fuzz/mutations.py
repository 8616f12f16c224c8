"""Mutations of a valid sample: flips, cuts, splices, wrong lengths, and values at the ends of their ranges."""

import random
import re
import struct

_LENGTHS = [0, 1, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1]
_NUMBERS = b"0 -1 1e308 1e400 NaN Infinity 4611686018427387905 9223372036854775807 9223372036854775808".split()
_VALUES = [*_NUMBERS, b"9" * 400, b"9" * 5000, b"null", b"true", b'""', b"[]", b"{}", b"[" * 300, b'{"a":' * 300]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def mutated(sample: bytes, rng: random.Random) -> bytes:
    """Return the sample with one to four mutations."""
    for _ in range(rng.randint(1, 4)):
        sample = rng.choice(_WAYS)(sample, rng)
    return sample


def _flip(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return data
    found = bytearray(data)
    found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _cut(data: bytes, rng: random.Random) -> bytes:
    begin, end = sorted(rng.randint(0, len(data)) for _ in range(2))
    return data[:begin] + data[end:] if rng.random() < 0.7 else data[:begin]


def _splice(data: bytes, rng: random.Random) -> bytes:
    begin, end, at = (rng.randint(0, len(data)) for _ in range(3))
    return data[:at] + data[min(begin, end) : max(begin, end)] + data[at:]


def _length(data: bytes, rng: random.Random) -> bytes:
    length, kind = rng.choice(_LENGTHS), rng.choice("HIQ")
    new = struct.pack(f"<{kind}", length % 2 ** (8 * struct.calcsize(kind)))
    at = rng.randint(0, len(data))
    return data[:at] + new + data[at + len(new) :]


def _value(data: bytes, rng: random.Random) -> bytes:
    """Replace a number of a text."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return data
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(_VALUES) + data[one.end() :]


def _text(data: bytes, rng: random.Random) -> bytes:
    """Replace a quoted text or insert a line."""
    found = list(re.finditer(rb'"[^"]*"', data)) or list(re.finditer(rb"[a-z_]+", data))
    if not found:
        return data
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(_VALUES) + data[one.end() :]


_WAYS = (_flip, _cut, _splice, _length, _value, _value, _text)
