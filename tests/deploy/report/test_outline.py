"""The judge of pages: it finds what it is there to find."""

import pytest

from tests.deploy.report.outline import Outline

GOOD = (
    '<html lang="en"><body><header><h1>a</h1><nav aria-label="n"><a href="#x">b</a></nav></header>'
    '<main id="x"><section aria-label="s"><h2>c</h2>'
    '<table><caption>d</caption><tr><th scope="row">e</th></tr></table>'
    '<figure aria-labelledby="x"><figcaption><h3>f</h3></figcaption></figure></section></main><footer>g</footer>'
    "</body></html>"
)


def test_a_good_page_has_no_faults() -> None:
    assert Outline(GOOD).faults() == []


@pytest.mark.parametrize(
    ("was", "becomes", "fault"),
    [
        ("<h2>c</h2>", "<h3>c</h3>", "h1 is followed by h3"),
        ("<h1>a</h1>", "", "one first heading is needed"),
        ("<caption>d</caption>", "", "a table has no caption"),
        (' scope="row"', "", "th e has no scope"),
        ("<figcaption><h3>f</h3></figcaption>", "", "a figure has no caption"),
        ('href="#x"', 'href="#y"', "nothing has the id y"),
        ("<footer>g</footer>", "", "one footer is needed"),
        ('<main id="x">', '<main id="x"><p id="x"></p>', "id x occurs twice"),
        ('<section aria-label="s">', "<section>", "a section has no name"),
        (' lang="en"', "", "the language is not said"),
        ("</section>", "<button></button></section>", "a button has no text"),
        ("</section>", '<p tabindex="3">x</p></section>', "the order of the keyboard is changed"),
        ("</section>", "<b></section>", "b is not closed"),
    ],
)
def test_each_fault_is_found(was: str, becomes: str, fault: str) -> None:
    assert was in GOOD
    assert fault in Outline(GOOD.replace(was, becomes, 1)).faults()


def test_what_is_fetched_and_read_is_found() -> None:
    found = Outline('<p>a<script src="https://x">b</script><i>c</i></p><img src="d"><style>e</style>')
    assert found.fetched == ["https://x", "d"]
    assert found.text == "ac"
