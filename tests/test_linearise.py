"""The splitter: what was written comes back as a linear part and as few elements of as few arguments as possible."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_models import toml

import cadet_sym as cs
from cadet_sym.expectation import described

NAMES = ("x1", "x2", "v1", "v2")


def split(rate: str, elements: str = "", outputs: str = "") -> cs.QuasiLinearSystem:
    """Linearise a system whose first rate is the one given."""
    rest = "\n".join(f'{name} = "-{name} + w"' for name in NAMES[1:])
    return cs.linearise(
        cs.augment(
            toml(
                f"""
                name = "split"
                [parameters]
                k = 2.0
                m = 3.0
                g = 0.5
                {elements}
                [rates]
                x1 = "{rate}"
                {rest}
                [noise]
                w = 1.0
                {outputs}
                [run]
                duration = 1.0
                """
            )
        )
    )


@pytest.mark.parametrize(
    ("rate", "arguments"),
    [
        ("-k*x1 - v1 + 3", []),
        ("abs(v1 - v2)*(v1 - v2)", [1]),
        ("2*x1 + x1**3", [1]),
        ("x1*(1 + x1**2)", [1]),
        ("(x1 - x2)**3 - k*(x1 - x2)", [1]),
        ("-(k*(x1 - x2) + m*abs(v1 - v2)*(v1 - v2))/m", [1]),
        ("x1*v1", [2]),
        ("abs(v1 - v2)*(x1 - x2)", [2]),
        ("max(x1, x2)", [1]),
        ("1 if x1 > x2 else -1", [1]),
        ("sign(v1)*max(x1, 0)", [2]),
        ("abs(x1 + k*v1)*(2*x1 + 2*k*v1)", [1]),
        ("x1**2*x2 - x1**2*x2", []),
        ("(x1 + x2)*(x1 - x2)", [2]),
        ("x1*x2*v1", [3]),
    ],
)
def test_the_fewest_arguments_are_found(rate, arguments):
    quasi = split(rate)
    assert sorted(len(element.forms) for element in quasi.elements) == arguments


def test_linear_parts_are_kept_out_of_the_elements():
    quasi = split("2*x1 + x1**3 + x1*(k + x1**2)")
    assert sp.expand(quasi.A[0, 0] - 2 - sp.Symbol("k", real=True)) == 0
    assert len(quasi.elements) == 1
    assert quasi.b[0, 0] == 2


def test_equal_elements_are_shared_between_equations():
    system = cs.augment(
        toml(
            """
            name = "two masses"
            [parameters]
            m1 = 2.0
            m2 = 3.0
            [elements.damper]
            arguments = ["z"]
            value = "abs(z)*z"
            [rates]
            a = "-a - damper(a - b)/m1 + w"
            b = "-b + damper(a - b)/m2"
            [noise]
            w = 1.0
            [run]
            duration = 1.0
            """
        )
    )
    quasi = cs.linearise(system)
    assert [element.name for element in quasi.elements] == ["damper"]
    assert all(quasi.b[i, 0] != 0 for i in (0, 1))


def test_a_declared_element_of_what_is_not_linear_is_written_out():
    quasi = split("-f(x1**2)", elements='[elements.f]\narguments = ["z"]\nvalue = "max(z - 1, 0)"')
    assert [len(element.forms) for element in quasi.elements] == [1]


def test_too_many_arguments_name_the_term():
    with pytest.raises(cs.LinearisationError, match="argument") as error:
        split("abs(x1)*abs(x2)*abs(v1)*abs(v2)")
    assert any("x1" in note for note in error.value.__notes__)


@pytest.mark.parametrize(
    ("output", "said"),
    [
        ("log(v1 + 1)", "the output `o` has no Gaussian expectation: `log(v1 + 1)` is not a real number where (v1 + 1) < 0"),
        ("abs(v1)**-0.5", "the variance of the output `o` has no Gaussian expectation: `1/v1` is infinite at v1 = 0"),
        ("f(v1)**-1", "the output `o` has no Gaussian expectation"),
        ("f(v1)", "the element `f` has no Gaussian expectation: `log(v1)`"),
    ],
)
def test_what_has_no_expectation_is_said_of_the_output_in_the_words_of_the_states(output, said):
    elements = '[elements.f]\narguments = ["z"]\nvalue = "log(z)"'
    with pytest.raises(cs.LinearisationError) as error:
        split("-x1", elements=elements, outputs=f'[outputs]\no = "{output}"')
    assert str(error.value).startswith(said)


def test_a_doubtful_expectation_is_warned_of_in_the_words_of_the_states():
    with pytest.warns(cs.ExpectationWarning) as caught:
        split("-x1", outputs='[outputs]\no = "1/(1.01 + sin(40*(x1 - v1)))"')
    of = [str(each.message).partition(": quadrature of ") for each in caught]
    assert [where for where, _, _ in of] == ["the output `o`", "the variance of the output `o`"]
    assert all("sin(-40*x1 + 40*v1)" in what for _, _, what in of)


FACTORS = ["x1", "x2", "(x1 - x2)", "(v1 + 2*v2)", "abs(x1 - x2)", "max(v1, 0)", "k", "0.7", "sin(x1)", "(1 + x1**2)"]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.lists(st.sampled_from(FACTORS), min_size=1, max_size=2), min_size=1, max_size=3), st.integers(0, 99))
def test_the_parts_add_up_to_what_was_written(terms, seed):
    rate = " + ".join("*".join(term) for term in terms)
    quasi = split(rate)
    point = np.random.default_rng(seed).normal(size=4)
    values = dict(zip(quasi.states, map(sp.Float, point), strict=True))
    values |= {sp.Symbol(n, real=True): sp.Float(v) for n, v in quasi.system.model.parameter_values().items()}
    total = sum(quasi.A[0, j] * state for j, state in enumerate(quasi.states)) + quasi.c[0]
    for j, element in enumerate(quasi.elements):
        arguments = [form.of(quasi.states) for form in element.forms]
        body = element.describing.body.xreplace(dict(zip(element.describing.arguments, arguments, strict=True)))
        total += quasi.b[0, j] * body
    expected = float(quasi.system.drift[0].subs(values))
    assert float(sp.sympify(total).subs(values)) == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("output", ["x1**2 + v1", "abs(x1)*x1 - 3*x2 + 1", "max(x1, 0) + max(x2, 0)", "x1*v1"])
def test_the_variance_of_an_output_is_that_of_gaussian_samples(output):
    model = toml(
        f"""
        name = "output"
        [rates]
        x1 = 0
        x2 = 0
        v1 = 0
        [initial]
        x1 = 0.3
        x2 = -0.5
        v1 = 1.0
        [initial.covariance]
        "x1,x1" = 0.5
        "x2,x2" = 0.8
        "v1,v1" = 1.2
        "x1,x2" = 0.3
        "x1,v1" = -0.4
        [outputs]
        y = "{output}"
        [run]
        duration = 1.0
        """
    )
    history = cs.compile(model).propagate([0.0])
    rng = np.random.default_rng(1)
    x1, x2, v1 = rng.multivariate_normal(history.state_mean[0], history.state_covariance[0], 400_000).T
    samples = eval(output, {"abs": np.abs, "max": np.maximum, "x1": x1, "x2": x2, "v1": v1})
    spread = samples.std() / np.sqrt(len(samples))
    assert abs(history.mean["y"][0] - samples.mean()) < 4.5 * spread
    fourth = np.sqrt(((samples - samples.mean()) ** 2).var() / len(samples))
    assert abs(history.variance["y"][0] - samples.var()) < 4.5 * fourth


def test_equal_functions_at_several_wheels_and_in_outputs_are_made_once(monkeypatch):
    made = []

    def counted(arguments, body, *known):
        made.append(body)
        return described(arguments, body, *known)

    monkeypatch.setattr("cadet_sym.linearisation.described", counted)
    found = split("tanh(x1)*abs(v1) + k*tanh(x2)*abs(v2)", outputs='[outputs]\nforce = "m*tanh(x1)*abs(v1)"')
    assert len(made) == 2, "that of both rates and the output, and its square in the output's variance"
    assert [each.describing.name for each in found.elements] == ["f1", "f2"]
    assert found.elements[0].describing == found.elements[1].describing
