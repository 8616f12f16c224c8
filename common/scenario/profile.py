"""A profile: a named network in which every number has a source and a degree of certainty."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from tis.common.scenario.base import Part, RuleText, refuse
from tis.common.scenario.network import NetworkPart

Basis = Literal["measured", "fitted", "judgement"]

ProfileName = Annotated[
    str,
    StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_-]{0,63}$"),
    RuleText("must consist of at most 64 letters, digits, '_' and '-', and not begin with '-'"),
]
NumberPath = Annotated[
    str,
    StringConstraints(pattern=r"^[^.\s]+(\.[^.\s]+)*$"),
    RuleText("must be a path like forward.delay.points or *.loss.p_loss"),
]
_Text = Annotated[str, Field(min_length=1)]


class Number(Part):
    """Provenance of numbers in a profile.

    ``of`` is a path below ``network`` and covers all numbers beneath it. ``*`` stands for any one step, so that
    ``*.delay`` means both directions.
    """

    of: NumberPath = Field(description="Path of the numbers below network, like forward.delay.points.")
    source: _Text = Field(description="Name of the source, one of sources.")
    basis: Basis = Field(
        description="measured: published or recorded as such; fitted: computed from measured or published numbers; "
        "judgement: chosen, because no source gives it."
    )
    note: str = Field("", description="Derivation of the numbers: splitting, rounding, assumptions.")

    def covers(self, path: tuple[str, ...]) -> bool:
        """Tell whether the entry covers the number at ``path``."""
        steps = self.of.split(".")
        return len(steps) <= len(path) and all(step in ("*", there) for step, there in zip(steps, path, strict=False))


class Profile(Part):
    """A network of the library, or one fitted to a trace. Every number is one way, per direction."""

    name: ProfileName = Field(description="Name of the profile, used in scenarios.")
    title: _Text = Field(description="Short description, one line.")
    notes: str = Field("", description="Remarks for users, such as omissions and unpublished quantities.")
    sources: dict[ProfileName, _Text] = Field(
        min_length=1, description="Publications and recordings, by a short name."
    )
    network: NetworkPart = Field(description="The network, as under network in a scenario.")
    numbers: tuple[Number, ...] = Field((), description="Source and basis of each number in the network.")

    @model_validator(mode="after")
    def _accounted_for(self) -> Self:
        """Refuse numbers with no source or two, and entries without a number."""
        faults = []
        if self.network.from_profile is not None:
            faults.append("network must not refer to another profile")
        paths = list(numeric_paths(self.partial()))
        for path in paths:
            of = [number.of for number in self.numbers if number.covers(path)]
            if not of:
                faults.append(f"numbers must have an entry for network.{'.'.join(path)}")
            elif len(of) > 1:
                faults.append(f"numbers must cover network.{'.'.join(path)} once, not by {' and '.join(of)}")
        for number in self.numbers:
            if number.source not in self.sources:
                faults.append(
                    f"numbers.source must be one of sources ({', '.join(self.sources)}), not {number.source}"
                )
            if not any(number.covers(path) for path in paths):
                faults.append(f"numbers.of must be a path of numbers in network, not {number.of}")
        faults += [
            f"sources must be used: no number refers to {source}"
            for source in self.sources
            if paths and all(number.source != source for number in self.numbers)
        ]
        refuse(dict.fromkeys(faults))
        return self

    def partial(self) -> dict[str, Any]:
        """Return the network as plain values, without the defaults that the file omits."""
        return self.network.model_dump(mode="json", exclude_unset=True)

    def basis_of(self, path: tuple[str, ...]) -> Number | None:
        """Return the entry that covers a number."""
        return next((number for number in self.numbers if number.covers(path)), None)


def numeric_paths(tree: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of every number in a tree of mappings and lists, places in lists counted from 0."""
    if isinstance(tree, Mapping):
        for key, below in tree.items():
            yield from numeric_paths(below, (*above, str(key)))
    elif isinstance(tree, list | tuple):
        for place, below in enumerate(tree):
            yield from numeric_paths(below, (*above, str(place)))
    elif isinstance(tree, int | float) and not isinstance(tree, bool):
        yield above
