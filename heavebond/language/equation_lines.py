"""Lines of `equations:`, of a component or a function: continued while a bracket is open, each with its label."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from heavebond.core.errors import Place, Problems
from heavebond.text.yaml_source import Node, Scalar

_EQUALS = re.compile(r"(?<![<>=!])=(?!=)")


def equation_lines(node: Node | None, problems: Problems) -> Iterator[tuple[str, str, Place]]:
    """(text, label behind `#`, place) of every equation."""
    if node is None:
        return
    if not isinstance(node, Scalar):
        problems.add("not-text", f"`equations:` holds {node.kind}; text is expected", node.place,
                     hint="Write `equations: |` and one equation a line below it.")
        return
    if node.place.continued and not node.block:
        problems.add("equations-joined", "without `|` YAML makes one line of all equations", node.place,
                     hint="Write `equations: |` and one equation a line below it.")
        return
    for line in _joined(node.lines()):
        content, _, label = line.text.partition("#")
        if content.strip():
            yield content.rstrip(), label.strip(), line.place


def _joined(lines: list[Scalar]) -> list[Scalar]:
    """Join a line with an open parenthesis or bracket to the next one, unless that is a separate equation."""
    joined: list[Scalar] = []
    for line in lines:
        previous = joined[-1] if joined else None
        head, _, comment = previous.text.partition("#") if previous is not None else ("", "", "")
        is_open = head.count("(") > head.count(")") or head.count("[") > head.count("]")
        if previous is not None and is_open and not _EQUALS.search(line.text.partition("#")[0]):
            tail, _, more = line.text.partition("#")
            content = head.rstrip() + " "
            label = comment.strip() or more.strip()
            place = replace(previous.place, continued=(*previous.place.continued, (len(content), line.place)))
            joined[-1] = Scalar(content + tail.strip() + (f"  # {label}" if label else ""), place)
        else:
            joined.append(line)
    return joined
