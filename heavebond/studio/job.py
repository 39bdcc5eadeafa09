"""The input of the studio's workers: a diagram in the state of the editor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Job:
    """A diagram's text, its file, its name in problems, and the values of sliders."""

    text: str
    path: str
    name: str
    values: Mapping[str, str] = field(default_factory=dict)
