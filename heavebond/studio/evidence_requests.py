"""Answers to requests of a page about records: comparisons, records that become experiments, long computations."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import Any

from heavebond.core.errors import Problem, UsageError
from heavebond.studio.folder import BUNDLED
from heavebond.studio.long_jobs import known
from heavebond.studio.tab import Handler, Tab
from heavebond.studio.values import with_records
from heavebond.studio.workers import Answer

USES = ("fit", "validate", "test")


# -- comparison ----------------------------------------------------------------------------------------------------------
async def _compare(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.runner.ask_newest("compare", tab.job(message))


async def _channel(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.runner.ask("channel", tab.job(message), str(message["record"]), str(message["channel"]))


async def _against(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.runner.ask("against", tab.job(message), str(message["record"]), str(message["channel"]),
                                str(message["signal"]))


# -- records that become an experiment -----------------------------------------------------------------------------------
async def _propose(tab: Tab, message: dict[str, Any]) -> Answer:
    file = tab.folder.record(str(message["file"]))
    return await tab.checker.ask("propose", tab.job(message), str(file))


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
                                   str(model), files, columns, free)
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
    options = {**options, "folder": str(tab.folder.root) if name.startswith(BUNDLED) else "", "root": str(tab.folder.root)}
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


HANDLERS: dict[str, Handler] = {
    "compare": _compare, "channel": _channel, "against": _against, "propose": _propose, "experiment": _experiment,
    "join": _join, "jobs": _jobs, "begin": _begin, "end": _end, "array": _array, "add": _add}
