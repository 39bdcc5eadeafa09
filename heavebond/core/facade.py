"""Methods of public objects that are implemented in packages above, such as `result.plot()` and `model.graph()`.

A module imports from its own package and those below. The package above registers its function by `provides`, and the
method calls it by `call`. `heavebond/__init__.py` imports the packages that register functions, so every method is
available.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])
_PROVIDED: dict[str, Callable[..., Any]] = {}


def provides(*methods: str) -> Callable[[AnyFunction], AnyFunction]:
    """Register a function as the implementation of methods (`Class.method`); its first argument is the object."""
    def register(function: AnyFunction) -> AnyFunction:
        _PROVIDED.update(dict.fromkeys(methods, function))
        return function
    return register


def call(method: str, *arguments: Any) -> Any:
    """Call the function that is registered for a method."""
    return _PROVIDED[method](*arguments)


class Displayed:
    """A result that a notebook displays by the function that is registered as `CLASS._repr_html_`."""

    def _repr_html_(self) -> str:
        """Its tables and figures, for notebooks."""
        return str(call(f"{type(self).__name__}._repr_html_", self))
