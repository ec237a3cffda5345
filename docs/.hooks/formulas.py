"""Formulas of the pages, `$$` on lines of their own around LaTeX, as MathML: browsers show it
without any script, and no network is asked. GitHub typesets the same lines by itself.
"""

import re

from latex2mathml.converter import convert

# fences come first, so that what stands in them stays
_PARTS = re.compile(r"^```.*?^```$|^\$\$\n(?P<formula>.*?)\n\$\$$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Return a page with its formulas as MathML."""
    return _PARTS.sub(_set, markdown)


def _set(match: re.Match[str]) -> str:
    formula = match["formula"]
    return match[0] if formula is None else convert(formula, display="block")
