"""Clock exchanges around the line fitted to them, with the remaining uncertainty."""

from typing import Final

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.common.channels import Side
from tis.common.clocks import PPM
from tis.common.units import NS_PER_S, NS_PER_US
from tis.deploy.logs.read.clocks import RunClocks, SideClock
from tis.deploy.present import plot_style as style
from tis.deploy.present.palette import BLUE, GREEN, PALE, Tone
from tis.deploy.present.thinning import evenly

_SIDES: Final[dict[Side, Tone]] = {"surgeon": BLUE, "patient": GREEN}
_N_INSTANTS: Final = 400
_HEIGHT: Final = 240


def clock_figure(clocks: RunClocks) -> style.Figure | None:
    """Draw a panel for each side whose clock was compared with netem's; None when all share one clock."""
    known = {side: clocks.sides[side] for side in _SIDES if side in clocks.sides}
    compared = {side: clock for side, clock in known.items() if clock.kind == "exchanged"}
    if not compared:
        return None
    drifts = ", ".join(
        f"{side}: {clock.model.drift / PPM:.2f} ppm, known within {clock.summary()['uncertainty_us']:.0f} \u00b5s"
        for side, clock in compared.items()
    )
    return style.Figure(
        plots=tuple(_panel(side, clock) for side, clock in compared.items()),
        title="The clocks against netem's",
        caption="A dot is an exchange with netem: its offset from the fitted line. Slow exchanges lie far out, as "
        "one way took longer than the other. The pale band is the uncertainty left by the shortest exchanges: the "
        "true offset lies in it, and every delay between the two hosts is uncertain by as much. It is narrow where "
        f"exchanges were fast and frequent. Here {drifts}.",
        alt=f"Offsets of clock exchanges about the fitted line over run time, with band of uncertainty. {drifts}.",
        keys=(*(style.Key(side, _SIDES[side], "dot") for side in compared), style.Key("uncertainty", PALE, "bar")),
    )


def _panel(side: Side, clock: SideClock) -> figure:
    exchanges, model = clock.exchanges, clock.model
    middle_ns = (exchanges.asked_ns + exchanges.answered_ns) // 2
    off_us = (exchanges.offset_ns - model.offset_at(middle_ns)) / NS_PER_US
    end_ns = max(clock.last_ns, int(middle_ns[-1]), 1)
    at_ns = np.linspace(min(0, int(middle_ns[0])), end_ns, _N_INSTANTS).astype(np.int64)
    open_us = model.uncertainty_ns(at_ns) / NS_PER_US
    reach_us = 2.5 * float(open_us.max())
    fig = style.plain_figure(
        _HEIGHT,
        x_axis_label="run time, s",
        y_axis_label=f"{side}: offset off the line, \u00b5s",
        x_range=Range1d(start=float(at_ns[0]) / NS_PER_S, end=end_ns / NS_PER_S),
        y_range=Range1d(start=-reach_us, end=reach_us),
    )
    at_s = at_ns / NS_PER_S
    band = style.data(at=at_s, low=-open_us, high=open_us)
    fig.varea("at", "low", "high", source=band, fill_color=PALE.light, fill_alpha=0.5)
    shown = evenly(len(exchanges))
    trip_us = exchanges.round_trip_ns[shown] / NS_PER_US
    dots = style.data(at=middle_ns[shown] / NS_PER_S, off=off_us[shown], trip=trip_us)
    drawn = fig.scatter("at", "off", source=dots, size=4, color=_SIDES[side].light)
    tips = ("at", "@at{0.0} s"), ("off the line", "@off{0.0} \u00b5s"), ("round trip", "@trip{0} \u00b5s")
    style.hover(fig, drawn, *tips)
    return fig
