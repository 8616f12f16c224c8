"""Pace of a page: the browser says which frame it has drawn, and gets no other before."""

from typing import Final

from bokeh.core.properties import Int
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.model import DataModel
from bokeh.models import CustomJS

# The answer leaves after the frame's painting; a hidden page paints nothing, and answers all the same.
_ANSWER: Final = """
const answer = () => { pace.drawn = pace.sent }
if (document.hidden) setTimeout(answer)
else requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(answer)))
"""


class Pace(DataModel):
    """Number of the last frame sent, and of the last one drawn; a root without a view.

    Bokeh itself knows when a frame is written to the socket. A browser that draws slower than that queues what it
    reads, and falls ever further behind.
    """

    sent: int = Int(default=0)  # type: ignore[assignment]  # Bokeh's descriptor of an int
    drawn: int = Int(default=0)  # type: ignore[assignment]  # Bokeh's descriptor of an int

    def attach(self, doc: Document) -> None:
        """Let the browser answer once it has drawn the document, and after each frame."""
        answer = CustomJS(args={"pace": self}, code=_ANSWER)
        doc.js_on_event(DocumentReady, answer)
        self.js_on_change("sent", answer)

    @property
    def is_drawing(self) -> bool:
        """Tell whether the last frame is not drawn yet."""
        return self.drawn != self.sent

    def end_frame(self) -> None:
        """Ask for an answer; call it after the last change of a frame."""
        self.sent += 1
