"""Text of the live page: state of the run and its sides, figures of the last seconds, state of netem."""

from collections.abc import Mapping, Sequence
from html import escape
from types import MappingProxyType
from typing import Final, NamedTuple, get_args

from tis.common.channels import Side
from tis.common.clocks import UNKNOWN_DRIFT_PPM
from tis.common.peer_life import NO_ALARMS, TEXTS, Alarm
from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.units import NS_PER_S
from tis.deploy.view.hold_reason import RunAbout
from tis.deploy.watch.book import MISSING
from tis.deploy.watch.live_figures import LiveFigures
from tis.deploy.watch.observer import Attendance, Vantage
from tis.deploy.watch.safety import Stretch
from tis.netem.expected.synopsis import beside_delay

_NO_VALUE: Final = "–"
_KINDS: Final = {"constant": "", "bernoulli": "each message by itself"}
"""Models shown by a description instead of their name."""

_SPOKEN: Final = {"std": "deviation"}

_END_TO_END: Final = (
    "End to end goes by the newest sample that the patient has, command or arm position, so it can be below the "
    "one-way delay, which is that of every arm position."
)


class RunOutput(NamedTuple):
    """Output of a finished run: its kind, report or folder, and its path."""

    what: str
    path: str


class PageContext(NamedTuple):
    """Run that the page shows: one started with the page (``beside``), or one at these endpoints."""

    beside: bool
    west: str
    east: str
    is_driven: bool = False
    """Whether a page can move the hand."""
    about: RunAbout | None = None
    """The run's scenario, where the page's command started it."""
    is_reported: bool = True
    """Whether a report is written at the end of the run that was started with the page."""


def run_html(
    attendance: Attendance,
    now_s: float,
    context: PageContext,
    output: RunOutput | None = None,
    alarms: Mapping[Alarm, int] = NO_ALARMS,
) -> str:
    """Return the state of the run, what the patient has evidence of and, after the end, the place of the output."""
    end = _end_html(context, output) if "netem" in attendance.left else ""
    told = "".join(
        f'<p class="alarm" role="alert">The patient {escape(TEXTS[alarm])}, since {begun_ns / NS_PER_S:.1f} s.</p>'
        for alarm, begun_ns in sorted(alarms.items())
    )
    return f'<p class="run">{escape(run_text(attendance, now_s, context))}</p>{told}{end}'


def run_text(attendance: Attendance, now_s: float, context: PageContext) -> str:
    """Return the state of the run as a sentence."""
    if "netem" in attendance.left:
        reason = f": {attendance.end_reason}" if attendance.end_reason else ""
        return f"The run has ended after {now_s:.1f} s{reason}."
    if not attendance.connected:
        if context.beside:
            return "The run is being started; this takes a few seconds."
        return f"Waiting for a run whose netem listens at {context.west} (west) and {context.east} (east)."
    if now_s <= 0:
        missing = [side for side in get_args(Side) if side not in attendance.present]
        return f"Waiting for {' and '.join(missing)}." if missing else "All three are ready; it begins."
    whole = "" if context.about is None else f" of {context.about.duration_s:g} s"
    return f"Running, {now_s:.0f} s{whole}"


def _end_html(context: PageContext, output: RunOutput | None) -> str:
    if output is not None:
        where = f"Its {escape(output.what)}: <code>{escape(output.path)}</code>"
    elif context.beside:
        where = "Its report is being written." if context.is_reported else "Its summary is being written."
    else:
        where = "Its report lies where the run was started; tis names the folder there."
    return f'<p class="end">{where}<br>Nothing here changes any more: below are its last seconds.</p>'


def figures_html(
    found: LiveFigures,
    ticks_missed: Mapping[Side, int],
    picture: str = "",
    note: str = "",
    safety: Mapping[str, Sequence[Stretch]] = MappingProxyType({}),
    is_hold: bool = False,
) -> str:
    """Return the picture of the network beside the other figures as tiles: a name, number with unit, and meaning.

    A note stands below them. An estimate that ``is_hold`` is not compared with hold.
    """
    ratio = found.ratio_to_hold
    if ratio is None or is_hold:
        verdict = "how far the estimate is from the true place, root mean square (RMSE)"
    else:
        verdict = (
            f"of the estimate, root mean square (RMSE): {100 * ratio:.0f} % of the "
            f"{_number(found.hold_rmse_mm, 'mm')} by which repeating the last sample (<i>hold</i>) errs"
        )
    tiles = (
        ("End to end", _number(found.end_to_end_p50_ms, "ms"), _silence(found.silent_s)
         or "median, from a new sample to the estimate with it; "
         f"99 of 100 within {_number(found.end_to_end_p99_ms, 'ms')} (p99); at all ticks the newest sample was up to "
         f"{_number(found.age_max_ms, 'ms')} old"),
        ("Position error", _number(found.rmse_mm, "mm"), verdict),
        ("Orientation error", _number(found.turn_rms_deg, "°"),
         f"of the estimate, root mean square; hold errs by {_number(found.hold_turn_rms_deg, '°')}"),
        ("The operator sees", "–" if found.display is None else _number(found.display.feedback_mm, "mm"),
         _silence(found.display_silent_s)
         or "error of the delayed picture, root mean square, against the arm when the newest command acts; "
         + ("while the arm is stopped there is no predicted one" if _all_stopped(safety) else
            f"the predicted arm errs by {_number(found.display and found.display.predicted_mm, 'mm')}")),
        ("Ticks missed", str(sum(ticks_missed.values())) if ticks_missed else _NO_VALUE, _missed(ticks_missed)),
    )  # fmt: skip
    items = "".join(
        f"<li><span>{name}</span><strong>{value}</strong><small>{meaning}</small></li>"
        for name, value, meaning in tiles
    )
    items += _safety_html(safety)
    below = f'<p class="note">{escape(f"{found.limit_text} {_END_TO_END} {note}".strip())}</p>'
    return f'<div class="seconds">{picture}<ul class="tiles">{items}</ul></div>{below}'


def _all_stopped(safety: Mapping[str, Sequence[Stretch]]) -> bool:
    return bool(safety) and all(stretches[-1].mode in ("slow_stop", "safe") for stretches in safety.values())


def _missed(ticks: Mapping[Side, int]) -> str:
    """Return whose ticks were missed: the terminal adds them up, the summary lists each side."""
    each = " and ".join(f"{side} {ticks[side]}" for side in MISSING if side in ticks)
    return f"{each}{': ' if each else ''}ticks that had not begun when the next one was due, since the run began"


def _silence(silent_s: float | None) -> str:
    return "" if silent_s is None else f"nothing arrived for {silent_s:.1f} s"


def _safety_html(safety: Mapping[str, Sequence[Stretch]]) -> str:
    """Return the tile of the safety states: each arm's state now, and a strip of the last seconds."""
    if not safety:
        return ""
    arms = []
    for arm, stretches in safety.items():
        now = stretches[-1]
        parts = "".join(
            f'<i class="{escape(one.mode)}" style="flex-grow:{max(one.until_s - one.from_s, 0.001):.3f}"></i>'
            for one in stretches
        )
        name = f"{escape(arm)} " if len(safety) > 1 else ""
        arms.append(
            f'<strong>{name}{_spoken(now.mode)}</strong><span class="strip" aria-hidden="true">{parts}</span>'
        )
    return (
        f"<li><span>Safety state</span>{''.join(arms)}<small>following: the estimate drives the arm; resuming: the "
        "arm comes slowly back to it; holding, stopping, stopped: it does not. The strip shows the last seconds"
        "</small></li>"
    )


MODES_IN_WORDS: Final = {
    "tracking": "following",
    "resuming": "resuming",
    "hold": "holding",
    "slow_stop": "stopping",
    "safe": "stopped",
}
"""What an arm does in each safety state, wherever the page tells it."""


def _spoken(mode: str) -> str:
    return escape(MODES_IN_WORDS.get(mode, mode))


def vantage_text(found: Vantage | None, context: PageContext) -> str:
    """Return a note on the accuracy of the figures from this host; empty where one clock stamps everything."""
    if context.beside or found is None:
        return ""
    seen = (
        "Delays are seen on netem's own host."
        if found.here
        else "Delays are seen from another host than netem's, and corrected for the ways to here, each taken as half "
        f"a round trip: they may be off by up to {_number(found.bound_ms, 'ms')}."
    )
    return (
        f"{seen} End to end and age go from the surgeon's clock to the patient's, as compared when the run began: on "
        f"two hosts they drift apart, by up to {UNKNOWN_DRIFT_PPM / 1000:g} ms a second. The report corrects both."
    )


def state_html(state: EmulatorState | None) -> str:
    """Return netem's state, a line for each direction."""
    if state is None or state.forward is None or state.feedback is None:
        return "<p>The state of the network is not known yet.</p>"
    items = "".join(
        f"<li><b>{name}</b> {_now(one)}</li>"
        for name, one in (("Now, to the patient:", state.forward), ("Now, back:", state.feedback))
    )
    return f'<ul class="now">{items}</ul>'


def _now(one: DirectionState) -> str:
    if one.outage:
        return f"<strong>outage, nothing passes</strong>{_changed(one)}"
    stages = [f"{name} {_stage(one, name)}" for name in ("delay", "jitter", "loss")]
    stall = ["stall, nothing leaves"] if one.stall else []
    return escape("; ".join([*stall, *stages, *beside_delay(one.now)])) + _changed(one)


def _stage(one: DirectionState, name: str) -> str:
    stage = getattr(one.now, name)
    if stage is None:
        return "none"
    values = stage.model_dump(exclude_none=True, exclude_defaults=True)
    kind = values.pop("kind", stage.kind)
    shown = [_setting(field, value) for field, value in values.items() if isinstance(value, int | float)]
    named = [text for text in (_KINDS.get(kind, kind),) if text]
    return ", ".join([*shown, *named] if kind in _KINDS else [*named, *shown])


def _setting(field: str, value: float) -> str:
    if field == "p_loss":
        return f"{100 * value:g} %"
    name, _, unit = field.rpartition("_")
    return (
        f"{value:g} {unit}"
        if unit == "ms" and name in ("delay", "")
        else f"{_SPOKEN.get(name or field, name or field)} {value:g} {unit}".strip()
    )


def _changed(one: DirectionState) -> str:
    if not one.added:
        return ""
    ends = [entry.at_s + entry.for_s for entry in one.added if entry.for_s is not None]
    until = f" until {max(ends):.1f} s" if len(ends) == len(one.added) else ""
    return f" <em>changed while running{until}</em>"


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return _NO_VALUE
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f}{' ' if unit else ''}{unit}"
