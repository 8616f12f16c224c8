"""Page of the commands, read off the Typer application."""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin

import typer

from from_code.markdown import code, prose, table
from from_code.sources import app

_KINDS: Final = {str: "text", int: "integer", float: "number", Path: "path"}
_HEAD: Final = """# Commands

Every command of `tis`, with all its options, read off the application itself; `tis COMMAND --help` prints the same.
A value in italics is required. [Exit codes](exit_codes.md) are the same for all commands.
"""


def page() -> str:
    """Return the page."""
    commands = list(leaves(typer.main.get_command(app), ("tis",)))
    index = table(
        ("command", "purpose"),
        ((f"[`{' '.join(path)}`](#{_anchor(path)})", prose(_first_sentence(one))) for path, one in commands),
    )
    return "\n".join([_HEAD, index, "", *(_section(path, one) for path, one in commands)])


def leaves(command: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command that is no group, with the words that call it."""
    for name, one in getattr(command, "commands", {}).items():
        if getattr(one, "commands", None):
            yield from leaves(one, (*path, name))
        elif not one.hidden:
            yield (*path, name), one


def _section(path: tuple[str, ...], command: Any) -> str:
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    arguments = [one for one in shown if one.param_type_name == "argument"]
    options = [one for one in shown if one.param_type_name == "option" and one.name != "help"]
    words = " ".join([*path, *(["[OPTIONS]"] if options else []), *map(_usage, arguments)])
    lines = [f"## {' '.join(path)}", "", "```text", words, "```", ""]
    lines += [prose(paragraph) + "\n" for paragraph in inspect.cleandoc(command.help or "").split("\n\n")]
    if arguments:
        rows = ((code(_metavar(one)), _required(one), prose(one.help or "")) for one in arguments)
        lines += [table(("argument", "", "meaning"), rows), ""]
    panels = dict.fromkeys(getattr(one, "rich_help_panel", None) for one in options)
    for panel in panels:
        rows_of = (_option(one) for one in options if getattr(one, "rich_help_panel", None) == panel)
        if panel:
            lines += [f"**{prose(panel)}**", ""]
        lines += [table(("option", "value", "default", "meaning"), rows_of), ""]
    return "\n".join(lines)


def _option(option: Any) -> tuple[str, str, str, str]:
    names = ", ".join(map(code, [*option.opts, *option.secondary_opts]))
    value = "" if option.is_flag else f"{_metavar(option)}{' (repeatable)' if option.multiple else ''}"
    default = "*required*" if option.required else code(_default(option))
    return names, prose(value), default, prose(option.help or "")


def _default(option: Any) -> str:
    value = option.default
    if value is None or value is False or callable(value) or value in ((), []):
        return ""
    if value is True:
        return str(option.opts[0])
    return str(value)


def _metavar(parameter: Any) -> str:
    if parameter.metavar:
        return str(parameter.metavar)
    if parameter.param_type_name == "argument":
        return str(parameter.name).upper()
    kind = _element(parameter.type_descriptor.annotation)
    if get_origin(kind) is Literal:
        return ", ".join(map(str, get_args(kind)))
    bounds = [f">= {parameter.min}"] * (parameter.min is not None) + [f"<= {parameter.max}"] * (
        parameter.max is not None
    )
    return " ".join([_KINDS.get(kind, kind.__name__), ", ".join(bounds)]).strip()


def _element(annotation: Any) -> Any:
    """Return the type of one value, of a list's too."""
    return get_args(annotation)[0] if get_origin(annotation) in (list, tuple) else annotation


def _usage(argument: Any) -> str:
    name = _metavar(argument) + ("..." if argument.nargs == -1 else "")
    return name if argument.required else f"[{name}]"


def _required(argument: Any) -> str:
    return "*required*" if argument.required else "optional"


def _first_sentence(command: Any) -> str:
    text = " ".join(inspect.cleandoc(command.help or "").split())
    return text.partition(". ")[0].removesuffix(".")


def _anchor(path: tuple[str, ...]) -> str:
    return "-".join(path)
