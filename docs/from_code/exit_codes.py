"""Page of the exit codes, read off the errors and constants of the vocabulary."""

import inspect

from from_code.markdown import prose, table
from from_code.sources import errors

_HEAD = """# Exit codes

Scripts may rely on these codes. The names are those of `{module}`.
"""
_CONSTANTS = {
    "EXIT_OK": "Success.",
    "EXIT_LOSSY_RECOVERY": "Part of the input is missing or damaged; what is there was written (`recover`, `report`, "
    "`merge`, `export`).",
    "EXIT_INVALID_RUN": "The command finished, but the run is not valid as a measurement; `problems` in "
    "[summary.json](summary.md) gives the reasons, and [troubleshooting](../testbed/troubleshooting.md) the cures.",
    "EXIT_BUG": "A bug in `tis`; please report the traceback.",
    "EXIT_INTERRUPTED": "Interrupted by Ctrl-C or a signal, ended in order.",
}
"""Meanings of the constants; the exceptions explain themselves in their docstrings."""


def page() -> str:
    """Return the page; raises `LookupError` when a constant is not explained, or no longer exists."""
    constants = {name: value for name, value in vars(errors).items() if name.startswith("EXIT_")}
    if constants.keys() != _CONSTANTS.keys():
        raise LookupError(f"exit codes without words, or words without one: {constants.keys() ^ _CONSTANTS.keys()}")
    rows = [(constants[name], name, prose(_CONSTANTS[name])) for name in constants]
    rows += [
        (one.exit_code, one.__name__, prose(inspect.getdoc(one) or "")) for one in errors.TisError.__subclasses__()
    ]
    rows.append((1, "", "The reader of the output closed the pipe, as `head` does."))
    shown = table(
        ("code", "name", "meaning"),
        ((str(value), f"`{name}`" if name else "", text) for value, name, text in sorted(rows)),
    )
    return f"{_HEAD.format(module=errors.__name__)}\n{shown}\n"
