"""Answers to the requests of a page: files, drawings and runs, records and long computations."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Any

from heavebond.core.errors import Problem, UsageError
from heavebond.core.limits import FILE_BYTES
from heavebond.core.native_permission import fmu_allowed
from heavebond.core.writable import confined
from heavebond.language.edits import with_values
from heavebond.studio.diagram_edits import with_records
from heavebond.studio.folder import BUNDLED, EMPTY, TEMPLATES, bundled_machines
from heavebond.studio.job import Job
from heavebond.studio.long_jobs import known
from heavebond.studio.tab import Handler, Tab, document_entry, times
from heavebond.studio.workers import LOST, Answer

HANGS = 10.0  # s of a check after which a newer one replaces it
LEFT = 1.5  # s after which a check of a closed diagram is replaced by that of another
USES = ("fit", "validate", "test")


# -- files -------------------------------------------------------------------------------------------------------------
async def _home(tab: Tab, _: dict[str, Any]) -> Answer:
    tab.document = None
    diagrams = await asyncio.to_thread(tab.folder.diagrams)
    machines = [{k: v for k, v in entry.items() if k != "path"} for entry in bundled_machines()]
    folder_exists = await asyncio.to_thread(tab.folder.root.is_dir)
    return "done", {"folder": str(tab.folder.root), "there": folder_exists, "diagrams": diagrams, "machines": machines,
                    "templates": [{"name": name, "title": title} for name, (title, _) in TEMPLATES.items()],
                    "first": tab.first, "fmus": fmu_allowed()}, None


async def _list(tab: Tab, _: dict[str, Any]) -> Answer:
    """The diagrams that may be compared with the open one."""
    machines = [{"name": entry["name"], "kind": entry["kind"]} for entry in bundled_machines()]
    return "done", {"diagrams": await asyncio.to_thread(tab.folder.diagrams), "machines": machines}, None


async def _difference(tab: Tab, message: dict[str, Any]) -> Answer:
    other_file = await asyncio.to_thread(tab.folder.read, str(message["other"]))
    return await tab.checker.ask("difference", Job(other_file.text, str(other_file.path), other_file.name), tab.job(message))


async def _open(tab: Tab, message: dict[str, Any]) -> Answer:
    tab.document = await asyncio.to_thread(tab.folder.read, str(message["name"]))
    tab.other_files = {}
    layout, version = (None, "") if tab.document.name.startswith(BUNDLED) else \
        await asyncio.to_thread(tab.folder.layout, tab.document.name)
    return "done", {**document_entry(tab.document), "layout": layout, "layout_version": version}, None


async def _new(tab: Tab, message: dict[str, Any]) -> Answer:
    name, template = str(message["name"]), str(message.get("template", "spring"))
    make, origin = (tab.folder.create, EMPTY) if message.get("empty") else (tab.folder.create_from, template)
    return "done", {"name": await asyncio.to_thread(make, name, origin)}, None


async def _thumbnail(tab: Tab, message: dict[str, Any]) -> Answer:
    """The small drawing of a file on the first page."""
    document = await asyncio.to_thread(tab.folder.read, str(message["name"]))
    return await tab.librarian.ask("thumbnail", Job(document.text, str(document.path), document.name))


async def _copy(tab: Tab, message: dict[str, Any]) -> Answer:
    """Copy a bundled machine with all its files to a folder of the opened folder."""
    from heavebond.estimation.starter_folder import new as start_folder

    name = str(message["name"])
    folder = tab.folder.path(f"{name}/{name}.yaml").parent
    if folder.parent != tab.folder.root.resolve():
        raise UsageError([Problem("name-bad", f"'{name}' cannot name a folder here")])
    with confined(tab.folder.root):
        starter = await asyncio.to_thread(start_folder, folder, str(message["origin"]).removeprefix(BUNDLED))
    return "done", {"name": starter.diagrams[0].relative_to(folder.parent).as_posix()}, None


async def _import(tab: Tab, message: dict[str, Any]) -> Answer:
    """A model of another program, translated into a new folder of the opened folder."""
    content = str(message["content"])
    if len(content) > 4 * FILE_BYTES / 3 + 4:
        raise UsageError([Problem("file-too-large", f"a model has at most {FILE_BYTES // 10**6} MB")])
    return await tab.librarian.ask("import", str(message["name"]), content, str(tab.folder.root))


async def _derive(tab: Tab, message: dict[str, Any]) -> Answer:
    values = {str(k): str(v) for k, v in message["values"].items()}
    document = await asyncio.to_thread(tab.folder.derive, str(message["name"]), str(message["origin"]), values)
    return "done", {"name": document}, None


async def _write(tab: Tab, message: dict[str, Any]) -> Answer:
    values = {str(k): str(v) for k, v in message["values"].items()}
    return "done", {"text": await asyncio.to_thread(with_values, str(message["text"]), values)}, None


async def _layout(tab: Tab, message: dict[str, Any]) -> Answer:
    """Store the charts and the kept runs of a document beside it. If another tab has stored others since, they stay, and are
    returned."""
    name, layout = str(message["name"]), message["layout"]
    if not isinstance(layout, dict):
        raise TypeError(layout)
    stored = await asyncio.to_thread(tab.folder.save_layout, name, layout, str(message["base"]))
    if stored:
        return "done", {"layout": None, "layout_version": stored}, None
    other, version = await asyncio.to_thread(tab.folder.layout, name)
    return "done", {"layout": other or {}, "layout_version": version}, None


async def _save(tab: Tab, message: dict[str, Any]) -> Answer:
    name, text, base = (str(message[k]) for k in ("name", "text", "base"))
    saved = await asyncio.to_thread(tab.folder.save, name, text, base)
    if tab.document is not None and tab.document.name == name:
        tab.document = saved
    return "done", document_entry(saved), None


# -- drawings and runs -------------------------------------------------------------------------------------------------
async def _view(tab: Tab, message: dict[str, Any]) -> Answer:
    job = tab.job(message)
    opened = [str(name) for name in message.get("opened", ())]
    patience, tab.checked = HANGS if tab.checked == job.name else LEFT, job.name
    answer = await tab.checker.ask_newest("view", job, opened, patience=patience)
    if answer == LOST:
        answer = await tab.checker.ask_newest("view", job, opened, patience=patience)
    for part in answer[1].get("parts", {}).values() if answer[0] == "done" else ():
        part["file"] = tab.folder.document(Path(part.pop("path")))
    if answer[0] == "done" and tab.document is not None and tab.document.name == job.name:
        tab.other_files = await asyncio.to_thread(times, answer[1].get("files", []))
        tab.expect_runs()
    return answer


async def _forms(tab: Tab, _: dict[str, Any]) -> Answer:
    """The commands of the command line with their options."""
    if not tab.command_line:
        return "done", {"forms": {}}, None
    return await tab.librarian.ask("forms", tab.command_line)


async def _run(tab: Tab, message: dict[str, Any]) -> Answer:
    job, task = tab.job(message), str(message["do"])
    arguments = () if task in ("animation", "modes", "film") else ([str(name) for name in message.get("names", ())],)
    ask = tab.runner.ask_newest if task in ("run", "preview") else tab.runner.ask
    return await ask(task, job, *arguments)


async def _stop(tab: Tab, _: dict[str, Any]) -> Answer:
    tab.runner.stop()
    return "done", {}, None


# -- records that become an experiment -----------------------------------------------------------------------------------
async def _experiment(tab: Tab, message: dict[str, Any]) -> Answer:
    """Write an experiment for a diagram into its folder, or into the opened folder for a bundled one; existing files are
    unchanged.
    """
    model, name = tab.folder.path(str(message["model"])), str(message["name"])
    root = tab.folder.root.resolve()
    beside = root if str(message["model"]).startswith(BUNDLED) else model.parent
    document = tab.folder.new_name(name, beside.relative_to(root).as_posix())
    files = {str(tab.folder.record(str(file))): str(use) for file, use in message["files"].items()}
    if not files or not set(files.values()) <= set(USES):
        raise UsageError([Problem("usage", "an experiment needs records, each to fit, to validate or to test")])
    columns = [{str(k): str(v) for k, v in column.items()} for column in message["columns"]]
    free = {str(k): str(v) for k, v in message.get("free", {}).items()}
    answer = await tab.checker.ask("experiment", str(tab.folder.path(document)), document, str(message.get("title") or name),
                                   str(model), files, columns, free, str(message.get("every") or ""))
    if answer[0] != "done":
        return answer
    await asyncio.to_thread(tab.folder.write_new, document, str(answer[1]["text"]))
    return "done", {"name": document}, None


async def _join(tab: Tab, message: dict[str, Any]) -> Answer:
    """Add records to the text of an experiment, held out until the user changes it."""
    path = tab.folder.path(str(message["name"])).parent
    files = [os.path.relpath(tab.folder.record(str(file)), path) for file in message["files"]]
    text, names = await asyncio.to_thread(with_records, str(message["text"]), [Path(f).as_posix() for f in files])
    return "done", {"text": text, "names": names}, None


# -- long computations ---------------------------------------------------------------------------------------------------
async def _jobs(tab: Tab, message: dict[str, Any]) -> Answer:
    """State of the computations on a document; from now on this page receives their progress."""
    return "done", {"jobs": [job.entry() for job in tab.jobs.of(str(message["name"]))]}, None


async def _begin(tab: Tab, message: dict[str, Any]) -> Answer:
    name, kind = str(message["name"]), known(str(message["kind"]))
    document = await asyncio.to_thread(tab.folder.read, name)
    options = message.get("given", {})
    if not isinstance(options, dict):
        raise TypeError(options)
    options = {**options, "folder": str(tab.folder.root) if name.startswith(BUNDLED) else "", "root": str(tab.folder.root),
               "command_line": tab.command_line}
    return "done", {"job": tab.jobs.begin(kind, name, document.path, document.version, options).entry()}, None


async def _end(tab: Tab, message: dict[str, Any]) -> Answer:
    job = tab.jobs.numbered(int(message["number"]))
    job.stop()
    return "done", {"job": job.entry()}, None


async def _array(tab: Tab, message: dict[str, Any]) -> Answer:
    job = tab.jobs.numbered(int(message["number"]))
    return "done", {}, job.arrays[str(message["key"])]


async def _add(tab: Tab, message: dict[str, Any]) -> Answer:
    """Write the result as a diagram and an experiment that extend the former ones; returns the experiment's name."""
    options = message.get("given", {})
    if not isinstance(options, dict):
        raise TypeError(options)
    job = tab.jobs.numbered(int(message["number"]))
    files = await job.write(options)
    if not files:
        raise UsageError([Problem("nothing-found", "the computation has no result to write")])
    return "done", {"files": [_name(tab, Path(file)) for file in files], "open": _name(tab, Path(files[-1]))}, None


def _name(tab: Tab, path: Path) -> str:
    root = tab.folder.root.resolve()
    return path.resolve().relative_to(root).as_posix() if path.resolve().is_relative_to(root) else path.name


# requests that are one task of a worker
ASKED: dict[str, Handler] = {
    "edit": lambda tab, message: tab.checker.ask_again("edit", tab.job(message), dict(message["action"])),
    "palette": lambda tab, message: tab.librarian.ask("palette", tab.job({"text": "", **message})),
    "component": lambda tab, message: tab.librarian.ask("component", tab.job({"text": "", **message}), str(message["kind"])),
    "picture": lambda tab, message: tab.librarian.ask("picture", tab.job(message)),
    "classes": lambda tab, message: tab.librarian.ask("classes", tab.job(message)),
    "events": lambda tab, message: tab.runner.ask("events", tab.job(message), str(message.get("event", ""))),
    "compare": lambda tab, message: tab.runner.ask_newest("compare", tab.job(message)),
    "channel": lambda tab, message: tab.runner.ask("channel", tab.job(message), str(message["record"]),
                                                   str(message["channel"])),
    "against": lambda tab, message: tab.runner.ask("against", tab.job(message), str(message["record"]),
                                                   str(message["channel"]), str(message["signal"])),
    "propose": lambda tab, message: tab.checker.ask("propose", tab.job(message),
                                                    str(tab.folder.record(str(message["file"]))))}
HANDLERS: dict[str, Handler] = {
    "home": _home, "list": _list, "difference": _difference, "open": _open,
    "new": _new, "copy": _copy, "import": _import, "derive": _derive, "write": _write, "save": _save,
    "layout": _layout,
    "thumbnail": _thumbnail, "view": _view, "forms": _forms, "stop": _stop, **ASKED,
    **dict.fromkeys(("run", "prepare", "preview", "signals", "spectrum", "animation", "modes", "film"), _run),
    "experiment": _experiment, "join": _join, "jobs": _jobs, "begin": _begin, "end": _end, "array": _array, "add": _add}
