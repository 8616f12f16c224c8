"""Records or messages as columns: the one container of a log's content in memory.

A dict takes 700 bytes or more per record; ten minutes at 1 kHz with four estimators would fill several GB.
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from operator import itemgetter
from types import NoneType
from typing import Annotated, Any, Final, Literal, Protocol, Self, get_args, get_origin, overload

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tis.common.topic import Topic
from tis.deploy.logs.json_rows import Row
from tis.deploy.logs.limits import MAX_NUMBER, MAX_WORD_CHARS, MAX_WORDS

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


class AnyColumn(list[Any]):
    """Values of a record that no topic of this version declares."""

    def array(self) -> NDArray[Any]:
        """Return all values (N,)."""
        return np.array(self, dtype=object)

    def plain(self, first: int, last: int) -> list[Any]:
        """Return some values."""
        return self[first:last]


class ArrayColumn:
    """An array, as it is."""

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
    if get_origin(annotation) is Annotated:
        return column_of(kinds[0], is_limited)
    if get_origin(annotation) is Literal:
        return WordColumn(is_limited)
    if kinds:  # X | None
        (kind,) = kinds
        return IntColumn(kind, optional=True) if kind in (int, bool) else column_of(kind, is_limited)
    if annotation in (int, bool):
        return IntColumn(annotation)
    if annotation is float:
        return RealColumn()
    return WordColumn(is_limited) if annotation is str else RealColumn(tuple(annotation.model_fields))


class Frame(Sequence[Row]):
    """N records as named columns, each an attribute: ``frame.seq``; and a sequence of dicts, built at access.

    A column is int64, bool or text (N,), vectors are (N, axes); numbers and optional integers are float64, NaN for
    None. ``keys`` are the texts of ``key``, where that column holds their numbers. Oracle: the same records as dicts
    (tests/deploy/logs/read/test_frame).
    """

    def __init__(self, columns: Mapping[str, Column], keys: tuple[str, ...] = ()) -> None:
        self._columns, self.keys = dict(columns), keys
        self._length = len(next(iter(columns.values()), ()))
        self._defaults: Row | None = None

    @classmethod
    def of(cls, topic: Topic | None) -> Self:
        """Return an empty frame for a topic's records; None: for those of an unknown one, with any fields."""
        if topic is None:
            return cls({})
        fields = {name: topic.model.model_fields[name] for name in topic.fields}
        found = cls({name: column_of(field.annotation, topic.is_frequent) for name, field in fields.items()})
        found._defaults = {name: field.default for name, field in fields.items() if not field.is_required()}
        return found

    @classmethod
    def of_arrays(cls, keys: tuple[str, ...] = (), /, **columns: NDArray[Any]) -> Self:
        """Return a frame of columns as they are, (N,) or (N, axes) each."""
        return cls({name: ArrayColumn(values) for name, values in columns.items()}, keys)

    def extend(self, rows: Sequence[Row]) -> None:
        """Add records; raises `LookupError`, `TypeError` or `ValueError` when one is not of the model."""
        if not rows:
            return
        if self._defaults is None:
            names = dict.fromkeys(name for row in rows for name in row)
            self._columns |= {name: AnyColumn([None] * self._length) for name in names if name not in self._columns}
            fields: Iterable[Sequence[Any]] = ([row.get(name) for row in rows] for name in self._columns)
        else:
            n, defaults = len(self._columns), self._defaults
            # fields with a default may be absent in the JSON
            taken = [{**defaults, **row} if len(row) < n else row for row in rows]
            # transposed once: columns are filled field by field, without a loop per record
            fields = list(zip(*map(itemgetter(*self._columns), taken), strict=True))
        for column, values in zip(self._columns.values(), fields, strict=True):
            column.extend(values)
        self._length += len(rows)

    def extend_columns(self, **columns: Ints) -> None:
        """Add integers of all columns, (N,) each."""
        for name, column in self._columns.items():
            column.extend(columns[name])  # type: ignore[arg-type]
        self._length += len(next(iter(columns.values())))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the fields' names."""
        return tuple(self._columns)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column, (N,) or (N, axes)."""
        return self._columns[name].array()

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("_") or name not in self._columns:
            raise AttributeError(name)
        return self._columns[name].array()

    def where(self, name: str, word: str) -> Flags:
        """Mark the records (N,) with ``word`` in a field of text."""
        column = self._columns[name]
        return column.equal(word) if isinstance(column, WordColumn) else np.asarray(column.array() == word)

    def at(self, which: Flags | Ints | slice) -> Self:
        """Return a selection; selecting all copies nothing."""
        if isinstance(which, np.ndarray) and which.dtype == np.bool_ and which.all():
            return self
        return type(self).of_arrays(self.keys, **{name: self.column(name)[which] for name in self._columns})

    def with_columns(self, **columns: NDArray[Any]) -> Self:
        """Return the records with some integer fields replaced; the others are shared."""
        found = type(self)(self._columns, self.keys)
        found._length, found._defaults = self._length, self._defaults
        for name, values in columns.items():
            known = self._columns.get(name)
            found._columns[name] = ArrayColumn(values)
            if isinstance(known, IntColumn):
                found._columns[name] = compact = IntColumn(known.dtype)
                compact.extend(values)
        return found

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> list[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | list[Row]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(self._length))]
        if not -self._length <= index < self._length:
            raise IndexError(index)
        at = index % self._length
        return next(self._rows(at, at + 1))

    def __iter__(self) -> Iterator[Row]:
        for first in range(0, self._length, _CHUNK):
            yield from self._rows(first, min(first + _CHUNK, self._length))

    def _rows(self, first: int, last: int) -> Iterator[Row]:
        names = tuple(self._columns)
        if not names:
            return iter([{}] * (last - first))
        values = zip(*(column.plain(first, last) for column in self._columns.values()), strict=True)
        return (dict(zip(names, row, strict=True)) for row in values)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return self is other or (len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True)))

    __hash__ = None  # type: ignore[assignment]
