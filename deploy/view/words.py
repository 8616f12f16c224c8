"""What the page says in words and numbers: who is there, the figures of the last seconds, what netem does now."""

from html import escape
from typing import Final, get_args

from common.channels import Side
from common.scenario.control import DirectionState, EmulatorState
from deploy.watch.figures import LiveFigures
from deploy.watch.observer import Attendance

_ROLES: Final[dict[Side, str]] = {
    "surgeon": "moves the master",
    "netem": "is the network between them",
    "patient": "estimates where the arm is",
}
_NO_VALUE: Final = "–"


def sides_html(there: Attendance, now_s: float) -> str:
    """Return the state of the three sides, and of the run."""
    items = []
    for side in get_args(Side):
        state, kind = _state(side, there, now_s)
        items.append(f'<li class="{kind}"><b>{side}</b> <span>{state}</span><small>{_ROLES[side]}</small></li>')
    return f'<p class="run">{escape(run_text(there, now_s))}</p><ul class="sides">{"".join(items)}</ul>'


def run_text(there: Attendance, now_s: float) -> str:
    """Return in a sentence how the run stands."""
    if "netem" in there.left:
        reason = f": {there.end_reason}" if there.end_reason else ""
        return f"The run is over, at {now_s:.1f} s{reason}. What is drawn below are its last seconds."
    if not there.connected:
        return "Looking for netem …"
    if now_s <= 0:
        missing = [side for side in get_args(Side) if side not in there.present]
        return f"Waiting for {' and '.join(missing)} …" if missing else "All three are ready; it begins."
    return f"Running, {now_s:.0f} s"


def _state(side: Side, there: Attendance, now_s: float) -> tuple[str, str]:
    if side in there.left:
        return "has left", "gone"
    if side in there.present:
        return ("running", "good") if now_s > 0 else ("ready", "good")
    return "not there yet", "open"


def figures_html(found: LiveFigures, n_ticks_absent: int) -> str:
    """Return the figures as tiles: a name, a number with its unit, and what it means."""
    arm, answers = found.streams.get("arm"), found.streams.get("answers")
    to_patient = _NO_VALUE if arm is None else _number(arm.delay_p50_ms, "ms")
    back = _NO_VALUE if answers is None else _number(answers.delay_p50_ms, "ms")
    loss_to = _NO_VALUE if arm is None else _number(arm.loss_pct, "%")
    loss_back = _NO_VALUE if answers is None else _number(answers.loss_pct, "%")
    ratio = found.ratio_to_hold
    if ratio is None:
        verdict = "the estimate against repeating the last sample"
    else:
        verdict = f"{_number(ratio, '')}&times; the error of <i>hold</i> ({_number(found.hold_rmse_mm, 'mm')})"
    tiles = (
        ("One-way delay", to_patient, f"to the patient, median; back {back}"),
        ("Lost", loss_to, f"of the arm's samples; of the estimates on their way back {loss_back}"),
        ("End to end", _number(found.end_to_end_p50_ms, "ms"),
         f"from a sample to the estimate that uses it; 99 % within {_number(found.end_to_end_p99_ms, 'ms')}"),
        ("Position error", _number(found.rmse_mm, "mm"), verdict),
        ("Ticks without an estimate", str(n_ticks_absent), "since this page was begun"),
    )  # fmt: skip
    items = "".join(
        f"<li><span>{name}</span><strong>{value}</strong><small>{meaning}</small></li>"
        for name, value, meaning in tiles
    )
    return f'<ul class="tiles">{items}</ul>'


def state_html(state: EmulatorState | None) -> str:
    """Return what netem does now, in each direction."""
    if state is None or state.forward is None or state.feedback is None:
        return "<p>netem has not said yet what it does.</p>"
    rows = "".join(
        f"<tr><th>{name}</th><td>{_stage(one, 'delay')}</td><td>{_stage(one, 'jitter')}</td>"
        f"<td>{_stage(one, 'loss')}</td><td>{_changed(one)}</td></tr>"
        for name, one in (("to the patient", state.forward), ("back", state.feedback))
    )
    head = "<tr><th></th><th>delay</th><th>jitter</th><th>loss</th><th>changed</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>"


def _stage(one: DirectionState, name: str) -> str:
    if name == "loss" and one.outage:
        return "<b>outage</b>"
    stage = getattr(one.now, name)
    if stage is None:
        return "none"
    values = stage.model_dump(exclude_none=True, exclude_defaults=True)
    kind = values.pop("kind", stage.kind)
    shown = [_setting(field, value) for field, value in values.items() if isinstance(value, int | float)]
    return escape(f"{kind} {', '.join(shown)}".strip())


def _setting(field: str, value: float) -> str:
    if field == "p_loss":
        return f"{100 * value:g} %"
    name, _, unit = field.rpartition("_")
    return (
        f"{value:g} {unit}" if unit == "ms" and name in ("delay", "") else f"{name or field} {value:g} {unit}".strip()
    )


def _changed(one: DirectionState) -> str:
    if not one.added:
        return "no"
    ends = [entry.at_s + entry.for_s for entry in one.added if entry.for_s is not None]
    return f"until {max(ends):.1f} s" if len(ends) == len(one.added) else "yes"


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return _NO_VALUE
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f}{' ' if unit else ''}{unit}"
