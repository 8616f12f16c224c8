"""A section of a page: title, figures, and safe markup."""

from collections.abc import Sequence
from dataclasses import dataclass

from deploy.report.plots.plot_style import Figure


@dataclass(frozen=True)
class Section:
    """A section; ``before`` and ``markup`` enclose its figures, of which a None had nothing to draw.

    ``mark`` is shown beside the title, ``beside`` lets figures share a row.
    """

    anchor: str
    title: str
    figures: Sequence[Figure | None] = ()
    markup: str = ""
    before: str = ""
    mark: str = ""
    beside: bool = False
