"""The patient's node from a scenario, and the models of its arms from training rows or a model file."""

from collections.abc import Callable, Sequence

from tis.common.channels import HandChannels, hand_channels
from tis.common.errors import DataError, Fault
from tis.common.estimators import short_name
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import is_learned
from tis.common.scenario.security import Mtls
from tis.common.signing import SECRETS
from tis.common.sources.trajectory import Recording
from tis.common.ticker import SendPlan, Ticker
from tis.common.units import ms_to_ns
from tis.patient_side.estimators.guarded import NO_FACTORIES, Factories, build_any
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.external_arm import ExternalArm
from tis.patient_side.hand import PatientHand
from tis.patient_side.identification.companions import Stage, untimed
from tis.patient_side.identification.dataset import trained
from tis.patient_side.identification.identify import identify_hands
from tis.patient_side.learning.train import with_learned
from tis.patient_side.linear_system import Array
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.methods import build_methods
from tis.patient_side.phase_lock import PhaseLock
from tis.patient_side.plant.build import build_plant, executing_plant
from tis.patient_side.plant.protocol import Plant
from tis.patient_side.plant.touching_servo import TouchingServo
from tis.patient_side.playout import Playout
from tis.patient_side.safety import gate
from tis.patient_side.safety.gate import StreamGate
from tis.patient_side.safety.limits import limits_of
from tis.patient_side.safety.safety_state import SafetyFilter
from tis.patient_side.safety.set_point import Place
from tis.patient_side.statespace import ArmModel
from tis.patient_side.touch import ArmTouch


def identify_models(
    scenario: Scenario, recording: Recording, trainings: Sequence[Recording], stage: Stage = untimed
) -> tuple[ArmModel, ...]:
    """Identify one model for each hand of the recording from the training recordings; raises `DataError`.

    ``stage`` measures the fits for single estimators, as `identify_hands` does. Raises `InputError` where the
    scenario requests a model that no filter can use.
    """
    scenario.identification.check_for_runs()
    wanted = {scenario.active_estimator, *scenario.estimators, *scenario.patient.orientation.in_order}
    hands = [hand.hand for hand in recording.hands]
    found = identify_hands(trainings, hands, scenario.identification, recording.pairing, wanted, stage)
    learned = [short_name(name) for name in scenario.estimators if is_learned(name)]
    return with_learned([each.model for each in found], trainings, scenario.identification, learned, stage)


def choose_models(
    scenario: Scenario, models: Sequence[ArmModel], where: str, recording: Recording | None = None
) -> tuple[ArmModel, ...]:
    """Return a file's model for each hand of the scenario; raises `DataError`.

    Their arms must be those that the hands drive in ``recording``; a replay drives none and has no recording.
    """
    by_hand = {model.hand: model for model in models}
    faults = [
        Fault(where, "hand", f"the scenario needs a model of the {hand} hand", sorted(by_hand))
        for hand in scenario.source.hands
        if hand not in by_hand
    ]
    faults += [
        Fault(where, "rate_hz", f"must be the scenario's {scenario.rate_hz}", model.rate_hz)
        for model in models
        if model.rate_hz != scenario.rate_hz
    ]
    faults += [
        Fault(
            where,
            "arm",
            f"must be {part.arm}, which the {part.hand} hand drives in this run: a model file serves runs with the "
            "pairing that it was identified with (source.pairing, or drives of a table's columns)",
            by_hand[part.hand].arm,
        )
        for part in (() if recording is None else recording.hands)
        if part.hand in by_hand and by_hand[part.hand].arm != part.arm
    ]
    if faults:
        raise DataError(faults)
    return tuple(by_hand[hand] for hand in scenario.source.hands)


def build_patient(
    scenario: Scenario,
    models: Sequence[ArmModel],
    recording: Recording | None,
    stopwatch_ns: Callable[[], int] = lambda: 0,
    own: Factories = NO_FACTORIES,
    build: Callable[[str, ArmModel, Factories], Estimator] = build_any,
) -> PatientNode:
    """Return the patient's node; without a recording (in a replay of a log) it has no arm to move.

    ``build`` returns an estimator by its name; ``own`` holds the factories behind the scenario's ``module:factory``
    names. Raises `InputError` where one returns no estimator for a model.
    """
    hands = []
    gates: dict[str, StreamGate] = {}
    names = [scenario.active_estimator, *(name for name in scenario.estimators if name != scenario.active_estimator)]
    if "hold" not in names:
        names.append("hold")  # the reference of all scores
    for i, model in enumerate(models):
        channels = hand_channels(model.hand, model.arm)
        estimators = [build(name, model, own) for name in names]
        plant = _plant(scenario, recording, i) if recording is not None else _touching(scenario, model)
        safety = _safety(scenario, model)
        methods = build_methods(scenario.patient.orientation.in_order, model.wrist)
        hand = PatientHand(channels, Playout(scenario.rate_hz), estimators, plant, safety, methods)
        if scenario.touch is not None:
            servo = plant if isinstance(plant, TouchingServo) else None
            hand.touch = ArmTouch(channels, scenario.touch, scenario.rate_hz, servo)
        hand.holds_on_conflict = scenario.on_conflict == "hold"
        hands.append(hand)
        gates |= _gates(scenario, model, channels)
    if len(hands) > 1:
        one, other = (hand.playout for hand in hands)
        one.other_arm, other.other_arm = other.arm, one.arm
    ticker = Ticker(scenario.rate_hz, scenario.n_samples, ms_to_ns(scenario.patient.tick_phase_ms))
    mode = scenario.patient.tick
    lock = PhaseLock(scenario.rate_hz) if mode == "phase_locked" else None
    rule = scenario.patient.safety.release
    is_forged = not scenario.network.corrupts("forward")
    return PatientNode(
        scenario.session, hands, ticker, stopwatch_ns, lock, mode == "on_arrival", gates, rule,
        _releasers(scenario), is_forged,
    )  # fmt: skip


def _releasers(scenario: Scenario) -> frozenset[str]:
    """Return the names of which one must have signed a release, where messages are signed."""
    security = scenario.security
    if not isinstance(security, Mtls):
        return frozenset((SECRETS,))
    return frozenset(scenario.patient.safety.releasers or ("surgeon", *security.control))


def _plant(scenario: Scenario, recording: Recording, i: int) -> Plant:
    """Return the arm of hand ``i``."""
    hand, spec = recording.hands[i], scenario.patient.plant
    if spec.kind == "external":
        return ExternalArm(hand.hand, hand.arm, ms_to_ns(spec.silent_after_ms))
    return build_plant(scenario, recording, hand)


def _touching(scenario: Scenario, model: ArmModel) -> Plant | None:
    """Return an arm that needs no recording where it decides on set points: one that touches."""
    if scenario.touch is None or scenario.patient.plant.kind == "external":
        return None
    return executing_plant(scenario.patient.plant, scenario.seed, model.arm, scenario.touch)


def _gates(scenario: Scenario, model: ArmModel, channels: HandChannels) -> dict[str, StreamGate]:
    """Return the gates of a hand's two streams by key; their workspaces lie about the means of the training rows."""
    limit, part = scenario.patient.gate, scenario.surgeon
    plan = SendPlan(scenario.rate_hz, scenario.n_samples, part.copies, ms_to_ns(part.copy_spacing_ms))
    streams = (
        (channels.command, model.input_offset_m, model.command_movement),
        (channels.arm, model.output_offset_m, model.arm_movement),
    )
    return {
        channel.key(scenario.session): StreamGate(
            plan,
            _place(at_m),
            gate.limits_of(limit, channel is channels.arm, trained(scenario, movement)),
        )
        for channel, at_m, movement in streams
    }


def _safety(scenario: Scenario, model: ArmModel) -> SafetyFilter | None:
    """Return the safety of an arm, whose workspace lies about the mean of the training rows; None: switched off."""
    part = scenario.patient.safety
    limits = limits_of(part, scenario.rate_hz, trained(scenario, model.arm_movement))
    return SafetyFilter(limits, _place(model.output_offset_m)) if part.enabled else None


def _place(at_m: Array) -> Place:
    x, y, z = at_m.tolist()
    return x, y, z
