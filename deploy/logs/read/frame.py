"""Records or messages as columns: the one container of a log's content in memory.

A dict takes 700 bytes or more per record; ten minutes at 1 kHz with four estimators would fill several GB.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any, Final, Self, get_type_hints, overload

import numpy as np
from msgspec.structs import fields
from numpy.typing import NDArray

from tis.common.topic import Topic
from tis.deploy.logs.payloads import Row
from tis.deploy.logs.read.columns import ArrayColumn, Column, Flags, IntColumn, Ints, WordColumn, column_of

_AT_ONCE: Final = 4096


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
        types = get_type_hints(topic.model)
        found = cls({name: column_of(types[name], topic.is_frequent) for name in topic.fields})
        found._defaults = {
            field.name: field.default
            for field in fields(topic.model)
            if field.name in topic.fields and not field.required
        }
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
            new = (name for name in names if name not in self._columns)
            self._columns |= {name: ArrayColumn(np.full(self._length, None, dtype=object)) for name in new}
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
        columns: dict[str, Column] = {
            name: one.at(which) if isinstance(one, WordColumn) else ArrayColumn(one.array()[which])
            for name, one in self._columns.items()
        }
        return type(self)(columns, self.keys)

    def first_of_each(self, name: str) -> Self:
        """Return the first record for each value of a field, ascending."""
        return self.at(np.unique(self.column(name), return_index=True)[1])

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
        for first in range(0, self._length, _AT_ONCE):
            yield from self._rows(first, min(first + _AT_ONCE, self._length))

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
