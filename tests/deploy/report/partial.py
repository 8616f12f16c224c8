"""Parts of a summary with a few figures chosen by hand, unchecked: what a test does not name is not there."""

from collections.abc import Iterable, Mapping
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from tis.common.errors import CURE
from tis.deploy.report.section import Section
from tis.deploy.report.summary import Summary


def part(model: type[Section], values: Mapping[str, Any]) -> Any:
    """Return a section with these values, the sections within it likewise."""
    fields = model.model_fields
    return model.model_construct(**{name: _as(fields[name].annotation, value) for name, value in values.items()})


def summary_of(values: Mapping[str, Any]) -> Any:
    """Return a summary with these values, read from one clock."""
    return part(Summary, {"uncertainty_ms": {}, "not_resolvable": [], "recording": None, **values})


def causes(problems: Iterable[str]) -> list[str]:
    """Return problems without what to do about them."""
    return [text.partition(CURE)[0] for text in problems]


def _as(kind: Any, value: Any) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _as(inner[0], value)
    if origin in (Union, UnionType):
        sections = [one for one in inner if isinstance(one, type) and issubclass(one, Section)]
        return _as(sections[0], value) if sections and isinstance(value, Mapping) else value
    if origin is dict and isinstance(value, Mapping):
        return {name: _as(inner[1], one) for name, one in value.items()}
    if origin is list and isinstance(value, list):
        return [_as(inner[0], one) for one in value]
    if isinstance(kind, type) and issubclass(kind, Section) and isinstance(value, Mapping):
        return part(kind, value)
    return value
