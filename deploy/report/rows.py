"""Records that come by the hundred thousand: kept as columns, read as rows.

A dict for each takes 700 bytes and more; ten minutes at 1 kHz with four estimators would fill several GB.
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from common.messages import Message
from common.records import (
    ESTIMATES,
    FRESH,
    PLANT,
    PROMPT,
    TICKS,
    TRUTH,
    EstimateNote,
    FreshNote,
    PlantNote,
    PromptNote,
    TickNote,
    TruthRow,
)

Row = dict[str, Any]
Floats = NDArray[np.float64]

_MODELS: Final[Mapping[str, type[Message]]] = {
    TICKS: TickNote,
    TRUTH: TruthRow,
    FRESH: FreshNote,
    PLANT: PlantNote,
    PROMPT: PromptNote,
}
_NOWHERE: Final = (np.nan, np.nan, np.nan)
_INTS, _MAYBE, _FLAGS, _WORDS, _POINTS = "ints", "maybe", "flags", "words", "points"
_NO_INT: Final = -(1 << 63)


def column_model(topic: str) -> type[Message] | None:
    """Return the model of a topic whose records are kept as columns; None for all others."""
    return EstimateNote if topic.startswith(f"{ESTIMATES}/") else _MODELS.get(topic)


class Rows(Sequence[Row]):
    """Records of one flat model: a sequence of dicts made when asked for, over columns that can be had whole.

    Fields are integers or None, booleans, words, or points (x, y, z) or None. Oracle: the same records as plain
    dicts (tests/deploy/report/test_rows).
    """

    def __init__(self, model: type[Message]) -> None:
        self._kinds = {name: _kind(str(field.annotation)) for name, field in model.model_fields.items()}
        self._defaults = {
            name: field.default for name, field in model.model_fields.items() if not field.is_required()
        }
        self._columns: dict[str, array[Any]] = {name: array(_CODES[kind]) for name, kind in self._kinds.items()}
        self._words: dict[str, int] = {}
        self._length = 0

    def extend(self, rows: Iterable[Row]) -> None:
        """Add records; raises `LookupError`, `TypeError` or `ValueError` when one is not of the model."""
        taken = [{**self._defaults, **row} if len(row) < len(self._kinds) else row for row in rows]
        for name, kind in self._kinds.items():
            values = [row[name] for row in taken]
            column = self._columns[name]
            if kind == _POINTS:
                if not column and all(point is None for point in values):
                    continue  # a field that nobody fills takes no room
                column.extend(_NOWHERE * (self._length - len(column) // 3))
                for point in values:
                    column.extend(_NOWHERE if point is None else (point["x"], point["y"], point["z"]))
            elif kind == _MAYBE:
                column.extend([_NO_INT if value is None else value for value in values])
            elif kind == _WORDS:
                column.extend([self._words.setdefault(word, len(self._words)) for word in values])
            else:
                column.extend(values)
        self._length += len(taken)

    def append(self, row: Row) -> None:
        """Add one record."""
        self.extend((row,))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the fields' names."""
        return tuple(self._kinds)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column (N,): integers as int64, booleans as bool, words as an array of text; points are (N, 3).

        Where a point is None it is NaN; integers that may be None are float64, NaN for None.
        """
        kind, values = self._kinds[name], self._columns[name]
        if kind == _POINTS:
            if not values:
                return np.full((self._length, 3), np.nan)
            return np.array(values, dtype=np.float64).reshape(-1, 3)
        if kind == _WORDS:
            words = np.array([*self._words, ""], dtype=np.str_)
            return words[np.array(values, dtype=np.int64)]
        if kind == _MAYBE:
            ns = np.array(values, dtype=np.int64)
            return np.where(ns == _NO_INT, np.nan, ns)
        return np.array(values, dtype=np.bool_ if kind == _FLAGS else np.int64)

    def where(self, name: str, word: str) -> NDArray[np.bool_]:
        """Return which records (N,) hold ``word`` in a field of words."""
        return np.equal(np.array(self._columns[name], dtype=np.int64), self._words.get(word, -1))

    def with_columns(self, columns: Mapping[str, NDArray[np.int64]]) -> "Rows":
        """Return the records with other values in some fields of integers."""
        found = object.__new__(Rows)
        found.__dict__.update(self.__dict__)
        found._columns = {**self._columns, **{name: array("q", ns.tobytes()) for name, ns in columns.items()}}
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
        return next(self._made(range(at, at + 1)))

    def __iter__(self) -> Iterator[Row]:
        return self._made(range(self._length))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def _made(self, which: range) -> Iterator[Row]:
        words = list(self._words)
        columns = [(name, kind, self._columns[name]) for name, kind in self._kinds.items()]
        for i in which:
            row: Row = {}
            for name, kind, values in columns:
                if kind == _POINTS:
                    x, y, z = values[3 * i : 3 * i + 3] if values else _NOWHERE
                    row[name] = {"x": x, "y": y, "z": z} if x == x else None
                elif kind == _WORDS:
                    row[name] = words[values[i]]
                elif kind == _MAYBE:
                    row[name] = None if values[i] == _NO_INT else values[i]
                else:
                    row[name] = bool(values[i]) if kind == _FLAGS else values[i]
            yield row


_CODES: Final = {_INTS: "q", _MAYBE: "q", _FLAGS: "b", _WORDS: "h", _POINTS: "d"}


def _kind(annotation: str) -> str:
    if "Vector3" in annotation:
        return _POINTS
    if "bool" in annotation:
        return _FLAGS
    if "int" in annotation:
        return _MAYBE if "None" in annotation else _INTS
    return _WORDS
