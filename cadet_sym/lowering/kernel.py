"""Write a numerical procedure, itself written in a small part of Python, in LLVM's intermediate language.

What is compiled runs as Python too, on NumPy arrays, with the same numbers: that is how it is tested.

The part: whole functions of `float`, `int`, `Vector` and `Function` (annotated) that return a `float` or an `int`; local
variables that keep the type of their first value; `if`, `while`, `for ... in range(...)`, `break`, `continue`, `return`;
arithmetic, comparisons, `and`, `or`, `not`; `sqrt`, `abs`, `min` and `max` of two, `float`, `int`, `isfinite`,
`part(vector, first)`; entries of vectors; numbers and tuples of numbers of the module that the procedure stands in; calls of
procedures written before, and of a `Function`, which takes four vectors and writes into the last. Vectors that are given to
a procedure may not overlap where one of them is written.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from functools import cache
from math import isfinite, sqrt
from types import ModuleType
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from cadet_sym.cache import digest, shelf
from cadet_sym.lowering.instructions import literal
from cadet_sym.lowering.machine import MachineCode, machine_code

__all__ = ["Function", "Vector", "isfinite", "kernel", "kernel_text", "part", "sqrt"]

Vector = npt.NDArray[np.float64]
Function = Callable[..., None]

TYPES = {"float": "double", "int": "i64", "Vector": "ptr", "Function": "ptr"}

FLOATING = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
INTEGER = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.FloorDiv: "sdiv", ast.Mod: "srem"}
FLOATING_TESTS = {ast.Lt: "olt", ast.LtE: "ole", ast.Gt: "ogt", ast.GtE: "oge", ast.Eq: "oeq", ast.NotEq: "une"}
INTEGER_TESTS = {ast.Lt: "slt", ast.LtE: "sle", ast.Gt: "sgt", ast.GtE: "sge", ast.Eq: "eq", ast.NotEq: "ne"}

DECLARATIONS = """declare double @llvm.sqrt.f64(double)
declare double @llvm.fabs.f64(double)
declare double @pow(double, double) nounwind
"""


def part(vector: Vector, first: int) -> Vector:
    """The vector from its entry `first` on."""
    return vector[first:]


def kernel(
    *procedures: Callable[..., float], fused: bool = False, lanes: int | None = None, plain: bool = False
) -> MachineCode:
    """Procedures as machine code, the last of them to be called; kept in the cache, for no model is part of it."""
    text = kernel_text(*procedures, fused=fused, lanes=lanes, plain=plain)
    return machine_code(text, procedures[-1].__name__, shelf=shelf(digest(text)), effort=2)


def kernel_text(
    *procedures: Callable[..., float], fused: bool = False, lanes: int | None = None, plain: bool = False
) -> str:
    """Procedures as LLVM's text, the last of them under its own name; each may call those before it.

    Parameters
    ----------
    fused : a product and a sum may become one operation with one rounding, which is faster; the last bits are then
        not those of Python.
    plain : the last procedure only leads to the others: LLVM compiles it as it stands, in a third of the time of all.

    Raises
    ------
    SyntaxError
        If one steps out of the part of Python that is understood.
    """
    kinds: dict[str, str] = {}
    constants: dict[str, str] = {}
    texts = []
    for procedure in procedures:
        tree = _definition(procedure)
        known = procedure.__globals__ if lanes is None else {**procedure.__globals__, "LANES": lanes}
        text = _Writer(tree, procedure is procedures[-1], known, kinds, constants).text()
        if lanes is not None:
            text = text.replace(" nounwind {", f' nounwind "prefer-vector-width"="{64 * lanes}" {{')
        if plain and procedure is procedures[-1]:
            text = text.replace(" nounwind", " nounwind noinline optnone", 1)
        for each in ("fadd", "fsub", "fmul") if fused else ():
            text = text.replace(f" = {each} ", f" = {each} contract ")
        texts.append(text)
        assert isinstance(tree.returns, ast.Name)
        kinds[tree.name] = TYPES[tree.returns.id]
    return "\n".join([DECLARATIONS, *constants.values(), *texts])


def _definition(procedure: Callable[..., float]) -> ast.FunctionDef:
    """A procedure's definition: of a module's own without a look for where it ends, which takes longer than all else."""
    if procedure.__qualname__ == procedure.__name__ and (module := inspect.getmodule(procedure)) is not None:
        return _definitions(module)[procedure.__name__]
    tree = ast.parse(textwrap.dedent(inspect.getsource(procedure))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


@cache
def _definitions(module: ModuleType) -> dict[str, ast.FunctionDef]:
    """What a module defines, by name."""
    tree = ast.parse(inspect.getsource(module))
    return {each.name: each for each in tree.body if isinstance(each, ast.FunctionDef)}


class _Writer:
    """The text of one procedure, written from top to bottom; every variable has a place on the stack."""

    def __init__(
        self,
        tree: ast.FunctionDef,
        last: bool,
        known: dict[str, Any],
        procedures: dict[str, str],
        constants: dict[str, str],
    ) -> None:
        self.tree, self.last, self.known = tree, last, known
        self.procedures, self.constants = procedures, constants
        self.lines: list[str] = []
        self.stack: list[str] = []
        self.variables: dict[str, str] = {}  # name: type
        self.loops: list[tuple[str, str]] = []  # where `continue` and `break` lead
        self.count = 0

    def text(self) -> str:
        heads = []
        for argument in self.tree.args.args:
            assert isinstance(argument.annotation, ast.Name)
            kind = TYPES[argument.annotation.id]
            apart = " noalias" if argument.annotation.id == "Vector" else ""
            heads.append(f"{kind}{apart} %in.{argument.arg}")
            self._variable(argument.arg, kind)
            self.lines.append(f"  store {kind} %in.{argument.arg}, ptr %{argument.arg}")
        assert isinstance(self.tree.returns, ast.Name)
        self.result = TYPES[self.tree.returns.id]
        self._all(self.tree.body)
        body = [*self.stack, *self.lines, "  unreachable"]
        scope = "" if self.last else "internal "
        head = f"define {scope}{self.result} @{self.tree.name}({', '.join(heads)}) nounwind {{"
        return "\n".join([head, *body, "}"]) + "\n"

    # -- statements -----------------------------------------------------------------------------------------

    def _all(self, body: list[ast.stmt]) -> None:
        for statement in body:
            getattr(self, f"_do_{type(statement).__name__}", self._unknown)(statement)

    def _do_Assign(self, node: ast.Assign) -> None:
        (target,) = node.targets
        self._store(target, *self._value(node.value))

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        self._store(node.target, *self._binary(node.op, self._value(node.target), self._value(node.value)))

    def _store(self, target: ast.expr, text: str, kind: str) -> None:
        if isinstance(target, ast.Subscript):
            kind, text = "double", self._as_float(text, kind)
            place = self._entry(target)
        else:
            assert isinstance(target, ast.Name)
            held = self.variables.get(target.id)
            if held is None:
                self._variable(target.id, kind)
            elif held != kind:
                kind, text = held, self._as_float(text, kind) if held == "double" else self._unknown(target)
            place = f"%{target.id}"
        self.lines.append(f"  store {kind} {text}, ptr {place}")

    def _do_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return  # a docstring
        assert isinstance(node.value, ast.Call)
        assert isinstance(node.value.func, ast.Name)
        if node.value.func.id in self.procedures:
            self._value(node.value)
            return
        called, _ = self._value(node.value.func)
        given = ", ".join(f"ptr {self._value(each)[0]}" for each in node.value.args)
        self.lines.append(f"  call void {called}({given})")

    def _do_If(self, node: ast.If) -> None:
        yes, no, end = self._labels("then", "else", "end")
        self._branch(node.test, yes, no)
        for label, body in ((yes, node.body), (no, node.orelse)):
            self._at(label)
            self._all(body)
            self._go(end)
        self._at(end)

    def _do_While(self, node: ast.While) -> None:
        test, body, end = self._labels("test", "body", "end")
        self._go(test)
        self._at(test)
        self._branch(node.test, body, end)
        self._at(body)
        self.loops.append((test, end))
        self._all(node.body)
        self.loops.pop()
        self._go(test)
        self._at(end)

    def _do_For(self, node: ast.For) -> None:
        assert isinstance(node.target, ast.Name)
        assert isinstance(node.iter, ast.Call)
        bounds = [self._value(each)[0] for each in node.iter.args]
        first, last = ("0", bounds[0]) if len(bounds) == 1 else bounds
        self._store(node.target, first, "i64")
        test, body, more, end = self._labels("test", "body", "more", "end")
        self._go(test)
        self._at(test)
        inside = self._new(f"icmp slt i64 {self._value(node.target)[0]}, {last}")
        self.lines.append(f"  br i1 {inside}, label %{body}, label %{end}")
        self._at(body)
        self.loops.append((more, end))
        self._all(node.body)
        self.loops.pop()
        self._go(more)
        self._at(more)
        self._store(node.target, self._new(f"add i64 {self._value(node.target)[0]}, 1"), "i64")
        self._go(test)
        self._at(end)

    def _do_Break(self, node: ast.Break) -> None:
        self._leave(f"br label %{self.loops[-1][1]}")

    def _do_Continue(self, node: ast.Continue) -> None:
        self._leave(f"br label %{self.loops[-1][0]}")

    def _do_Return(self, node: ast.Return) -> None:
        assert node.value is not None
        text, kind = self._value(node.value)
        self._leave(f"ret {self.result} {self._as_float(text, kind) if self.result == 'double' else text}")

    # -- expressions: text and type ---------------------------------------------------------------------------

    def _value(self, node: ast.expr) -> tuple[str, str]:
        return getattr(self, f"_of_{type(node).__name__}", self._unknown)(node)

    def _of_Constant(self, node: ast.Constant) -> tuple[str, str]:
        return self._number(node.value)

    def _of_Name(self, node: ast.Name) -> tuple[str, str]:
        if node.id in self.variables:
            kind = self.variables[node.id]
            return self._new(f"load {kind}, ptr %{node.id}"), kind
        value = self.known.get(node.id)
        if isinstance(value, tuple):
            numbers = ", ".join(f"double {literal(float(each))}" for each in value)
            self.constants[node.id] = f"@{node.id} = internal constant [{len(value)} x double] [{numbers}]"
            return f"@{node.id}", "ptr"
        return self._number(value) if isinstance(value, int | float) else self._unknown(node)

    def _of_Subscript(self, node: ast.Subscript) -> tuple[str, str]:
        return self._new(f"load double, ptr {self._entry(node)}"), "double"

    def _of_BinOp(self, node: ast.BinOp) -> tuple[str, str]:
        return self._binary(node.op, self._value(node.left), self._value(node.right))

    def _of_UnaryOp(self, node: ast.UnaryOp) -> tuple[str, str]:
        text, kind = self._value(node.operand)
        if isinstance(node.op, ast.Not):
            return self._new(f"xor i1 {text}, true"), "i1"
        if not isinstance(node.op, ast.USub):
            self._unknown(node)
        return self._new(f"fneg double {text}" if kind == "double" else f"sub i64 0, {text}"), kind

    def _of_Compare(self, node: ast.Compare) -> tuple[str, str]:
        found, left = "true", self._value(node.left)
        for op, each in zip(node.ops, node.comparators, strict=True):
            right = self._value(each)
            if left[1] == right[1] == "i64":
                test = self._new(f"icmp {INTEGER_TESTS[type(op)]} i64 {left[0]}, {right[0]}")
            else:
                a, b = self._as_float(*left), self._as_float(*right)
                test = self._new(f"fcmp {FLOATING_TESTS[type(op)]} double {a}, {b}")
            found, left = test if found == "true" else self._new(f"and i1 {found}, {test}"), right
        return found, "i1"

    def _of_BoolOp(self, node: ast.BoolOp) -> tuple[str, str]:
        place = f"truth.{self.count}"
        self.count += 1
        self.stack.append(f"  %{place} = alloca i1")
        (end,) = self._labels("known")
        for each in node.values:
            found, _ = self._value(each)
            self.lines.append(f"  store i1 {found}, ptr %{place}")
            (more,) = self._labels("more")
            yes, no = (more, end) if isinstance(node.op, ast.And) else (end, more)
            self.lines.append(f"  br i1 {found}, label %{yes}, label %{no}")
            self._at(more)
        self._go(end)
        self._at(end)
        return self._new(f"load i1, ptr %{place}"), "i1"

    def _of_IfExp(self, node: ast.IfExp) -> tuple[str, str]:
        (yes, kind), (no, other) = self._value(node.body), self._value(node.orelse)
        if kind != other:
            kind, yes, no = "double", self._as_float(yes, kind), self._as_float(no, other)
        return self._new(f"select i1 {self._value(node.test)[0]}, {kind} {yes}, {kind} {no}"), kind

    def _of_Call(self, node: ast.Call) -> tuple[str, str]:
        assert isinstance(node.func, ast.Name)
        name, given = node.func.id, [self._value(each) for each in node.args]
        if name in self.procedures:
            kind = self.procedures[name]
            return self._new(f"call {kind} @{name}({', '.join(f'{k} {x}' for x, k in given)})"), kind
        if name == "part":
            return self._new(f"getelementptr double, ptr {given[0][0]}, i64 {given[1][0]}"), "ptr"
        x = [self._as_float(*each) for each in given]
        if name in ("sqrt", "abs"):
            return self._new(f"call double @llvm.{'fabs' if name == 'abs' else name}.f64(double {x[0]})"), "double"
        if name == "float":
            return x[0], "double"
        if name == "int":
            return self._new(f"fptosi double {x[0]} to i64"), "i64"
        if name == "isfinite":
            return self._new(f"fcmp oeq double {self._new(f'fsub double {x[0]}, {x[0]}')}, 0.0"), "i1"
        if name not in ("min", "max"):
            self._unknown(node)
        test = "olt" if name == "min" else "ogt"  # Python keeps the first unless the second is smaller, or larger
        if all(kind == "i64" for _, kind in given):
            second = self._new(f"icmp s{test[1:]} i64 {given[1][0]}, {given[0][0]}")
            return self._new(f"select i1 {second}, i64 {given[1][0]}, i64 {given[0][0]}"), "i64"
        second = self._new(f"fcmp {test} double {x[1]}, {x[0]}")
        return self._new(f"select i1 {second}, double {x[1]}, double {x[0]}"), "double"

    def _binary(self, op: ast.operator, left: tuple[str, str], right: tuple[str, str]) -> tuple[str, str]:
        if left[1] == right[1] == "i64" and type(op) in INTEGER:
            return self._new(f"{INTEGER[type(op)]} i64 {left[0]}, {right[0]}"), "i64"
        a, b = self._as_float(*left), self._as_float(*right)
        if isinstance(op, ast.Pow):
            return self._new(f"call double @pow(double {a}, double {b})"), "double"
        if type(op) not in FLOATING:
            self._unknown(op)
        return self._new(f"{FLOATING[type(op)]} double {a}, {b}"), "double"

    # -- parts ------------------------------------------------------------------------------------------------

    def _entry(self, node: ast.Subscript) -> str:
        vector, index = self._value(node.value)[0], self._value(node.slice)[0]
        return self._new(f"getelementptr double, ptr {vector}, i64 {index}")

    def _number(self, value: object) -> tuple[str, str]:
        if isinstance(value, bool):
            return str(value).lower(), "i1"
        return (str(value), "i64") if isinstance(value, int) else (literal(float(str(value))), "double")

    def _as_float(self, text: str, kind: str) -> str:
        return text if kind == "double" else self._new(f"sitofp {kind} {text} to double")

    def _variable(self, name: str, kind: str) -> None:
        self.variables[name] = kind
        self.stack.append(f"  %{name} = alloca {kind}")

    def _new(self, instruction: str) -> str:
        self.count += 1
        self.lines.append(f"  %.{self.count} = {instruction}")
        return f"%.{self.count}"

    def _labels(self, *names: str) -> list[str]:
        self.count += 1
        return [f"{name}.{self.count}" for name in names]

    def _at(self, label: str) -> None:
        self.lines.append(f"{label}:")

    def _go(self, label: str) -> None:
        self.lines.append(f"  br label %{label}")

    def _leave(self, instruction: str) -> None:
        self.lines.append(f"  {instruction}")
        self._at(*self._labels("dead"))  # what follows is never reached, and LLVM drops it

    def _branch(self, test: ast.expr, yes: str, no: str) -> None:
        self.lines.append(f"  br i1 {self._value(test)[0]}, label %{yes}, label %{no}")

    def _unknown(self, node: ast.AST) -> NoReturn:
        raise SyntaxError(f"{self.tree.name}: {ast.dump(node)[:80]} is not understood")
