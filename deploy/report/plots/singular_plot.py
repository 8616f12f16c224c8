"""Singular values of the identification, with the order of the arm's model."""

import math
from typing import Any, Final

from bokeh.models import ColumnDataSource
from bokeh.models.annotations import Label, Span
from bokeh.models.ranges import Range1d
from bokeh.models.tools import HoverTool

from tis.common.scenario.identification import Identification, is_model_file
from tis.deploy.report.palette import BLUE, PALE, VERMILION
from tis.deploy.report.plots import plot_style as style
from tis.patient_side.identification.validation import fit_text

_RULES: Final = {
    "energy": "The order is the smallest whose values make up 85 % of the sum of all.",
    "gap": "The order is that of the largest drop from one value to the next.",
    "criterion": "An information criterion chose the order, not these values.",
    "validation": "Validation chose the order, not these values: the smallest that predicts the validation rows as "
    "well as any.",
}
_ENDS: Final = ((min, math.floor), (max, math.ceil))


def singular_figure(identification: dict[str, Any], which: str, part: Identification) -> style.Figure | None:
    """Draw one arm's singular values from the summary's ``identification``; None when none is above zero.

    ``part`` is the scenario's, with the rule of the order.
    """
    values = [(i + 1, value) for i, value in enumerate(identification["singular_values"]) if value > 0]
    if not values:
        return None
    order, method = identification["order"], identification["method"]
    # whole decades, so that the log axis has round labels
    low, high = (round_to(math.log10(end(value for _, value in values))) for end, round_to in _ENDS)
    fig = style.plain_figure(
        300,
        y_axis_type="log",
        x_axis_label="number of the singular value",
        y_axis_label="singular value",
        y_range=Range1d(start=10.0**low, end=10.0 ** max(high, low + 1)),
    )
    fig.yaxis.ticker = [10.0**power for power in range(low, max(high, low + 1) + 1)]
    source = ColumnDataSource({"number": [i for i, _ in values], "value": [value for _, value in values]})
    fig.line("number", "value", source=source, line_color=PALE.light)
    dots = fig.scatter("number", "value", source=source, size=7, fill_color=BLUE.light, line_color=None)
    fig.add_tools(HoverTool(renderers=[dots], tooltips=[("number", "@number"), ("value", "@value{0.000e}")]))
    fig.add_layout(Span(location=order + 0.5, dimension="height", line_color=VERMILION.light, line_dash="dashed"))
    fig.add_layout(
        Label(
            x=order + 0.5,
            y=10,
            y_units="screen",
            text=f"order {order}",
            x_offset=5,
            text_color=VERMILION.light,
        )
    )
    fit = ", ".join(fit_text(value, 3) for value in identification["fit_pct"])
    caption = (
        "Each value weighs one more state of the arm. "
        f"The model found by {method} has order {order} (left of the dashed line)"
        + (": no state at all, the arm follows its command at once. " if identification["static"] else ". ")
        + f"{_rule_text(part, method)} "
        + f"On rows kept for validation it explains {fit} % of the variance of x, y, z."
    )
    return style.Figure(
        plots=(fig,),
        title=f"The arm's model: singular values, {which}",
        caption=caption,
        alt=f"Logarithmic chart of {len(values)} singular values from {values[0][1]:.3g} to {values[-1][1]:.3g}; "
        f"chosen order {order}.",
    )


def _rule_text(part: Identification, method: str) -> str:
    """Return a sentence on the rule that chose the order."""
    if is_model_file(part.train):
        return "The order is that of the model file."
    if isinstance(part.order, int):
        return "The scenario sets the order."
    rule = part.order if part.order != "auto" else "energy" if method == "moesp_paper" else "validation"
    return _RULES[rule]
