"""Turn the moment equations into CasADi functions: the rate of the packed moments, outputs, and their parts.

Functions of the moments take y in the order of `packing.Packing`; `p` holds the parameters that have a number of
their own, in declared order; `ctx` is [t, s, V, V']. Evaluation of SX graphs and their derivatives is
CasADi's; nothing here integrates or solves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import sympy as sp

from cadet_sym.language.expression import DISTANCE, SPEED, SPEED_RATE, TIME, symbol
from cadet_sym.linear_forms import LinearForm
from cadet_sym.linearisation import Nonlinearity, OutputForm
from cadet_sym.lowering.delay import ground_rates, transport, wheel_forcing
from cadet_sym.lowering.elements import element_function
from cadet_sym.lowering.expressions import to_casadi
from cadet_sym.lowering.unrolled import in_line, unrolled
from cadet_sym.moments import MomentEquations

__all__ = ["LoweredSystem", "lower"]

_Environment = Mapping[sp.Symbol, ca.SX]

_PARTS = ["dy", "N", "speed", "entering"]


@dataclass(frozen=True, eq=False)
class LoweredSystem:
    """The moment equations as CasADi functions; each is built when it is first asked for."""

    equations: MomentEquations
    parameters: tuple[str, ...]  # those with a number of their own: the entries of p

    def unrolled(self) -> LoweredSystem:
        """The same with nothing but scalar operations: expectations that find their order when called get a fixed one."""
        equations = unrolled(self.equations)
        return self if equations is self.equations else LoweredSystem(equations, self.parameters)

    @cached_property
    def rate(self) -> ca.Function:
        """(t, y, p) -> dy/dt of the packed moments."""
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", self.equations.packing.size), self._p()
        ctx = self._context(t, y, p)
        env = self.environment(ctx, p) | self._gates(ctx, p)
        return ca.Function("rate", [t, y, p], [self._rate(y, env)], ["t", "y", "p"], ["dy"])

    @cached_property
    def jacobian(self) -> ca.Function:
        """(t, y, p) -> d(dy/dt)/dy, sparse."""
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", self.equations.packing.size), self._p()
        return ca.Function(
            "jacobian", [t, y, p], [ca.jacobian(self.rate(t, y, p), y)], ["t", "y", "p"], ["J"]
        )

    @cached_property
    def parts(self) -> ca.Function:
        """(t, y, p) -> rate but for the ground between the wheels, N (sparse), V/h and b of every gap (see `transport`)."""
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", self.equations.packing.size), self._p()
        ctx = self._context(t, y, p)
        env = self.environment(ctx, p) | self._gates(ctx, p)
        return ca.Function("parts", [t, y, p], self._parts(y, env), ["t", "y", "p"], _PARTS)

    @cached_property
    def held_parts(self) -> ca.Function:
        """(t, s, V, y, p) -> the same at a constant speed, wheels all on the ground."""
        arguments, env = self._held()
        return ca.Function("held_parts", arguments, self._parts(arguments[3], env), ["t", "s", "V", "y", "p"], _PARTS)

    @cached_property
    def held_rate(self) -> ca.Function:
        """(t, s, V, y, p) -> dy/dt at a constant speed, wheels all on the ground."""
        arguments, env = self._held()
        return ca.Function("held_rate", arguments, [self._rate(arguments[3], env)], ["t", "s", "V", "y", "p"], ["dy"])

    def _held(self) -> tuple[list[ca.SX], dict[sp.Symbol, ca.SX]]:
        t, s, V = ca.SX.sym("t"), ca.SX.sym("s"), ca.SX.sym("V")
        y, p = ca.SX.sym("y", self.equations.packing.size), self._p()
        gates = {gate: ca.SX(1) for gate in self.equations.gates}
        return [t, s, V, y, p], self.environment(ca.vertcat(t, s, V, 0), p) | gates

    @cached_property
    def outputs(self) -> ca.Function:
        """(t, y, p) -> means and variances of the outputs."""
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", self.equations.packing.size), self._p()
        env = self.environment(self._context(t, y, p), p)
        mu, P = self._moments(y)
        pairs = [_output_moments(form, mu, P, env) for form in self.equations.quasi_linear.outputs.values()]
        mean = ca.vertcat(*(m for m, _ in pairs))
        variance = ca.vertcat(*(v for _, v in pairs))
        return ca.Function("outputs", [t, y, p], [mean, variance], ["t", "y", "p"], ["mean", "variance"])

    @cached_property
    def outputs_at(self) -> ca.Function:
        """(y, ctx, p) -> means and variances of the outputs, speed and time given."""
        ctx, y, p = ca.SX.sym("ctx", 4), ca.SX.sym("y", self.equations.packing.moments), self._p()
        env = self.environment(ctx, p)
        mu, P = self._moments(y)
        pairs = [_output_moments(form, mu, P, env) for form in self.equations.quasi_linear.outputs.values()]
        mean = ca.vertcat(*(m for m, _ in pairs))
        variance = ca.vertcat(*(v for _, v in pairs))
        return ca.Function(
            "outputs_at", [y, ctx, p], [mean, variance], ["y", "ctx", "p"], ["mean", "variance"]
        )

    @cached_property
    def motion(self) -> ca.Function:
        """(t, p) -> speed, its rate, and the distance where it is known in closed form (else 0)."""
        t, p = ca.SX.sym("t"), self._p()
        env = self._parameters(p) | {TIME: t}
        system = self.equations.quasi_linear.system
        distance = sp.S.Zero if system.distance is None else system.distance
        values = [to_casadi(e, env) for e in (system.speed, system.speed_rate, distance, system.start)]
        names = ["V", "dV", "s", "start"]
        return ca.Function("motion", [t, p], [ca.SX(v) for v in values], ["t", "p"], names)

    @cached_property
    def linear(self) -> ca.Function:
        """(ctx, p) -> A, c, b, C, d, D of mu' = A mu + c + b F, z = C mu + d, wheels all on the ground."""
        ctx, p = ca.SX.sym("ctx", 4), self._p()
        env = self.environment(ctx, p) | {gate: ca.SX(1) for gate in self.equations.gates}
        quasi = self.equations.quasi_linear
        n = len(quasi.states)
        forms = [form for element in quasi.elements for form in element.forms]
        C = _matrix({(i, j): v for i, f in enumerate(forms) for j, v in f.coefficients}, (len(forms), n), env)
        d = ca.vertcat(*(to_casadi(form.constant, env) for form in forms))
        parts = [
            _sparse(quasi.A, env),
            ca.vertcat(*(to_casadi(entry, env) for entry in quasi.c)),
            _sparse(quasi.b, env),
            C,
            ca.SX(d),
            _sparse(self.equations.diffusion, env),
        ]
        return ca.Function("linear", [ctx, p], parts, ["ctx", "p"], ["A", "c", "b", "C", "d", "D"])

    @cached_property
    def elements(self) -> ca.Function:
        """(theta, ctx, p) -> F, gain, dF/dtheta, dgain/dtheta; theta = [z means; covariances element by element]."""
        quasi = self.equations.quasi_linear
        counts = [len(element.forms) for element in quasi.elements]
        total = sum(counts)
        theta = ca.SX.sym("theta", total + sum(k * (k + 1) // 2 for k in counts))
        ctx, p = ca.SX.sym("ctx", 4), self._p()
        env = self.environment(ctx, p)
        F, gain, first, pair = [], [], 0, total
        for element, k in zip(quasi.elements, counts, strict=True):
            size = k * (k + 1) // 2
            alone = replace(element, describing=in_line(element.describing))
            f, g = _describe(alone, theta[first : first + k], theta[pair : pair + size], env)
            F.append(f)
            gain.append(g)
            first, pair = first + k, pair + size
        F, gain = ca.SX(ca.vertcat(*F)), ca.SX(ca.vertcat(*gain))
        parts = [F, gain, ca.jacobian(F, theta), ca.jacobian(gain, theta)]
        return ca.Function("elements", [theta, ctx, p], parts, ["theta", "ctx", "p"], ["F", "k", "dF", "dk"])

    @cached_property
    def gain_matrix(self) -> ca.Function:
        """(y, ctx, p) -> N = E[df/dx] at packed means and covariances, wheels all on the ground."""
        y, ctx, p = ca.SX.sym("y", self.equations.packing.moments), ca.SX.sym("ctx", 4), self._p()
        env = self.environment(ctx, p)
        self._add_elements(*self._moments(y), env)
        N = _sparse(self.equations.gain_matrix, env)
        return ca.Function("gain_matrix", [y, ctx, p], [N], ["y", "ctx", "p"], ["N"])

    @cached_property
    def output_rows(self) -> ca.Function:
        """(ctx, p) -> for every output, the linear forms of the state that it depends on, (rows, n) each."""
        ctx, p = ca.SX.sym("ctx", 4), self._p()
        env = self.environment(ctx, p)
        rows = [_rows_of(form, env) for form in self.equations.quasi_linear.outputs.values()]
        return ca.Function("output_rows", [ctx, p], rows)

    @cached_property
    def noise(self) -> ca.Function:
        """(ctx, p) -> noise input b (n, m), intensity Q (m, m) and the setback of each column (m)."""
        ctx, p = ca.SX.sym("ctx", 4), self._p()
        env = self.environment(ctx, p)
        system = self.equations.quasi_linear.system
        setbacks = ca.vertcat(*(to_casadi(source.setback, env) for source in system.sources))
        b, Q = (
            _sparse(sp.ImmutableSparseMatrix(matrix), env)
            for matrix in (system.noise_input, system.intensity)
        )
        return ca.Function("noise", [ctx, p], [b, Q, ca.SX(setbacks)], ["ctx", "p"], ["b", "Q", "setback"])

    # -- parts ------------------------------------------------------------------------------------------

    def _p(self) -> ca.SX:
        return ca.SX.sym("p", len(self.parameters))

    def _parameters(self, p: ca.SX) -> dict[sp.Symbol, ca.SX]:
        """Every parameter: those with a number are entries of p, the others follow from them."""
        env = {symbol(name): p[i] for i, name in enumerate(self.parameters)}
        declared = self.equations.quasi_linear.system.model.parameters
        waiting = {symbol(name): entry.value for name, entry in declared.items() if symbol(name) not in env}
        while waiting:
            ready = [name for name, value in waiting.items() if value.free_symbols <= env.keys()]
            assert ready, "parameters that need each other are refused by the model"
            for name in ready:
                env[name] = ca.SX(to_casadi(waiting.pop(name), env))
        return env

    def _context(self, t: ca.SX, y: ca.SX, p: ca.SX) -> ca.SX:
        """[t, s, V, V'] along the run."""
        V, dV, s, _ = self.motion(t, p)
        packing = self.equations.packing
        return ca.vertcat(t, y[packing.moments] if packing.distance else s, V, dV)

    def environment(self, ctx: ca.SX, p: ca.SX) -> dict[sp.Symbol, ca.SX]:
        """Values of all parameters, the time, the distance, the speed and its rate; ctx is [t, s, V, V']."""
        names = (TIME, DISTANCE, SPEED, SPEED_RATE)
        return self._parameters(p) | {name: ctx[i] for i, name in enumerate(names)}

    def _gates(self, ctx: ca.SX, p: ca.SX) -> dict[sp.Symbol, ca.SX]:
        start = self.motion(0, p)[3]
        env = self._parameters(p)
        return {
            gate: ca.if_else(ctx[1] - start >= to_casadi(setback, env), 1, 0)
            for gate, setback in self.equations.gates.items()
        }

    def _moments(self, y: ca.SX) -> tuple[ca.SX, ca.SX]:
        packing = self.equations.packing
        n = packing.n
        triangle = ca.SX(ca.Sparsity.lower(n), y[n : packing.moments])
        return y[:n], ca.tril2symm(triangle)

    def _add_elements(self, mu: ca.SX, P: ca.SX, env: dict[sp.Symbol, ca.SX]) -> None:
        """Give the expectation and gains of every element their values."""
        equations = self.equations
        for j, element in enumerate(equations.quasi_linear.elements):
            F, gain = _describe(element, *_input_moments(element, mu, P, env), env)
            env[equations.expectations[j]] = F
            env |= {k: gain[a] for a, k in enumerate(equations.gains[j])}

    def _rate(self, y: ca.SX, env: dict[sp.Symbol, ca.SX]) -> ca.SX:
        head, N = self._head(y, env)
        if self.equations.delay is None:
            return head
        return ca.densify(ca.vertcat(head, ground_rates(self.equations, N, self._ground(y), env)))

    def _ground(self, y: ca.SX) -> ca.SX:
        """The correlation with the ground between the wheels."""
        return y[y.numel() - self.equations.packing.ground :]

    def _ingredients(self, y: ca.SX, env: dict[sp.Symbol, ca.SX]) -> tuple[ca.SX, ca.SX, ca.SX]:
        """What the moments' rates are made of: mu', N and D."""
        equations = self.equations
        mu, P = self._moments(y)
        self._add_elements(mu, P, env)
        env |= {mean: mu[i] for i, mean in enumerate(equations.means)}
        mean_rate = ca.vertcat(*(to_casadi(rate, env) for rate in equations.mean_rate))
        D = _sparse(equations.diffusion, env)
        if equations.delay is not None:
            D += wheel_forcing(equations, self._ground(y), env)
        return mean_rate, _sparse(equations.gain_matrix, env), D

    def _head(self, y: ca.SX, env: dict[sp.Symbol, ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Rate of the moments, and of the distance if it is integrated; and N."""
        packing = self.equations.packing
        mean_rate, N, D = self._ingredients(y, env)
        half = ca.mtimes(N, self._moments(y)[1])
        covariance_rate = half + half.T + D  # P' = N P + P N' + D
        triangle = covariance_rate[ca.Sparsity.lower(packing.n)].nz[:]
        return ca.densify(ca.vertcat(mean_rate, triangle, *[env[SPEED]] * packing.distance)), N

    @cached_property
    def ingredients(self) -> ca.Function:
        """(t, y, p) -> mu' (with V, where the distance is integrated), N and D, sparse."""
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", self.equations.packing.size), self._p()
        ctx = self._context(t, y, p)
        env = self.environment(ctx, p) | self._gates(ctx, p)
        mean_rate, N, D = self._ingredients(y, env)
        mean_rate = ca.densify(ca.vertcat(mean_rate, *[env[SPEED]] * self.equations.packing.distance))
        return ca.Function("ingredients", [t, y, p], [mean_rate, N, D], ["t", "y", "p"], ["dmu", "N", "D"])

    def _parts(self, y: ca.SX, env: dict[sp.Symbol, ca.SX]) -> list[ca.SX]:
        """Rate of what goes before the ground between the wheels, and what moves that ground."""
        head, N = self._head(y, env)
        travel = transport(self.equations, env)
        entering = [ca.densify(ca.vec(columns)) for _, columns in travel]
        return [head, N, ca.vertcat(*(speed for speed, _ in travel)), ca.vertcat(*entering)]


def lower(equations: MomentEquations) -> LoweredSystem:
    """Make the moment equations ready for CasADi; parameters with a number of their own become its inputs."""
    declared = equations.quasi_linear.system.model.parameters
    own = tuple(name for name, parameter in declared.items() if not parameter.value.free_symbols)
    return LoweredSystem(equations, own)


def _matrix(entries: Mapping[tuple[int, int], sp.Expr], shape: tuple[int, int], env: _Environment) -> ca.SX:
    matrix = ca.SX(*shape)
    for (i, j), value in entries.items():
        matrix[i, j] = to_casadi(value, env)
    return matrix


def _sparse(matrix: sp.ImmutableSparseMatrix, env: _Environment) -> ca.SX:
    return _matrix(matrix.todok(), matrix.shape, env)


def _form(form: LinearForm, mu: ca.SX, env: _Environment) -> ca.SX:
    total = ca.SX(to_casadi(form.constant, env))
    for i, value in form.coefficients:
        total += to_casadi(value, env) * mu[i]
    return total


def _covariance(first: LinearForm, second: LinearForm, P: ca.SX, env: _Environment) -> ca.SX:
    """C_a P C_b^T; written symmetrically, so that equal forms give the same graph."""
    total = ca.SX(0)
    for i, u in first.coefficients:
        for j, v in second.coefficients:
            total += to_casadi(u * v, env) * P[i, j]
    return total


def _input_moments(element: Nonlinearity, mu: ca.SX, P: ca.SX, env: _Environment) -> tuple[ca.SX, ca.SX]:
    """Mean and covariance (lower triangle, row by row) of an element's arguments."""
    forms = element.forms
    mean = ca.vertcat(*(_form(form, mu, env) for form in forms))
    pairs = (_covariance(forms[a], forms[b], P, env) for a in range(len(forms)) for b in range(a + 1))
    return mean, ca.vertcat(*pairs)


def _describe(element: Nonlinearity, m: ca.SX, S: ca.SX, env: _Environment) -> tuple[ca.SX, ca.SX]:
    """E[f] and its equivalent gains."""
    free = _free_symbols(element)
    q = ca.vertcat(*(env[name] for name in free)) if free else ca.SX(0, 1)
    F, gain = element_function(element.describing, free)(m, S, q)
    return F, gain


def _free_symbols(element: Nonlinearity) -> tuple[sp.Symbol, ...]:
    describing = element.describing
    own = describing.body.free_symbols - set(describing.arguments)
    return tuple(sorted((s for s in own if isinstance(s, sp.Symbol)), key=lambda s: s.name))


def _rows_of(form: OutputForm, env: _Environment) -> ca.SX:
    rows = [{i: v for i, v in enumerate(form.linear) if v != 0}]
    rows += [dict(argument.coefficients) for element in form.elements for argument in element.forms]
    entries = {(r, i): v for r, row in enumerate(rows) for i, v in row.items()}
    return _matrix(entries, (len(rows), form.linear.cols), env)


def _expectation(form: OutputForm, mu: ca.SX, P: ca.SX, env: _Environment) -> ca.SX:
    """E[y] = linear mu + constant + sum_j coefficient_j F_j."""
    total = ca.SX(to_casadi(form.constant, env))
    for i, value in enumerate(form.linear):
        if value != 0:
            total += to_casadi(value, env) * mu[i]
    for coefficient, element in zip(form.coefficients, form.elements, strict=True):
        F, _ = _describe(element, *_input_moments(element, mu, P, env), env)
        total += to_casadi(coefficient, env) * F
    return total


def _output_moments(form: OutputForm, mu: ca.SX, P: ca.SX, env: _Environment) -> tuple[ca.SX, ca.SX]:
    """Mean and variance of an output; covariances with the linear part come from Stein's lemma.

    Var[y] = l P l^T + 2 sum_j a_j l P C_j^T k_j + sum_ij a_i a_j (E[f_i f_j] - F_i F_j)
    """
    row = ca.SX(1, mu.numel())
    for i, value in enumerate(form.linear):
        if value != 0:
            row[i] = to_casadi(value, env)
    variance = ca.mtimes([row, P, row.T])
    mean = ca.mtimes(row, mu) + to_casadi(form.constant, env)
    expectations, weights = [], [to_casadi(a, env) for a in form.coefficients]
    for weight, element in zip(weights, form.elements, strict=True):
        F, gain = _describe(element, *_input_moments(element, mu, P, env), env)
        expectations.append(F)
        mean += weight * F
        C = _matrix(
            {(a, i): v for a, f in enumerate(element.forms) for i, v in f.coefficients},
            (len(element.forms), mu.numel()),
            env,
        )
        variance += 2 * weight * ca.mtimes([row, P, C.T, gain])
    for (i, j), product in form.products.items():
        both = _expectation(product, mu, P, env) - expectations[i] * expectations[j]
        variance += (1 if i == j else 2) * weights[i] * weights[j] * both
    return ca.SX(mean), ca.SX(variance)
