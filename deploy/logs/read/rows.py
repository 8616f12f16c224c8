"""Frequent records, stored as columns and read as rows.

A dict takes 700 bytes or more per record; ten minutes at 1 kHz with four estimators would fill several GB.
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from operator import itemgetter
from typing import Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, is_predicted, is_set_point
from tis.common.messages import Message, SafetyMode, Vector3
from tis.common.records import (
    ESTIMATES,
    FRESH,
    ORIENTATIONS,
    PLANT,
    PROMPT,
    TICKS,
    TRUTH,
    EstimateNote,
    FreshNote,
    OrientationNote,
    PlantNote,
    PromptNote,
    TickNote,
    TruthRow,
)
from tis.deploy.logs.json_rows import Row
from tis.deploy.logs.read.compact_ints import CompactInts, integers

_MODELS: Final[Mapping[str, type[Message]]] = {
    TICKS: TickNote,
    TRUTH: TruthRow,
    FRESH: FreshNote,
    PLANT: PlantNote,
    PROMPT: PromptNote,
}


class SetPointRow(Message):
    """The part of a `tis.common.messages.SetPoint` that is scored and drawn."""

    sample_ns: int
    position_m: Vector3
    hand: Hand
    tick: int
    mode: SafetyMode


class PredictedRow(Message):
    """The part of a `tis.common.messages.PredictedPose` that is scored and exported."""

    sample_ns: int
    position_m: Vector3
    hand: Hand
    tick: int
    shown_tick: int
    shown_m: Vector3
    command_ns: int
    round_trip_ns: int


_INTS, _MAYBE, _FLAGS, _WORDS, _REALS, _POINTS, _TURNS = "ints", "maybe", "flags", "words", "reals", "points", "turns"
_AXES: Final[Mapping[str, str]] = {_POINTS: "xyz", _TURNS: "xyzw"}
_OF_AXES: Final = {kind: itemgetter(*axes) for kind, axes in _AXES.items()}
_NO_POINT: Final = {kind: dict.fromkeys(axes, np.nan) for kind, axes in _AXES.items()}
_NO_INT: Final = -(1 << 63)
_MAX_WORD_CHARS: Final = 256  # of a name or a key; a column of words takes as much for each of its rows


def column_model(topic: str) -> type[Message] | None:
    """Return the model of a topic whose records are kept as columns; None for all others."""
    if topic.startswith("/"):
        if topic.startswith(f"{ORIENTATIONS}/"):
            return OrientationNote
        return EstimateNote if topic.startswith(f"{ESTIMATES}/") else _MODELS.get(topic)
    if is_predicted(topic):
        return PredictedRow
    return SetPointRow if is_set_point(topic) else None


class Rows(Sequence[Row]):
    """Records of one flat model: a sequence of dicts, built at access, over columns.

    Fields are integers or None, booleans, words, numbers or None, and points (x, y, z) or quaternions (x, y, z, w) or
    None. Oracle: the same records as plain
    dicts (tests/deploy/logs/read/test_rows).
    """

    def __init__(self, model: type[Message]) -> None:
        self._kinds = {name: _kind(str(field.annotation)) for name, field in model.model_fields.items()}
        self._defaults = {
            name: field.default for name, field in model.model_fields.items() if not field.is_required()
        }
        self._values = itemgetter(*self._kinds)
        self._columns = {name: array(_CODES[kind]) for name, kind in self._kinds.items() if kind in _CODES}
        self._ints = {name: CompactInts() for name, kind in self._kinds.items() if kind not in _CODES}
        self._words: dict[str, int] = {}
        self._length = 0

    def extend(self, rows: Iterable[Row]) -> None:
        """Add records; raises `LookupError`, `TypeError` or `ValueError` when one is not of the model."""
        n = len(self._kinds)
        # fields with a default may be absent in the JSON
        taken = [{**self._defaults, **row} if len(row) < n else row for row in rows]
        if not taken:
            return
        # transposed once: columns are filled field by field, without a loop per record
        fields = dict(zip(self._kinds, zip(*map(self._values, taken), strict=True), strict=True))
        for name, kind in self._kinds.items():
            values = fields[name]
            if kind == _INTS:
                self._ints[name].extend(integers(values))
            elif kind == _MAYBE:
                known = integers([0 if value is None else value for value in values])
                known[[value is None for value in values]] = _NO_INT
                self._ints[name].extend(known)
            elif kind == _FLAGS:
                self._columns[name].extend(values)
            elif kind == _WORDS:
                for word in dict.fromkeys(values):
                    if not isinstance(word, str) or len(word) > _MAX_WORD_CHARS:
                        raise ValueError(f"a word must have at most {_MAX_WORD_CHARS} characters")
                    self._words.setdefault(word, len(self._words))
                self._columns[name].extend(map(self._words.__getitem__, values))
            else:
                self._add_reals(kind, self._columns[name], values)
        self._length += len(taken)

    def _add_reals(self, kind: str, column: "array[Any]", values: Sequence[Any]) -> None:
        n_none, n_axes = values.count(None), len(_AXES.get(kind, "."))
        if not column and n_none == len(values):
            return  # a field without values takes no memory
        column.extend((np.nan,) * (n_axes * self._length - len(column)))
        nothing = _NO_POINT.get(kind, np.nan)
        known = [nothing if value is None else value for value in values] if n_none else values
        column.extend(known if kind == _REALS else chain.from_iterable(map(_OF_AXES[kind], known)))

    def append(self, row: Row) -> None:
        """Add one record."""
        self.extend((row,))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the fields' names."""
        return tuple(self._kinds)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column (N,): int64, bool, or text; points are (N, 3), quaternions (N, 4), NaN for None.

        Numbers and optional integers are float64, NaN for None.
        """
        kind = self._kinds[name]
        if name in self._ints:
            ns = self._ints[name].values()
            return np.where(ns == _NO_INT, np.nan, ns) if kind == _MAYBE else ns
        values = self._columns[name]
        if kind in (*_AXES, _REALS):
            shape = (self._length, len(_AXES[kind])) if kind in _AXES else (self._length,)
            return np.array(values, dtype=np.float64).reshape(shape) if values else np.full(shape, np.nan)
        if kind == _WORDS:
            words = np.array([*self._words, ""], dtype=np.str_)
            return words[np.array(values, dtype=np.int64)]
        return np.array(values, dtype=np.bool_)

    def where(self, name: str, word: str) -> NDArray[np.bool_]:
        """Mark the records (N,) with ``word`` in a field of words."""
        # words are stored as int16 codes, so the comparison needs no text
        return np.equal(np.array(self._columns[name], dtype=np.int16), self._words.get(word, -1))

    def with_columns(self, columns: Mapping[str, NDArray[np.int64]]) -> "Rows":
        """Return the records with some integer fields replaced."""
        # shares all columns that do not change
        found = object.__new__(Rows)
        found.__dict__.update(self.__dict__)
        found._ints = dict(self._ints)
        for name, ns in columns.items():
            found._ints[name] = CompactInts()
            found._ints[name].extend(ns)
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
        for i in which:
            row: Row = {}
            for name, kind in self._kinds.items():
                if kind in (_INTS, _MAYBE):
                    value = self._ints[name][i]
                    row[name] = None if kind == _MAYBE and value == _NO_INT else value
                    continue
                values = self._columns[name]
                if kind in _AXES:
                    axes = _AXES[kind]
                    found = values[len(axes) * i : len(axes) * (i + 1)]
                    row[name] = dict(zip(axes, found, strict=True)) if values and found[0] == found[0] else None
                elif kind == _REALS:
                    row[name] = values[i] if values and values[i] == values[i] else None
                else:
                    row[name] = words[values[i]] if kind == _WORDS else bool(values[i])
            yield row


_CODES: Final = {_FLAGS: "b", _WORDS: "h", _REALS: "d", _POINTS: "d", _TURNS: "d"}


def _kind(annotation: str) -> str:
    if "Vector3" in annotation:
        return _POINTS
    if "Quaternion" in annotation:
        return _TURNS
    if "float" in annotation:
        return _REALS
    if "bool" in annotation:
        return _FLAGS
    if "int" in annotation:
        return _MAYBE if "None" in annotation else _INTS
    return _WORDS
