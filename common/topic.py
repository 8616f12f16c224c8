"""Declaration of a topic: the key of one kind of record in the logs, and all that is known of its records."""

import inspect
from collections.abc import Sequence
from typing import Self

from tis.common.messages import Message


class Topic(str):
    """The key of a log's records, as text, with what writers, readers, exports and the manual know of the records.

    Attributes
    ----------
    model
        The model of each record; the descriptions of its fields are those of an export and of the manual.
    fields
        The fields that are read, the columns of an export; by default all.
    stamps
        Fields with an instant by the clock of the side that writes the record.
    samples
        Fields with a sample instant, by the surgeon's clock.
    is_group
        Names follow: ``KEY/NAME`` is the topic of a record.
    is_frequent
        A tick or a packet writes one, so that reading makes no model of it.
    is_recomputable
        A replay of the arrivals computes the records again, so a log may lack them where the disk is too slow.
    table
        The name of an export's table; that of a rare record's begins with the side.
    """

    __slots__ = ("fields", "is_frequent", "is_group", "is_recomputable", "model", "samples", "stamps", "table")

    model: type[Message]
    fields: tuple[str, ...]
    stamps: tuple[str, ...]
    samples: tuple[str, ...]
    is_group: bool
    is_frequent: bool
    is_recomputable: bool
    table: str

    def __new__(
        cls,
        key: str,
        model: type[Message],
        *,
        fields: Sequence[str] = (),
        stamps: Sequence[str] = (),
        samples: Sequence[str] = (),
        is_group: bool = False,
        is_frequent: bool = False,
        is_recomputable: bool = False,
        table: str | None = None,
    ) -> Self:
        """Return the topic of a key."""
        self = super().__new__(cls, key)
        self.model, self.fields = model, tuple(fields or model.__struct_fields__)
        self.stamps, self.samples = tuple(stamps), tuple(samples)
        self.is_group, self.is_frequent, self.is_recomputable = is_group, is_frequent, is_recomputable
        self.table = key.rpartition("/")[2] if table is None else table
        return self

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        """Pickle the key alone."""
        return str, (str(self),)

    @property
    def about(self) -> str:
        """Return what a record is: the first paragraph of its model's documentation."""
        return " ".join((inspect.getdoc(self.model) or "").split("\n\n")[0].split())
