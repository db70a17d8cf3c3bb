"""Exponential, logarithm and others of eight numbers at once, in LLVM's intermediate language.

The C library takes one number at a time, which is most of the time of a sum over nodes or over the rows of a measured curve.
Here each function is brought to a short interval and is a polynomial there, so that eight numbers take little longer than
one. Errors are below one unit in the last place of exp, log, sin and cos, and below two of erf, tanh, asinh and atan.
Numbers that some of them make something special of, infinite or far from all others, are left to the C library.

The polynomials are interpolations at 60 points of Chebyshev in 50 digits, cut where a tenth of a unit is reached, and written
in powers. tests/test_vectors.py makes them again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from cadet_sym.lowering.instructions import SEVERAL, Module

__all__ = ["VECTORS", "of_scalars", "vector"]

EXP = (  # (e^r - 1 - r)/r^2, |r| <= 0.3467
    *(0.5, 0.16666666666666671003, 0.041666666666666676802, 0.0083333333333261192989, 0.0013888888888879052595),
    *(0.00019841269874875661482, 0.000024801587336499026016, 2.7557255330683725562e-6, 2.7557263218491367933e-7),
    *(2.5105245845597673077e-8, 2.0918160101597146921e-9),
)
LOG = (  # 2 (artanh(s)/s - 1)/s^2 in s^2 <= 0.02945
    *(0.66666666666666697158, 0.3999999999989873966, 0.28571428626293988221, 0.22222211086412543403),
    *(0.18182892439841020302, 0.15331617152084196903, 0.14617681693024872892),
)
ERF = (  # erf(x)/x - 1 in x^2 <= 1
    *(0.12837916709551256666, -0.37612638903183543533, 0.11283791670945129749, -0.026866170643256994332),
    *(0.0052239776072699452863, -0.00085483259825432250569, 0.00012055295112667001076, -0.000014924740785377575036),
    *(1.6447471190594618058e-6, -1.6208829856810200783e-7, 1.3721520406351094437e-8, -7.7985438505499469037e-10),
)
ERFC = (  # e^(x^2) (1 - erf x)/t in t - 1/2, t = 3/(3 + x), 1 <= x <= 6
    *(0.35800230236277990568, 0.58892963544659249399, 0.78697114280545433234, 0.82791269839847436742),
    *(0.6374813935423318426, 0.28615717010265664897, -0.025864890861590144395, -0.12945339656476088659),
    *(-0.04678873170513540923, 0.047241149089454991014, 0.036691429638378681659, -0.02085284122738447638),
    *(-0.02315638106992362947, 0.013430381133899547306, 0.0066984694074647442597),
)
SIN = (  # (sin(r)/r - 1)/r^2 in r^2 <= 0.6169
    *(-0.16666666666666664624, 0.0083333333333309484647, -0.00019841269836758339843, 2.7557316102351842799e-6),
    *(-2.505113179039596868e-8, 1.5918124622918354832e-10),
)
COS = (  # (cos(r) - 1 + r^2/2)/r^4 in r^2 <= 0.6169
    *(0.041666666666666665389, -0.0013888888888887397158, 0.000024801587298765456442, -2.7557317271565814641e-7),
    *(2.0876146227111280134e-9, -1.1382629040483007732e-11),
)
ATAN = (  # (atan(t)/t - 1)/t^2 in t^2 <= 0.1716
    *(-0.33333333333333330267, 0.1999999999999564425, -0.14285714284690053064, 0.11111111016993041185),
    *(-0.090909046433188874542, 0.076921845973405890232, -0.066645299282672218727, 0.058582992548110678193),
    *(-0.050861890290968967914, 0.03925178980950335423, -0.019200190093082432632),
)

LOG2E = 1.4426950408889634
LN2 = (0.6931471803691238, 1.9082149292705877e-10)  # the first part has 32 bits: times a power's exponent it is exact
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)  # the first two have 32 bits each
ATAN_FROM = ((0.41421356237309503, 0.7853981633974483, 3.061616997868383e-17),)  # tan(pi/8); pi/4 in two parts
ATAN_FROM += ((2.414213562373095, 1.5707963267948966, 6.123233995736766e-17),)  # tan(3 pi/8); pi/2
MAGIC = 1.5 * 2.0**52  # added to a smaller number it leaves the nearest integer in the last bits
MAGIC_BITS = 0x4338000000000000
SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
SMALLEST = 2.0**-1022  # of the numbers that have all their digits

N, I, B = (SEVERAL.of(one) for one in ("double", "i64", "i1"))


class _Writer:
    """Instructions one after the other, in registers of a common name; a value is a register's name or a constant."""

    def __init__(self, name: str, module: Module) -> None:
        self.lines: list[str] = []
        self.count = 0
        self.name, self.module = name, module

    def _to(self, text: str) -> str:
        self.count += 1
        self.lines.append(f"  %r{self.name}.{self.count} = {text}")
        return f"%r{self.name}.{self.count}"

    def of(self, kind: str, *x: str | float) -> str:
        """An operation by CasADi's name, or `FMA`, a b + c with one rounding where the processor has it."""
        values = [each if isinstance(each, str) else SEVERAL.constant(each) for each in x]
        self.count += 1
        self.module.kinds.add(kind)
        self.lines += SEVERAL.instructions(f"{self.name}.{self.count}", kind, values)
        return f"%a{self.name}.{self.count}"

    def fma(self, a: str | float, b: str | float, c: str | float) -> str:
        return self.of("FMA", a, b, c)

    def polynomial(self, coefficients: Sequence[float], y: str) -> str:
        """Horner's rule in y^2 for even and odd powers, side by side."""
        square = self.of("SQ", y)
        chains = []
        for start in range(2):
            own = coefficients[start::2]
            total: str | float = own[-1]
            for coefficient in reversed(own[:-1]):
                total = self.fma(total, square, coefficient)
            chains.append(total)
        return self.fma(chains[1], y, chains[0])

    def where(self, comparison: str, x: str, bound: float, a: str | float, b: str | float) -> str:
        """A if x compares so, else b."""
        return self.either(self.truth(comparison, x, bound), a, b)

    def truth(self, comparison: str, x: str, bound: float) -> str:
        return self._to(f"fcmp {comparison} {N} {x}, {SEVERAL.constant(bound)}")

    def either(self, truth: str, a: str | float, b: str | float) -> str:
        a, b = (each if isinstance(each, str) else SEVERAL.constant(each) for each in (a, b))
        return self._to(f"select {B} {truth}, {N} {a}, {N} {b}")

    def integers(self, operation: str, x: str, y: str | int) -> str:
        return self._to(f"{operation} {I} {x}, {y if isinstance(y, str) else SEVERAL.same(f'i64 {y}')}")

    def bits(self, x: str) -> str:
        return self._to(f"bitcast {N} {x} to {I}")

    def number(self, bits: str) -> str:
        return self._to(f"bitcast {I} {bits} to {N}")

    def not_zero(self, x: str) -> str:
        return self._to(f"icmp ne {I} {x}, zeroinitializer")

    def power_of_two(self, n: str) -> str:
        """2^n of integers n from -1022 to 1023."""
        return self.number(self.integers("shl", self.integers("add", n, 1023), 52))

    # -- parts of several functions ---------------------------------------------------------------------------

    def to_nearest(self, x: str, unit: float) -> tuple[str, str]:
        """The integer nearest to x times a unit, as a number and as an integer."""
        shifted = self.fma(x, unit, MAGIC)
        return self.of("SUB", shifted, MAGIC), self.integers("sub", self.bits(shifted), MAGIC_BITS)

    def reduced(self, x: str) -> tuple[str, str]:
        """e^r - 1 and the integer n of e^x = 2^n e^r, |x| <= 800."""
        n, integer = self.to_nearest(x, LOG2E)
        r = self.fma(n, -LN2[1], self.fma(n, -LN2[0], x))
        return self.fma(self.of("SQ", r), self.polynomial(EXP, r), r), integer

    def logarithm(self, u: str, c: str | float) -> str:
        """log(u) + c for u > 0 with all digits, |c| no more than its rounding error."""
        bits = self.bits(u)
        k = self.integers("ashr", self.integers("sub", bits, SQRT_HALF_BITS), 52)
        n = self.of("SUB", self.number(self.integers("add", k, MAGIC_BITS)), MAGIC)
        f = self.of("SUB", self.number(self.integers("sub", bits, self.integers("shl", k, 52))), 1.0)
        s = self.of("DIV", f, self.of("ADD", f, 2.0))
        z = self.of("SQ", s)
        half = self.of("MUL", self.of("MUL", f, 0.5), f)
        rest = self.of("ADD", half, self.of("MUL", z, self.polynomial(LOG, z)))
        # log(1 + f) = f - (f^2/2 - s (f^2/2 + z p(z))), z = s^2
        small = self.fma(s, rest, self.fma(n, LN2[1], c))
        return self.fma(n, LN2[0], self.of("SUB", f, self.of("SUB", half, small)))

    def quarter(self, x: str) -> tuple[str, str, str]:
        """sin(r), cos(r) and the integer n of x = r + n pi/2, |r| <= pi/4; r is rounded, and what it lost is in `lost`."""
        n, integer = self.to_nearest(x, 1 / (HALF_PI[0] + HALF_PI[1]))
        first, second = self.fma(n, -HALF_PI[0], x), self.of("MUL", n, HALF_PI[1])
        r = self.of("SUB", first, second)
        lost = self.fma(n, -HALF_PI[2], self.of("SUB", self.of("SUB", first, r), second))
        z = self.of("SQ", r)
        sine = self.of("ADD", r, self.fma(self.of("MUL", r, z), self.polynomial(SIN, z), lost))
        half = self.of("MUL", z, 0.5)
        rest = self.fma(self.of("SQ", z), self.polynomial(COS, z), self.of("NEG", self.of("MUL", r, lost)))
        near = self.of("SUB", 1.0, half)
        cosine = self.of("ADD", near, self.of("ADD", self.of("SUB", self.of("SUB", 1.0, near), half), rest))
        return self.of("COPYSIGN", sine, r), cosine, integer

    def turned(self, x: str, quarters: int) -> str:
        """sin(x + quarters pi/2)."""
        sine, cosine, n = self.quarter(x)
        n = self.integers("add", n, quarters)
        value = self.either(self.not_zero(self.integers("and", n, 1)), cosine, sine)
        return self.number(self.integers("xor", self.bits(value), self.integers("shl", self.integers("and", n, 2), 62)))


def _exp(w: _Writer, x: str) -> str:
    x = w.where("ogt", x, 800.0, 800.0, x)
    p, n = w.reduced(w.where("olt", x, -800.0, -800.0, x))
    half = w.integers("ashr", n, 1)  # in two steps, for what is smaller than the smallest number with all digits
    first, second = w.power_of_two(half), w.power_of_two(w.integers("sub", n, half))
    return w.of("MUL", w.fma(first, p, first), second)


def _log(w: _Writer, x: str) -> str:
    return w.logarithm(x, 0.0)


def _tanh(w: _Writer, x: str) -> str:
    size = w.of("FABS", x)
    p, n = w.reduced(w.of("TWICE", w.where("ogt", size, 22.0, 22.0, size)))
    power = w.power_of_two(n)  # of e^2x = power (1 + p)
    less, more = (w.fma(power, p, w.of("ADD", power, one)) for one in (-1.0, 1.0))
    half = w.of("MUL", less, 0.5)
    # 1 - 2/(e^2x + 1) where that is large, else h - h (e^2x - 1)/(e^2x + 1), h = (e^2x - 1)/2
    large = w.truth("ogt", size, 0.55)
    quotient = w.of("DIV", w.either(large, 2.0, less), more)
    value = w.either(large, w.of("SUB", 1.0, quotient), w.fma(w.of("NEG", half), quotient, half))
    return w.of("COPYSIGN", value, x)


def _erf(w: _Writer, x: str) -> str:
    size = w.of("FABS", x)
    size = w.where("ogt", size, 6.0, 6.0, size)
    square = w.of("SQ", size)
    small = w.fma(size, w.polynomial(ERF, square), size)
    t = w.of("DIV", 3.0, w.of("ADD", size, 3.0))
    p, n = w.reduced(w.of("NEG", square))
    power = w.power_of_two(n)
    tail = w.of("MUL", w.of("MUL", t, w.polynomial(ERFC, w.of("SUB", t, 0.5))), w.fma(power, p, power))
    return w.of("COPYSIGN", w.where("ogt", size, 1.0, w.of("SUB", 1.0, tail), small), x)


def _asinh(w: _Writer, x: str) -> str:
    size = w.of("FABS", x)
    square = w.of("SQ", size)
    # log(1 + y), y = |x| + x^2/(1 + sqrt(1 + x^2))
    y = w.of("ADD", size, w.of("DIV", square, w.of("ADD", w.of("SQRT", w.of("ADD", square, 1.0)), 1.0)))
    u = w.of("ADD", y, 1.0)
    lost = w.of("SUB", y, w.of("SUB", u, 1.0))
    return w.of("COPYSIGN", w.logarithm(u, w.of("DIV", lost, u)), x)


def _sin(w: _Writer, x: str) -> str:
    return w.turned(x, 0)


def _cos(w: _Writer, x: str) -> str:
    return w.turned(x, 1)


def _atan(w: _Writer, x: str) -> str:
    size = w.of("FABS", x)
    above, below, first, second = size, SEVERAL.constant(1.0), SEVERAL.constant(0.0), SEVERAL.constant(0.0)
    # atan(x) = pi/4 + atan((x - 1)/(x + 1)) = pi/2 + atan(-1/x)
    turned = ((w.of("SUB", size, 1.0), w.of("ADD", size, 1.0)), (SEVERAL.constant(-1.0), size))
    for (bound, *angle), fraction in zip(ATAN_FROM, turned, strict=True):
        above, below = (w.where("ogt", size, bound, new, old) for new, old in zip(fraction, (above, below), strict=True))
        first, second = (w.where("ogt", size, bound, new, old) for new, old in zip(angle, (first, second), strict=True))
    t = w.of("DIV", above, below)
    z = w.of("SQ", t)
    small = w.fma(w.of("MUL", t, z), w.polynomial(ATAN, z), second)
    return w.of("COPYSIGN", w.of("ADD", first, w.of("ADD", t, small)), x)


VECTORS: Mapping[str, tuple[Callable[[_Writer, str], str], tuple[float, float] | None]] = {
    # and from which to which size of the argument, if it is not for all numbers
    "EXP": (_exp, None),
    "LOG": (_log, (SMALLEST, 1.7976931348623157e308)),
    "TANH": (_tanh, None),
    "ERF": (_erf, None),
    "ASINH": (_asinh, (0.0, 1e150)),
    "SIN": (_sin, (0.0, 1e5)),
    "COS": (_cos, (0.0, 1e5)),
    "ATAN": (_atan, None),
}
"""By CasADi's names of operations."""


def vector(k: int, kind: str, x: str, module: Module, *, in_place: bool) -> list[str]:
    """Register %a<k> from eight numbers: by a call, or in place, which is faster, where there is nothing special."""
    write, between = VECTORS[kind]
    if in_place and between is None:
        writer = _Writer(str(k), module)
        result = write(writer, x)
        return [*writer.lines, *SEVERAL.instructions(k, "ASSIGN", [result])]
    name = f"{kind.lower()}.eight"
    if name not in module.loops:
        module.loops[name] = _function(name, kind, module)
    return [f"  %a{k} = call {N} @{name}({N} {x})"]


def of_scalars(kind: str, module: Module) -> str:
    """The name of a function (pointer, eight numbers) that writes eight numbers there.

    So they are moved to and from the registers of single numbers in one place, and not wherever there are some.
    """
    name = f"{kind.lower()}.scalars"
    if name not in module.loops:
        lanes = range(SEVERAL.lanes or 1)
        lines = [f"  %v{i} = insertelement {N} {f'%v{i - 1}' if i else 'poison'}, double %x{i}, i64 {i}" for i in lanes]
        lines += vector(0, kind, f"%v{lanes[-1]}", module, in_place=True)
        head = f"define internal void @{name}(ptr %p, {', '.join(f'double %x{i}' for i in lanes)}) nounwind {{"
        module.loops[name] = "\n".join([head, *lines, f"  store {N} %a0, ptr %p", "  ret void", "}\n"])
    return name


def _function(name: str, kind: str, module: Module) -> str:
    """Its text, with calls of the C library for what is not between the sizes given."""
    write, between = VECTORS[kind]
    writer = _Writer("", module)
    result = write(writer, "%x")
    if between is None:
        ends = [f"  ret {N} {result}"]
    else:
        sized = "%x" if kind == "LOG" else writer.of("FABS", "%x")
        low, high = map(SEVERAL.constant, between)
        module.kinds.add(kind)
        ends = [
            f"  %low = fcmp oge {N} {sized}, {low}",
            f"  %high = fcmp ole {N} {sized}, {high}",
            f"  %fine = and {B} %low, %high",
            f"  %mask = bitcast {B} %fine to i{SEVERAL.lanes}",
            f"  %all = icmp eq i{SEVERAL.lanes} %mask, -1",
            "  br i1 %all, label %usual, label %special",
            "usual:",
            f"  ret {N} {result}",
            "special:",
            *SEVERAL.instructions(0, kind, ["%x"]),
            f"  %each = select {B} %fine, {N} {result}, {N} %a0",
            f"  ret {N} %each",
        ]
    return "\n".join([f"define internal {N} @{name}({N} %x) nounwind {{", *writer.lines, *ends, "}\n"])
