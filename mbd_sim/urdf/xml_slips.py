"""XML that is not well-formed, and that TinyXML-2, with which Gazebo, urdfdom and MuJoCo read, accepts.

Slips are mended in the text, without moving any line: `--` in a comment, a blank before `<?xml`, a bare `&`, and no
blank between two attributes.
"""

from __future__ import annotations

import re
from xml.parsers import expat

_TOKENS = re.compile(
    r"(?P<comment><!--.*?-->)"
    r"|(?P<verbatim><!\[CDATA\[.*?\]\]>|<\?.*?\?>)"
    r"|(?P<tag><[A-Za-z_](?:[^<>\"']|\"[^\"]*\"|'[^']*')*>)"
    r"|(?P<entity>&)",
    re.DOTALL,
)
_DECLARATION = re.compile(r"\s+<\?xml\b.*?\?>", re.DOTALL)
_BARE = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9A-Fa-f]+);)")
_QUOTED = re.compile(r"(=\s*(?:\"[^\"]*\"|'[^']*'))(?=[A-Za-z_])")
_NO_NEWLINE = re.compile(r"[^\n]")


def mended(text: str) -> tuple[str, tuple[str, ...]]:
    """The text as well-formed XML, as far as these slips go, and each of them with its line."""
    found: list[tuple[int, str]] = []
    if declaration := _DECLARATION.match(text):
        found.append((declaration.end(), "a blank before <?xml"))
        text = _NO_NEWLINE.sub(" ", declaration[0]) + text[declaration.end() :]

    def mend(token: re.Match[str]) -> str:
        whole, start = token[0], token.start()
        if token["comment"]:
            inner = whole[4:-3]
            if "--" not in inner and not inner.endswith("-"):
                return whole
            found.append((start, "'--' in a comment"))
            return f"<!--{_NO_NEWLINE.sub(' ', inner)}-->"
        if token["verbatim"]:
            return whole
        if token["entity"]:
            bare = _BARE.match(text, start)
            if bare:
                found.append((start, "a bare '&'"))
            return "&amp;" if bare else whole
        spaced = _QUOTED.sub(r"\1 ", whole)
        if spaced != whole:
            found.append((start, "no blank between attributes"))
        if _BARE.search(spaced):
            found.append((start, "a bare '&'"))
        return _BARE.sub("&amp;", spaced)

    result = _TOKENS.sub(mend, text)
    return result, tuple(f"{slip} (line {text.count(chr(10), 0, place) + 1})" for place, slip in found)


def slips_of(text: str) -> tuple[str, ...]:
    """The slips in a text, if it is not well-formed because of them."""
    try:
        expat.ParserCreate().Parse(text.removeprefix("\ufeff"), True)
    except (expat.ExpatError, UnicodeError):
        return mended(text)[1]
    return ()
