"""Inspection of the type annotations of a format's fields, for error messages."""

from types import NoneType, UnionType
from typing import Annotated, Any, TypeGuard, Union, get_args, get_origin

from pydantic import BaseModel


def variants(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the alternative models of a field by their ``kind``, or by class name where they have none."""
    is_union = get_origin(annotation) in (Union, UnionType)
    members = [bare(member) for member in (get_args(annotation) if is_union else (annotation,))]
    named: dict[str, type[BaseModel]] = {}
    for member in members:
        if is_model(member) and "kind" in member.model_fields:
            named |= dict.fromkeys(get_args(member.model_fields["kind"].annotation), member)
        elif is_model(member) and is_union:
            named[member.__name__] = member
    return named


def bare(annotation: Any) -> Any:
    """Return an annotation without ``Annotated`` and ``| None``."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
            continue
        if get_origin(annotation) in (Union, UnionType):
            members = [member for member in get_args(annotation) if member is not NoneType]
            if len(members) == 1:
                annotation = members[0]
                continue
        return annotation


def is_model(annotation: Any) -> TypeGuard[type[BaseModel]]:
    """Tell whether an annotation is a model."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
