"""Answers to requests of a page to its workers: drawings, runs, signals."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from heavebond.studio.tab import Handler, Tab, times
from heavebond.studio.workers import LOST, Answer

HANGS = 10.0  # s of a check after which a newer one replaces it
LEFT = 1.5  # s after which a check of a closed diagram is replaced by that of another


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
        tab.others = await asyncio.to_thread(times, answer[1].get("files", []))
        tab.expect_runs()
    return answer


async def _edit(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.checker.ask_again("edit", tab.job(message), dict(message["action"]))


async def _palette(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.librarian.ask("palette", tab.job({"text": "", **message}))


async def _component(tab: Tab, message: dict[str, Any]) -> Answer:
    return await tab.librarian.ask("component", tab.job({"text": "", **message}), str(message["kind"]))


async def _run(tab: Tab, message: dict[str, Any]) -> Answer:
    job, task = tab.job(message), str(message["do"])
    arguments = () if task in ("animation", "modes", "film") else ([str(name) for name in message.get("names", ())],)
    ask = tab.runner.ask_newest if task in ("run", "preview") else tab.runner.ask
    return await ask(task, job, *arguments)


async def _stop(tab: Tab, _: dict[str, Any]) -> Answer:
    tab.runner.stop()
    return "done", {}, None


HANDLERS: dict[str, Handler] = {
    "view": _view, "edit": _edit, "palette": _palette, "component": _component, "stop": _stop,
    **dict.fromkeys(("run", "prepare", "preview", "signals", "animation", "modes", "film"), _run)}
