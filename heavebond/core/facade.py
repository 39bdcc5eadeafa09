"""Convenience methods of public objects that belong to packages above: `model.graph()`, `result.plot()`.

A module imports from its own package and those below. A method that only calls a function of a package above finds that
function when it is called, by the path in this table.
"""

from __future__ import annotations

import importlib
from typing import Any

FUNCTIONS = {
    "Model.graph": "equations.diagram_graph:diagram_graph",
    "Model._repr_svg_": "pictures.drawing:draw",
    "Model._repr_html_": "reports.notebook:model_html",
    "Result._repr_html_": "reports.notebook:result_html",
    "Comparison._repr_html_": "reports.notebook:comparison_html",
    "Fit._repr_html_": "reports.notebook:fit_html",
    "Diagnosis._repr_html_": "reports.notebook:diagnosis_html",
    "Result.plot": "pictures.plot:plot_signals",
    "Comparison.plot": "pictures.plot:plot_comparison",
}


def call(method: str, *given: Any, **named: Any) -> Any:
    """What the function behind a method of `FUNCTIONS` returns."""
    module, _, function = FUNCTIONS[method].partition(":")
    return getattr(importlib.import_module(f"heavebond.{module}"), function)(*given, **named)
