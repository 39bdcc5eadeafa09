"""Names of a 20-sim model as names of the language: identifiers that are not keywords."""

from __future__ import annotations

import keyword
import re
import unicodedata

from heavebond.text.expression import FUNCTIONS, KEYWORDS

GERMAN = {"\u00e4": "ae", "\u00f6": "oe", "\u00fc": "ue", "\u00df": "ss", "\u00c4": "Ae", "\u00d6": "Oe", "\u00dc": "Ue"}
YAML_WORDS = {"on", "off", "yes", "no", "true", "false", "null"}
RESERVED = {*KEYWORDS, *FUNCTIONS, *keyword.kwlist, "time", "pi", "set", "start", "solve", "each", "repeat", "at",
            "prev"}


def identifier(text: str) -> str:
    """Identifier for a name: `Submodel-Equation 1` becomes `Submodel_Equation_1`."""
    plain = re.sub(r"\W+", "_", ascii_text(text), flags=re.ASCII).strip("_") or "unnamed"
    if plain[0].isdigit():
        plain = f"n_{plain}"
    return f"{plain}_" if plain in RESERVED or plain.lower() in YAML_WORDS else plain


def labels(name: str) -> list[str]:
    r"""The names of a quantity of a file in the translated model: `Part\x_1_2` for `Part\x[1,2]`, and for `x[2,1]`, which
    may be an element of a vector, `x_2` too."""
    *path, last = name.split("\\")
    index_match = re.fullmatch(r"(.*)\[\s*([0-9]+)\s*(?:,\s*([0-9]+)\s*)?\](.*)", last)
    if index_match is None:
        name_list = [last]
    else:
        label, row, column, ending = index_match.groups()
        name_list = [f"{label}_{row}_{column}{ending}"] * bool(column) + [f"{label}_{row}{ending}"] * (column in (None, "1"))
    return ["\\".join(identifier(word) for word in (*path, one)) for one in name_list]


def ascii_text(text: str) -> str:
    """Letters without accents, Greek letters by their names: `Verst\u00e4rker` as `Verstaerker`, `\u03b8_1` as `theta_1`."""
    if text.isascii():
        return text
    letters = []
    for c in text:
        name = unicodedata.name(c, "")
        if c in GERMAN:
            letters.append(GERMAN[c])
        elif name.startswith("GREEK"):
            letter = name.split(" LETTER ")[-1].split()[0].lower()
            letters.append(letter.capitalize() if "CAPITAL" in name else letter)
        else:
            letters.append(unicodedata.normalize("NFKD", c).encode("ascii", "ignore").decode() or "_")
    return "".join(letters)


def camel(text: str) -> str:
    """`WaveGenerator-VariableTimeSquare` as `WaveGeneratorVariableTimeSquare`."""
    words = [w for w in re.split(r"[^A-Za-z0-9]+", ascii_text(text)) if w]
    plain = "".join(w[0].upper() + w[1:] for w in words) or "Unnamed"
    return plain if plain[0].isalpha() else f"N{plain}"


def snake(text: str) -> str:
    """`WaterTank` as `water_tank`, for the names of files."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", text).lower()
