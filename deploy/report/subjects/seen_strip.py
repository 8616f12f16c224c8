"""The surgeon's screen, second by second: small pictures, decoded again from the log for the page."""

import io
from base64 import b64encode
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from tis.common.scenario import Scenario
from tis.common.sight.stamp import Picture
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.present.numbers import number
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.seen_pictures import seen_pictures

MOST: Final = 24
_SIDE: Final = 160
"""Pixels of the longer side: some 3 kB each."""
_QUALITY: Final = 60
_STILL_NS: Final = 500 * NS_PER_MS


class Moment(NamedTuple):
    """An instant, and the frame that stood on the screen then, since ``shown_ns``."""

    at_ns: int
    frame: int
    shown_ns: int

    def words(self, state: str) -> str:
        """Return what is to be said of it beside its second."""
        still_ns = self.at_ns - self.shown_ns
        damage = "" if state == "complete" else state
        return f"still for {number(still_ns / NS_PER_MS, ' ms')}" if still_ns > _STILL_NS else damage


def moments(found: Pictures) -> list[Moment]:
    """Return the frames on the screen at the end of each second; of long runs of every second, third, ... one.

    Before the first picture there is none. Oracle: literal records, test_seen_strip.
    """
    seconds = found.until_ns // NS_PER_S
    step_ns = max(-(-seconds // MOST), 1) * NS_PER_S
    instants = np.arange(step_ns, found.until_ns + 1, step_ns)
    place = np.searchsorted(found.shown_ns, instants, side="right") - 1
    return [
        Moment(int(at_ns), int(found.seen.frame[i]), int(found.shown_ns[i]))
        for at_ns, i in zip(instants, place, strict=True)
        if i >= 0
    ]


def strip_markup(run_dir: Path, scenario: Scenario, found: Pictures | None) -> str:
    """Return the strip of pictures; "" without a picture, or where none can be decoded here."""
    if found is None or run_dir == Path():
        return ""
    wanted = moments(found)
    frames = sorted({one.frame for one in wanted})
    seen = {
        one.frame: (one.state, _small(one.seen))
        for one in seen_pictures(run_dir, scenario, found, len(frames), frames)
    }
    shown = "".join(_figures(wanted, seen))
    step_s = (wanted[1].at_ns - wanted[0].at_ns) // NS_PER_S if len(wanted) > 1 else 1
    every = "each second" if step_s == 1 else f"every {step_s} s"
    said = f"The screen at the end of {every}; framed where the picture was damaged or stood still."
    return f'<p class="note">{said}</p><div class="strip">{shown}</div>' if shown else ""


def _figures(wanted: Sequence[Moment], seen: dict[int, tuple[str, str]]) -> Iterator[str]:
    for one in wanted:
        if one.frame not in seen:
            continue
        (state, data), second = seen[one.frame], f"{one.at_ns // NS_PER_S} s"
        words = one.words(state)
        mark = ' class="damaged"' if words else ""
        alt = escape(f"The screen at {second}{words and ': ' + words}")
        yield (
            f'<figure{mark}><img src="data:image/jpeg;base64,{data}" alt="{alt}">'
            f"<figcaption>{second} <small>{escape(words)}</small></figcaption></figure>"
        )


def _small(picture: Picture) -> str:
    from PIL import Image

    out, image = io.BytesIO(), Image.fromarray(picture)
    image.thumbnail((_SIDE, _SIDE))
    image.save(out, "JPEG", quality=_QUALITY)
    return b64encode(out.getvalue()).decode()
