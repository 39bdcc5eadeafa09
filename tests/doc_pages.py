"""Executes the pages of the documentation: files are written and loaded, commands run, numbers compared.

What a fenced block is, says its info string, and for files an HTML comment on the line above it, which readers do not
see:

    <!-- file: slider.yaml -->        the block is this file: written, loaded, assembled, started; run further down
    <!-- wrong file: slider.yaml -->  the block is this file, and heavebond must refuse it
    <!-- bundled: cmc_ahc/passive.yaml -->   every line of the block stands in this file under models/, in this order
    <!-- output -->                   the block is what the Python block before it prints
    ```yaml fragment                  YAML that is only parsed
    ```python                         run, all blocks of a page in one namespace; `print(x)  # 49.9` is compared
    ```console                        `$ heavebond ...` is run and the lines below it are compared
    ```sh                             `heavebond ...` must succeed, `make NAME` must be in the Makefile
    ```text                           not looked at

Output is compared line by line in order, words as they stand and numbers within 1 % (counts of candidates within 20
%: they rise with each effect of the library). A line may end with ` ...` where only its beginning counts, a line
`...` stands for any number of lines. What a failing command says is compared letter by letter, as its carets must
point at the right sign.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.language import laws
from heavebond.language.library import bundled, library
from heavebond.language.power_law import check_power
from heavebond.numerics.initialise import start
from heavebond.numerics.inputs import pieced
from heavebond.studies.campaign import KEPT
from heavebond.studies.run_case import checked
from heavebond.text.yaml_source import parse, read

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
LANGUAGES = ("yaml", "python", "console", "sh", "text", "csv")
TOLERANCE = 0.01
GROWING = re.compile(r"\bcandidates\b")  # lines whose counts rise with each effect of the library
GROWTH = 0.2
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
MARK = re.compile(r"<!--\s*(file|wrong file|bundled|output)\b:?\s*(\S*)\s*-->")
PRINTED = re.compile(r"\bprint\(.*\)\s+# (.+)$")


@dataclass(frozen=True)
class Block:
    """A fenced block: where its first line stands, its info string, its mark above (kind, name), its lines."""

    page: Path
    line: int
    info: str
    mark: tuple[str, str]
    lines: tuple[str, ...]

    @property
    def language(self) -> str:
        """The first word of the info string."""
        return self.info.split(" ")[0]

    @property
    def text(self) -> str:
        """The block as a file."""
        return "\n".join(self.lines) + "\n"


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page in order."""
    begin, info, mark, inner = 0, "", ("", ""), []
    lines = page.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        if line.startswith("```") and not begin:
            above = MARK.fullmatch(lines[number - 2].strip()) if number > 1 else None
            begin, info, inner = number + 1, line[3:].strip(), []
            mark = (above.group(1), above.group(2)) if above else ("", "")
        elif line.startswith("```"):
            yield Block(page, begin, info, mark, tuple(inner))
            begin = 0
        elif begin:
            inner.append(line)
    assert not begin, f"{page.name}:{begin - 1}: this block is not closed"


@dataclass
class PageRun:
    """One page being executed in the current folder; `found` are its mistakes, `said` what failing commands say now.
    `studies`: a folder with completed cases of bundled studies, read and added to."""

    page: Path
    studies: Path | None = None
    found: list[str] = field(default_factory=list)
    said: dict[int, list[str]] = field(default_factory=dict)
    waiting: dict[str, Block] = field(default_factory=dict)
    printed: list[str] = field(default_factory=list)
    names: dict[str, object] = field(default_factory=dict)

    def execute(self) -> PageRun:
        """Every block in order."""
        for block in blocks(self.page):
            for name in [n for n in self.waiting if n.removesuffix(".yaml") in block.text or n in block.text]:
                if block.language in ("console", "python", "sh"):
                    del self.waiting[name]
            try:
                self._block(block)
            except Exception as error:  # whatever a page does wrong is a finding about the page
                self._wrong(block, f"{type(error).__name__}: {error}")
        for block in self.waiting.values():
            self._wrong(block, f"no command on this page runs {block.mark[1]}")
        return self

    def _wrong(self, block: Block, what: str, line: int = 0) -> None:
        self.found.append(f"{self.page.name}:{block.line + line}: {what}")

    def _block(self, block: Block) -> None:
        kind, name = block.mark
        if block.language not in LANGUAGES:
            self._wrong(block, f"'{block.language}' is no kind of block that is checked: {', '.join(LANGUAGES)}")
        elif kind in ("file", "wrong file"):
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_text(block.text, encoding="utf-8")
            if name.endswith(".yaml"):
                self._file(block, name, right=kind == "file")
        elif kind == "bundled":
            self._bundled(block, name)
        elif kind == "output":
            self._compare(block, 0, list(block.lines), self.printed)
        elif block.language == "yaml":
            if block.info != "yaml fragment":
                self._wrong(block, "YAML without a file name above it is marked `yaml fragment`")
            parse(block.text)
        elif block.language in ("python", "console", "sh"):
            getattr(self, f"_{block.language}")(block)

    # -- files -----------------------------------------------------------------------------------------------------
    def _file(self, block: Block, name: str, *, right: bool) -> None:
        keys = read(Path(name)).root.items if right else {}
        if {"model", "experiment", "study"} & set(keys):
            self.waiting[name] = block
        try:
            _accept(Path(name))
        except hb.HeavebondError as error:
            if right:
                self._wrong(block, f"{name} is refused:\n{error}")
        else:
            if not right:
                self._wrong(block, f"{name} is accepted, which the page says it is not")

    def _bundled(self, block: Block, name: str) -> None:
        rest = iter((bundled("models") / name).read_text(encoding="utf-8").splitlines())
        for k, line in enumerate(block.lines):
            if line.strip() != "..." and not any(line.rstrip() == there.rstrip() for there in rest):
                self._wrong(block, f"this line does not stand in models/{name} (in this order): {line}", k)
                return

    # -- commands --------------------------------------------------------------------------------------------------
    def _sh(self, block: Block) -> None:
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        for k, line in enumerate(block.lines):
            words = shlex.split(line, comments=True)
            if words[:1] == ["heavebond"]:
                code, output = run(words[1:])
                if code:
                    self._wrong(block, f"`{line}` ends with {code}:\n{output}", k)
            elif words[:1] == ["make"] and not set(words[1:]) <= set(targets):
                self._wrong(block, f"the Makefile has no such target: {line}", k)

    def _console(self, block: Block) -> None:
        begins = [k for k, line in enumerate(block.lines) if line.startswith("$ ")]
        for k, end in zip(begins, [*begins[1:], len(block.lines)], strict=True):
            words = shlex.split(block.lines[k][2:])
            if words[0] != "heavebond":
                self._wrong(block, "only heavebond is run in a console block", k)
                continue
            if self.studies is not None and words[1:2] == ["study"] and words[2].startswith("cmc_ahc/studies/"):
                _link_completed(Path(words[2]).name, self.studies)
            code, output = run(words[1:])
            wanted = list(block.lines[k + 1:end])
            if code:
                self._said(block, k, wanted, output)
            else:
                self._compare(block, k + 1, wanted, output)
                if words[1] in ("run", "compare") and not NUMBER.search("".join(wanted)):
                    self._wrong(block, "no number of this command is pinned", k)

    def _said(self, block: Block, k: int, wanted: list[str], output: list[str]) -> None:
        """What a failing command says, letter by letter; with tolerance where the page leaves something out."""
        while wanted and not wanted[-1]:
            wanted.pop()
        if any(line.endswith("...") for line in wanted):
            self._compare(block, k + 1, wanted, output)
            return
        if wanted != output:
            self._wrong(block, "the command says something else now:\n" + "\n".join(output), k)
            self.said[block.line + k] = output

    def _python(self, block: Block) -> None:
        heard = io.StringIO()
        with contextlib.redirect_stdout(heard):
            exec(compile("\n" * (block.line - 1) + block.text, str(block.page), "exec"), self.names)
        self.printed = heard.getvalue().splitlines()
        expected = [(k, found.group(1)) for k, line in enumerate(block.lines) if (found := PRINTED.search(line))]
        for k, text in expected:
            self._compare(block, k, [text], self.printed)

    def _compare(self, block: Block, first: int, wanted: list[str], output: list[str]) -> None:
        position = 0
        for k, line in enumerate(wanted):
            if not line.strip() or line.strip() == "...":
                continue
            hit = next((n for n in range(position, len(output)) if alike(line, output[n])), None)
            if hit is None:
                self._wrong(block, f"the output has no line like this: {line}\n" + "\n".join(output), first + k)
                return
            position = hit + 1


def _link_completed(study: str, studies: Path) -> None:
    """Let the output folder of a study in the current folder have the completed cases of the test run."""
    completed, link = studies / study / KEPT, Path(study) / KEPT
    completed.mkdir(parents=True, exist_ok=True)
    link.parent.mkdir(exist_ok=True)
    if not link.exists():
        link.symlink_to(completed)


def _accept(path: Path) -> None:
    """Load a file as far as it goes: a diagram to its start, a component to its laws, a function to its steps, an
    experiment and a study to their equations."""
    keys = read(path).root.items
    if "function" in keys:
        assert library([path.parent]).functions[str(getattr(keys["function"], "text", ""))].steps
    elif "component" in keys:
        known = library([path.parent])
        component = known.component(str(getattr(keys["component"], "text", "")))
        laws.check(component, known.domains)
        report = check_power(component, known.domains)
        assert report.holds, report.verdict
    elif "experiment" in keys:
        hb.load_experiment(path)
    elif "study" in keys:
        checked(hb.load_study(path))
    else:
        assembly = hb.assemble(hb.load(path))
        inputs = pieced(assembly.flat, 0.0, 0.0)
        start(assembly, 0.0, inputs.columns[:, 0] if inputs.columns.size else None)


def run(arguments: list[str]) -> tuple[int, list[str]]:
    """The exit code of `heavebond ARGUMENTS` and the lines that it writes."""
    result = CliRunner().invoke(main, arguments, prog_name="heavebond")
    lines = [line.rstrip() for line in result.output.splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    return result.exit_code, lines


def alike(wanted: str, line: str) -> bool:
    """Whether two lines agree: words exactly, numbers within 1 % (candidates 20 %), any number of spaces and of `─` for
    one."""
    wanted, line = (" ".join(re.sub(r"─+", "─", text).split()) for text in (wanted, line))
    partial = wanted.endswith(" ...")
    wanted = wanted.removesuffix(" ...")
    words, other = NUMBER.split(wanted), NUMBER.split(line)
    numbers, others = (list(map(float, NUMBER.findall(text))) for text in (wanted, line))
    if partial:
        if not other[len(words) - 1:] or not other[len(words) - 1].startswith(words[-1]):
            return False
        other, others = [*other[:len(words) - 1], words[-1]], others[:len(numbers)]
    tolerance = GROWTH if GROWING.search(wanted) else TOLERANCE
    return words == other and len(numbers) == len(others) and all(
        abs(a - b) <= tolerance * max(abs(a), abs(b)) for a, b in zip(numbers, others, strict=True))


def rewrite(page: Path, said: dict[int, list[str]]) -> None:
    """Put what failing commands say now in the place of what the page says; `said` is by the line of the command."""
    lines = page.read_text(encoding="utf-8").splitlines()
    for number in sorted(said, reverse=True):
        end = next(k for k in range(number, len(lines)) if lines[k].startswith(("```", "$ ")))
        lines[number:end] = said[number]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
