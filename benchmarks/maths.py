"""A hook of mkdocs: formulas between dollars become MathML when the site is built.

Browsers set it without a network and without scripts.
"""

import re

from latex2mathml.converter import convert

_CODE = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_BLOCK = re.compile(r"^\$\$\n(.+?)\n\$\$$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<!\s)\$(?![\w$])")


def on_page_markdown(markdown: str, **_: object) -> str:
    """Return a page with its formulas as MathML; code is left as it is."""
    parts = _CODE.split(markdown)
    parts[::2] = [typeset(part) for part in parts[::2]]
    return "".join(parts)


def typeset(text: str) -> str:
    """Return text with `$...$` and blocks between lines of `$$` as MathML."""
    text = _BLOCK.sub(
        lambda found: f'<div class="maths">{convert(found[1], display="block")}</div>', text
    )
    return _INLINE.sub(lambda found: convert(found[1]), text)
