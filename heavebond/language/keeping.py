"""What is made from files, taken from the cache where it was made from the same contents before."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TypeVar

from heavebond.basis.cache import Cache, the_cache
from heavebond.language.fingerprint import Fingerprint, diagram_files, key, program
from heavebond.text.packing import Unpackable, pack, unpack

T = TypeVar("T")
# what takes less processor time (s) than this is made again about as quickly as it is found
WORTH = 0.03


@dataclass(frozen=True)
class Kind:
    """What is kept: its class, a word for it, and the dataclasses that it is made of."""

    of: type
    word: str
    classes: tuple[type, ...] = ()


def values_in(*modules: str) -> tuple[type, ...]:
    """The public dataclasses that modules of ours define, which are imported already."""
    return tuple(c for module in modules for name, c in vars(sys.modules[f"heavebond.{module}"]).items()
                 if isinstance(c, type) and is_dataclass(c) and c.__module__ == f"heavebond.{module}" and name[0] != "_")


def kept(kind: Kind, follows: Callable[[], Fingerprint], make: Callable[[], T], lasting: Callable[[T], bool],
         outside: Mapping[str, object] | None = None) -> T:
    """What `make` gives, from the cache where it is there; `follows` is what it follows from, and is asked again after it
    was made, so that nothing is kept that was made while files changed, nor what follows from more (is not `lasting`).
    What is `outside` is not kept with it."""
    cache, before = _on(), time.time_ns()
    if cache is None or (first := _fingerprint(follows)) is None:
        return make()
    found: T | None = _found(cache, kind, first, outside)
    if found is not None:
        return found
    began = time.process_time()
    made = make()
    if time.process_time() - began >= WORTH and lasting(made):
        _keep(cache, kind, _fingerprint(follows), before, made, outside)
    return made


def kept_diagram(kind: Kind, path: Path, make: Callable[[], T], files: Callable[[T], Sequence[Path]]) -> T:
    """The diagram in a file, from the cache where it is there. It follows from the `files` that it is written in, which are
    known when it was read once; they are kept by themselves."""
    def where() -> Fingerprint:
        own = program()
        return Fingerprint(key(own.digest, os.getcwd(), str(path)).encode(), own.newest)

    cache, before = _on(), time.time_ns()
    if cache is None or (here := _fingerprint(where)) is None:
        return make()
    chain = Kind(tuple, "files")

    def follows(names: Sequence[Path]) -> Fingerprint:
        own = diagram_files(names)
        return Fingerprint(key(here.digest, own.digest).encode(), max(own.newest, here.newest))

    names: tuple[Path, ...] | None = _found(cache, chain, here, None)
    if names is not None and (now := _fingerprint(lambda: follows(names))) is not None:
        found: T | None = _found(cache, kind, now, None)
        if found is not None:
            return found
    made = make()
    now = _fingerprint(lambda: follows(files(made)))
    _keep(cache, chain, now and here, before, tuple(files(made)), None)
    _keep(cache, kind, now, before, made, None)
    return made


def _on() -> Cache | None:
    cache = the_cache()
    return None if cache is None or cache.switched_off else cache


def _fingerprint(follows: Callable[[], Fingerprint]) -> Fingerprint | None:
    try:
        return follows()
    except OSError:
        return None  # what is wrong with the file is said where it is read


def _found(cache: Cache, kind: Kind, follows: Fingerprint, outside: Mapping[str, object] | None) -> T | None:
    name = key(kind.word, follows.digest)
    data = cache.fetch(name)
    if data is None:
        return None
    try:
        found: T = unpack(data, kind.classes, outside)
        if not isinstance(found, kind.of):
            raise Unpackable(f"this is no {kind.word}")
    except Unpackable:
        cache.drop(name)
        return None
    return found


def _keep(cache: Cache, kind: Kind, follows: Fingerprint | None, since: int, made: object,
          outside: Mapping[str, object] | None) -> None:
    if follows is not None and follows.settled(since):
        with suppress(Unpackable):
            cache.keep(key(kind.word, follows.digest), pack(made, kind.classes, outside))
