"""Page of the Python API: its objects' own docstrings."""

from importlib import import_module

from pydantic import BaseModel

from from_code.sources import API

_HEAD = """# Python API

The objects that scripts and notebooks may use. Names elsewhere in the packages may change with any version.
"""


def page() -> str:
    """Return the page."""
    parts = [_HEAD]
    for title, (module, members) in API.items():
        parts += [f"## {title}", "", f"```{{eval-rst}}\n.. module:: {module}\n```", ""]
        parts += [f"```python\nfrom {module} import {', '.join(members)}\n```", ""]
        parts += [_object(module, member) for member in members]
    return "\n".join(parts)


def _object(module: str, name: str) -> str:
    found = getattr(import_module(module), name)
    if isinstance(found, type) and issubclass(found, BaseModel):
        return _model(f"{module}.{name}", found)
    kind = "autoclass" if name[0].isupper() else "autofunction"
    options = "   :members:\n   :member-order: bysource\n" if kind == "autoclass" else ""
    return f"```{{eval-rst}}\n.. {kind}:: {module}.{name}\n{options}```\n"


def _model(path: str, model: type[BaseModel]) -> str:
    """Return a model with the names of its fields alone, as their checks would fill the signature."""
    fields = ", ".join(
        name if field.is_required() else f"{name}={field.default!r}" for name, field in model.model_fields.items()
    )
    return f"```{{eval-rst}}\n.. autoclass:: {path}(*, {fields})\n```\n"
