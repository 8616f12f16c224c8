"""The tables are those of the models: every field of every part has its row."""

import json
import re
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import pytest
import yaml
from pydantic import BaseModel
from typer.testing import CliRunner

from tests.netem.making import link
from tis.common.channels import Direction
from tis.common.scenario.control import Operation
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Pipeline, Stages
from tis.deploy.cli.main import app
from tis.deploy.net.stage_reference import EXAMPLE, REQUESTS, Parameter, network_page, sections
from tis.deploy.shell import guard
from tis.netem.control.control import Control
from tis.netem.link.link import Link


def _models(annotation: Any) -> list[type[BaseModel]]:
    """Return the models within an annotation, by the types themselves and not by their schema."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is Annotated:
        return _models(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType, tuple):
        return [model for one in get_args(annotation) for model in _models(one)]
    return []


def _names(model: type[BaseModel]) -> set[str]:
    names: set[str] = set()
    for name, field in model.model_fields.items():
        below = [one for one in _models(field.annotation) if one not in (Pipeline, Change)]
        names |= {f"{name}.{inner}" for one in below for inner in _names(one)} if below else {name}
    return names


FIELDS = {name: field.annotation for name, field in {**Pipeline.model_fields, **NetworkPart.model_fields}.items()}


@pytest.mark.parametrize("name", [*Stages.model_fields, "rules", "outages", "steps", "states", "timeline", "buffer"])
def test_every_field_of_every_kind_has_its_row(name: str) -> None:
    (section,) = [one for one in sections() if one.name == name]
    expected = [_names(model) - {"kind"} for model in _models(FIELDS[name])]
    assert [{one.name.replace("[]", "") for one in kind.parameters} for kind in section.kinds] == expected


def test_ranges_and_defaults_are_said_in_words() -> None:
    found = {
        (section.name, kind.name, one.name): one
        for section in sections()
        for kind in section.kinds
        for one in kind.parameters
    }
    assert found["loss", "burst", "p_loss"][1:3] == (">= 0, < 1", "")
    assert found["loss", "burst", "mean_burst"].values == "1 to 2,000"
    assert found["corrupt", "", "bits"][1:3] == ("integer 1 to 1,000", "1")
    assert found["outages", "periodic", "direction"][1:3] == ("forward, feedback, both", "both")
    assert found["rules", "", "pipeline"].values == "stages"
    assert found["change", "", "outage"][1:3] == ("true, false", "false")
    assert found["delay", "trace", "path"] == Parameter(
        "path", "text", "", "CSV file in the format of `tis net probe`.", required=True
    )


def test_they_are_printed_and_one_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard.OUT, "width", 200)
    listed = CliRunner().invoke(app, ["net", "stages"])
    assert listed.exit_code == 0
    assert "gilbert_elliott   p_bad, p_good, " in listed.output
    assert "[mtu_bytes], [p_loss_bad], [p_loss_good]" in listed.output
    explained = CliRunner().invoke(app, ["net", "stages", "jitter"])
    assert "half_width_ms  0 to 3,600,000  required  Largest deviation in either direction" in explained.output
    of_kind = CliRunner().invoke(app, ["net", "stages", "gilbert_elliott"])
    assert of_kind.output.startswith("loss: ")
    assert "p_loss_good" in of_kind.output
    assert "bernoulli" not in of_kind.output.partition("\n")[2]
    both = CliRunner().invoke(app, ["net", "stages", "uniform"]).output
    assert "delay: " in both
    assert "jitter: " in both
    refused = CliRunner().invoke(app, ["net", "stages", "los"])
    assert refused.exit_code == 2
    assert "NAME: must be one of loss, duplicate, corrupt" in refused.stderr


GUIDE = Path(__file__).parents[3] / "docs" / "emulator" / "describe_network.md"


def test_the_example_has_everything_that_changes_and_is_valid() -> None:
    network = NetworkPart.model_validate(yaml.safe_load(EXAMPLE))
    assert network.states is not None
    assert [len(part) for part in (network.rules, network.outages, network.timeline)] == [2, 1, 1]


def _control() -> Control:
    links: dict[Direction, Link] = {way: link(way) for way in get_args(Direction)}
    return Control(links)


@pytest.mark.parametrize(("operation", "request_"), REQUESTS)
def test_the_requests_shown_are_accepted(operation: str, request_: Any) -> None:
    answer, _ = _control().handle(operation, json.dumps(request_).encode(), 2_000_400_000)
    assert answer.accepted, answer.reasons


def test_every_operation_is_shown() -> None:
    assert {operation for operation, _ in REQUESTS} == set(get_args(Operation))


def test_the_requests_and_stages_of_the_manual_are_those_of_the_emulator() -> None:
    text = network_page() + GUIDE.read_text(encoding="utf-8")
    shown = re.findall(r"^tis/netem/control/(\w+) +(\{.*\})$", text, re.MULTILINE)
    assert {operation for operation, _ in shown} == set(get_args(Operation))
    for operation, request in shown:
        answer, _ = Control(_control().links, _library).handle(operation, request.encode(), 2_000_400_000)
        assert answer.accepted, answer.reasons
    (loss,) = [section for section in sections() if section.name == "loss"]
    assert all(f"`{kind.name}`" in GUIDE.read_text(encoding="utf-8") for kind in loss.kinds)


def test_the_guide_s_networks_are_valid() -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    networks = [raw for raw in map(yaml.safe_load, blocks) if "rules" in raw]
    assert networks
    for raw in networks:
        NetworkPart.model_validate(raw)


def _library(name: str) -> dict[str, Any]:
    return {"forward": {"delay": {"kind": "constant", "delay_ms": 1}}}
