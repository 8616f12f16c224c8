"""Profiles from records: fitted stages, their uncertainty and their provenance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from tis.common.channels import Direction
from tis.common.errors import DataError, Fault
from tis.common.runtime.scenario_files import load_traces, read_limited
from tis.common.scenario.network.delay import TraceDelay
from tis.common.scenario.profile import Profile
from tis.common.trace import Trace
from tis.deploy.net.foreign_records import both_ways, captured, parse_round_trips
from tis.deploy.net.profiles import build_profile
from tis.deploy.net.run_records import run_records
from tis.netem.fit.backlogs import MESSAGE_BYTES
from tis.netem.fit.candidates import REPLAYS, fit_closing
from tis.netem.fit.direction import MIN_RECEIVED, DirectionFit
from tis.netem.fit.marginal import MarginalName
from tis.netem.fit.record import DirectionRecord
from tis.netem.fit.statistics import AUTOCORRELATIONS

_MIN_ARRIVED: Final = 100
_TELLS_STATES: Final = 3000
"""Of a made network with two states, slow for .9 s in every 3.5 s, 300 answers to ping fit one regime, 3000 both."""
_MAX_BYTES: Final = 256_000_000
_MAX_INTERVAL_RATIO: Final = 4.0

Ways = Literal["forward", "feedback", "both"]
Records = Mapping[Direction, DirectionRecord]
Fits = Mapping[Direction, DirectionFit]


def records(
    source: Path, ways: Ways, received: Path | None = None, key: str | None = None
) -> dict[Direction, DirectionRecord]:
    """Return the record to fit for each direction: from a run folder's log, one trace, round trips, or captures.

    Of a run folder it is that of ``key``, None: of its busiest. One trace, and the pair of captures ``source`` and
    ``received``, stand for ``ways``. Of round trips, ``feedback`` is the constant half unless ``ways`` is
    ``feedback``. Raises `DataError`, and `InputError` for an unknown key.
    """
    if received is not None:
        return dict.fromkeys(_directions(ways), DirectionRecord.of(captured(source, received)))
    if source.is_dir():
        return run_records(source, key)
    trip = _round_trips(source)
    if trip is not None:
        varying, constant = (DirectionRecord.of(trace) for trace in both_ways(trip))
        return (
            {"forward": constant, "feedback": varying}
            if ways == "feedback"
            else {"forward": varying, "feedback": constant}
        )
    path = str(source)
    record = DirectionRecord.of(load_traces(TraceDelay(kind="trace", path=path, advance="packet"))[path])
    return dict.fromkeys(_directions(ways), record)


def _directions(ways: Ways) -> tuple[Direction, ...]:
    return ("forward", "feedback") if ways == "both" else (ways,)


def _round_trips(source: Path) -> Trace | None:
    """Return the round trips in a file, None where it has none; what cannot be read is reported as a trace."""
    try:
        content = read_limited(source, _MAX_BYTES)
    except OSError:
        return None
    return parse_round_trips(content.decode("utf-8", "replace"), str(source))


def fit_records(
    of: Records, wanted: MarginalName | None = None, n_replays: int = REPLAYS
) -> tuple[dict[Direction, DirectionFit], list[tuple[Direction, Fault]]]:
    """Fit each distinct record once; return the fits, and a fault for each record without one.

    A network has one path of states for both directions, so of two records only the first has states. ``wanted``
    does not bind a constant record beside another one, as the constant half of round trips. Raises `DataError` when
    no record can be fitted.
    """
    done: dict[int, DirectionFit] = {}
    refused: dict[int, Fault] = {}
    alone = len({id(record) for record in of.values()}) == 1
    for record in of.values():
        if id(record) not in done and id(record) not in refused:
            taken = any(fit.states is not None for fit in done.values())
            try:
                own = wanted if alone or not _is_constant(record.trace) else None
                done[id(record)] = fit_closing(record, own, n_replays, with_states=not taken)
            except ValueError as error:
                without = f", without {'; '.join(record.left_out)}" if record.left_out else ""
                refused[id(record)] = Fault(record.trace.label, "", f"{error}{without}{_advice(record.trace)}")
    if not done:
        varying = [refused[id(record)] for record in of.values() if alone or not _is_constant(record.trace)]
        raise DataError(list(dict.fromkeys(varying)) or list(refused.values()))
    fits = {direction: done[id(record)] for direction, record in of.items() if id(record) in done}
    return fits, [(direction, refused[id(record)]) for direction, record in of.items() if id(record) in refused]


def _is_constant(trace: Trace) -> bool:
    return len(np.unique(trace.delay_ns[trace.delay_ns >= 0])) == 1


def _advice(trace: Trace) -> str:
    is_short = int((trace.delay_ns >= 0).sum()) < MIN_RECEIVED
    return "; record more round trips, as with `ping -c 200`" if is_short and "split" in trace.about else ""


def refuse_unfitted(source: Path, unfitted: Sequence[tuple[Direction, Fault]]) -> None:
    """Raise `DataError` if a recorded direction has no fit: all of its delays and losses would be missing.

    Only of a run folder a direction is left out, as applications may use one way alone.
    """
    if unfitted and not source.is_dir():
        raise DataError([fault for _, fault in unfitted])


def profile_of(name: str, of: Records, fits: Fits, unfitted: Sequence[tuple[Direction, Fault]] = ()) -> Profile:
    """Return a profile whose sources are the records' headers and whose numbers are the fits."""
    numbers: list[dict[str, str]] = []
    sources: dict[str, str] = {}
    network: dict[str, Any] = {}
    # one trace for both directions is a single record with a single source
    together = len({id(of[direction]) for direction in fits}) == 1
    for direction, fit in fits.items():
        if together and sources:
            break
        found = fit.network(*fits) if together else fit.network(direction)
        n_outages = len(network.get("outages", []))
        outages = [*network.get("outages", []), *found.get("outages", [])]
        steps = [*network.get("steps", []), *found.get("steps", [])]
        network |= found | ({"outages": outages} if outages else {}) | ({"steps": steps} if steps else {})
        source = "record" if together else f"record_{direction}"
        sources[source] = _origin(of[direction], fit)
        where = "*" if together and len(fits) > 1 else direction
        numbers += [
            {"of": f"{where}.{stage}", "source": source, "basis": "fitted", "note": note}
            for stage, note in _notes(fit).items()
        ]
        lengths_s = {} if fit.outages.process is None else {"outages": fit.outages.lengths_s}
        lengths_s |= {} if fit.stalls is None else {"stalls": fit.stalls.lengths_s}
        for what, s in lengths_s.items():
            note = f"{len(s)} {what} of {s.min():.4g} to {s.max():.4g} s"
            numbers.append({"of": f"outages.{n_outages}", "source": source, "basis": "fitted", "note": note})
            n_outages += 1
        if fit.steps is not None:
            note = f"{len(fit.steps.values_ms)} values of 0 to {fit.steps.values_ms.max():.4g} ms"
            numbers.append({"of": f"steps.{len(steps) - 1}", "source": source, "basis": "fitted", "note": note})
        if fit.states is not None:
            numbers.append({"of": "states", "source": source, "basis": "fitted", "note": fit.states.note})
    raw = {
        "name": name,
        "title": f"Fitted to {of[next(iter(fits))].trace.label}",
        "notes": " ".join([_remarks(fits, together), *(f"{line}." for line in unfitted_lines(unfitted))]),
        "sources": sources,
        "network": network,
        "numbers": numbers,
    }
    return build_profile(raw, name)


def unfitted_lines(unfitted: Sequence[tuple[Direction, Fault]]) -> list[str]:
    """Return a line for each direction without a fit."""
    return [f"{direction}: left out of the profile, {fault.where}: {fault.rule}" for direction, fault in unfitted]


def _origin(record: DirectionRecord, fit: DirectionFit) -> str:
    trace = record.trace
    about = "; ".join(f"{key}: {value}" for key, value in trace.about.items())
    return f"{trace.label}, {fit.n} messages in {fit.duration_s:.3f} s" + (f" ({about})" if about else "")


def _notes(fit: DirectionFit) -> dict[str, str]:
    chosen = next(candidate for candidate in fit.marginal.candidates if candidate.name == fit.marginal.chosen)
    n_arrived = fit.n - fit.n_lost
    notes = {
        "delay": fit.steady
        if fit.steady and chosen.name == "constant"
        else f"{chosen.name}, Kolmogorov-Smirnov distance {chosen.ks:.4f} to {n_arrived} delays",
        "correlation": "half-life of the Gaussian scores"
        + ("" if (ends := fit.half_life.interval) is None else f", 95 % within {ends[0]:.4g} to {ends[1]:.4g} s"),
        "loss": f"{fit.n_lost} of {fit.n} lost, 95 % within {_percent(fit.losses.p_loss_interval)}"
        + (
            ""
            if (runs := fit.losses.mean_burst_interval) is None
            else f"; mean run {fit.losses.mean_burst:.4g}, 95 % within {runs[0]:.4g} to {runs[1]:.4g}"
        ),
    }
    if fit.backlogs is not None:
        notes["rate"] = f"slopes of {fit.backlogs.n} backlogs, for messages of {MESSAGE_BYTES} bytes"
    notes |= dict.fromkeys(("duplicate", "corrupt"), f"share of the {n_arrived} messages that arrived")
    return {stage: note for stage, note in notes.items() if stage in fit.stages}


def _percent(interval: tuple[float, float]) -> str:
    return f"{100 * interval[0]:.4g} to {100 * interval[1]:.4g} %"


def cautions(fit: DirectionFit) -> list[str]:
    """Return warnings about a fit: too few messages, a wide half-life, what does not close, states not told apart."""
    found = []
    n_arrived = fit.n - fit.n_lost
    if n_arrived < _MIN_ARRIVED:
        found.append(f"only {n_arrived} messages arrived: a delay fit needs at least {_MIN_ARRIVED} to be reliable")
    ends = fit.half_life.interval
    if ends is not None and ends[1] > _MAX_INTERVAL_RATIO * ends[0]:
        found.append(f"the half-life is between {ends[0]:.2g} and {ends[1]:.2g} s: measure longer")
    missed = [one for one in fit.closures if not one.closes]
    found += [
        f"{one.name} does not close: {one.record:.4g} in the record and {one.mean:.4g} in the mean of "
        f"{fit.n_replays} replays, fewer than 85 of 100 within the {one.low:.4g} to {one.high:.4g} of further records"
        for one in missed
    ]
    memory = [one.name for one in missed if one.name in AUTOCORRELATIONS]
    if memory and fit.has_one_regime:
        more = max(_TELLS_STATES, 2 * fit.n)
        found.append(
            f"{' and '.join(memory)}: slow stretches that come and go, states of the network, would explain it; "
            f"{fit.n} messages do not tell them apart, so the fit has none: measure {more} or more"
        )
    return found


def _remarks(fits: Fits, together: bool) -> str:
    remarks = []
    if together and len(fits) > 1:
        remarks.append("One direction was recorded and stands for both.")
    for direction, fit in fits.items():
        about = "" if together else f"{direction}: "
        remarks += [f"{about}{caution}." for caution in cautions(fit)]
        remarks += [f"{about}left out: {left_out}." for left_out in fit.left_out]
        if fit.half_life.seconds is None:
            remarks.append(f"{about}no correlation of delays: {fit.half_life.why}.")
        elif fit.half_life.correlated_share is not None and fit.half_life.correlated_share < 0.8:
            remarks.append(
                f"{about}only {100 * fit.half_life.correlated_share:.0f} % of the delays' variance fades with the "
                "half-life; the rest changes from message to message, which the model does not reproduce."
            )
        if fit.n_lost == 0:
            high = fit.losses.p_loss_interval[1]
            remarks.append(f"{about}no losses in {fit.n} messages: below {100 * high:.2g} % at 95 %.")
        if fit.closures:
            each = (f"{one.name}: {one.record:.4g} ({one.low:.4g} to {one.high:.4g})" for one in fit.closures)
            expected = "Record, and where 95 of 100 further records of its length are expected"
            remarks.append(f"{about}{expected}: {'; '.join(each)}.")
        if together:
            break
    return " ".join(remarks)


def plain(fits: Fits) -> dict[str, Any]:
    """Return the fits as plain values, for ``--json``."""
    return {
        direction: {
            "stages": fit.stages,
            "n": fit.n,
            "n_lost": fit.n_lost,
            "duration_s": fit.duration_s,
            "overtaken": fit.overtaken,
            "steady": fit.steady,
            "left_out": list(fit.left_out),
            "chosen": fit.marginal.chosen,
            "ks_bound": fit.marginal.ks_bound,
            "candidates": [candidate._asdict() for candidate in fit.marginal.candidates],
            "half_life": fit.half_life._asdict(),
            "losses": fit.losses._asdict(),
            "outages": fit.outages.process,
            "outage_lengths_s": fit.outages.lengths_s.tolist(),
            "stalls": None if fit.stalls is None else fit.stalls.process,
            "stall_lengths_s": [] if fit.stalls is None else fit.stalls.lengths_s.tolist(),
            "backlogs": None
            if fit.backlogs is None
            else {name: value for name, value in fit.backlogs._asdict().items() if name != "within"},
            "steps": None if fit.steps is None else fit.steps.process,
            "states": None if fit.states is None else fit.states.network(direction),
            "n_replays": fit.n_replays,
            "closures": [{**one._asdict(), "closes": one.closes} for one in fit.closures],
        }
        for direction, fit in fits.items()
    }
