"""Suggestions for an unknown component name: by its spelling, or by the words of the library's summaries."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from pathlib import Path

from heavebond.core.errors import suggest
from heavebond.text.yaml_source import read_text

_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_SUMMARY = re.compile(r"^summary:[ \t]*(.+)$", re.MULTILINE)
MISSPELT = 0.85  # difflib's ratio of two names that differ by a typing error
LISTED = 4
# Words of other programs and of the workshop, with the library's words for them.
MEANS = {
    "ground": "fixed ground", "earth": "fixed ground", "limiter": "saturation", "heater": "heat", "cable": "rope",
    "capacitance": "capacitor", "inductance": "inductor", "ram": "cylinder", "jack": "cylinder", "coupling": "clutch",
    "bottle": "accumulator receiver", "vessel": "tank receiver", "bulk": "volume", "gearbox": "gear", "gravity": "weight",
    "bumper": "stop", "stiction": "friction", "wheel": "wheel tyre pulley", "reservoir": "tank reservoir",
}


def near_components(name: str, files: Mapping[str, Path]) -> str:
    """A hint for a component `name` that is none of `files` (by name).

    If a word of it occurs nowhere, or none in a name, the component with the most similar spelling; else the components
    whose name, summary and domain contain most of its words, the simplest first, and of these only such without other
    words, if there are any.
    """
    hint = suggest(name, files) or "`heavebond library` lists every component."
    wanted = _words(name)
    scores = {known: _scores(wanted, known, path) for known, path in files.items() if path.suffix == ".yaml"}
    columns = list(zip(*scores.values(), strict=True))
    found_nowhere = any(not any(column) for column in columns) or all(max(column) < 2 for column in columns)
    spelt = difflib.get_close_matches(name.lower(), map(str.lower, files), n=1, cutoff=MISSPELT)
    if spelt and (found_nowhere or spelt[0] == name.lower()):
        return hint
    best = max(map(sum, scores.values()), default=0)
    near = sorted((known for known, score in scores.items() if sum(score) == best), key=lambda known: (
        len(_words(known)), -difflib.SequenceMatcher(None, name.lower(), known.lower()).ratio()))
    if not best or len(near) > 3 * LISTED:
        return hint
    near = [known for known in near if set(_words(known)) <= set(wanted)] or near
    more = f" `heavebond library {_synonyms(wanted[-1])[0]}` lists more." if len(near) > LISTED else ""
    *near_others, last = [f"'{known}'" for known in near[:LISTED]]
    return f"Did you mean {', '.join(near_others)}{' or ' if near_others else ''}{last}?{more}"


def _words(name: str) -> list[str]:
    return list(dict.fromkeys(word.lower() for word in _PARTS.findall(name)))


def _scores(wanted: list[str], known: str, path: Path) -> list[int]:
    """For each of the `wanted` words 2 if the name of a component contains it, 1 if its summary or domain does, else 0."""
    name_words = set(_words(known))
    summary = _SUMMARY.search(read_text(path))
    summary_text = " ".join([summary.group(1) if summary else "", path.parent.name]).lower()

    def score(words: list[str]) -> int:
        if name_words.intersection(words):
            return 2
        return int(any(re.search(rf"\b{re.escape(word)}", summary_text) for word in words if len(word) > 1))

    return [score([word, *_synonyms(word)]) for word in wanted]


def _synonyms(word: str) -> list[str]:
    return MEANS.get(word, word).split()
