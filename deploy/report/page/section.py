"""A part of a page: a title, figures, and markup that is safe already."""

from collections.abc import Sequence
from dataclasses import dataclass

from deploy.report.plots.plot_style import Figure


@dataclass(frozen=True)
class Section:
    """``before`` and ``markup`` stand before and after the figures; a figure that is None had nothing to draw.

    ``mark`` stands beside the title, ``beside`` lets figures share a row where there is room.
    """

    anchor: str
    title: str
    figures: Sequence[Figure | None] = ()
    markup: str = ""
    before: str = ""
    mark: str = ""
    beside: bool = False
