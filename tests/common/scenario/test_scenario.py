import json
from collections.abc import Iterator
from types import UnionType
from typing import Any, Union, get_args, get_origin

import pytest
from pydantic import BaseModel, Discriminator, ValidationError

from tis.common.scenario import Scenario
from tis.common.scenario.base import RuleText
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.scenario.reading import build_scenario, schema_json

MINIMAL: dict[str, Any] = {"version": 1, "name": "a", "source": {"kind": "synthetic"}}


def build(**changes: Any) -> Scenario:
    return build_scenario(MINIMAL | changes, "s.yaml")


def models(model: type[BaseModel], seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """Yield the model and every model that its annotations mention."""
    if model in seen:
        return
    seen.add(model)
    yield model
    todo: list[Any] = [field.annotation for field in model.model_fields.values()]
    while todo:
        annotation = todo.pop()
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield from models(annotation, seen)
        todo += get_args(annotation)


ALL_MODELS = list(models(Scenario, set()))


def test_the_defaults_are_a_runnable_scenario() -> None:
    scenario = build()
    assert (scenario.seed, scenario.duration_s, scenario.rate_hz) == (1, 20.0, 30)
    assert scenario.estimators == ("hold", "innovations_kf")
    assert scenario.network.forward == Pipeline()
    assert scenario.hosts == "auto"


@pytest.mark.parametrize("model", ALL_MODELS, ids=lambda model: model.__name__)
def test_every_part_is_frozen_and_refuses_unknown_keys(model: type[BaseModel]) -> None:
    assert model.model_config.get("frozen") is True
    assert model.model_config.get("extra") == "forbid"
    assert model.model_config.get("allow_inf_nan") is False
    assert model.__doc__


def test_the_schema_describes_every_field() -> None:
    schema = json.loads(schema_json())
    parts = {"Scenario": schema, **schema["$defs"]}
    assert {model.__name__ for model in ALL_MODELS} == set(parts)
    bare = [
        f"{part}.{name}"
        for part, body in parts.items()
        for name, field in body["properties"].items()
        if not field.get("description", "").strip()
    ]
    assert bare == []
    assert all(body["additionalProperties"] is False for body in parts.values())


@pytest.mark.parametrize("model", ALL_MODELS, ids=lambda model: model.__name__)
def test_every_union_is_told_apart_by_kind_or_explained_in_words(model: type[BaseModel]) -> None:
    """Else a bad value is refused once by each branch, under names that no file contains."""
    for name, field in model.model_fields.items():
        members = [part for part in get_args(field.annotation) if part is not type(None)]
        if get_origin(field.annotation) in (Union, UnionType) and len(members) > 1:
            explained = any(isinstance(note, RuleText | Discriminator) for note in field.metadata)
            assert explained or field.discriminator is not None, f"{model.__name__}.{name}"


def test_counts_and_instants() -> None:
    scenario = build(duration_s=0.7, rate_hz=30, drain_s=0.5)
    assert scenario.n_samples == 21  # 0.7 * 30 is 20.999999999999996 in floats
    assert scenario.end_ns == 1_200_000_000


def test_the_observers_commands_pass_clean() -> None:
    assert build().generated_rules() == ()
    observer = build(topology="observer", session="lab").generated_rules()
    assert [rule.key for rule in observer] == ["lab/MTML/measured_cp", "lab/MTMR/measured_cp"]
    assert all(rule.pipeline == Pipeline() and rule.direction == "forward" for rule in observer)


@pytest.mark.parametrize(
    ("given", "alone", "policy"),
    [
        (None, True, "continue"),
        (None, False, "end"),
        ("end", True, "end"),
        ("continue", False, "continue"),
    ],
)
def test_policy_on_peer_loss(given: str | None, alone: bool, policy: str) -> None:
    assert build(on_peer_loss=given).peer_loss_policy(alone) == policy


def test_a_scenario_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        build().seed = 2  # type: ignore[misc]
