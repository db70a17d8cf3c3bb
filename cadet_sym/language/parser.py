"""Text to expression: Python's own syntax tree, a closed list of what may stand in it, and a caret under what may not.

Nothing is executed: `ast.parse` only reads, and every node is built by a row of a table here or refused.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import sympy as sp
from sympy.core.symbol import Str

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import Limits, checked, current_limits, power
from cadet_sym.language.canonical import canonical
from cadet_sym.language.names import exact
from cadet_sym.language.scope import ANYTHING, Scope
from cadet_sym.language.source import Source, read_source
from cadet_sym.language.vocabulary import (
    DISTANCE,
    FUNCTIONS,
    TIME,
    ElementCall,
    der,
    negation,
    piecewise,
    relation,
    symbol,
)

_COMPARISONS: dict[type[ast.cmpop], Any] = {
    ast.Gt: sp.StrictGreaterThan,
    ast.GtE: sp.GreaterThan,
    ast.Lt: sp.StrictLessThan,
    ast.LtE: sp.LessThan,
    ast.Eq: sp.Equality,
    ast.NotEq: sp.Unequality,
}
_FOREIGN_OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.BitXor: ("^", "a power is written `**`"),
    ast.FloorDiv: ("//", "division is written `/`"),
    ast.Mod: ("%", "there is no remainder in this language"),
}
_SIGNS: dict[type[ast.cmpop], str] = {ast.Gt: ">=", ast.GtE: ">=", ast.Lt: "<=", ast.LtE: "<=", ast.Eq: "=="}
_NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def parse(text: str, scope: Scope | None = None) -> sp.Expr:
    """Turn the text of an expression into the expression.

    Parameters
    ----------
    text : numbers, names, `+ - * / **`, comparisons, `and or not`, `A if C else B`, `der(h)`, functions, elements.
    scope : which names may stand in it; without one every name is taken as it stands, an unknown
        function as an element.

    Raises
    ------
    ModelError : with the text and the column of what is wrong.
    """
    if not isinstance(text, str):
        raise ModelError(f"an expression is text, not {type(text).__name__}")
    try:
        limits = current_limits()
        source = read_source(text, limits)
        # SymPy's evaluation is not always settled at first: (32**1.5)**0.5
        return canonical(_Reader(source, scope or ANYTHING, limits).number(source.root, 0))
    except ModelError as error:
        raise error.placed(text=text, column=0) from None


def parse_comparison(text: str, scope: Scope | None = None) -> list[tuple[str, sp.Expr, sp.Expr]]:
    """Turn the text of a comparison, or of a chain of them, into its links: sign, left side, right side.

    Raises
    ------
    ModelError : with the text and the column of what is wrong.
    """
    try:
        limits = current_limits()
        source = read_source(text, limits)
        reader, node = _Reader(source, scope or ANYTHING, limits), source.root
        if not isinstance(node, ast.Compare) or not all(type(each) in _SIGNS for each in node.ops):
            raise ModelError("a comparison is wanted, as `a <= b`, `a >= b` or `a == b`")
        sides = [canonical(reader.number(side, 1)) for side in (node.left, *node.comparators)]
    except ModelError as error:
        raise error.placed(text=text, column=0) from None
    return [(_SIGNS[type(each)], *pair) for each, pair in zip(node.ops, pairwise(sides), strict=True)]


@dataclass
class _Reader:
    """One reading of one text: a method a kind of node."""

    source: Source
    scope: Scope
    limits: Limits

    def error(self, message: str, node: ast.AST) -> ModelError:
        return ModelError(message, text=self.source.text, column=self.source.column(node))

    def number(self, node: ast.AST, level: int) -> sp.Expr:
        """A node that stands for a number."""
        if level > self.limits.levels:
            raise self.error(f"nested deeper than {self.limits.levels} levels: split it into elements", node)
        read = _NODES.get(type(node))
        if read is None:
            raise self.error(f"{_foreign(node)} has no place in an expression", node)
        try:
            return checked(read(self, node, level))
        except ModelError as error:
            raise error.placed(text=self.source.text, column=self.source.column(node)) from None

    def constant(self, node: ast.Constant, level: int) -> sp.Expr:
        text = self.source.segment(node)
        if not _NUMBER.fullmatch(text) or not isinstance(node.value, int | float):
            raise self.error(f"`{text}` is not a number: write it in decimal digits, as 1000 or 1e3", node)
        return exact(node.value)

    def name(self, node: ast.Name, level: int) -> sp.Expr:
        name = self.source.name(node)
        if name in FUNCTIONS or name == "der":
            raise self.error(f"`{name}` is a function: write `{name}(...)`", node)
        if name == "pi":
            return sp.pi
        if problem := self.scope.refusal(name):
            raise self.error(problem, node)
        return TIME if name == "t" else DISTANCE if name == "s" else symbol(name)

    def unary(self, node: ast.UnaryOp, level: int) -> sp.Expr:
        if isinstance(node.op, ast.Not | ast.Invert):
            raise self.error("a condition is not a number: write `1 if ... else 0`", node)
        value = self.number(node.operand, level + 1)
        return -value if isinstance(node.op, ast.USub) else value

    def binary(self, node: ast.BinOp, level: int) -> sp.Expr:
        if isinstance(node.op, ast.Pow):
            base, exponent = self.number(node.left, level + 1), self.number(node.right, level + 1)
            return power(base, exponent)
        if type(node.op) in _FOREIGN_OPERATORS:
            sign, hint = _FOREIGN_OPERATORS[type(node.op)]
            raise self.error(f"`{sign}` has no place in an expression: {hint}", node)
        if isinstance(node.op, ast.Add | ast.Sub):
            return self._sum(node, level)
        if isinstance(node.op, ast.Mult | ast.Div):
            return self._product(node, level)
        raise self.error(f"the operator in `{self.source.segment(node)}` has no place in an expression", node)

    def _sum(self, node: ast.AST, level: int) -> sp.Expr:
        """`a + b - c + ...`: one level, however long."""
        terms: list[tuple[bool, ast.AST]] = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            terms.append((isinstance(node.op, ast.Sub), node.right))
            node = node.left
        terms.append((False, node))
        values = [(minus, self.number(term, level + 1)) for minus, term in reversed(terms)]
        return sp.Add(*(-value if minus else value for minus, value in values))

    def _product(self, node: ast.AST, level: int) -> sp.Expr:
        """`a * b / c * ...`: one level, multiplied from the left as Python does."""
        factors: list[tuple[bool, ast.AST]] = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            factors.append((isinstance(node.op, ast.Div), node.right))
            node = node.left
        result = self.number(node, level + 1)
        for divide, factor in reversed(factors):
            value = self.number(factor, level + 1)
            if divide and value.is_zero:
                raise self.error("division by zero", factor)
            result = checked(result * (power(value, sp.Integer(-1)) if divide else value))
        return result

    def call(self, node: ast.Call, level: int) -> sp.Expr:
        if not isinstance(node.func, ast.Name):
            raise self.error("only a function or an element can be called", node)
        name = self.source.name(node.func)
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.error(f"`{name}` takes its arguments by position", node)
        if name == "der":
            return self._derivative(node)
        if name in FUNCTIONS:
            least, most, build = FUNCTIONS[name]
            if len(node.args) < least or (most is not None and len(node.args) > most):
                raise self.error(f"`{name}` takes {_count(least, most)}, {len(node.args)} given", node)
            return build(*(self.number(argument, level + 1) for argument in node.args))
        if problem := self.scope.call_refusal(name, len(node.args)):
            raise self.error(problem, node)
        return ElementCall(Str(name), *(self.number(argument, level + 1) for argument in node.args))

    def _derivative(self, node: ast.Call) -> sp.Expr:
        of = node.args[0] if node.args else None
        if len(node.args) > 2 or not isinstance(of, ast.Name):
            raise self.error("`der` takes a name and, if it is not 1, a whole number: `der(h)`, `der(h, 2)`", node)
        name = self.source.name(of)
        order = 1
        if len(node.args) == 2:
            written = node.args[1]
            if not isinstance(written, ast.Constant) or type(written.value) is not int or not 0 <= written.value <= 8:
                raise self.error("the order of a derivative is a whole number up to 8", written)
            order = written.value
        if problem := self.scope.derivative_refusal(name, order):
            raise self.error(problem, node.args[0])
        return der(symbol(name), order)

    def conditional(self, node: ast.IfExp, level: int) -> sp.Expr:
        """`A if c else B if d else C ...`: one level, however many cases."""
        branches: list[tuple[sp.Expr, Any]] = []
        last: ast.AST = node
        while isinstance(last, ast.IfExp):
            branches.append((self.number(last.body, level + 1), self.condition(last.test, level + 1)))
            last = last.orelse
        branches.append((self.number(last, level + 1), sp.true))
        return piecewise(branches)

    def condition(self, node: ast.AST, level: int) -> Any:
        """A node that is true or false."""
        if level > self.limits.levels:
            raise self.error(f"nested deeper than {self.limits.levels} levels: split it into elements", node)
        if isinstance(node, ast.BoolOp):
            combine = sp.And if isinstance(node.op, ast.And) else sp.Or
            return combine(*(self.condition(value, level + 1) for value in node.values))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return negation(self.condition(node.operand, level + 1))
        if isinstance(node, ast.Compare):
            return self._comparison(node, level)
        raise self.error(f"`{self.source.segment(node)}` is a number where a condition is wanted, as `z > 0`", node)

    def _comparison(self, node: ast.Compare, level: int) -> Any:
        sides = [self.number(side, level + 1) for side in (node.left, *node.comparators)]
        links = []
        for operator, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if type(operator) not in _COMPARISONS:
                raise self.error("`in` and `is` have no place in an expression", node)
            links.append(relation(_COMPARISONS[type(operator)], left, right))
        return sp.And(*links)


def _not_a_number(reader: _Reader, node: ast.AST, level: int) -> sp.Expr:
    raise reader.error("a condition is not a number: write `1 if ... else 0`", node)


_NODES: dict[type[ast.AST], Any] = {
    ast.Constant: _Reader.constant,
    ast.Name: _Reader.name,
    ast.UnaryOp: _Reader.unary,
    ast.BinOp: _Reader.binary,
    ast.Call: _Reader.call,
    ast.IfExp: _Reader.conditional,
    ast.Compare: _not_a_number,
    ast.BoolOp: _not_a_number,
}


def _count(least: int, most: int | None) -> str:
    if most is None:
        return f"{least} arguments or more"
    return f"{most} argument{'s' if most > 1 else ''}"


def _foreign(node: ast.AST) -> str:
    kinds = {
        ast.Attribute: "an attribute (a dot)",
        ast.Subscript: "an index",
        ast.Tuple: "a comma outside a call",
        ast.Lambda: "a lambda",
        ast.Starred: "a star",
        ast.GeneratorExp: "a loop",
    }
    return kinds.get(type(node), f"this ({type(node).__name__})")
