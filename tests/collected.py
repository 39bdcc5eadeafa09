"""A check of many cases as one test: every case is run, and all that fail are reported together.

`for_each` takes the place of `pytest.mark.parametrize` where the cases are many and short: a test of pytest takes several
milliseconds by itself, which for thousands of cases is longer than the checks.
"""

from __future__ import annotations

import functools
import inspect
import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest


def partly(cases: Iterable[Any], every: int) -> list[Any]:
    """The cases of a sweep for `pytest.mark.parametrize`: the first, and each `every`-th after it, run with `make test`; the
    others are marked `long`."""
    return [case if number % every == 0 else
            pytest.param(*(case if type(case) is tuple else (case,)), marks=pytest.mark.long)
            for number, case in enumerate(cases)]


def for_each(names: str | Sequence[str], cases: Iterable[Any], *, ids: Callable[[Any], object] | None = None,
             parts: int = 1) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test function for every case, with the arguments `names` from the case.

    `ids(case)` names a case in the report; the default is its representation. `parts` divides the cases into so many tests,
    for checks of more than some 10 s. Fixtures are those of one test; `tmp_path` is a new folder for each case, and a change
    by `monkeypatch` ends with its case. A case that is skipped does not end the others. There must be at least one case.
    """
    keys = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    every = list(cases)
    assert every, f"there is no case of {keys}"

    def decorated(function: Callable[..., None]) -> Callable[..., None]:
        given = inspect.signature(function)
        fixtures = [p for name, p in given.parameters.items() if name not in keys]
        assert set(keys) <= set(given.parameters), f"{function.__name__} does not take {keys}"

        @functools.wraps(function)
        def run_all(*, part: int = 0, **provided: Any) -> None:
            failures, skipped, chosen = [], [], every[part::parts]
            for number, case in enumerate(chosen):
                name = str(ids(case)) if ids else repr(case)[:120]
                values = dict(zip(keys, case if len(keys) > 1 else [case], strict=True))
                own = dict(provided)
                if isinstance(folder := own.get("tmp_path"), Path):
                    own["tmp_path"] = folder / f"case_{number}"
                    own["tmp_path"].mkdir()
                try:
                    if "monkeypatch" in own:
                        with provided["monkeypatch"].context() as patch:
                            function(**values, **{**own, "monkeypatch": patch})
                    else:
                        function(**values, **own)
                except pytest.skip.Exception as reason:
                    skipped.append(f"{name}: {reason}")
                except (Exception, pytest.fail.Exception):
                    failures.append(f"--- {name}\n{traceback.format_exc(limit=-6)}")
            if failures:
                raise AssertionError(f"{len(failures)} of {len(chosen)} cases fail\n" + "\n".join(failures[:20]))
            if len(skipped) == len(chosen):
                pytest.skip(skipped[0])

        more = [inspect.Parameter("part", inspect.Parameter.KEYWORD_ONLY)] if parts > 1 else []
        run_all.__signature__ = inspect.Signature(fixtures + more)  # type: ignore[attr-defined]
        del run_all.__wrapped__  # pytest would read the arguments of the function itself
        return pytest.mark.parametrize("part", range(parts))(run_all) if parts > 1 else run_all

    return decorated
