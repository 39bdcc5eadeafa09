"""Answers to requests of a page about files: first page; open, create, copy and save diagrams."""

from __future__ import annotations

import asyncio
from typing import Any

from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import confined
from heavebond.studio.folder import BUNDLED, EMPTY, NEW, bundled_machines
from heavebond.studio.tab import Handler, Tab, document_entry
from heavebond.studio.values import with_values
from heavebond.studio.workers import Answer


async def _home(tab: Tab, _: dict[str, Any]) -> Answer:
    tab.document = None
    diagrams = await asyncio.to_thread(tab.folder.diagrams)
    machines = [{k: v for k, v in entry.items() if k != "path"} for entry in bundled_machines()]
    folder_exists = await asyncio.to_thread(tab.folder.root.is_dir)
    return "done", {"folder": str(tab.folder.root), "there": folder_exists, "diagrams": diagrams, "machines": machines,
                    "first": tab.first}, None


async def _open(tab: Tab, message: dict[str, Any]) -> Answer:
    tab.document = await asyncio.to_thread(tab.folder.read, str(message["name"]))
    tab.others = {}
    return "done", document_entry(tab.document), None


async def _new(tab: Tab, message: dict[str, Any]) -> Answer:
    text = EMPTY if message.get("empty") else NEW
    return "done", {"name": await asyncio.to_thread(tab.folder.create, str(message["name"]), text)}, None


async def _copy(tab: Tab, message: dict[str, Any]) -> Answer:
    """Copy a bundled machine with all its files to a folder of the opened folder."""
    from heavebond.estimation.starter_folder import start_folder

    name = str(message["name"])
    folder = tab.folder.path(f"{name}/{name}.yaml").parent
    if folder.parent != tab.folder.root.resolve():
        raise UsageError([Problem("name-bad", f"'{name}' cannot name a folder here")])
    with confined(tab.folder.root):
        starter = await asyncio.to_thread(start_folder, folder, str(message["origin"]).removeprefix(BUNDLED))
    return "done", {"name": starter.diagrams[0].relative_to(folder.parent).as_posix()}, None


async def _derive(tab: Tab, message: dict[str, Any]) -> Answer:
    values = {str(k): str(v) for k, v in message["values"].items()}
    document = await asyncio.to_thread(tab.folder.derive, str(message["name"]), str(message["origin"]), values)
    return "done", {"name": document}, None


async def _write(tab: Tab, message: dict[str, Any]) -> Answer:
    values = {str(k): str(v) for k, v in message["values"].items()}
    return "done", {"text": await asyncio.to_thread(with_values, str(message["text"]), values)}, None


async def _save(tab: Tab, message: dict[str, Any]) -> Answer:
    name, text, base = (str(message[k]) for k in ("name", "text", "base"))
    saved = await asyncio.to_thread(tab.folder.save, name, text, base)
    if tab.document is not None and tab.document.name == name:
        tab.document = saved
    return "done", document_entry(saved), None


HANDLERS: dict[str, Handler] = {"home": _home, "open": _open, "new": _new, "copy": _copy, "derive": _derive,
                                "write": _write, "save": _save}
