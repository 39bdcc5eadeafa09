"""Statements of SIDOPS that are executed one after the other, with symbols: assignments, choices and loops."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.assignments import assigned
from heavebond.import_20sim.choices import decided, simplified
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import Evaluator, fold, spread
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.memory import Memory
from heavebond.import_20sim.sidops_tree import Assign, Do, Expr, For, If, Statement, While

Env = dict[str, Expr]
MOST_TURNS = 500
MOST_BRANCHES = 200  # limit of iterations of a loop that ends at a condition of the run


def _where(env: Env, condition: Expr, value: bool) -> Env:
    """The values in a branch."""
    return {name: decided(e, condition, value) for name, e in env.items()}


class Execution:
    """Symbolic execution of the statements of one submodel; an `Env` holds the values by the text of each element."""

    component: Component
    memory: Memory
    comments: Mapping[int, str]
    evaluate: Evaluator
    numbers: dict[str, float]

    def __init__(self) -> None:
        self.targets: Env = {}  # assigned values, by text
        self.turns = 0
        self.said: dict[str, list[str]] = {}  # the comments at the statements that assign a quantity

    def _do(self, statement: Do) -> None:
        raise NotImplementedError

    def _run(self, statements: Iterable[Statement], env: Env) -> None:
        """Execute assignments in sequence with symbols; `env` holds the values."""
        outer, self.evaluate.values = self.evaluate.values, env
        for statement in statements:
            try:
                self._statement(statement, env)
            except Unreadable as problem:
                self.component.untranslated.append((problem.line or statement.line, problem.reason))
        self.evaluate.values = outer

    def _statement(self, statement: Statement, env: Env) -> None:
        outer, self.evaluate.values = self.evaluate.values, env
        try:
            if statement.line in self.comments:
                # keep a comment for the first quantity that a statement assigns
                for label in assigned(statement)[:1]:
                    comments = self.said.setdefault(label, [])
                    if (comment := self.comments[statement.line]) not in comments:
                        comments.append(comment)
            if isinstance(statement, Assign):
                self._assign(statement, env)
            elif isinstance(statement, If):
                condition = simplified(self.evaluate.scalar(statement.condition))
                known = fold(condition, self.numbers)
                if known is not None:
                    for inner in statement.then if known else statement.otherwise:
                        self._statement(inner, env)
                else:
                    then, otherwise = _where(env, condition, True), _where(env, condition, False)
                    for body, branch_env in ((statement.then, then), (statement.otherwise, otherwise)):
                        for inner in body:
                            self._statement(inner, branch_env)
                    env.update(self._merged(condition, then, otherwise, env))
            elif isinstance(statement, For):
                self._for(statement, env)
            elif isinstance(statement, While):
                self._while(statement, env)
            else:
                self._do(statement)
        finally:
            self.evaluate.values = outer

    def comment(self, label: str) -> str:
        """The comments of all statements that assign a quantity: lines before the equation, and last the text on its
        line.
        """
        comments = [comment.split("\n") for comment in self.said.pop(label, ())]
        before = [line for lines in comments for line in lines[:-1]]
        return "\n".join([*before, "; ".join(dict.fromkeys(lines[-1] for lines in comments if lines[-1]))])

    def _assign(self, statement: Assign, env: Env) -> None:
        self.memory.target = statement.left.name if statement.left.op == "name" else ""
        if places := self.evaluate.places(statement.left, statement.right):
            for element, condition, value in places:
                self.targets[f.text(element)] = element
                env.update(self._merged(simplified(condition), {**env, f.text(element): value}, dict(env), env))
            return
        values = self.evaluate(statement.right)
        self.evaluate.values = {}
        target = self.evaluate(statement.left)
        elements = [e for row in target for e in row]
        for e, v in zip(elements, spread(values, len(elements), statement.line), strict=True):
            known = fold(v, self.numbers)
            env[f.text(e)] = simplified(v) if known is None else f.number(known)
            self.targets[f.text(e)] = e

    def _merged(self, condition: Expr, then: Env, otherwise: Env, env: Env) -> Env:
        """The values after a choice between two branches."""
        merged: Env = {}
        for name in dict.fromkeys([*then, *otherwise]):
            a, b = (side.get(name, env.get(name, Expr("prev", name=name))) for side in (then, otherwise))
            merged[name] = a if a == b else simplified(Expr("if", (condition, a, b)))
        return merged

    def _turn(self, line: int) -> None:
        self.turns += 1
        if self.turns > MOST_TURNS * 20:
            raise Unreadable(line, f"the loops have more than {MOST_TURNS * 20} turns")

    def _for(self, statement: For, env: Env) -> None:
        first, last = self.evaluate.whole(statement.first), self.evaluate.whole(statement.last)
        step = 1 if statement.step is None else self.evaluate.whole(statement.step)
        if step == 0 or abs(last - first) > MOST_TURNS * abs(step):
            raise Unreadable(statement.line, f"a loop of more than {MOST_TURNS} turns is not translated")
        shadowed = self.numbers.get(statement.name)
        for k in range(first, last + (1 if step > 0 else -1), step):
            self._turn(statement.line)
            self.numbers[statement.name] = float(k)
            for inner in statement.body:
                self._statement(inner, env)
        self.numbers.pop(statement.name, None)
        if shadowed is not None:
            self.numbers[statement.name] = shadowed

    def _while(self, statement: While, env: Env) -> None:
        """`while c do ... end`, or `repeat ... until c` (`after`), whose condition is known beforehand."""
        branches: list[tuple[Expr, Env]] = []  # values if the loop ends at a condition that is determined during the run
        loop_env = dict(env)
        for turn in range(MOST_TURNS + 1):
            self.evaluate.values = loop_env
            condition = f.number(1) if statement.after and turn == 0 else \
                simplified(f.truth(self.evaluate.scalar(statement.condition)))
            goes_on = simplified(Expr("not", (condition,))) if statement.after and turn else condition
            known = fold(goes_on, self.numbers)
            if known is not None and not known:
                break
            if known is None:
                if len(branches) == MOST_BRANCHES:
                    raise Unreadable(statement.line, "a loop with more than "
                                     f"{MOST_BRANCHES} turns that depend on the run is not translated")
                branches.append((goes_on, _where(loop_env, goes_on, False)))
                loop_env = _where(loop_env, goes_on, True)
            self._turn(statement.line)
            for inner in statement.body:
                self._statement(inner, loop_env)
        else:
            raise Unreadable(statement.line, f"a loop of more than {MOST_TURNS} turns is not translated")
        for condition, ended in reversed(branches):
            loop_env = self._merged(condition, loop_env, ended, env)
        env.clear()
        env.update(loop_env)
