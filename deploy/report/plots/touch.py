"""Touch over time: the force at the tool and at the hand, and the energies of both ends of the coupling."""

import numpy as np
from bokeh.models.ranges import Range1d

from tis.common.records import CONTACTS, PLANT
from tis.common.units import NS_PER_S
from tis.deploy.present import plot_style as style
from tis.deploy.present.numbers import counted
from tis.deploy.present.palette import BLUE, VERMILION
from tis.deploy.present.thinning import evenly_and_largest
from tis.deploy.report.run_view import MAX_TICKS, HandView, RunView
from tis.deploy.report.subjects.touch import MJ_PER_J, energy_j, shown_forces
from tis.deploy.report.subjects.touch_tables import energy_text, stability_text
from tis.deploy.report.subjects.tracking import Array, at_ticks


def touch_figure(run: RunView, view: HandView, x_range: Range1d) -> style.Figure | None:
    """Draw the forces at tool and hand, and the energies below; None for a run without touch."""
    found, shown = run.summary.touch.get(view.hand), shown_forces(run.logs, view.hand)
    if found is None or shown is None:
        return None
    contacts = run.logs.of_hand("patient", CONTACTS, view.hand).first_of_each("tick")
    arm = run.logs.of_hand("patient", PLANT, view.hand).first_of_each("tick")
    hand_j = energy_j(shown)
    tool_j = _work_j(contacts.force_n, at_ticks(contacts.tick, arm, "position_m"))
    largest_j = max(float(np.abs(each).max(initial=0.0)) for each in (hand_j, tool_j))
    unit, per_j = ("J", 1.0) if largest_j >= 1.0 else ("mJ", MJ_PER_J)
    forces = style.time_figure(x_range, "force, N", 220)
    energies = style.time_figure(x_range, f"energy put in, {unit}", 220)
    ends = (
        ("at the tool", VERMILION, contacts.t_ns, contacts.force_n, tool_j, 2.0),
        ("at the hand", BLUE, shown.sample_ns, shown.force_n, hand_j, 1.2),
    )
    for name, tone, t_ns, force_n, work_j, width in ends:
        size_n = np.linalg.norm(force_n, axis=1)
        kept = evenly_and_largest(size_n, MAX_TICKS)
        source = style.data(t=t_ns[kept] / NS_PER_S, force=size_n[kept], energy=per_j * work_j[kept])
        for panel, column, tip in ((forces, "force", "{0.000} N"), (energies, "energy", f"{{0.00}} {unit}")):
            line = panel.line("t", column, source=source, line_color=tone.light, line_width=width)
            style.named(name, [line])
            style.hover(panel, line, ("run time", "@t{0.000} s"), (name, f"@{column}{tip}"))
    return style.Figure(
        plots=(forces, energies),
        title=f"Force and energy over time: {view.title}",
        caption=_caption(hand_j, shown.limited),
        alt=f"Line charts over run time: forces at tool and hand, and energies. The loop: {stability_text(found)}.",
        keys=tuple(style.Key(name, tone, "line", toggles=True, of=name) for name, tone, *_ in ends),
    )


def _work_j(force_n: Array, position_m: Array) -> Array:
    """Return the work (N,) of an arm on what it touches, in J; the force is that on the arm."""
    work = -(0.5 * (force_n[1:] + force_n[:-1]) * np.diff(position_m, axis=0)).sum(axis=1)
    return np.concatenate([[0.0], np.nancumsum(work)])


def _caption(hand_j: Array, limited: Array) -> str:
    text = "Force: on the tool, and shown to the hand, which is a network later. Energy: what the hand "
    text += "has put into the coupling (positive: from the hand), and the work of the tool on what it touches. "
    text += "Below zero the coupling has given the hand more than the hand had put in"
    least_j = float(hand_j.min(initial=0.0))
    text += f", here up to {energy_text(-MJ_PER_J * least_j)}. " if least_j < 0 else "; here it never has. "
    cut = int(np.count_nonzero(limited == "force"))
    return text + (f"At {counted(cut, 'tick')} the largest force allowed cut the one shown. " if cut else "")
