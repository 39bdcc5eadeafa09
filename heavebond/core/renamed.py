"""Former names of keys in files: the warning, and the collection of uses for `heavebond check --fix`."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from heavebond.core.errors import Place
from heavebond.core.presentation import count


class RenamedKeyWarning(FutureWarning):
    """A file uses the former name of a key, which the next release does not read."""


@dataclass(frozen=True)
class RenamedKey:
    """A key under its former name: which, its present name, and where."""

    old: str
    new: str
    place: Place


# the renamed keys that a command met; None where nobody collects them
_MET: ContextVar[list[RenamedKey] | None] = ContextVar("renamed keys met", default=None)


@contextmanager
def collecting() -> Iterator[list[RenamedKey]]:
    """Collect the renamed keys that are met inside instead of warning of them."""
    met: list[RenamedKey] = []
    token = _MET.set(met)
    try:
        yield met
    finally:
        _MET.reset(token)


def meet(key: RenamedKey) -> None:
    """Hand a renamed key to who collects them; without one, warn of it."""
    met = _MET.get()
    if met is None:
        warnings.warn(message([key]), RenamedKeyWarning, stacklevel=3)
    else:
        met.append(key)


def message(keys: Iterable[RenamedKey]) -> str:
    """What a user is told of renamed keys."""
    found = list(dict.fromkeys(keys))
    first, files = found[0].place, list(dict.fromkeys(key.place.file for key in found))
    names = ", ".join(dict.fromkeys(f"`{key.old}:` is now `{key.new}:`" for key in found))
    more = f" ({count(len(found), 'place')} in {count(len(files), 'file')})" if len(found) > 1 else ""
    file = first.file if len(files) == 1 else "FILE"
    what = "rewrites it" if len(files) == 1 else "rewrites FILE and the files that it reads"
    return f"{first.file}:{first.line}: {names}{more}. The next release reads only the new name; " \
        f"`heavebond check {file} --fix` {what}."
