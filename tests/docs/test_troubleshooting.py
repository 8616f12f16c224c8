"""The page on messages: each problem and warning that the code declares has an entry, each entry is the code's."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.test_source import ROOT, functions, product_files
from tis.common.peer_life import TEXTS
from tis.common.refusal import MEANING
from tis.deploy.report.validity import _LIVES

PAGE: Final = (ROOT / "docs" / "testbed" / "troubleshooting.md").read_text(encoding="utf-8")
HEADS: Final = re.findall(r"^\| ((?:`[^`]+`(?:<br>)?)+) \|", PAGE, re.MULTILINE)
ENTRIES: Final = [words for head in HEADS for words in re.findall(r"`([^`]+)`", head)]
QUOTED: Final = [*ENTRIES, *(words for words in re.findall(r"`([^`]+)`", PAGE) if " " in words)]
_MAKES: Final = re.compile(r"Return ((a |the )?problems?|(a )?sentences? on|(a )?warnings?|.*, and warnings)\b")
_WHOLLY: Final = ("plausibility.py", "own_estimators.py", "tally.py", "pairing.py")
"""Files whose functions declare nothing but messages of runs, though their docstrings tell it otherwise."""
_CALLS: Final = ("violations.append", "warnings.append", "problems.append", ".warning", "._warn", "print_warnings")
_ELSEWHERE: Final = (
    "deploy/studies", "deploy/compare", "deploy/bench",  # beside their tables
    "deploy/present", "deploy/report/plots", "deploy/report/run_view", "deploy/report/subjects/network/disturbances",
    "deploy/watch",  # below their pictures
)  # fmt: skip
"""What explains itself where it stands."""


def _template(node: ast.AST) -> str:
    """Return a text with an ellipsis for each value; "" for what is no text."""
    if isinstance(node, ast.JoinedStr):
        return "".join(str(one.value) if isinstance(one, ast.Constant) else "…" for one in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _templates(root: ast.AST) -> Iterator[str]:
    """Yield the texts of at least four words below a node, each whole."""
    if text := _template(root):
        if len(re.findall(r"(?<!\S)[a-z]{2,}", text)) > 3 and "{}" not in text:
            yield text
        return
    if isinstance(root, ast.Assign) and ast.unparse(root.targets[0]).endswith("cure"):
        return
    is_problem = isinstance(root, ast.Call) and ast.unparse(root.func) == "problem"  # its second text is the cure
    for child in root.args[:1] if is_problem and isinstance(root, ast.Call) else ast.iter_child_nodes(root):
        yield from _templates(child)


def _declared(file: Path) -> Iterator[str]:
    """Yield the problems and warnings that a file declares: by its functions' docstrings, and by what they call."""
    for function in functions(file):
        if _MAKES.match(ast.get_docstring(function) or "") or file.name in _WHOLLY:
            for statement in function.body[1:]:
                yield from _templates(statement)
        for call in ast.walk(function):
            if isinstance(call, ast.Call) and ast.unparse(call.func).endswith(_CALLS):
                for argument in call.args:
                    yield from _templates(argument)


def _messages() -> dict[str, str]:
    """Return where each message is declared."""
    shown = (file for file in product_files() if not str(file.relative_to(ROOT)).startswith(_ELSEWHERE))
    found = {text: f"{file.relative_to(ROOT)}" for file in shown for text in _declared(file)}
    lives = (re.sub(r"\{[^}]*\}", "…", text) for text in (*TEXTS.values(), *(text for text, _ in _LIVES.values())))
    return found | dict.fromkeys(lives, "what sides notice of each other")


def _is_of(entry: str, text: str) -> bool:
    """Tell whether the fixed words of an entry stand in a text, in their order."""
    at = 0
    for words in entry.split("…"):
        at = text.find(words, at) + len(words)
        if at < len(words):
            return False
    return True


def test_each_declared_message_has_an_entry() -> None:
    lacking = {text: where for text, where in _messages().items() if not any(_is_of(one, text) for one in QUOTED)}
    assert lacking == {}


def test_each_problem_of_a_run_says_what_to_do() -> None:
    lacking = []
    for file in product_files():
        for function in functions(file):
            makes = re.match(r"Return (a|the) problem", ast.get_docstring(function) or "") is not None
            appended = [call.args[0] for call in ast.walk(function)
                        if isinstance(call, ast.Call) and ast.unparse(call.func) == "problems.append"]  # fmt: skip
            made = [ast.unparse(each).startswith("problem(") for each in appended if not isinstance(each, ast.Name)]
            returned = [each.value for each in ast.walk(function) if makes and isinstance(each, ast.Return)]
            bare = [
                one for each in returned for one in getattr(each, "elts", [each]) if isinstance(one, ast.JoinedStr)
            ]
            if not all(made) or (bare and function.name != "problem"):
                lacking.append(f"{file.relative_to(ROOT)}: {function.name}")
    assert lacking == []


def test_each_kind_of_refusal_is_named() -> None:
    page = " ".join(PAGE.split())
    assert [words for words in MEANING.values() if words not in page] == []


def test_each_entry_is_a_message_of_the_code() -> None:
    texts = [text for file in product_files() for text in _all_texts(file)]
    assert [entry for entry in ENTRIES if not any(_is_of(entry, text) for text in texts)] == []


def _all_texts(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if text := _template(node):
            yield re.sub(r"\{[^}]*\}", "…", text)
