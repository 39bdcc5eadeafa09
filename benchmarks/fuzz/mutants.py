"""Mutants of the bundled files: a seed takes a file, and changes it as a slip of the pen would, or out of spite."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

from heavebond.language.library import bundled

# a diagram, an experiment or a study; what they name belongs to them
HEADS = ("model", "experiment", "study")
NAMED_FILE = re.compile(r"\b(?:extends|model):\s*([\w./-]+\.yaml)\b")
KIND = re.compile(r"\bis:\s*([A-Z]\w*)")
WORD = re.compile(r"\b[A-Za-z_]\w*\b")
KEY = re.compile(r"^  (\w+):", re.MULTILINE)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
QUANTITY = re.compile(r"(?<![\w.])(-?\d[\d.]*(?:e[+-]?\d+)?) ([A-Za-z%][\w*/()%]*)")
WIRED = re.compile(r"^\s+\S+:\s*\[[^\]]*\]", re.MULTILINE)
END = re.compile(r"[\w.+-]+(?:\[\d+\])?")
ENTRY = re.compile(r"[\w.]+: (?:\"[^\"]*\"|\[[^\]]*\]|[^,{}\[\]]+)")
NUMBERS = ("0", "-1", "1e300", "-1e300", "1e-300", "1e-9", "1e9", "1e400", "nan", "inf", "1e20", "3")
UNITS = ("m", "mm", "kg", "t", "s", "ms", "N", "kN", "kN/m", "bar", "Pa", "L/min", "m**3/s", "K", "degC", "rad", "deg", "Hz",
         "%", "1", "V", "A", "furlong", "N*m", "kN*s/m", "cm**2", "m/s", "kg*m**2", "J", "W")
LARGE = ("spatial/barge_crane.yaml", "spatial/landing_crane.yaml")
MOST = 3  # mutations of one mutant
OWN_COPY = 0.12  # share of mutants whose slip is in a copy of a component of the library, as of a user's own


@dataclass(frozen=True)
class Mutant:
    """The files of a machine, `root` the one to be read, all paths relative; what was changed, and where.

    `folder` is the bundled one, whose records and tables are needed too.
    """

    seed: int
    folder: Path
    root: str
    files: dict[str, str]
    changed: str
    mutations: tuple[str, ...]


def kind_of(text: str) -> str:
    """What a file describes: model, experiment, study, component, or nothing that is known."""
    heads = re.findall(r"^(\w+):", text, re.MULTILINE)
    return next((head for head in ("experiment", "study", "component", "model") if head in heads), "")


@cache
def roots() -> tuple[str, ...]:
    """Every bundled diagram, experiment and study; machines as often as examples of single components. Those whose assembly
    alone takes ten seconds are left out."""
    models = bundled("models")
    files = [f for f in sorted(models.rglob("*.yaml")) if kind_of(f.read_text(encoding="utf-8")) in HEADS]
    names = [name for f in files if "data" not in f.parts and (name := f.relative_to(models).as_posix()) not in LARGE]
    examples = [name for name in names if name.startswith("examples/")]
    machines = [name for name in names if not name.startswith("examples/")]
    return (*examples, *machines * (len(examples) // len(machines)))


@cache
def files_of(root: str) -> dict[str, str]:
    """The texts of a file and of all that it is made of in its folder, by their paths from there: diagrams that it extends,
    components of their own."""
    folder = bundled("models") / root.partition("/")[0]
    found: dict[str, str] = {}
    left = [folder / root.partition("/")[2]]
    while left:
        path = left.pop()
        name = path.relative_to(folder).as_posix()
        if name in found:
            continue
        found[name] = text = path.read_text(encoding="utf-8")
        others = [path.parent / other for other in NAMED_FILE.findall(text)]
        left += [p.resolve() for p in others if p.is_file() and folder.resolve() in p.resolve().parents]
        left += [_own(folder)[kind] for kind in KIND.findall(text) if kind in _own(folder)]
    return found


@cache
def _own(folder: Path) -> dict[str, Path]:
    return _components(folder / "components")


@cache
def _components(folder: Path) -> dict[str, Path]:
    """Component files by the names of their components."""
    found = {}
    for path in sorted(folder.rglob("*.yaml")):
        head = re.search(r"^component: *(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        if head:
            found[head[1]] = path.resolve()
    return found


def mutant(seed: int) -> Mutant:
    """The mutant of a seed."""
    random = Random(seed)
    root = random.choice(roots())
    files = dict(files_of(root))
    changed = random.choice(sorted(files))
    used = sorted({kind for text in files.values() for kind in KIND.findall(text)} & {*_components(bundled("components"))})
    if used and random.random() < OWN_COPY:
        kind = random.choice(used)
        changed = f"components/{kind.lower()}.yaml"
        files[changed] = _components(bundled("components"))[kind].read_text(encoding="utf-8")
    text, done = files[changed], list[str]()
    number = random.choice((1, 1, 1, 1, 2, MOST))
    while len(done) < number:
        name = random.choices(NAMES, WEIGHTS)[0]
        after = MUTATIONS[name](text, random)
        if after != text:
            done.append(name)
        text = after
    files[changed] = text
    return Mutant(seed, bundled("models") / root.partition("/")[0], root.partition("/")[2], files, changed, tuple(done))


# -- lines -------------------------------------------------------------------------------------------------------------
def _lines(change: Callable[[list[str], Random], list[str]]) -> Callable[[str, Random], str]:
    def changed(text: str, random: Random) -> str:
        return "\n".join(change(text.split("\n"), random))
    return changed


def _removed(lines: list[str], random: Random) -> list[str]:
    k = random.randrange(len(lines))
    return lines[:k] + lines[k + 1:]


def _doubled(lines: list[str], random: Random) -> list[str]:
    k = random.randrange(len(lines))
    return lines[:k + 1] + lines[k:]


def _swapped(lines: list[str], random: Random) -> list[str]:
    i, k = random.randrange(len(lines)), random.randrange(len(lines))
    lines = list(lines)
    lines[i], lines[k] = lines[k], lines[i]
    return lines


# -- words -------------------------------------------------------------------------------------------------------------
def _at(pattern: re.Pattern[str], new: Callable[[re.Match[str], Random, list[str]], str]) -> Callable[[str, Random], str]:
    """One place that a pattern finds, written anew; `new` is given all that it finds."""
    def changed(text: str, random: Random) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        one = random.choice(found)
        return text[:one.start()] + new(one, random, [m[0] for m in found]) + text[one.end():]
    return changed


def _words(text: str, random: Random) -> list[str]:
    """Names that the file gives to parts, nodes and values; now and then any word in it."""
    given = sorted(set(KEY.findall(text)))
    return given if given and random.random() < 0.8 else sorted(set(WORD.findall(text)))


def _word(found: re.Match[str], random: Random, others: list[str]) -> str:
    """Another name that is written in the same way: a component, a unit or name of one letter, any other."""
    def manner(word: str) -> tuple[bool, bool]:
        return word[0].isupper(), len(word) == 1

    return random.choice([o for o in others if o != found[0] and manner(o) == manner(found[0])] or others)


def _exchanged(text: str, random: Random) -> str:
    """Two names take each other's place everywhere."""
    words = _words(text, random)
    if len(words) < 2:
        return text
    one, other = random.sample(words, 2)
    return WORD.sub(lambda m: {one: other, other: one}.get(m[0], m[0]), text)


def _named_alike(text: str, random: Random) -> str:
    """A name becomes another one that stands in the file, everywhere."""
    words = _words(text, random)
    if not words:
        return text
    one, other = random.choice(words), random.choice([*words, *WORD.findall(text), "time", "pi", "x", "v", "p", "a", "b"])
    return WORD.sub(lambda m: other if m[0] == one else m[0], text)


def _factor(found: re.Match[str], random: Random, _: list[str]) -> str:
    return repr(float(found[0]) * random.choice((-1.0, 0.1, 10.0, 1e-3, 1e3, 1e-6, 1e6, 1.001)))


def _other_unit(found: re.Match[str], random: Random, others: list[str]) -> str:
    units = sorted({other.split(" ")[1] for other in others})
    # often one of the same sort, as `mm` for `m`
    near = [u for u in {*units, *UNITS} if (u in ("1", "%")) == (found[2] in ("1", "%")) and u[-1] == found[2][-1]]
    unit = random.choice(sorted(near) if near and random.random() < 0.6 else [*UNITS, *units, ""])
    return f"{found[1]} {unit}".rstrip()


def _values_exchanged(text: str, random: Random) -> str:
    found = list(QUANTITY.finditer(text))
    if len(found) < 2:
        return text
    one, other = sorted(random.sample(found, 2), key=lambda m: m.start())
    if random.random() < 0.7:  # each keeps its unit
        first, second = f"{other[1]} {one[2]}", f"{one[1]} {other[2]}"
    else:
        first, second = other[0], one[0]
    return text[:one.start()] + first + text[one.end():other.start()] + second + text[other.end():]


# -- entries and wires -------------------------------------------------------------------------------------------------
def _entry_removed(found: re.Match[str], random: Random, _: list[str]) -> str:
    return ""


def _entry_doubled(found: re.Match[str], random: Random, others: list[str]) -> str:
    return f"{found[0]}, {random.choice([found[0], *others])}"


def _wire_moved(text: str, random: Random) -> str:
    """A port goes from one node to another, is left off, stands on two, or changes places with another."""
    ends = [m for wire in WIRED.finditer(text) for m in END.finditer(text, text.index("[", wire.start()), wire.end())]
    if len(ends) < 2:
        return text
    one, other = sorted(random.sample(ends, 2), key=lambda m: m.start())
    before, between, after = text[:one.start()], text[one.end():other.start()], text[other.end():]
    return random.choice((
        before + other[0] + between + one[0] + after, before.rstrip(", ") + between + f"{other[0]}, {one[0]}" + after,
        before + f"{one[0]}, {other[0]}" + between.lstrip(", ") + after, before + between.lstrip(", ") + other[0] + after,
        before + one[0] + between + f"{other[0]}, {one[0]}" + after))


def _letter(text: str, random: Random) -> str:
    """A sign is lost, or one more stands there."""
    k = random.randrange(max(1, len(text)))
    sign: str = random.choice(("", *":{}[],=\"'#-+*/(). \t\n0ex\\é"))
    return text[:k] + sign + text[k + random.randint(0, 1):]


MUTATIONS: dict[str, Callable[[str, Random], str]] = {
    "line removed": _lines(_removed), "line doubled": _lines(_doubled), "lines swapped": _lines(_swapped),
    "names exchanged": _exchanged, "names alike": _named_alike,
    "name in one place": _at(WORD, _word),
    "number": _at(NUMBER, lambda found, random, others: random.choice(NUMBERS)), "number scaled": _at(NUMBER, _factor),
    "unit": _at(QUANTITY, _other_unit), "values exchanged": _values_exchanged,
    "entry removed": _at(ENTRY, _entry_removed), "entry doubled": _at(ENTRY, _entry_doubled),
    "wire moved": _wire_moved, "sign": _letter}
# what most often leaves a diagram that runs is taken more often
OFTEN = {"number": 3.0, "number scaled": 4.0, "values exchanged": 4.0, "unit": 2.0, "wire moved": 2.0, "entry removed": 2.0}
NAMES = sorted(MUTATIONS)
WEIGHTS = [OFTEN.get(name, 1.0) for name in NAMES]
