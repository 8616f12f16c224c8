"""Latency budget: the mean parts of the end-to-end latency as one bar, without JavaScript."""

from html import escape
from typing import Final

from tis.common.metrics.latency import LatencyParts
from tis.common.units import NS_PER_MS
from tis.deploy.report.palette import PARTS, Tone
from tis.deploy.report.tables.html_tables import nonbreaking_units
from tis.deploy.report.tables.numbers import number

_MIN_PIECE_PCT: Final = 0.4


def budget_ms(parts: LatencyParts) -> dict[str, float]:
    """Return the mean of each part in ms by name; they add up to the mean of the whole. Empty without samples."""
    whole = parts._asdict()
    if not len(whole.pop("end_to_end")):
        return {}
    return {name: float(values_ns.mean()) / NS_PER_MS for name, values_ns in whole.items()}


def budget_bar(means_ms: dict[str, float]) -> str:
    """Return the bar of `budget_ms` with legend and caption; "" without parts."""
    total_ms = sum(means_ms.values())
    if total_ms <= 0:
        return ""
    named = {name: (*PARTS[name], value) for name, value in means_ms.items()}
    longest = max(means_ms, key=lambda name: means_ms[name])
    pieces = "".join(
        f'<span style="width:{100 * value / total_ms:.2f}%;color:{_css(tone)}"></span>'
        for _, tone, value in named.values()
        if 100 * value / total_ms >= _MIN_PIECE_PCT
    )
    keys = "".join(
        f'<li><i class="bar" style="color:{_css(tone)}"></i>{escape(title)} {_ms(value)}</li>'
        for title, tone, value in named.values()
    )
    title, _, value = named[longest]
    caption = (
        f"From the instant of the newest sample to the estimate made with it, {_ms(total_ms)} pass in the mean: "
        "means add up part by part, medians do not. The longest part is the one to shorten first: here "
        f"{title}, mean {_ms(value)}, {100 * value / total_ms:.0f} % of the whole."
    )
    return (
        '<figure class="budget" aria-labelledby="budget"><figcaption><h3 id="budget">Where the time goes</h3>'
        f'<p>{escape(nonbreaking_units(caption))}</p></figcaption><div class="track" role="img" '
        'aria-label="Bar of the mean parts of the latency; the list below has the same numbers.">'
        f'{pieces}</div><ul class="keys">{keys}</ul></figure>'
    )


def _css(tone: Tone) -> str:
    return f"light-dark({tone.light},{tone.dark})"


def _ms(value: float) -> str:
    return f"{value:.1f} ms" if value >= 10 else f"{number(value)} ms" if value else "0 ms"
