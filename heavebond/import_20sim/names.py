"""Names of a 20-sim model as names of the language: identifiers that are no keywords."""

from __future__ import annotations

import re

RESERVED = {"in", "is", "at", "each", "for", "and", "or", "not", "time", "pi", "der", "repeat", "set", "start", "solve",
            "sum",
            "sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "asin", "acos", "atan", "abs", "sign", "min", "max", "floor",
            "if_else", "smooth_sign", "signed_sqrt", "uniform", "on", "off", "yes", "no", "true", "false", "null", "if",
            "else", "lambda", "class", "def", "return", "import", "from", "as", "with", "while", "try", "del", "None",
            "True",
            "False", "global", "pass", "break", "continue", "yield", "raise", "except", "finally", "assert", "nonlocal",
            "async", "await", "elif"}


def identifier(text: str) -> str:
    """`Submodel-Equation 1` as `Submodel_Equation_1`."""
    plain = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "unnamed"
    if plain[0].isdigit():
        plain = f"n_{plain}"
    return f"{plain}_" if plain in RESERVED else plain


def camel(text: str) -> str:
    """`WaveGenerator-VariableTimeSquare` as `WaveGeneratorVariableTimeSquare`."""
    words = [w for w in re.split(r"[^A-Za-z0-9]+", text) if w]
    plain = "".join(w[0].upper() + w[1:] for w in words) or "Unnamed"
    return plain if plain[0].isalpha() else f"N{plain}"


def snake(text: str) -> str:
    """`WaterTank` as `water_tank`, for the names of files."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", text).lower()
