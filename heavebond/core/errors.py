"""Errors and warnings as data: problems with a stable code, a place in a file and a hint."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from heavebond.core.limits import PROBLEMS_SHOWN

WIDEST_EXCERPT = 110
LONGEST_MESSAGE = 400
FEW = 3  # limit of suggested candidates with the same last word
SHORTEST_KIND = 5  # least number of letters of a component's name that is searched inside a word
SHORTEST_BEGIN = 3  # least number of letters that may begin a longer name


@dataclass(frozen=True)
class Place:
    """A range of characters in one line of a file; `line` and `column` count from 1, `text` is the whole line.

    If a text continues in later lines, `continued` gives the character counts and places: (characters, place).
    """

    file: str
    line: int
    column: int = 1
    text: str = ""
    length: int = 1
    continued: tuple[tuple[int, Place], ...] = ()

    def moved(self, characters: int, length: int = 1) -> Place:
        """The range that begins `characters` later in the same text."""
        for start, place in reversed(self.continued):
            if characters >= start:
                return place.moved(characters - start, length)
        continued = tuple((start - characters, place) for start, place in self.continued)
        return Place(self.file, self.line, self.column + characters, self.text, max(1, length), continued)

    def excerpt(self) -> list[str]:
        """The line with a caret below the range (tabs count as one column, as in `column`)."""
        if not self.text:
            return []
        number = f"{self.line:>5} | "
        # the line and the column; of a long line the part around the column
        if len(self.text) <= WIDEST_EXCERPT:
            text, column = self.text, self.column
        else:
            begin = max(0, min(self.column - 1 - WIDEST_EXCERPT // 2, len(self.text) - WIDEST_EXCERPT))
            end = begin + WIDEST_EXCERPT
            before, after = "..." if begin else "", "..." if end < len(self.text) else ""
            text, column = before + self.text[begin:end] + after, self.column - begin + len(before)
        room = max(1, len(text) - column + 1)
        caret = " " * (column - 1) + "^" * max(1, min(self.length, room))
        return [number + text.replace("\t", " "), " " * (len(number) - 2) + "| " + caret]


@dataclass(frozen=True)
class Problem:
    """One mistake. `code` is stable; `notes` are further known facts; `hint` states what to type."""

    code: str
    message: str
    place: Place | None = None
    hint: str = ""
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        head = f"{self.place.file}:{self.place.line}: " if self.place else ""
        message = self.message if len(self.message) <= LONGEST_MESSAGE else self.message[:LONGEST_MESSAGE] + " ..."
        lines = [f"{head}{message} [{self.code}]"]
        if self.place:
            lines += self.place.excerpt()
        lines += [f"    {note}" for note in self.notes]
        if self.hint:
            lines += [f"  {line}" for line in self.hint.splitlines()]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, object]:
        place = self.place
        where = {"file": place.file, "line": place.line, "column": place.column} if place else None
        return {"code": self.code, "message": self.message, "place": where, "hint": self.hint,
                "notes": list(self.notes)}


class HeavebondError(Exception):
    """A user's mistake, or a model or record that cannot do what was requested; never a fault of the program, except for
    FaultError. `figures` are the results that were computed nevertheless, for the JSON file."""

    def __init__(self, problems: Iterable[Problem] | str, *, hint: str = ""):
        self.figures: dict[str, object] = {}
        if isinstance(problems, str):
            problems = [Problem(self.default_code, problems, hint=hint)]
        self.problems = tuple(problems)
        more = len(self.problems) - PROBLEMS_SHOWN
        super().__init__("\n\n".join([*(str(p) for p in self.problems[:PROBLEMS_SHOWN]),
                                      *([f"and {more} more problems"] if more > 0 else [])]))

    default_code = "error"


class ModelError(HeavebondError):
    """A component, diagram, experiment or study file is wrong."""

    default_code = "model"


class DataError(HeavebondError):
    """A measured record cannot be used as the experiment asks."""

    default_code = "data"


class UsageError(HeavebondError):
    """The call or the command line is wrong (unknown signal, unreadable time, ...)."""

    default_code = "usage"


class StartError(HeavebondError):
    """No consistent initial values exist, or the file does not determine them."""

    default_code = "start"


class SimulationError(HeavebondError):
    """The integration could not reach the end."""

    default_code = "simulation"


class FaultError(HeavebondError):
    """A fault of heavebond ended a part of a command; `figures` holds the results that are known nevertheless."""

    default_code = "internal"


class RunWarning(UserWarning):
    """A run left the range in which its results are valid; the message is its verdict."""


class FaultWarning(RuntimeWarning):
    """A part of a long computation ended by a fault of heavebond; its result holds what was known before."""


@dataclass
class Problems:
    """Collects the problems of one stage, so that a user sees all of them at once."""

    found: list[Problem] = field(default_factory=list)
    _known: set[Problem] = field(default_factory=set)

    def __bool__(self) -> bool:
        """True if there is a problem."""
        return bool(self.found)

    def add(self, code: str, message: str, place: Place | None = None, *, hint: str = "",
            notes: Iterable[str] = ()) -> None:
        """Record a problem and continue; the same problem at the same place is recorded once."""
        problem = Problem(code, message, place, hint, tuple(notes))
        if problem not in self._known:
            self._known.add(problem)
            self.found.append(problem)

    def extend(self, error: HeavebondError) -> None:
        """Record the problems of an error that was caught."""
        for problem in error.problems:
            if problem not in self._known:
                self._known.add(problem)
                self.found.append(problem)

    def raise_as(self, kind: type[HeavebondError] = ModelError) -> None:
        """Raise all recorded problems as one error, in the order of the lines; do nothing without problems."""
        if self.found:
            files = {f: k for k, f in enumerate(dict.fromkeys(p.place.file for p in self.found if p.place))}
            raise kind(sorted(self.found, key=lambda p: (
                (files[p.place.file], p.place.line, p.place.column) if p.place else (len(files), 0, 0))))


def suggest(word: str, candidates: Iterable[str]) -> str:
    """`Did you mean 'x'?` for the candidates nearest to `word` (case ignored), or an empty text.

    If the word contains the whole name of a component (`HydraulicCylinder`, `cylinder`), this is the only suggestion;
    the same for a candidate that differs in case only. A word that ends a few candidates (`K_p` of `controller.K_p`)
    suggests these; so does one that lacks a part between its first and its last (`line.p` of `line.a.p`), and one that
    begins them (`dry`) if no other name is more similar.
    """
    if len(word) > 100:
        return ""
    by_lower: dict[str, str] = {}
    for candidate in candidates:
        by_lower.setdefault(candidate.lower(), candidate)
    ending = [n for n in by_lower if n.endswith(f".{word.lower()}")]
    first, _, last = word.lower().rpartition(".")
    ending = [word.lower()] if word.lower() in by_lower else \
        ending or [n for n in by_lower if first and n.startswith(f"{first}.") and n.endswith(f".{last}")]
    near = ending if 1 <= len(ending) <= FEW else difflib.get_close_matches(word.lower(), list(by_lower), n=2, cutoff=0.6)
    if not near and len(word) >= SHORTEST_BEGIN:
        beginning = [n for n in by_lower if n.startswith(word.lower())]
        near = beginning if len(beginning) <= FEW else []
    if not near:
        return ""
    kinds = {n: name for n, name in by_lower.items() if name[0].isupper() and len(n) >= SHORTEST_KIND}
    inside = [n for n in kinds if n in word.lower()]
    if inside:
        near = [max(inside, key=len)]
    elif near[0] in kinds:  # there are many components: a second suggestion must be about as similar
        near = near[:1] + difflib.get_close_matches(word.lower(), near[1:], cutoff=0.68)
    return "Did you mean " + " or ".join(f"'{by_lower[n]}'" for n in near) + "?"


# advice if no name is similar and there are too many to list
NAMES_LISTED = "`heavebond check --names` lists them all."


def nearest(word: str, candidates: Iterable[str]) -> str | None:
    """The candidate that is most similar to `word`, if any."""
    suggestion = suggest(word, candidates)
    return suggestion.split("'")[1] if suggestion else None


def either(words: Iterable[str], joint: str = "and") -> str:
    """`'a', 'b' and 'c'`."""
    return joined([f"'{word}'" for word in words], joint)


def joined(words: Sequence[str], joint: str = "and") -> str:
    """`a, b and c`."""
    return f" {joint} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def listing(words: Iterable[str], limit: int = 12) -> str:
    """`a, b, c and 5 more`: a list that fits on a line."""
    words = list(words)
    if len(words) <= limit:
        return ", ".join(words)
    return ", ".join(words[:limit]) + f" and {len(words) - limit} more"
