"""Identified models: singular values with the order, and poles in the unit circle with half-lives."""

import math
from typing import Any, Final

import numpy as np
from bokeh.models.annotations import Label, Span
from bokeh.models.ranges import DataRange1d, Range1d
from numpy.typing import NDArray

from tis.common.scenario.identification import Identification, is_model_file
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import number
from tis.deploy.present.palette import AXIS, BLUE, PALE, VERMILION, VIOLET, Tone
from tis.deploy.present.thinning import column
from tis.deploy.report.subjects.identification import IdentifiedModel
from tis.patient_side.identification.validation import fit_text
from tis.patient_side.statespace import ArmModel

_RULES: Final = {
    "energy": "The order is the smallest whose values make up 85 % of the sum of all.",
    "gap": "The order is that of the largest drop from one value to the next.",
    "criterion": "An information criterion chose the order, not these values.",
    "validation": "Validation chose the order, not these values: the smallest that predicts the validation rows as "
    "well as any.",
}
_ENDS: Final = ((min, math.floor), (max, math.ceil))


def singular_figure(identification: IdentifiedModel, which: str, part: Identification) -> style.Figure | None:
    """Draw one arm's singular values from the summary's ``identification``; None when none is above zero.

    ``part`` is the scenario's, with the rule of the order.
    """
    values = [(i + 1, value) for i, value in enumerate(identification.singular_values) if value > 0]
    if not values:
        return None
    order, method = identification.order, identification.method
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
    source = style.data(number=[i for i, _ in values], value=[value for _, value in values])
    fig.line("number", "value", source=source, line_color=PALE.light)
    dots = fig.scatter("number", "value", source=source, size=7, fill_color=BLUE.light, line_color=None)
    style.hover(fig, dots, ("number", "@number"), ("value", "@value{0.000e}"))
    fig.add_layout(Span(location=order + 0.5, dimension="height", line_color=VERMILION.light, line_dash="dashed"))
    text: dict[str, Any] = {"text": f"order {order}", "text_color": VERMILION.light}
    fig.add_layout(Label(x=order + 0.5, y=10, y_units="screen", x_offset=5, **text))
    fit = ", ".join(fit_text(value, 3) for value in identification.fit_pct)
    caption = (
        "Each value weighs one more state of the arm. "
        f"The model found by {method} has order {order} (left of the dashed line)"
        + (": no state at all, the arm follows its command at once. " if identification.static else ". ")
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


Poles = NDArray[np.complex128]
_SAME: Final = 1e-4
"""Poles closer than this count as one: multiple eigenvalues are computed no more exactly."""

_FOLD: Final = {2: "double", 3: "triple"}


def poles_of(model: ArmModel) -> dict[str, tuple[Poles, Tone]]:
    """Return the eigenvalues of the arm's model, and of its movement without commands; none for order 0."""
    found = {"arm under its command": (model.space.A, BLUE)}
    if model.innovations is not None:
        found["arm by itself"] = (model.innovations.A, VIOLET)
    return {name: (np.linalg.eigvals(A).astype(np.complex128), tone) for name, (A, tone) in found.items() if len(A)}


def poles_figure(model: ArmModel) -> style.Figure | None:
    """Draw one arm's poles; None when no model has any."""
    poles = poles_of(model)
    if not poles:
        return None
    fig = style.plain_figure(
        340,
        x_axis_label="real part",
        y_axis_label="imaginary part",
        x_range=DataRange1d(),  # unlike a fixed range it grows until the circle is round
        y_range=DataRange1d(),
        match_aspect=True,
    )
    turn = np.linspace(0, 2 * np.pi, 181)
    fig.line(column(np.cos(turn)), column(np.sin(turn)), line_color=AXIS.light, line_dash="dashed")
    for name, (values, tone) in poles.items():
        halves_ms = _half_life_ms(values, model)
        source = style.data(re=values.real, im=values.imag, modulus=np.abs(values), half_life=halves_ms)
        marks = fig.scatter("re", "im", source=source, marker="x", size=10, color=tone.light, line_width=2)
        style.named(name, [marks])
        where, life = (name, "@re{0.000} + @im{0.000} i"), ("halves in", "@half_life{0} ms")
        style.hover(fig, marks, where, ("modulus", "@modulus{0.0000}"), life)
    return style.Figure(
        plots=(fig,),
        title=f"Poles in the unit circle, {model.hand} hand",
        caption=_caption(poles, model),
        alt="Complex plane with the unit circle. "
        + ", ".join(f"{n}: {len(v)} poles" for n, (v, _) in poles.items())
        + ".",
        keys=tuple(style.Key(name, tone, "cross", toggles=True) for name, (_, tone) in poles.items()),
    )


def _half_life_ms(poles: Poles, model: ArmModel) -> NDArray[np.float64]:
    modulus = np.abs(poles)
    with np.errstate(divide="ignore"):
        samples = np.log(0.5) / np.log(modulus)
    return np.where((modulus > 0) & (modulus < 1), 1000 * samples / model.rate_hz, np.nan)


def _caption(poles: dict[str, tuple[Poles, Tone]], model: ArmModel) -> str:
    text = "Inside the circle a motion decays, more slowly the nearer to it; outside it grows without bound. "
    for name, (values, _) in poles.items():
        slowest = values[np.argmax(np.abs(values))]
        life = float(_half_life_ms(np.array([slowest]), model)[0])
        tail = f"halves in {number(life)} ms" if np.isfinite(life) else "does not decay"
        modulus = float(np.abs(slowest))
        text += f"The {name} has {_counted(values)}; the motion of the slowest, of modulus {modulus:.4f}, {tail}. "
    text = text.rstrip()
    if model.order == 0:
        text += " The arm under its command has none: it follows at once, order 0."
    return text


def _counted(poles: Poles) -> str:
    """Return the number of poles, and of visible crosses where poles coincide."""
    if len(poles) == 1:
        return "1 pole"
    # a cluster of k poles contributes k times 1/k, hence one cross
    near = np.abs(poles[:, None] - poles[None, :]) < _SAME
    times = near.sum(axis=1)
    n_seen = round(float((1.0 / times).sum()))
    if n_seen == len(poles):
        return f"{len(poles)} poles"
    crosses = "1 cross" if n_seen == 1 else f"{n_seen} crosses"
    if np.ptp(times) == 0:
        n = int(times[0])
        return f"{len(poles)} poles but {crosses}, since each is {_FOLD.get(n, f'there {n} times')}"
    return f"{len(poles)} poles but {crosses}, since some lie on each other"
