"""Rules between a live source, the plant, and the training of the models: what a run without a recording needs."""

from collections.abc import Mapping

from tis.common.errors import Fault, InputError
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.patient import PatientPart, is_model_file
from tis.common.scenario.source import Source


def live_rules(session: str, source: Source, patient: PatientPart, train: str) -> Mapping[str, bool]:
    """Return the rules of sources and plants that join by keys, each with whether it holds.

    Oracle: scenarios that break one rule each, tests/common/scenario/test_live_source.
    """
    is_live = isinstance(source, LiveSource)
    return {
        "patient.plant.kind must not be replay with a live source: there is no recorded arm to replay": (
            not is_live or patient.plant.kind != "replay"
        ),
        "identification.train must be synthetic or a model file with a live source, which has no training rows": (
            not is_live or train == "synthetic" or is_model_file(train)
        ),
        "identification.train can be synthetic with a live source only: own_head trains on a source's own rows": (
            is_live or train != "synthetic"
        ),
        f"source.keys must not begin with {session}/, the run's own keys, which cross the network": (
            not isinstance(source, LiveSource) or not any(_is_below(key, session) for key in source.all_keys)
        ),
        "patient.safety.enabled must be true with an external plant, which follows the set points": (
            patient.plant.kind != "external" or patient.safety.enabled
        ),
    }


def _is_below(key: str, session: str) -> bool:
    """Tell whether a key expression can be one of a session's keys."""
    return key.split("/")[0] in (session, "*", "**")


def virtual_time_faults(where: str, source: Source, patient: PatientPart) -> list[Fault]:
    """Return the faults of a scenario that cannot run in virtual time: its movement or its arm is made elsewhere."""
    faults = []
    if source.kind == "live":
        rule = "must be recorded or synthetic in virtual time: nothing tells what a live device would do"
        faults.append(Fault(where, "source.kind", rule, source.kind))
    if patient.plant.kind == "external":
        rule = "must be replay, servo or mujoco in virtual time: an external arm moves in real time only"
        faults.append(Fault(where, "patient.plant.kind", rule, patient.plant.kind))
    return faults


def check_foreign_surgeon(where: str, source: Source) -> None:
    """Raise `InputError` where another program cannot be the surgeon: the source would tell another movement."""
    if source.kind != "live":
        rule = "must be live with a foreign surgeon: only then nothing is expected of its movement"
        raise InputError(Fault(where, "source.kind", rule, source.kind))
