"""Describing functions as CasADi functions of mean, covariance and parameters."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import sympy as sp

from cadet_sym.expectation.describing import DescribingFunction
from cadet_sym.lowering.joint import Joint


@lru_cache(maxsize=512)
def element_function(df: DescribingFunction, free: tuple[sp.Symbol, ...] | None = None) -> ca.Function:
    """Compile a describing function to (m: k, S: k(k+1)/2, q: parameters) -> (F: 1, gain: k).

    Parameters
    ----------
    df : the describing function.
    free : the symbols that q stands for, in that order; by default those in it that are no arguments, in order of name.

    Returns
    -------
    A function of SX graphs, so that calls are inlined: m the means, S the covariance's lower triangle row by row; F is E[f],
    gain its gradient in the mean.
    """
    m, S, q, env = _inputs(df, parameters_of(df) if free is None else free)
    F, gain = expectation_and_gain(df, m, S, env)
    return ca.Function("element", [m, S, q], [F, gain], ["m", "S", "q"], ["F", "gain"])


def parameters_of(df: DescribingFunction) -> tuple[sp.Symbol, ...]:
    """What else is in a function than its arguments, in the order in which it is handed over."""
    symbols = (s for s in df.body.free_symbols - set(df.arguments) if isinstance(s, sp.Symbol))
    return tuple(sorted(symbols, key=str))


def expectation_and_gain(df: DescribingFunction, m: ca.SX, S: ca.SX, env: dict[sp.Symbol, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """E[f] and its gradient in the mean as expressions."""
    return Joint(m, S, env).expectation_and_gain(df)


def _inputs(df: DescribingFunction, free: tuple[sp.Symbol, ...]) -> tuple[ca.SX, ca.SX, ca.SX, dict[sp.Symbol, ca.SX]]:
    m, S, q = ca.SX.sym("m", len(df.means)), ca.SX.sym("S", len(df.covariances)), ca.SX.sym("q", len(free))
    return m, S, q, {symbol: q[i] for i, symbol in enumerate(free)}
