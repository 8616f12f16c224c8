"""A page as a browser and a screen reader take it: what it fetches, its outline, and what breaks their rules."""

from html.parser import HTMLParser
from itertools import pairwise
from typing import Final

_FETCHING: Final = ("src", "href", "srcset", "data", "action", "poster", "background", "formaction")
_REFERS: Final = ("aria-labelledby", "aria-describedby", "aria-controls")
_VOID: Final = ("meta", "link", "br", "img", "input", "hr")

Attributes = dict[str, str]


class Outline(HTMLParser):
    """Everything of a page that is not drawn by its scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.tags: list[str] = []
        self.elements: list[tuple[str, Attributes, tuple[str, ...]]] = []
        """Name, attributes, and the names of the elements around it."""
        self.text = ""
        self.words: dict[int, str] = {}
        """The text in each element, by its place in ``elements``."""
        self._open: list[tuple[str, int]] = []
        self.unclosed: list[str] = []
        self.feed(page)
        self.unclosed += [name for name, _ in self._open]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.tags.append(tag)
        self.fetched += [given[name] for name in _FETCHING if name in given]
        self.elements.append((tag, given, tuple(name for name, _ in self._open)))
        if tag not in _VOID:
            self._open.append((tag, len(self.elements) - 1))

    def handle_endtag(self, tag: str) -> None:
        name, _ = self._open.pop()
        if name != tag:
            self.unclosed.append(name)

    def handle_data(self, data: str) -> None:
        if any(name in ("script", "style") for name, _ in self._open):
            return
        self.text += data
        for _, place in self._open:
            self.words[place] = self.words.get(place, "") + data

    def all(self, *names: str) -> list[tuple[Attributes, str]]:
        """Return attributes and text of each element of these names."""
        return [(given, self.words.get(i, "")) for i, (tag, given, _) in enumerate(self.elements) if tag in names]

    def faults(self) -> list[str]:
        """Return what somebody without a mouse or without eyes would stumble over."""
        found = [f"{name} is not closed" for name in self.unclosed]
        found += self._names()
        levels = [
            int(name[1]) for name, _, _ in self.elements if len(name) == 2 and name[0] == "h" and name[1].isdigit()
        ]
        if levels[:1] != [1] or levels.count(1) != 1:
            found.append("one first heading is needed")
        found += [f"h{a} is followed by h{b}" for a, b in pairwise(levels) if b > a + 1]
        for landmark in ("header", "main", "footer", "nav"):
            if self.tags.count(landmark) != 1:
                found.append(f"one {landmark} is needed")
        for i, (name, given, around) in enumerate(self.elements):
            inside = [
                tag
                for tag, _, outer in self.elements[i + 1 :]
                if len(outer) > len(around) and outer[len(around)] == name
            ]
            found += self._rules(name, given, around, self.words.get(i, "").strip(), inside)
        return found

    def _names(self) -> list[str]:
        ids = [given["id"] for _, given, _ in self.elements if "id" in given]
        found = [f"id {name} occurs twice" for name in sorted(set(ids)) if ids.count(name) > 1]
        for _, given, _ in self.elements:
            named = [name for reference in _REFERS for name in given.get(reference, "").split()]
            named += [target[1:] for target in [given.get("href", "")] if target.startswith("#")]
            found += [f"nothing has the id {name}" for name in named if name not in ids]
        return found

    @staticmethod
    def _rules(name: str, given: Attributes, around: tuple[str, ...], text: str, inside: list[str]) -> list[str]:
        found = []
        labelled = any(given.get(label) for label in ("aria-label", "aria-labelledby"))
        if name == "table" and "caption" not in inside:
            found.append("a table has no caption")
        if name == "th" and given.get("scope") not in ("col", "row"):
            found.append(f"th {text} has no scope")
        if name in ("section", "figure", "nav") and not labelled:
            found.append(f"a {name} has no name")
        if name == "figure" and "figcaption" not in inside:
            found.append("a figure has no caption")
        if name in ("button", "a", "summary", "h1", "h2", "h3", "caption", "figcaption") and not (text or labelled):
            found.append(f"a {name} has no text")
        if given.get("role") in ("img", "region", "group") and not labelled:
            found.append(f"a {given['role']} has no name")
        if given.get("tabindex", "0") not in ("0", "-1"):
            found.append("the order of the keyboard is changed")
        if name == "img" and "alt" not in given:
            found.append("an image has no alternative")
        if name == "html" and not given.get("lang"):
            found.append("the language is not said")
        if name in ("td", "th") and "table" not in around:
            found.append(f"a {name} is in no table")
        return found
