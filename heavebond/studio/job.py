"""What the studio asks its workers to work on: a diagram as it stands in the editor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Job:
    """A diagram's text, its file, the name under which problems call it, and the values that sliders set."""

    text: str
    path: str
    name: str
    values: Mapping[str, str] = field(default_factory=dict)
