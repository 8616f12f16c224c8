"""Declarations of the logs' topics: complete, and found by the keys of records."""

import pickle

import pytest

from tis.common.messages import Message, PredictedPose, SetPoint
from tis.common.records import COUNTERS, ESTIMATES, FATES, ORIENTATIONS, RELEASES, TICKS, TickNote
from tis.common.safety_records import QUARANTINE
from tis.common.topics import LOCAL, RECORD_MODULES, TOPICS, topic_of
from tis.deploy.logs.read.frame import Frame

DURATIONS = {"step_ns", "for_ns", "phase_ns", "age_ns", "age_before_ns", "round_trip_ns"}
ON_PROCESSORS = {f"{name}_ns" for name in ("own", "busy", "idle", "iowait", "steal", "throttled")}
NETEMS = {"FateBatch", "ReleaseBatch", "QueueNote", "ControlNote"}
CLOCKS_OWN = {"ClockNote", "ExchangeNote", "DisciplineNote"}


def test_every_model_of_a_record_has_one_topic() -> None:
    models = [
        one
        for module in RECORD_MODULES
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, Message) and one.__module__ == module.__name__
    ]
    assert len(models) > 20
    assert sorted(model.__name__ for model in models) == sorted(topic.model.__name__ for topic in TOPICS.values())


def test_every_instant_of_every_record_has_an_owner() -> None:
    """A record added later must say whose clock its stamps are by."""
    for topic in (*TOPICS.values(), *LOCAL.values()):
        assert {*topic.stamps, *topic.samples} <= set(topic.fields), topic
        if topic.model.__name__ not in NETEMS | CLOCKS_OWN:
            stated = {"sample_ns"} if topic is QUARANTINE else set()  # by whoever sent it, perhaps on no clock
            instants = {name for name in topic.fields if name.endswith("_ns")}
            assert instants <= {*topic.stamps, *topic.samples} | DURATIONS | ON_PROCESSORS | stated, topic


def test_a_record_is_found_by_its_key() -> None:
    assert topic_of("/tis/ticks") is TICKS
    assert topic_of("/tis/counters") is COUNTERS
    assert topic_of("/tis/estimates/own:a/b.py") is ESTIMATES
    assert topic_of("/tis/orientations/hold") is ORIENTATIONS
    assert [topic_of(key) for key in ("/tis/ticks/x", "/x", "tis/MTML/measured_cp", "servo_cp")] == [None] * 4
    for key, model in (("tis/PSM2/servo_cp", SetPoint), ("a/b/PSM1/predicted_cp", PredictedPose)):
        topic = topic_of(key)
        assert topic is not None
        assert topic.model is model


def test_a_topic_is_its_key_as_text() -> None:
    assert {"/tis/ticks": 1}[TICKS] == 1
    assert f"{ESTIMATES}/hold" == "/tis/estimates/hold"
    assert pickle.loads(pickle.dumps(TICKS)) == "/tis/ticks"
    assert (TICKS.model, TICKS.table, TICKS.about) == (TickNote, "ticks", "A tick of this side, begun or missed.")


@pytest.mark.parametrize("topic", [*TOPICS.values(), *LOCAL.values()])
def test_every_record_can_be_columns(topic: str) -> None:
    declared = TOPICS.get(topic) or LOCAL[topic]
    if declared not in (FATES, RELEASES):
        assert Frame.of(declared).names == declared.fields
