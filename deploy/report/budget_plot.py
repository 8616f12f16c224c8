"""Where the time goes: the median parts of the end-to-end latency in one bar."""

from typing import Any, Final

from bokeh.models.annotations import Label, Span
from bokeh.models.ranges import Range1d

from deploy.report import plot_style as style

_PARTS: Final = {
    "surgeon": ("surgeon", "#7a5195"),
    "network": ("network", "#0072b2"),
    "tick_wait": ("wait for the tick", "#e69f00"),
    "compute": ("compute", "#009e73"),
}


def budget_figure(latency_ms: dict[str, Any]) -> style.Figure | None:
    """Draw the bar from the summary's ``latency_ms``; None when its medians are not known."""
    medians = {title: (latency_ms[name]["p50"], colour) for name, (title, colour) in _PARTS.items()}
    whole_ms = latency_ms["end_to_end"]["p50"]
    if whole_ms is None or any(value is None for value, _ in medians.values()):
        return None
    parts = {title: (float(value), colour) for title, (value, colour) in medians.items()}
    total_ms = sum(value for value, _ in parts.values())
    fig = style.plain_figure(190, x_axis_label="ms, median of each part", y_range=Range1d(start=0, end=1))
    fig.x_range = Range1d(start=0, end=1.12 * max(total_ms, whole_ms, 1e-3))
    fig.yaxis.visible = False
    fig.ygrid.visible = False
    drawn, left = {}, 0.0
    for title, (value, colour) in parts.items():
        bar = fig.quad(left=left, right=left + value, bottom=0.15, top=0.65, fill_color=colour, line_color="#ffffff")
        drawn[f"{title} {_ms(value)}"] = [bar]
        left += value
    fig.add_layout(Span(location=whole_ms, dimension="height", line_color=style.TRUTH, line_dash="dashed"))
    text = f"whole: {_ms(whole_ms)}"
    fig.add_layout(Label(x=whole_ms, y=0.72, text=text, text_align="right", x_offset=-5))
    style.add_legend(fig, drawn, mutes=False)
    largest = max(parts, key=lambda title: parts[title][0])
    share = f", {100 * parts[largest][0] / total_ms:.0f} % of the bar" if total_ms else ""
    return style.Figure(
        plot=fig,
        title="Where the time goes",
        says=f"The longest piece is what to shorten first: here {largest}, {_ms(parts[largest][0])}{share}. "
        f"From the instant of a sample to the estimate made with it, half of the ways take at most {_ms(whole_ms)} "
        "(dashed). The pieces are medians, each of its own, so the bar need not end exactly there.",
        alt="Stacked bar of median latencies: " + ", ".join(f"{t} {_ms(v)}" for t, (v, _) in parts.items()) + ".",
    )


def _ms(value: float) -> str:
    return f"{value:.1f} ms" if value >= 10 else f"{value:.2f} ms" if value else "0 ms"
