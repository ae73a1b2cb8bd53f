"""Output to terminals and pipes that cannot show every character: `m/s²` becomes `m/s^2`, `λ` becomes `lambda`.

A terminal without UTF-8, such as one with `LC_ALL=C` or a Windows console, has no code for some of the characters of
reports. Python would end the program there.
"""

from __future__ import annotations

import codecs
import sys
import unicodedata
import warnings
from pathlib import Path

PLAIN = {
    "·": "*", "×": "x", "−": "-", "–": "-", "—": "-", "…": "...", "°": " deg", "±": "+/-", "≥": ">=", "≤": "<=",
    "√": "sqrt ", "∞": "inf", "→": "->", "←": "<-", "µ": "u", "μ": "u", "½": "1/2", "¼": "1/4", "⁻": "^-", "∂": "d",
    "∇": "grad ", "∫": "integral ", "‖": "||", "∘": "o", "⟂": "_|_", "ø": "o", "Ø": "O", "“": '"', "”": '"', "’": "'",
}  # fmt: skip
HANDLER = "mbd_sim.plain"


def use_plain_characters() -> None:
    """Let standard output and standard error replace what their encoding lacks."""
    codecs.register_error(HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=HANDLER)


def use_plain_warnings() -> None:
    """Show warnings of this package as sentences, without the place in its source, which means nothing to users."""
    usual, package = warnings.formatwarning, str(Path(__file__).parents[1])

    def formatted(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
    ) -> str:
        if category is RuntimeWarning and filename.startswith(package):
            return f"warning: {message}\n"
        return usual(message, category, filename, lineno, line)

    warnings.formatwarning = formatted


def print_file(text: str) -> None:
    """Print the text of a file in UTF-8, from which programs read it, whatever the terminal can show."""
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(encoding="utf-8", errors="surrogateescape")
    print(text, end="" if text.endswith("\n") else "\n")


def plain(letter: str) -> str:
    """ASCII characters that stand for a character."""
    if letter in PLAIN:
        return PLAIN[letter]
    name = unicodedata.name(letter, "")
    if name.startswith("GREEK"):
        word = name.split(" WITH ")[0].rsplit(" ", 1)[1].replace("LAMDA", "LAMBDA")
        return word.lower() if "SMALL" in name else word.capitalize()
    form, decomposed = unicodedata.decomposition(letter), unicodedata.normalize("NFKD", letter)
    if decomposed != letter:
        text = "".join(part if part.isascii() else plain(part) for part in decomposed)
        return {"<super>": "^", "<sub>": "_"}.get(form.split(" ")[0], "") + text
    return "" if unicodedata.combining(letter) else letter.encode("ascii", "backslashreplace").decode()


def _replaced(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    if all("\udc80" <= letter <= "\udcff" for letter in letters):  # bytes of a path that could not be decoded
        return letters.encode("ascii", "surrogateescape"), error.end
    return "".join(plain(letter) for letter in letters), error.end
