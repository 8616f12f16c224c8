"""Columns of a log's content in memory: integers, texts, numbers and vectors, compressed where it pays."""

from array import array
from collections.abc import Iterable, Sequence
from itertools import chain
from operator import itemgetter
from types import NoneType
from typing import Any, Final, Literal, Protocol, get_args, get_origin

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tis.deploy.logs.blocks import MAX_NUMBER, MAX_WORD_CHARS, MAX_WORDS

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_CHUNK: Final = 4096
_SMALL: Final = (np.uint8, np.uint16, np.uint32)
_NO_INT: Final = -(1 << 63)


class Column(Protocol):
    """One field of N records."""

    def extend(self, values: Sequence[Any]) -> None:
        """Add values; raises `TypeError`, `ValueError` or `OverflowError` when one is not of the field."""

    def array(self) -> NDArray[Any]:
        """Return all values, (N,) or (N, axes), NaN for none."""

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some values as JSON has them, None for none."""

    def __len__(self) -> int:
        """Return the number of values."""


def integers(values: Iterable[int]) -> Ints:
    """Return the integers of records, (N,); raises `TypeError`, `OverflowError` or `ValueError` for anything else.

    `MAX_NUMBER` is the limit.
    """
    found = np.array(array("q", values), dtype=np.int64)
    if ((found > MAX_NUMBER) | (found < -MAX_NUMBER)).any():
        raise ValueError(f"an integer must be at most {MAX_NUMBER}")
    return found


def joined(parts: Iterable[NDArray[Any]], kind: DTypeLike = np.int64) -> NDArray[Any]:
    """Return arrays (N,) one after the other; an empty one of a kind without any."""
    return np.concatenate([np.empty(0, dtype=kind), *parts])


class IntColumn:
    """Integers or booleans, compressed: a full chunk is its minimum and small unsigned differences to it.

    This takes half the memory for instants, a quarter for counters, and none for what does not change. ``dtype`` is
    that of `array`; ``optional`` integers are float64 there. Oracle: a list, test_frame.
    """

    def __init__(self, dtype: DTypeLike = np.int64, optional: bool = False) -> None:
        self.dtype, self._optional = np.dtype(dtype), optional
        self._low: list[int] = []
        self._above: list[NDArray[Any]] = []
        self._rest = array("q")

    def extend(self, values: Sequence[Any] | NDArray[Any]) -> None:
        """Add values; those of an array may be any int64."""
        if isinstance(values, np.ndarray):
            ns = np.ascontiguousarray(values, dtype=np.int64)
        else:
            n_none = values.count(None) if self._optional else 0
            ns = integers([0 if value is None else value for value in values] if n_none else values)
            if n_none:
                ns[[value is None for value in values]] = _NO_INT
        # bytes go into the array directly, without an object per value
        self._rest.frombytes(ns.tobytes())
        if len(self._rest) >= _CHUNK:
            self._settle()

    def _settle(self) -> None:
        values = np.array(self._rest, dtype=np.int64)
        n_full = len(values) // _CHUNK
        for chunk in values[: n_full * _CHUNK].reshape(n_full, _CHUNK):
            low, high = int(chunk.min()), int(chunk.max())
            kind = next((kind for kind in _SMALL if high - low <= np.iinfo(kind).max), None)
            # a range beyond 32 bits may overflow 64 bits as a difference: stored as it is
            self._low.append(0 if kind is None else low)
            above: NDArray[Any] = chunk.copy() if kind is None else (chunk - low).astype(kind)
            self._above.append(above if high > low else above[:1].copy())
        self._rest = array("q", values[n_full * _CHUNK :].tobytes())

    def _stored(self, first: int, last: int) -> Ints:
        n_settled = len(self._low) * _CHUNK
        begin = first - first % _CHUNK
        found = np.empty(max(last - begin, 0), dtype=np.int64)
        for at in range(begin, min(last, n_settled), _CHUNK):
            place, above = found[at - begin : at - begin + _CHUNK], self._above[at // _CHUNK]
            place[:] = above[: len(place)]
            place += self._low[at // _CHUNK]
        if last > n_settled:
            found[max(n_settled - begin, 0) :] = self._rest[max(begin - n_settled, 0) : last - n_settled]
        return found[first - begin :]

    def array(self) -> NDArray[Any]:
        """Return all values (N,) as a new array."""
        ns = self._stored(0, len(self))
        return np.where(ns == _NO_INT, np.nan, ns) if self._optional else ns.astype(self.dtype, copy=False)

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some values."""
        ns = self._stored(first, last)
        values: list[Any] = ns.astype(self.dtype, copy=False).tolist()
        if self._optional:
            return [None if none else value for none, value in zip((ns == _NO_INT).tolist(), values, strict=True)]
        return values

    def __len__(self) -> int:
        return len(self._low) * _CHUNK + len(self._rest)


class WordColumn:
    """Texts of a few kinds, stored once each; with ``is_limited`` neither long ones nor many."""

    def __init__(self, is_limited: bool = True) -> None:
        self._is_limited = is_limited
        self._words: dict[str, int] = {}
        self._codes = IntColumn(np.int32)

    def extend(self, values: Sequence[Any]) -> None:
        """Add texts."""
        for word in dict.fromkeys(values):
            if not isinstance(word, str) or (self._is_limited and len(word) > MAX_WORD_CHARS):
                raise ValueError(f"a word must have at most {MAX_WORD_CHARS} characters")
            self._words.setdefault(word, len(self._words))
        if self._is_limited and len(self._words) > MAX_WORDS:
            raise ValueError(f"a field must have at most {MAX_WORDS} words")
        self._codes.extend(np.fromiter(map(self._words.__getitem__, values), np.int64, len(values)))

    def array(self) -> NDArray[Any]:
        """Return all texts (N,)."""
        return np.asarray(np.array([*self._words, ""], dtype=np.str_)[self._codes.array()])

    def equal(self, word: str) -> Flags:
        """Mark the records (N,) with a text, without building any text."""
        return np.asarray(self._codes.array() == self._words.get(word, -1))

    def at(self, which: Flags | Ints | slice) -> "WordColumn":
        """Return a selection of the texts, without building any."""
        found = WordColumn(self._is_limited)
        found._words = self._words
        found._codes.extend(self._codes.array()[which])
        return found

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some texts."""
        words = list(self._words)
        return [words[code] for code in self._codes.plain(first, last)]

    def __len__(self) -> int:
        return len(self._codes)


class RealColumn:
    """Numbers, or vectors with named axes; memory begins with the first value."""

    def __init__(self, axes: Sequence[str] = ()) -> None:
        self._axes, self._width = tuple(axes), len(axes) or 1
        self._values, self._length = array("d"), 0
        self._of_axes = itemgetter(*axes) if axes else None
        self._nothing: Any = dict.fromkeys(axes, np.nan) if axes else np.nan

    def extend(self, values: Sequence[Any]) -> None:
        """Add numbers, or a mapping by axis for each vector."""
        n_none = values.count(None)
        if self._values or n_none < len(values):
            self._values.extend((np.nan,) * (self._width * self._length - len(self._values)))
            known = [self._nothing if value is None else value for value in values] if n_none else values
            of_axes = self._of_axes
            self._values.extend(known if of_axes is None else chain.from_iterable(map(of_axes, known)))
        self._length += len(values)

    def array(self) -> NDArray[Any]:
        """Return all numbers (N,), or vectors (N, axes)."""
        shape = (self._length, self._width) if self._axes else (self._length,)
        return np.array(self._values, dtype=np.float64).reshape(shape) if self._values else np.full(shape, np.nan)

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some numbers, or a dict by axis for each vector."""
        if not self._values:
            return [None] * (last - first)
        numbers = self._values[first * self._width : last * self._width].tolist()
        if not self._axes:
            return [number if number == number else None for number in numbers]
        vectors = zip(*(iter(numbers),) * self._width, strict=True)
        return [dict(zip(self._axes, vector, strict=True)) if vector[0] == vector[0] else None for vector in vectors]

    def __len__(self) -> int:
        return self._length


class ArrayColumn:
    """An array as it is; one of objects takes the values of fields that no topic of this version declares."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._values = values

    def extend(self, values: Sequence[Any]) -> None:
        """Add values, by a copy of all."""
        self._values = np.concatenate([self._values, np.asarray(values, dtype=self._values.dtype)])

    def array(self) -> NDArray[Any]:
        """Return the array."""
        return self._values

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some values."""
        found: list[Any] = self._values[first:last].tolist()
        return found

    def __len__(self) -> int:
        return len(self._values)


def column_of(annotation: Any, is_limited: bool = True) -> Column:
    """Return an empty column for a field of a flat model, by its annotation."""
    kinds = [kind for kind in get_args(annotation) if kind is not NoneType]
    if get_origin(annotation) is Literal:
        return WordColumn(is_limited)
    if kinds:  # X | None
        (kind,) = kinds
        return IntColumn(kind, optional=True) if kind in (int, bool) else column_of(kind, is_limited)
    if annotation in (int, bool):
        return IntColumn(annotation)
    if annotation is float:
        return RealColumn()
    return WordColumn(is_limited) if annotation is str else RealColumn(annotation.__struct_fields__)
