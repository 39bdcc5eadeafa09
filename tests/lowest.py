"""The lowest declared version of every dependency, as constraints of pip: `python tests/lowest.py > FILE`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def lowest(project: dict[str, object]) -> dict[str, str]:
    """Name and lowest version of each requirement; the highest of these if a package is required several times."""
    lines = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
    found: dict[str, str] = {}
    for line in lines:
        match = re.fullmatch(r"([\w.-]+)(?:\[[\w,]*\])?(?:>=([\d.]+))?", line)
        assert match, f"pyproject.toml: the requirement '{line}' is not of the form NAME>=VERSION"
        name, version = match[1].lower(), match[2]
        if version:
            found[name] = max(found.get(name, "0"), version, key=lambda text: [int(part) for part in text.split(".")])
    return found


if __name__ == "__main__":
    for package, least in lowest(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]).items():
        print(f"{package}=={least}")
