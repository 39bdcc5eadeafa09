"""The commands of the command line in the studio: their options as forms, and their runs on a document.

The page names a command and gives values of its options; arguments are made from the options that the form has, so that
neither other options nor paths can be given. A command writes into the opened folder only.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import free_path
from heavebond.studio.contents import Entry
from heavebond.studio.folder import Folder

# the commands by the kind of document; the others have a place of their own in the studio
COMMANDS = {"model": ("check", "run", "modes", "linear", "design", "sensitivity", "sweep", "energy", "signal", "export"),
            "experiment": ("compare", "fit", "candidates", "laws", "errors", "monitor"), "study": ("study", "optimal")}
# options that name files or other computers
EXCLUDED = ("json", "output", "save", "write", "folder", "report", "sankey", "activity", "scheduler", "processes", "decide",
            "resume", "schema", "in_place")
PERMISSION = "allow_"  # options that permit to execute what a file contains: the server has the permission, never the page
FORMS = {"export": ("fmu", "c"), "design": ("", "yaml")}  # suffixes of files that a command writes; "": none
MOST_PICTURES, PICTURE_BYTES = 12, 4_000_000  # that are shown of a command
SHORTEST, LONGEST = 1, 500  # characters of a value


def forms(command_line: str) -> Entry:
    """The commands with their options, by the kind of document."""
    group = _group(command_line)
    command_forms: dict[str, list[Entry]] = {}
    for kind, names in COMMANDS.items():
        command_forms[kind] = []
        for name in [name for name in names if name in group.commands]:
            command = group.commands[name]
            options = [{"name": str(p.name), "flag": str(p.name), "help": "Files and folders below the opened folder.",
                        "metavar": "NAME", "kind": "text", "choices": [], "several": True, "required": p.required}
                       for p in _files(command)]
            options += [{"name": str(p.name), "flag": p.opts[-1], "help": p.help or "", "metavar": p.metavar or "",
                         "kind": "flag" if p.is_flag else "choice" if isinstance(p.type, click.Choice) else "text",
                         "choices": list(p.type.choices) if isinstance(p.type, click.Choice) else [],
                         "several": p.multiple, "required": p.required} for p in _options(command)]
            command_forms[kind].append({"name": name, "summary": command.get_short_help_str(100), "options": options,
                                        "picture": bool(_draws(command)), "formats": list(FORMS.get(name, ()))})
    return dict(command_forms)


def _group(command_line: str) -> click.Group:
    """The table of commands, which the command line names when it starts the studio: `module:name`."""
    module, _, name = command_line.partition(":")
    group = getattr(import_module(module), name)
    assert isinstance(group, click.Group)
    return group


def _options(command: click.Command) -> Iterator[click.Option]:
    for p in command.params:
        if (isinstance(p, click.Option) and p.name not in EXCLUDED and not str(p.name).startswith(PERMISSION)
                and not isinstance(p.type, click.Path)):
            yield p


def _files(command: click.Command | None) -> list[click.Argument]:
    """The arguments after the document: names of files and folders."""
    return [p for p in command.params if isinstance(p, click.Argument)][1:] if command else []


def _draws(command: click.Command) -> str:
    """The option with which the command draws a picture: `--output`, or `--sankey` for the flow of energy; empty if it draws
    none."""
    return next((p.opts[-1] for p in command.params if isinstance(p, click.Option)
                 and (p.name == "sankey" or (p.name == "output" and p.metavar == "PICTURE"))), "")


def arguments(group: click.Group, name: str, values: Mapping[str, Any]) -> list[str]:
    """The arguments for the values of a form; UsageError for a command or an option that has none."""
    if name not in {n for names in COMMANDS.values() for n in names} or name not in group.commands:
        raise UsageError([Problem("usage", "the page asked for something unknown")])
    known = {str(p.name): p for p in _options(group.commands[name])}
    texts: list[str] = []
    for key, value in values.items():
        option = known.get(str(key))
        if option is None:
            raise UsageError([Problem("usage", "the page asked for something unknown")])
        if option.is_flag:
            texts += [option.opts[-1]] if value is True else []
            continue
        for text in value if isinstance(value, list) else [value]:
            if SHORTEST <= len(str(text).strip()) <= LONGEST:
                texts.append(f"{option.opts[-1]}={str(text).strip()}")
    return texts


def run_command(path: Path, options: Mapping[str, Any], folder: Path) -> Entry:
    """Run a command on a document: its printed text, its picture, and the files that it wrote. If the command fails,
    a UsageError has its message."""
    group, name = _group(str(options["command_line"])), str(options.get("command", ""))
    values = dict(options.get("values") or {})
    files = [str(Folder(folder).inside(str(file).strip())) for p in _files(group.commands.get(name))
             for file in values.pop(str(p.name), [])]
    words = arguments(group, name, values)
    command, written = group.commands[name], ""
    with tempfile.TemporaryDirectory(prefix=".heavebond-", dir=folder) as scratch:
        if options.get("picture") is True and (drawing := _draws(command)):
            words.append(f"{drawing}={Path(scratch).resolve() / 'picture.svg'}")
        elif name in FORMS:
            suffix = options.get("format")
            if suffix not in FORMS[name]:
                raise UsageError([Problem("usage", "the page asked for something unknown")])
            stem = re.sub(r"[^A-Za-z0-9_]+", "_", path.stem)
            if name == "export":
                written = f"{stem}.{suffix}"
                words.append(f"--output={folder.resolve() / written}")
            elif suffix:
                written = free_path(folder / f"{stem}_designed.yaml").name
                words.append(f"--write={folder.resolve() / written}")
        out, err, code = io.StringIO(), io.StringIO(), 0
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), contextlib.chdir(folder):
            try:
                group.main([name, *words, "--", str(path), *files])
            except SystemExit as ended:
                code = int(ended.code or 0)
        picture = Path(scratch) / "picture.svg"
        svg = picture.read_text(encoding="utf-8") if picture.is_file() else ""
    messages = [line for line in err.getvalue().splitlines() if line.strip()]
    if code and not out.getvalue().strip():
        raise UsageError([Problem("command-failed", "\n".join(messages) or f"the command ended with code {code}")])
    shown = [path.name, *(str(Path(file).relative_to(folder.resolve())) for file in files), *words]
    command_text = " ".join(["heavebond", name, *(f"'{g}'" if " " in g else g for g in shown if scratch not in g)])
    printed = "\n".join(line for line in out.getvalue().splitlines() if scratch not in line)
    outputs = [written] if written and not code else []
    outputs += re.findall(r"^wrote (.+\.html)$", printed, re.MULTILINE)
    pictures = [{"title": command_text, "svg": svg}] if svg else []
    # those that the command wrote into a folder of its own
    for line in re.findall(r"^wrote (.+\.svg)$", printed, re.MULTILINE)[:MOST_PICTURES]:
        path = (folder / line).resolve()
        if path.is_relative_to(folder.resolve()) and path.is_file() and path.stat().st_size < PICTURE_BYTES:
            pictures.append({"title": line, "svg": path.read_text(encoding="utf-8")})
    return {"kind": "command", "command": command_text, "text": printed, "warnings": messages, "code": code,
            "pictures": pictures, "files": outputs}
