"""The walk from pydantic's locations to the paths of a file, on models made for it."""

import re
from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from tis.common.errors import InputError
from tis.common.scenario.base import RuleText
from tis.common.scenario.faults import faults
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.reading import build_scenario


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Circle(Strict):
    kind: Literal["circle", "disc"]
    radius_mm: float = Field(ge=0)
    # fields that are called like the tags which pydantic puts into its locations
    circle: int = 0
    disc: int = 0


class Box(Strict):
    kind: Literal["box"]
    width_mm: float
    inner: Annotated[Circle, Field(discriminator="kind")] | None = None

    @model_validator(mode="after")
    def _wide(self) -> "Box":
        if self.width_mm < 1:
            raise ValueError("width_mm must be at least 1\nbox is too small")
        return self


Shape = Annotated[Circle | Box, Field(discriminator="kind")]


class Drawing(Strict):
    shapes: tuple[Shape, ...] = ()
    only: Annotated[Circle, Field(discriminator="kind")] | None = None
    sizes_mm: Annotated[tuple[float, ...], Field(min_length=2)] = (1.0, 2.0)
    label: Annotated[Literal["auto"] | int, RuleText("must be {curly} or a number")] = "auto"


def texts(raw: dict[str, Any]) -> list[str]:
    with pytest.raises(ValidationError) as caught:
        Drawing.model_validate(raw)
    return [str(fault) for fault in faults(caught.value, Drawing, "f")]


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (
            {"shapes": [{"kind": "box", "width_mm": 2}, {"kind": "circle", "radius_mm": -1}]},
            ["f: shapes.1.radius_mm: must be at least 0 (got -1)"],
        ),
        (
            {"only": {"kind": "circle", "radius_mm": 1, "circle": "x", "disc": "y"}},
            ["f: only.circle: must be an integer (got 'x')", "f: only.disc: must be an integer (got 'y')"],
        ),
        (
            {"shapes": [{"kind": "box", "width_mm": 2, "inner": {"kind": "disc", "radius_m": 1}}]},
            [
                "f: shapes.0.inner.radius_mm: is required",
                "f: shapes.0.inner.radius_m: unknown key, did you mean 'radius_mm'? (got 1)",
            ],
        ),
        (
            {"shapes": [{"kind": "box", "width_mm": 0}]},
            ["f: shapes.0: width_mm must be at least 1", "f: shapes.0: box is too small"],
        ),
        (
            {"shapes": [{"kind": "ball"}, {}, 3]},
            [
                "f: shapes.0.kind: must be 'circle' or 'disc' or 'box' (got 'ball')",
                "f: shapes.1.kind: is required ('circle' or 'disc' or 'box')",
                "f: shapes.2: must be a mapping with a kind (got 3)",
            ],
        ),
        ({"label": "foo"}, ["f: label: must be {curly} or a number (got 'foo')"]),
        # a mapping where a list belongs is not shown: it can be long
        ({"shapes": {}, "a\nb": 1}, ["f: shapes: must be a list", "f: 'a\\nb': unknown key (got 1)"]),
        ({"sizes_mm": [1.0, "x"]}, ["f: sizes_mm.1: must be a number (got 'x')"]),
        ({"sizes_mm": [1.0]}, ["f: sizes_mm: must have at least 2 items (got [1.0])"]),
    ],
)
def test_the_path_is_the_files_and_the_rule_is_said_once(raw: dict[str, Any], expected: list[str]) -> None:
    assert texts(raw) == expected


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (
            {"shapes": [{"kind": "cirle", "radius_mm": 1}]},
            "shapes.0.kind: must be 'circle' or 'disc' or 'box', did you mean 'circle'? (got 'cirle')",
        ),
        ({"shapes": [{"kind": 5}]}, "shapes.0.kind: must be 'circle' or 'disc' or 'box' (got 5)"),
        ({"shapes": [{"kind": "fnord"}]}, "shapes.0.kind: must be 'circle' or 'disc' or 'box' (got 'fnord')"),
    ],
)
def test_a_word_that_is_nearly_right_is_named(raw: dict[str, Any], said: str) -> None:
    assert f"f: {said}" in texts(raw)


@pytest.mark.parametrize(("name", "meant"), [("west", "forward"), ("east", "feedback")])
def test_a_direction_by_its_end_is_named(name: str, meant: str) -> None:
    with pytest.raises(ValidationError) as caught:
        NetworkPart.model_validate({name: {}})
    assert [str(fault) for fault in faults(caught.value, NetworkPart, "f")] == [
        f"f: {name}: unknown key, did you mean {meant!r}? (got {{}})"
    ]


def test_of_very_many_faults_the_first_are_named_and_the_others_counted() -> None:
    with pytest.raises(InputError) as caught:
        build_scenario({f"k{i}": 0 for i in range(5000)}, "a.yaml")
    assert len(caught.value.faults) == 201
    assert re.fullmatch(r"a\.yaml: and 4\d\d\d more faults", str(caught.value.faults[-1]))
