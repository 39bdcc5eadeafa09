"""The benchmark of missing physics on the command line.

    python -m benchmarks.missing_physics run ANSWERS              all installed entries on all cases without an answer
    python -m benchmarks.missing_physics run ANSWERS --entry sindy --case rig_friction
    python -m benchmarks.missing_physics score ANSWERS            the tables, from the answers in a folder
    python -m benchmarks.missing_physics write                    write the cases anew (deterministic)
    python -m benchmarks.missing_physics code DIR                 the base models as C (heavebond export)
    python -m benchmarks.missing_physics measured FOLDER DIR      cases of measured sets from the user's copy
"""

from __future__ import annotations

import argparse
import importlib
import json
import time as clock
import traceback
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.missing_physics.reading import Case
from benchmarks.missing_physics.scoring import FOLDER, answers_in, by_case, cases, scores, table

ENTRIES = ("base_model", "heavebond_entry", "sindy", "ude", "black_box")


def entry(name: str) -> tuple[ModuleType | None, str]:
    """The module of an entry, or the reason why it cannot run."""
    text = (FOLDER / "entries" / f"{name}.py").read_text(encoding="utf-8")
    needed = next((line for line in text.splitlines() if line.startswith(("NEEDS =", "NAME, NEEDS ="))), "")
    missing = [word for word in ("pysindy", "sklearn", "jax", "diffrax", "optax", "pyoperon", "scipy")
               if f'"{word}"' in needed and find_spec(word) is None]
    if missing:
        return None, f"not installed: {', '.join(missing)} (pip install -r benchmarks/missing_physics/requirements.txt)"
    return importlib.import_module(f"benchmarks.missing_physics.entries.{name}"), ""


def answered(module: ModuleType, case: Case) -> dict[str, Any]:
    """The answer of an entry, with its processor time; an error is an answer without a prediction."""
    began = clock.process_time()
    try:
        content = module.answer(case)
    except Exception as error:  # a failure of an entry on one case must not end the run of all
        traceback.print_exc()
        content = {"missing": False, "effects": [], "predictions": {}, "error": f"{type(error).__name__}: {error}"}
    return {"entry": module.NAME, "case": case.name, **content, "processor": round(clock.process_time() - began, 2)}


def run(folder: Path, entries: list[str], chosen: list[str], root: Path) -> None:
    """Answer the cases without a file of an answer; entries that are not installed are left out with the reason."""
    for name in entries:
        module, reason = entry(name)
        if module is None:
            print(f"{name}: left out, {reason}")
            continue
        for case in cases(root).values():
            path = folder / name / f"{case.name}.json"
            if (chosen and case.name not in chosen) or path.exists():
                continue
            found = answered(module, case)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(found) + "\n", encoding="utf-8")
            names = "; ".join(e["words"] for e in found["effects"]) or "nothing named"
            print(f"{name} {case.name}: {names} ({found['processor']} s)", flush=True)


def main() -> None:
    """As the command line calls it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("command", choices=["run", "score", "write", "code", "measured"])
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--entry", action="append", default=[], choices=ENTRIES)
    parser.add_argument("--case", action="append", default=[], metavar="NAME")
    parser.add_argument("--root", type=Path, default=FOLDER, help="folder with `machines` and `truths`")
    options = parser.parse_args()
    needed = {"run": 1, "score": 1, "write": 0, "code": 1, "measured": 2}[options.command]
    if len(options.folders) != needed:
        parser.error(f"{options.command} needs {needed} folder{'' if needed == 1 else 's'}")
    if options.command == "run":
        run(options.folders[0], options.entry or list(ENTRIES), options.case, options.root)
    elif options.command == "score":
        found = scores(answers_in(options.folders[0]), options.root)
        print(table(found, len(cases(options.root))), by_case(found), sep="\n\n")
    else:
        from benchmarks.missing_physics import making

        if options.command == "write":
            for name in making.cases(options.case or making.names(), options.root):
                print(name, flush=True)
        elif options.command == "code":
            making.code(options.folders[0], options.root)
        else:
            making.measured(*options.folders)


if __name__ == "__main__":
    main()
