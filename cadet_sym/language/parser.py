"""Text to expression: Python's own syntax tree, a closed list of what may stand in it, and a caret under what may not.

Nothing is executed: `ast.parse` only reads, and every node is built by a row of a table here or refused.
"""

from __future__ import annotations

import ast
import difflib
import keyword
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.core.symbol import Str

from cadet_sym.errors import ModelError
from cadet_sym.language.bounds import Limits, checked, current_limits, power
from cadet_sym.language.scope import ANYTHING, Scope
from cadet_sym.language.vocabulary import (
    DISTANCE,
    FUNCTIONS,
    KEYWORDS,
    TIME,
    ElementCall,
    der,
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
_HINTS = {
    "^": "a power is written `**`",
    "#": "comments stand outside the quotes",
    "=": "a comparison is written `==`",
    "&": "write `and`",
    "|": "write `or`",
    "~": "write `not`",
    "[": "group with round brackets",
    "{": "group with round brackets",
    "%": "there is no remainder in this language",
    "−": "the minus sign is `-`",
    "–": "the minus sign is `-`",
    "×": "multiplication is written `*`",
    "·": "multiplication is written `*`",
    "≤": "write `<=`",
    "≥": "write `>=`",
    "'": "a derivative is written `der(h)`",
}
_NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NAME = re.compile(r"[^\W\d]\w*")


def parse(text: str, scope: Scope | None = None) -> sp.Expr:
    """Turn the text of an expression into the expression.

    Parameters
    ----------
    text : in the grammar of the model file: numbers, names, `+ - * / **`, comparisons, `and or not`, `A if C else B`, `der(h)`,
        the listed functions and the elements.
    scope : which names may stand in it; without one every name is taken as it stands, and an unknown function as an element.

    Raises
    ------
    ModelError : with the text and the column of what is wrong.
    """
    if not isinstance(text, str):
        raise ModelError(f"an expression is text, not {type(text).__name__}")
    try:
        return _Reader(text, scope or ANYTHING, current_limits()).expression()
    except ModelError as error:
        raise error.placed(text=text, column=0) from None


def name_problem(name: str) -> str | None:
    """Why `name` cannot be declared, or None if it can."""
    if not isinstance(name, str) or not name:
        return "a name is a non-empty text"
    if len(name) > 100:
        return "a name has at most 100 characters"
    if unicodedata.normalize("NFKC", name) != name:
        return f"write it in its normal form, `{unicodedata.normalize('NFKC', name)}`"
    if not _NAME.fullmatch(name) or not name.isidentifier():
        return "a name is letters, digits and underscores, and begins with a letter or an underscore"
    if name in KEYWORDS:
        return "it is a keyword of the expressions"
    if name in FUNCTIONS:
        return "it is a function of the expressions"
    if name in ("t", "s", "pi", "der"):
        meaning = {"t": "time", "s": "distance", "pi": "the number", "der": "the derivative"}[name]
        return f"it is reserved for {meaning}"
    return None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`; did you mean ...?`, or nothing if no known name is near."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=0.6)
    return f"; did you mean {' or '.join(f'`{n}`' for n in near)}?" if near else ""


@dataclass
class _Reader:
    """One reading of one text: knows where each node stands in it."""

    text: str
    scope: Scope
    limits: Limits

    def expression(self) -> sp.Expr:
        if len(self.text) > self.limits.characters:
            raise ModelError(
                f"an expression of {len(self.text)} characters, and the limit is {self.limits.characters}: "
                "split it into elements, or raise the limit"
            )
        self._characters()
        self._prepare()
        tree = self._tree()
        result = self.number(tree.body, 0)
        return result

    # ---- text

    def _characters(self) -> None:
        if not self.text.strip():
            raise ModelError("an empty expression; write 0 for nothing")
        for position, character in enumerate(self.text):
            if unicodedata.normalize("NFKC", character) != character and not character.isspace():
                plain = unicodedata.normalize("NFKC", character)
                self._fail(f"the character `{character}` is a variant of `{plain}`: write that", position)
            if not (character.isalnum() or character in "_+-*/()<>=!., \t\r\n" or unicodedata.combining(character)):
                hint = _HINTS.get(character)
                self._fail(
                    f"the character `{character}` has no place in an expression" + (f": {hint}" if hint else ""),
                    position,
                )
        if unicodedata.normalize("NFKC", self.text) != self.text:
            plain = unicodedata.normalize("NFKC", self.text)
            position = next(i for i, (a, b) in enumerate(zip(self.text, plain + "\0", strict=False)) if a != b)
            self._fail("a letter and its accent are written apart: write them as one character (NFKC)", position)

    def _prepare(self) -> None:
        """Source for `ast`: one line, and names that are keywords of Python but not of this language put behind masks."""
        self.names: dict[str, str] = {}
        spare = iter(chr(code) for code in range(0x13A0, 0x13F0) if chr(code) not in self.text)

        def mask(match: re.Match[str]) -> str:
            word = match.group()
            if not keyword.iskeyword(word) or word in KEYWORDS:
                return word
            for masked, original in self.names.items():
                if original == word:
                    return masked
            masked = next(spare) + word[1:]
            self.names[masked] = word
            return masked

        source = re.sub(r"\s", " ", self.text)
        self.source = re.sub(r"(?<![\w.])[^\W\d]\w*", mask, source)
        self.margin = len(self.source) - len(self.source.lstrip())

    def _tree(self) -> ast.Expression:
        try:
            return ast.parse(self.source.strip(), mode="eval")
        except SyntaxError as error:
            column = min(max((error.offset or 1) - 1 + self.margin, 0), len(self.text))
            self._fail(_syntax_message(self.text, column, error.msg or ""), column)
        except (RecursionError, MemoryError, ValueError, OverflowError):
            self._fail(f"nested deeper than {self.limits.levels} levels", 0)
        raise AssertionError

    def column(self, node: ast.AST, *, end: bool = False) -> int:
        """Character of the text at which a node begins."""
        offset = getattr(node, "end_col_offset" if end else "col_offset", 0) or 0
        return self.margin + len(self.source.strip().encode()[:offset].decode(errors="ignore"))

    def segment(self, node: ast.AST) -> str:
        """The text of a node."""
        return self.text[self.column(node) : self.column(node, end=True)]

    def _fail(self, message: str, where: int | ast.AST) -> None:
        column = where if isinstance(where, int) else self.column(where)
        raise ModelError(message, text=self.text, column=column)

    # ---- numbers

    def number(self, node: ast.AST, level: int) -> sp.Expr:
        """A node that stands for a number."""
        if level > self.limits.levels:
            self._fail(f"nested deeper than {self.limits.levels} levels: split it into elements", node)
        read = _NODES.get(type(node))
        if read is None:
            self._fail(f"{_foreign(node)} has no place in an expression", node)
        try:
            return checked(read(self, node, level))
        except ModelError as error:
            raise error.placed(text=self.text, column=self.column(node)) from None

    def constant(self, node: ast.Constant, level: int) -> sp.Expr:
        text = self.segment(node)
        if not _NUMBER.fullmatch(text) or isinstance(node.value, bool | complex):
            self._fail(f"`{text}` is not a number: write it in decimal digits, as 1000 or 1e3", node)
        return exact(node.value)

    def name(self, node: ast.Name, level: int) -> sp.Expr:
        name = self.names.get(node.id, node.id)
        if name in FUNCTIONS or name == "der":
            self._fail(f"`{name}` is a function: write `{name}(...)`", node)
        if name == "pi":
            return sp.pi
        if problem := self.scope.refusal(name):
            self._fail(problem, node)
        return TIME if name == "t" else DISTANCE if name == "s" else symbol(name)

    def unary(self, node: ast.UnaryOp, level: int) -> sp.Expr:
        if isinstance(node.op, ast.Not | ast.Invert):
            self._fail("a condition is not a number: write `1 if ... else 0`", node)
        value = self.number(node.operand, level + 1)
        return -value if isinstance(node.op, ast.USub) else value

    def binary(self, node: ast.BinOp, level: int) -> sp.Expr:
        if isinstance(node.op, ast.Pow):
            base, exponent = self.number(node.left, level + 1), self.number(node.right, level + 1)
            return power(base, exponent)
        if type(node.op) in _FOREIGN_OPERATORS:
            sign, hint = _FOREIGN_OPERATORS[type(node.op)]
            self._fail(f"`{sign}` has no place in an expression: {hint}", node)
        if isinstance(node.op, ast.Add | ast.Sub):
            return self._sum(node, level)
        if isinstance(node.op, ast.Mult | ast.Div):
            return self._product(node, level)
        self._fail(f"the operator in `{self.segment(node)}` has no place in an expression", node)
        raise AssertionError

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
                self._fail("division by zero", factor)
            result = checked(result * (power(value, sp.Integer(-1)) if divide else value))
        return result

    def call(self, node: ast.Call, level: int) -> sp.Expr:
        if not isinstance(node.func, ast.Name):
            self._fail("only a function or an element can be called", node)
        name = self.names.get(node.func.id, node.func.id)
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            self._fail(f"`{name}` takes its arguments by position", node)
        if name == "der":
            return self._derivative(node)
        if name in FUNCTIONS:
            least, most, build = FUNCTIONS[name]
            if len(node.args) < least or (most is not None and len(node.args) > most):
                self._fail(f"`{name}` takes {_count(least, most)}, {len(node.args)} given", node)
            return build(*(self.number(argument, level + 1) for argument in node.args))
        if problem := self.scope.call_refusal(name, len(node.args)):
            self._fail(problem, node)
        return ElementCall(Str(name), *(self.number(argument, level + 1) for argument in node.args))

    def _derivative(self, node: ast.Call) -> sp.Expr:
        if not 1 <= len(node.args) <= 2 or not isinstance(node.args[0], ast.Name):
            self._fail("`der` takes a name and, if it is not 1, a whole number: `der(h)`, `der(h, 2)`", node)
        name = self.names.get(node.args[0].id, node.args[0].id)
        order = 1
        if len(node.args) == 2:
            written = node.args[1]
            if not isinstance(written, ast.Constant) or type(written.value) is not int or not 0 <= written.value <= 8:
                self._fail("the order of a derivative is a whole number up to 8", written)
            order = written.value
        if problem := self.scope.derivative_refusal(name, order):
            self._fail(problem, node.args[0])
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

    # ---- conditions

    def condition(self, node: ast.AST, level: int) -> Any:
        """A node that is true or false."""
        if level > self.limits.levels:
            self._fail(f"nested deeper than {self.limits.levels} levels: split it into elements", node)
        if isinstance(node, ast.BoolOp):
            combine = sp.And if isinstance(node.op, ast.And) else sp.Or
            return combine(*(self.condition(value, level + 1) for value in node.values))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return sp.Not(self.condition(node.operand, level + 1))
        if isinstance(node, ast.Compare):
            return self._comparison(node, level)
        self._fail(f"`{self.segment(node)}` is a number where a condition is wanted, as `z > 0`", node)
        raise AssertionError

    def _comparison(self, node: ast.Compare, level: int) -> Any:
        sides = [self.number(side, level + 1) for side in (node.left, *node.comparators)]
        links = []
        for operator, left, right in zip(node.ops, sides, sides[1:], strict=False):
            if type(operator) not in _COMPARISONS:
                self._fail("`in` and `is` have no place in an expression", node)
            links.append(relation(_COMPARISONS[type(operator)], left, right))
        return sp.And(*links)


def _not_a_number(reader: _Reader, node: ast.AST, level: int) -> sp.Expr:
    raise ModelError(
        "a condition is not a number: write `1 if ... else 0`", text=reader.text, column=reader.column(node)
    )


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


def exact(value: int | float) -> sp.Rational:
    """A number as written: 0.1 is one tenth (the shortest decimal that gives the same double)."""
    if isinstance(value, int):
        return sp.Integer(value)
    if value != value or value in (float("inf"), float("-inf")):
        raise ModelError("this number is not finite")
    return sp.Rational(repr(float(value)))


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


def _syntax_message(text: str, column: int, message: str) -> str:
    if text[column : column + 1] == "=" or "==" in message or ":=" in message:
        return "`=` has no place in an expression: a comparison is written `==`"
    if text.count("(") != text.count(")"):
        return "brackets do not match"
    if re.search(r"\bif\b", text) and not re.search(r"\belse\b", text):
        return "a conditional needs its `else`: write `A if C else B`"
    rest = text[column:].strip()
    if not rest:
        return "the expression ends too early"
    return "this cannot be read: an operator, a comma or a bracket is missing or too many"
