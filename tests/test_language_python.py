"""A model declared in Python is the model of the file, and is refused in the same words."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
import sympy as sp

import cadet_sym as cs
from cadet_sym.errors import ExportError, LinearisationError, ModelError, SolverError
from cadet_sym.language.element import Element
from cadet_sym.language.expression import TIME, ElementCall, der, parse, symbol
from cadet_sym.language.frozen import FrozenDict
from cadet_sym.language.ground import exponential, iso8608, shaping_filter
from cadet_sym.language.model import Initial, Model, Noise, Parameter, Run
from cadet_sym.language.modelfile import loads
from cadet_sym.language.travel import Travel
from cadet_sym.language.vehicle import Contact, Vehicle

x, v, h, t, z = sp.symbols("x v h t z")
w_n, zeta, gamma, r, a = sp.symbols("omega_n zeta gamma r a")
oleo = Element("oleo", [z], sp.Piecewise((z**2, z > 0), (-r * z**2, True)))


def undercarriage(**changes) -> Model:
    vehicle = Vehicle(
        rates={x: v, v: -(w_n**2) * x - 2 * zeta * w_n * v - gamma * oleo(v) - der(h, 2)},
        contacts={h: Contact()},
        outputs={"closure": x},
    )
    ground = exponential(sigma=1, cutoff=0.2).rolling_contact(cutoff=2)
    parts = {
        "vehicle": vehicle,
        "ground": ground,
        "travel": Travel(speed=a * t),
        "parameters": {w_n: 10, zeta: 0.01, gamma: 0.1, r: 0.1, a: 8},
        "duration": 10,
    }
    return Model(**{**parts, **changes})


FILE = """
schema = 1
name = "any"
[parameters]
a = { value = 8.0, unit = "m/s^2" }
r = 0.1
gamma = 0.1
zeta = 0.01
omega_n = 10.0
[elements.oleo]
arguments = ["z"]
value = "z**2 if z > 0 else -r*z**2"
[rates]
x = "v"
v = "-omega_n**2*x - 2*zeta*omega_n*v - gamma*oleo(v) - der(h, 2)"
[contacts]
h = {}
[ground]
kind = "exponential"
sigma = 1.0
cutoff = 0.2
rolling_contact = 2.0
[travel]
speed = "a*t"
[outputs]
closure = "x"
[run]
duration = 10.0
"""


def test_python_and_file_give_one_model():
    built, read = undercarriage(), loads(FILE)
    assert built == read
    assert hash(built) == hash(read)
    assert built.hash == read.hash
    assert loads(built.to_toml()) == built


def test_what_differs_in_the_file_differs_in_the_model():
    assert undercarriage(duration=11) != loads(FILE)
    assert undercarriage(ground=exponential(1, 0.2).rolling_contact(3)) != loads(FILE)
    assert undercarriage(parameters={w_n: 10, zeta: 0.01, gamma: 0.1, r: 1, a: 8}) != loads(FILE)


def test_the_order_of_states_counts_and_that_of_parameters_does_not():
    vehicle = undercarriage().vehicle
    turned = dataclasses.replace(vehicle, rates={k: vehicle.rates[k] for k in reversed(vehicle.rates)})
    assert turned != vehicle
    backwards = {k: undercarriage().parameters[k] for k in reversed(list(undercarriage().parameters))}
    assert undercarriage(parameters=backwards) == undercarriage()


def test_elements_are_found_in_rates_outputs_and_other_elements():
    inner = Element("inner", z, z**3)
    outer = Element("outer", [z], inner(2 * z) + sp.Abs(z))
    vehicle = Vehicle(rates={x: -outer(x)}, outputs={"f": oleo(x)})
    assert set(vehicle.elements) == {"inner", "outer", "oleo"}
    assert vehicle.rates[symbol("x")] == parse("-outer(x)")
    assert vehicle.elements["outer"].value == parse("inner(2*z) + abs(z)")


def test_two_elements_of_one_name_are_refused():
    other = Element("oleo", [z], z)
    with pytest.raises(ModelError, match="two different elements are called `oleo`"):
        Vehicle(rates={x: -oleo(x) - other(x)})
    assert Vehicle(rates={x: -oleo(x), v: -Element("oleo", [z], oleo.value)(v)})


def test_an_element_takes_its_own_number_of_arguments():
    with pytest.raises(ModelError, match="`oleo` takes 1 argument, 2 given"):
        oleo(x, v)


def test_an_element_may_be_given_by_name_as_a_sympy_function():
    undefined = sp.Function("oleo")
    vehicle = Vehicle(rates={x: -undefined(x)}, elements={"oleo": oleo})
    assert vehicle.rates[symbol("x")].atoms(ElementCall)


def test_numbers_of_any_kind_are_exact():
    vehicle = Vehicle(rates={x: np.float64(-0.1) * x + np.int64(2), v: -0.5})
    assert list(vehicle.rates.values()) == [parse("2 - 0.1*x"), parse("-0.5")]


def test_names_may_be_texts_or_symbols():
    assert Vehicle(rates={"x": -x}) == Vehicle(rates={x: -x})
    assert Model(Vehicle({x: -a * x}), parameters={"a": 1}) == Model(Vehicle({x: -a * x}), parameters={a: 1})
    assert Model(Vehicle({x: sp.Symbol("w")}), noise={"w": 2}).noise == Noise(["w"], [[2]]) == Noise("w", 2)


GROUNDS = {
    'kind = "iso8608"\nclass = "C"\ncutoff = 0.05': lambda: cs.iso8608("C", cutoff=0.05),
    'kind = "second_order"\nsigma = 0.01\ncutoff = 0.1\nwavenumber = 0.5': lambda: cs.second_order(0.01, 0.1, 0.5),
    'kind = "spectrum"\nnumerator = [1e-6]\ndenominator = [0.04, 0, 1]': lambda: cs.spectrum([1e-6], [0.04, 0, 1]),
}


@pytest.mark.parametrize("text", GROUNDS)
def test_every_kind_of_ground_has_a_public_name(text):
    file = loads(f'schema = 1\n[rates]\nx = "h - x"\n[contacts]\nh = {{}}\n[ground]\n{text}\n[travel]\nspeed = "9"')
    vehicle = Vehicle({x: h - x}, contacts={h: Contact()})
    assert file.ground == GROUNDS[text]()
    assert file.hash == Model(vehicle, GROUNDS[text](), Travel(speed=9)).hash


@pytest.mark.parametrize("interpolation", ["linear", "monotone"])
@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
def test_a_measured_curve_of_arrays_is_that_of_the_file(outside, interpolation):
    rows = [[-1.0, -900.0], [0.0, 0.0], [0.3, 250.0]]
    file = loads(f"""
        schema = 1
        [elements.damper]
        arguments = ["z"]
        table = {rows}
        outside = "{outside}"
        interpolation = "{interpolation}"
        [rates]
        x = "-damper(x) + w"
        [noise]
        w = 1.0
        [run]
        duration = 1.0
    """)
    curve = cs.measured_curve(z, *np.transpose(rows), outside=outside, interpolation=interpolation)
    vehicle = Vehicle({x: -Element("damper", [z], curve)(x) + sp.Symbol("w")})
    assert file.hash == Model(vehicle, noise={"w": 1}, duration=1).hash


def test_the_initial_state_may_be_a_mapping():
    assert undercarriage(initial={x: -h}) == undercarriage(initial=Initial(values={x: -h}))


def test_run_is_given_whole_or_in_parts():
    assert undercarriage(duration=3, points=5, rtol=1e-6).run == Run(3, 5, 1e-6)
    assert undercarriage(duration=None, run=Run(duration=3)).run == Run(3)
    assert undercarriage(duration=None).run == Run()


def test_a_model_is_a_value():
    model = undercarriage()
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.name = "other"
    with pytest.raises(TypeError):
        model.parameters["r"] = Parameter(1)
    assert dataclasses.replace(model, name="other") == model
    assert dataclasses.replace(model, noise=None, duration=5).run.duration == 5


def test_a_model_survives_pickling():
    model = undercarriage()
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert again.hash == model.hash
    assert list(again.parameters) == list(model.parameters)


def test_the_hash_is_the_same_in_every_process():
    import subprocess
    import sys

    code = f"from cadet_sym.language.modelfile import loads; print(loads({FILE!r}).hash)"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": "7"}
    )
    assert found.stdout.strip() == undercarriage().hash


def test_a_frozen_dictionary_is_a_mapping():
    table = FrozenDict({"a": 1, "b": 2})
    assert table == {"b": 2, "a": 1}
    assert hash(table) == hash(FrozenDict([("b", 2), ("a", 1)]))
    assert repr(table) == "{'a': 1, 'b': 2}"
    assert pickle.loads(pickle.dumps(table)) == table
    assert (table == 3) is False


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Vehicle(rates={}), "at least one state"),
        (lambda: Vehicle(rates=[x]), "mapping of names"),
        (lambda: Vehicle(rates={"x": "v"}), "a SymPy expression is wanted, not str"),
        (lambda: Vehicle(rates={x: sp.I * x}), "not in the language"),
        (lambda: Vehicle(rates={x: sp.gamma(x)}), "not in the language"),
        (lambda: Vehicle(rates={sp.Symbol("t"): x}), "reserved for time"),
        (lambda: Vehicle(rates={x: v, sp.Symbol("x", positive=True): v}), "declared twice"),
        (lambda: Vehicle(rates={x: v}, contacts={h: 0.0}), "a Contact is wanted"),
        (lambda: Vehicle(rates={x: v}, elements={"a": oleo}), "an Element of that name"),
        (lambda: Contact(track=3), "track of a contact"),
        (lambda: Element("oleo", [], z), "no argument"),
        (lambda: Element("der", [z], z), "reserved"),
        (lambda: Element("f", [z], "z"), "a SymPy expression is wanted"),
        (lambda: Element("f", [z], z > 0), "not the condition `z > 0`"),
        (lambda: Element("f", [z, x], 3 * t), "not a function of the state: there is no `z` or `x` in it"),
        (lambda: cs.from_library("saturation", limit=-1), "not a function of the state"),
        (lambda: Travel(), "neither given"),
        (lambda: Travel(speed=1, distance=t), "both given"),
        (lambda: Run(points=1), "2 or more"),
        (lambda: Run(rtol=0), "between 0 and 1"),
        (lambda: Run(duration="ten"), "number or a SymPy expression"),
        (lambda: Initial(ground="rough"), "stationary"),
        (lambda: Initial(whole=True, ground="smooth"), "leave the other initial values out"),
        (lambda: Initial(covariance={(x, v): 1, (v, x): 1}), "given twice"),
        (lambda: Initial(covariance={x: 1}), "two states"),
        (lambda: Noise([], []), "no noise is named"),
        (lambda: Noise(["w"], [[1, 2], [3, 4]]), "1 x 1 matrix"),
        (lambda: exponential(1, -1), "positive"),
        (lambda: exponential(1, 1).rolling_contact(0), "positive"),
        (lambda: iso8608("Q"), "A to H"),
        (lambda: iso8608("A", gd=1), "both given"),
        (lambda: iso8608(), "neither given"),
        (lambda: shaping_filter({}), "at least one state"),
        (lambda: cs.measured_curve(z, [0, 1], [0, 1, 2]), "their shapes are (2,) and (3,)"),
        (lambda: cs.measured_curve(z, [0, 1, 1], [0, 1, 2]), "the same position 1 as the row before"),
        (lambda: cs.measured_curve(z, [0, np.nan], [0, 1]), "finite numbers"),
        (lambda: cs.measured_curve(z, [0], [0]), "a curve needs two or more"),
        (lambda: cs.measured_curve(z, ["low", "high"], [0, 1]), "real numbers"),
        (lambda: cs.measured_curve(z, [0, 1], [0, 1j]), "real numbers"),
        (lambda: cs.measured_curve(z, [0, 1], [0, 1], outside="stop"), "extrapolate, hold"),
        (lambda: shaping_filter({h: -h * sp.Symbol("w")}, {"w": 1}), "not linear in `h`"),
        (lambda: shaping_filter({h: -h}, {"w": 1}, h**2), "height is linear"),
        (lambda: undercarriage(ground=None), "touches no ground"),
        (lambda: undercarriage(travel=None), "needs a [travel]"),
        (lambda: undercarriage(parameters={}), "undeclared name `r`"),
        (lambda: undercarriage(duration=-1), "positive duration"),
        (lambda: undercarriage(initial=Initial(values={h: 1})), "is a contact, not a state"),
        (lambda: undercarriage(initial=Initial(values={x: x})), "is a state"),
        (lambda: undercarriage(initial=Initial(covariance={(x, v): 1})), "not positive semidefinite"),
        (lambda: undercarriage(noise={"x": 1}), "a state and a noise"),
        (lambda: undercarriage(travel=Travel(speed=a * (5 - t))), "speed is negative"),
        (lambda: undercarriage(vehicle=Vehicle({x: v})), "no contact touches this ground"),
    ],
)
def test_what_is_wrong_is_said(make, words):
    with pytest.raises(ModelError) as caught:
        make()
    assert words in str(caught.value)


# ------------------------------------------------------------------ errors


def test_each_error_has_the_exit_status_of_whose_fault_it_is():
    assert [e("x").exit_status for e in (ModelError, LinearisationError, SolverError, ExportError)] == [2, 2, 1, 1]
    assert issubclass(LinearisationError, ModelError)
    error = SolverError("no", time=1.0, state="x")
    assert (error.details, error.time) == ({"time": 1.0, "state": "x"}, 1.0)


def test_an_error_is_placed_once_and_points_at_its_name():
    error = ModelError("undeclared name `b`", token="b").placed(table="rates", key="x", text="abc + b")
    assert str(error.placed(file="m.toml", table="other")) == (
        "m.toml: [rates] x: undeclared name `b`\n    abc + b\n          ^"
    )


def test_long_texts_are_cut_around_the_caret():
    text = "x + " * 200 + "y"
    shown = str(ModelError("here", text=text, column=400)).splitlines()
    assert len(shown[1]) < 120
    assert shown[1][shown[2].index("^")] == "x"


def test_errors_survive_pickling():
    error = ModelError("undeclared", table="rates", key="x", text="abc", column=1)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    failed = SolverError("no", time=1.0)
    assert pickle.loads(pickle.dumps(failed)).args == failed.args


def test_time_is_the_users_own_t():
    assert Travel(speed=a * t).speed == symbol("a") * TIME
