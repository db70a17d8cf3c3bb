"""The model file: what it says is what is built, what is wrong is named with table, key and column."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cadet_sym.errors import ModelError
from cadet_sym.language.expression import TIME, Lookup, evaluate, limits, parse, symbol
from cadet_sym.language.modelfile import load, loads

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = sorted((ROOT / "models").glob("*.toml"))

OLEO = """\
schema = 1
name = "Oleo"

[parameters]
omega_n = { value = 10.0, unit = "rad/s", text = "natural frequency" }
zeta = 0.01
gamma = 0.1
r = 0.1
a = 8.0

[elements.oleo]
arguments = ["z"]
value = "z**2 if z > 0 else -r*z**2"

[rates]
x = "v"
v = "-omega_n**2*x - 2*zeta*omega_n*v - gamma*oleo(v) - der(h, 2)"

[contacts]
h = { setback = 0.0, track = "main" }

[ground]
kind = "exponential"
sigma = 1.0
cutoff = 0.2
rolling_contact = 2.0

[travel]
speed = "a*t"

[outputs]
closure = "x"
damper_force = "gamma*oleo(v)"
velocity = "der(x)"
power = "damper_force*v"

[run]
duration = 10.0
points = 101
"""

DUFFING = """\
schema = 1
[parameters]
Q = 0.2
[rates]
x = "v"
v = "-0.1*v - x - x**3 + w"
[noise]
w = "Q"
"""


def edited(text: str, *changes: tuple[str, str]) -> str:
    """The text with each first string replaced by the second; the first must be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def refusal(text: str, folder: Path | None = None) -> ModelError:
    with pytest.raises(ModelError) as caught:
        loads(text, folder=folder, file="car.toml")
    error = caught.value
    assert error.exit_status == 2
    assert str(error).startswith("car.toml: ")
    assert len(str(error).splitlines()) in (1, 3)
    return error


def pointed(error: ModelError) -> str:
    """The text from the caret on."""
    line, mark = str(error).splitlines()[1:]
    return line[mark.index("^") :]


# ------------------------------------------------------------------ what is read


def test_the_example_of_the_contract_is_read():
    model = loads(OLEO)
    assert model.name == "Oleo"
    assert [s.name for s in model.vehicle.rates] == ["x", "v"]
    assert model.parameters["omega_n"].unit == "rad/s"
    assert model.parameter_values() == {"omega_n": 10, "zeta": 0.01, "gamma": 0.1, "r": 0.1, "a": 8}
    assert model.travel is not None
    assert model.travel.speed == symbol("a") * TIME
    assert model.run.points == 101
    assert model.vehicle.outputs["power"] == symbol("damper_force") * symbol("v")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_every_shipped_model_survives_the_round_trip(path):
    model = load(path)
    again = loads(model.to_toml(), folder=path.parent)
    assert again == model
    assert again.hash == model.hash
    assert hash(again) == hash(model)
    assert again.to_toml() == model.to_toml()
    assert (again.name, again.text) == (model.name, model.text)
    assert [(p.unit, p.text) for p in again.parameters.values()] == [
        (p.unit, p.text) for p in model.parameters.values()
    ]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_every_shipped_model_states_drawing_source_and_units(path):
    heading = path.read_text().split("schema = 1")[0]
    assert all(line.startswith("#") or not line for line in heading.splitlines())
    assert "Source:" in heading
    assert "SI units" in heading or "Dimensionless" in heading or "units" in heading
    assert max(map(len, path.read_text().splitlines())) <= 140


def test_a_change_changes_equality_and_hash_but_words_do_not():
    model = loads(OLEO)
    reworded = loads(edited(OLEO, ('"Oleo"', '"Another"'), ('unit = "rad/s", ', ""), ("10.0, ", "10, ")))
    assert reworded == model
    assert reworded.hash == model.hash
    for change in [
        ("zeta = 0.01", "zeta = 0.02"),
        ("z > 0", "z >= 0"),
        ("points = 101", "points = 11"),
        ("2.0", "2.1"),
    ]:
        other = loads(edited(OLEO, change))
        assert other != model
        assert other.hash != model.hash


def test_a_parameter_may_be_an_expression_in_others_in_any_order():
    text = edited(OLEO, ("zeta = 0.01", 'zeta = "r/10"'), ("gamma = 0.1", 'gamma = { value = "zeta*10" }'))
    assert loads(text).parameter_values()["gamma"] == pytest.approx(0.1)


def test_where_a_number_stands_an_expression_may_stand():
    text = edited(
        OLEO,
        ("setback = 0.0", 'setback = "zeta*100"'),
        ("sigma = 1.0", 'sigma = "gamma*10"'),
        ("duration = 10.0", 'duration = "10*r"'),
    )
    model = loads(text)
    assert model.vehicle.contacts[symbol("h")].setback == 100 * symbol("zeta")
    assert evaluate(model.run.duration, {symbol("r"): 0.1}) == 1


def test_white_noise_is_given_one_by_one_or_as_a_matrix():
    alone = loads(edited(DUFFING, ('w = "Q"', 'names = ["w"]\nintensity = [["Q"]]')))
    assert alone == loads(DUFFING)
    two = edited(
        DUFFING, ("+ w", "+ w1 + 2*w2"), ('w = "Q"', 'names = ["w1", "w2"]\nintensity = [["Q", 0.1], [0.1, 1.0]]')
    )
    noise = loads(two).noise
    assert noise.names == ("w1", "w2")
    assert noise.intensity == sp.Matrix([[symbol("Q"), sp.Rational(1, 10)], [sp.Rational(1, 10), 1]])


def test_a_system_may_have_noise_in_time_and_a_ground():
    text = edited(OLEO, ("- der(h, 2)", "- der(h, 2) + w")) + "\n[noise]\nw = 0.1\n"
    model = loads(text)
    assert model.noise is not None
    assert model.ground is not None


def test_names_are_of_any_script_and_may_be_words_of_python():
    text = edited(DUFFING, ("Q = 0.2", "Q = 0.2\nlambda = 1\n'ω' = 2\n'in' = 3"), ("- x -", "- x*lambda/ω*in -"))
    assert set(loads(text).parameters) == {"Q", "lambda", "ω", "in"}


def test_the_ground_has_a_scope_of_its_own():
    text = edited(
        OLEO,
        ('kind = "exponential"\nsigma = 1.0\ncutoff = 0.2', 'kind = "shaping_filter"\nheight = "h"'),
        ("[travel]", '[ground.rates]\nh = "p"\np = "-a*p - h + gamma*w"\n[ground.noise]\nw = 1.0\n[travel]'),
    )
    road = loads(text).ground.shaping_filter()
    assert road.states == ("height", "slope", "p")


def test_an_argument_may_shadow_a_parameter():
    model = loads(edited(OLEO, ('arguments = ["z"]', 'arguments = ["a"]'), ("z**2 if z > 0 else -r*z**2", "a**3")))
    assert model.vehicle.elements["oleo"].value == symbol("a") ** 3


def test_the_initial_state_may_be_linear_in_the_contacts():
    text = (
        OLEO
        + '\n[initial]\nx = "-h"\nv = "-der(h) + zeta"\n[initial.covariance]\n"v,x" = 0.1\n"x,x" = 1.0\n"v,v" = "r"\n'
    )
    initial = loads(text).initial
    assert initial.values[symbol("x")] == -symbol("h")
    assert initial.covariance[symbol("v"), symbol("x")] == sp.Rational(1, 10)


def test_the_whole_may_start_stationary():
    assert loads(OLEO + '\n[initial]\nwhole = "stationary"\n').initial.whole


# ------------------------------------------------------------------ measured curves


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "damper.csv").write_text("velocity,force\n-1,-200\n0,0\n0.5,300\n2,900\n")
    (tmp_path / "mm.csv").write_text("row,velocity [mm/s],force [kN]\n1,-1000,-0.2\n2,0,0\n3,500,0.3\n4,2000,0.9\n")
    (tmp_path / "run.csv").write_text("time,speed\n0,0\n2,36\n4,36\n6,0\n")
    (tmp_path / "bump.csv").write_text("s,height\n1,0\n1.5,0.05\n2,0\n")
    return tmp_path


MEASURED = edited(OLEO, ('value = "z**2 if z > 0 else -r*z**2"', 'table = "damper.csv"'))


def test_a_measured_element_is_a_curve(folder):
    curve = loads(MEASURED, folder=folder).vehicle.elements["oleo"].value
    assert isinstance(curve, Lookup)
    assert (curve.outside, curve.method) == ("extrapolate", "linear")
    assert evaluate(curve, {symbol("z"): 0.25}) == 150
    assert evaluate(curve, {symbol("z"): 3.0}) == 1300
    held = loads(edited(MEASURED, ('"damper.csv"', '"damper.csv"\noutside = "hold"')), folder=folder)
    assert evaluate(held.vehicle.elements["oleo"].value, {symbol("z"): 3.0}) == 900


def test_units_of_the_columns_are_declared_and_exact(folder):
    how = 'columns = ["velocity", "force"]\nunits = ["mm/s", "kN"]'
    text = edited(MEASURED, ('"damper.csv"', f'"mm.csv"\n{how}'))
    assert loads(text, folder=folder) == loads(MEASURED, folder=folder)


def test_a_header_that_is_not_si_must_be_declared(folder):
    text = edited(MEASURED, ('"damper.csv"', '"mm.csv"\ncolumns = ["velocity", "force"]'))
    assert "not SI" in refusal(text, folder).message
    text = edited(text, ("columns", 'units = ["m/s", "kN"]\ncolumns'))
    assert "correct one of them" in refusal(text, folder).message


def test_curves_are_written_row_by_row_and_read_back(folder):
    text = edited(
        MEASURED,
        ('[travel]\nspeed = "a*t"', '[travel]\nspeed = { table = "run.csv", units = ["s", "km/h"], outside = "hold" }'),
    )
    text = edited(text, ("rolling_contact = 2.0", 'rolling_contact = 2.0\nprofile = { table = "bump.csv" }'))
    model = loads(text, folder=folder)
    assert loads(model.to_toml()) == model
    assert model.travel is not None
    assert evaluate(model.travel.speed, {TIME: 3.0}) == 10
    assert set(model.travel.breakpoints) == {0, 2, 4, 6}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "empty"),
        ("velocity,force\n", "0 rows"),
        ("velocity,force\n1,2\n", "1 row,"),
        ("1,2\n2,3\n", "line 1: numbers where the header"),
        ("v;f\n1;2\n2;3\n", "separate them by commas"),
        ("v,f\n1,2\n1,3\n", "line 3: the same position 1"),
        ("v,f\n1,2\n\n3,3\n2,5\n", "line 5: 2 after 3"),
        ("v,f\n1,2\n2,nan\n", "line 3, column `f`: `nan`"),
        ("v,f\n1,2\n2,inf\n", "line 3, column `f`: `inf`"),
        ("v,f\n1,2\n2,1e999\n", "line 3, column `f`"),
        ("v,f\n1,2\n2,\n", "line 3, column `f`: a value is missing"),
        ("v,f\n1,2\n2\n", "line 3: 1 values, and the header has 2"),
        ("v,f\n1,2\n2,0x10\n", "line 3, column `f`: `0x10`"),
        ('v,f\n1,2\n2,"1,5"\n', "decimal point"),
        ('v,f\n1,2\n2,"3\n', "not a row of a CSV file"),
        ("v,f\n1,2\n2,1_0\n", "line 3"),
        (b"v,f\n1,2\n2,\xff\n", "line 3: this is not UTF-8"),
        ("v,f\n" + "".join(f"{k},{k}\n" for k in range(10_002)), "more than 10000 rows"),
    ],
)
def test_a_bad_table_is_refused_with_its_row(tmp_path, content, words):
    (tmp_path / "damper.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    error = refusal(MEASURED, tmp_path)
    assert words in error.message
    assert error.table == "elements.oleo"
    assert "damper.csv" in error.message


def test_the_limit_of_rows_can_be_raised(tmp_path):
    (tmp_path / "damper.csv").write_text("v,f\n" + "".join(f"{k},{k}\n" for k in range(10_002)))
    with limits(rows=20_000):
        assert len(loads(MEASURED, folder=tmp_path).vehicle.elements["oleo"].value.knots) == 10_002


@pytest.mark.parametrize("path", ["/etc/passwd", "../secret.csv", "sub/../../secret.csv", "link.csv", "", "a\\u0000b"])
def test_a_table_may_not_lie_outside_the_folder(tmp_path, path):
    inside = tmp_path / "model"
    inside.mkdir()
    (tmp_path / "secret.csv").write_text("v,f\n1,2\n2,3\n")
    os.symlink(tmp_path / "secret.csv", inside / "link.csv")
    error = refusal(edited(MEASURED, ('"damper.csv"', f'"{path}"')), inside)
    assert "outside" in error.message or "name of a file" in error.message


def test_a_table_that_is_not_there_is_pointed_at(tmp_path):
    assert pointed(refusal(MEASURED, tmp_path)) == "damper.csv"


def test_a_table_in_a_folder_below_is_read(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "d.csv").write_text("\ufeffv,f\r\n-1,-1\r\n1,1\r\n")
    assert loads(edited(MEASURED, ("damper.csv", "data/d.csv")), folder=tmp_path)


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("change", "place", "words", "at"),
    [
        (("zeta*omega_n", "zeta*omega"), ("rates", "v"), "did you mean `omega_n`", "omega*v"),
        (("gamma*oleo(v) - der", "gamma*oleo(v, x) - der"), ("rates", "v"), "takes 1 argument, 2 given", "oleo(v, x)"),
        (("oleo(v) - der", "olio(v) - der"), ("rates", "v"), "did you mean `oleo`", "olio(v)"),
        (("oleo(v) - der", "oleo*v - der"), ("rates", "v"), "with its arguments", "oleo*v"),
        (("-omega_n**2*x", "-omega_n(2)*x"), ("rates", "v"), "multiply with `*`", "omega_n(2)*x"),
        (("der(h, 2)", "der(x)"), ("rates", "v"), "may stand in an output", "x)"),
        (("der(h, 2)", "der(zeta)"), ("rates", "v"), "taken of a contact", "zeta)"),
        (("der(h, 2)", "closure"), ("rates", "v"), "is an output", "closure"),
        (('x = "v"', 'x = "v +"'), ("rates", "x"), "ends too early", ""),
        (('x = "v"', 'x = ["v"]'), ("rates", "x"), "not a list", None),
        (('x = "v"', "x = true"), ("rates", "x"), "not true or false", None),
        (('x = "v"', "x = nan"), ("rates", "x"), "not finite", None),
        (('x = "v"', "x = 1979-05-27"), ("rates", "x"), "not a date", None),
        (("z > 0", "z > x"), ("elements.oleo", "value"), "is a state", "x else"),
        (("z > 0", "z > h"), ("elements.oleo", "value"), "is a contact", "h else"),
        (("z > 0", "z > oleo(z)"), ("elements.oleo", "value"), "may not call themselves", "oleo(z)"),
        (("z > 0", "z > s"), ("elements.oleo", "value"), "distance, `s`, may not stand", "s else"),
        (('["z"]', '["z", "z"]'), ("elements.oleo", "arguments"), "argument twice", None),
        (('["z"]', "[]"), ("elements.oleo", "arguments"), "no argument", None),
        (('["z"]', '["pi"]'), ("elements.oleo", "arguments"), "reserved", None),
        (('["z"]', "[1]"), ("elements.oleo", "arguments"), "list of names", None),
        (('arguments = ["z"]\n', ""), ("elements.oleo", ""), "`arguments` is missing", None),
        (('value = "z', 'valeu = "z'), ("elements.oleo", "valeu"), "did you mean `value`", None),
        (("[run]", 'table = "x.csv"\n[run]'), ("outputs", "table"), "attribute", "x.csv"),
        (("zeta = 0.01", "zeta = '2*zeta'"), ("parameters", "zeta"), "in a circle", "zeta"),
        (("zeta = 0.01", "zeta = 'r'\nq='zeta*2'"), None, None, None),
        (("zeta = 0.01", "zeta = 'q'\nq='zeta*2'"), ("parameters", "zeta"), "`zeta` -> `q` -> `zeta`", None),
        (("zeta = 0.01", "zeta = '1/(r - r*1)'"), ("parameters", "zeta"), "division by zero", "r - r"),
        (("zeta = 0.01", "zeta = '1/(r - a/80)'"), ("parameters", "zeta"), "not a finite number", None),
        (("zeta = 0.01", "zeta = 'x'"), ("parameters", "zeta"), "is a state", "x"),
        (("zeta = 0.01", "zeta = 't'"), ("parameters", "zeta"), "time, `t`", "t"),
        (("zeta = 0.01", "zeta = { unit = '1' }"), ("parameters", "zeta"), "`value` is missing", None),
        (("zeta = 0.01", "zeta = { value = 1, units = '1' }"), ("parameters.zeta", "units"), "`unit`", None),
        (("zeta = 0.01", "zeta = 0.01\nx = 3"), ("rates", "x"), "is a parameter and a state", None),
        (("zeta = 0.01", "zeta = 0.01\nsin = 3"), ("parameters", "sin"), "function of the expressions", None),
        (("zeta = 0.01", "zeta = 0.01\n'2x' = 3"), ("parameters", "2x"), "letters, digits", None),
        (("zeta = 0.01", "zeta = 0.01\n'a.b' = 3"), ("parameters", "a.b"), "letters, digits", None),
        (("zeta = 0.01", "zeta = 0.01\n'ﬁ' = 3"), ("parameters", "ﬁ"), "normal form, `fi`", None),
        (("zeta = 0.01", "zeta = 0.01\n'if' = 3"), ("parameters", "if"), "keyword", None),
        (("zeta = 0.01", "zeta = 0.01\n's' = 3"), ("parameters", "s"), "reserved for distance", None),
        (('closure = "x"', 'h = "x"'), ("outputs", "h"), "is a contact and an output", None),
        (('closure = "x"', 'closure = "power"'), ("outputs", "closure"), "declared later", "power"),
        (('"der(x)"', '"der(x, 2)"'), ("outputs", "velocity"), "only the first derivative", "x, 2)"),
        (("setback = 0.0", "setback = -1.0"), ("contacts", "h.setback"), "-1 found", None),
        (("setback = 0.0", "setback = 't'"), ("contacts", "h.setback"), "time, `t`", "t"),
        (("setback = 0.0", "setbak = 0.0"), ("contacts.h", "setbak"), "did you mean `setback`", None),
        (('track = "main"', "track = 2"), ("contacts.h", "track"), "a text is wanted", None),
        (("h = { setback = 0.0, track = \"main\" }", "h = 0"), ("contacts", "h"), "a table is wanted", None),
        (('"der(x)"', '"der(v)"'), ("outputs", "velocity"), "rate of `v` contains white noise", "der(v)"),
        (('"der(x)"', '"der(h , 2)"'), ("outputs", "velocity"), "infinite variance", "der(h , 2)"),
        (("rolling_contact = 2.0", ""), ("rates", "v"), "too rough for `der(h, 2)`", "der(h, 2)"),
        (("der(h, 2)", "der(h,4)"), ("rates", "v"), "needs 2 more filter stages", "der(h,4)"),
        (("der(h, 2)", "x*der(h, 2)"), ("rates", "v"), "not by a state", "der(h, 2)"),
        (("der(h, 2)", "abs(der(h, 2))"), ("rates", "v"), "not by a state", "der(h, 2)"),
        (("der(h, 2)", "oleo(der(h, 2))"), ("rates", "v"), "enters an element", "der(h, 2)"),
        (('[contacts]\nh = { setback = 0.0, track = "main" }', ""), ("rates", "v"), "undeclared name `h`", "h, 2)"),
        (('kind = "exponential"', 'kind = "exponental"'), ("ground", "kind"), "mean `exponential`", "exponental"),
        (('kind = "exponential"\n', ""), ("ground", ""), "`kind` is missing", None),
        (("sigma = 1.0\n", ""), ("ground", ""), "`sigma` is missing", None),
        (("cutoff = 0.2", "cutoff = -0.2"), ("ground", "cutoff"), "positive", None),
        (("cutoff = 0.2", 'cutoff = "-zeta"'), ("ground", "cutoff"), "positive", None),
        (("cutoff = 0.2", 'cutoff = "t"'), ("ground", "cutoff"), "time, `t`", "t"),
        (("cutoff = 0.2", 'cutoff = "x"'), ("ground", "cutoff"), "belongs to the vehicle", "x"),
        (("cutoff = 0.2", "cutoff = 0.2\nwavines = 2"), ("ground", "wavines"), "unknown key", None),
        (("rolling_contact = 2.0", "rolling_contact = 0.0"), ("ground", "rolling_contact"), "positive", None),
        (('speed = "a*t"', 'speed = "a*s"'), ("travel", "speed"), "distance, `s`", "s"),
        (('speed = "a*t"', 'speed = "a*t"\ndistance = 1'), ("travel", ""), "both given", None),
        (('speed = "a*t"', ""), ("travel", ""), "neither given", None),
        (('speed = "a*t"', 'speed = "a*t - 1"'), ("travel", "speed"), "-1 at t = 0", None),
        (('speed = "a*t"', 'speed = "a*(1 - t)"'), ("travel", "speed"), "negative within the run: -72 at t = 10", None),
        (('speed = "a*t"', 'speed = "1/t"'), ("travel", "speed"), "not a finite number at t = 0", None),
        (('speed = "a*t"', 'speed = "5 if t < 2 else 6"'), ("travel", "speed"), "jumps at t = 2", None),
        (('speed = "a*t"', 'distance = "t"\nstart = 2'), ("travel", "start"), "leave `start` out", None),
        (('speed = "a*t"', 'sped = "a*t"'), ("travel", "sped"), "did you mean `speed`", None),
        (("[travel]\nspeed = \"a*t\"", ""), ("ground", ""), "needs a [travel]", None),
        (("duration = 10.0", "duration = 0"), ("run", "duration"), "positive duration", None),
        (("duration = 10.0", 'duration = "t"'), ("run", "duration"), "time, `t`", "t"),
        (("points = 101", "points = 1"), ("run", "points"), "2 or more", None),
        (("points = 101", "points = 10.5"), ("run", "points"), "a whole number", None),
        (("points = 101", "rtol = 0.0"), ("run", "rtol"), "between 0 and 1", None),
        (("points = 101", "rtol = true"), ("run", "rtol"), "not true or false", None),
        (("points = 101", "steps = 101"), ("run", "steps"), "unknown key", None),
        (("schema = 1\n", ""), ("", "schema"), "schema = 1", None),
        (("schema = 1\n", "schema = 2\n"), ("", "schema"), "reads schema = 1", None),
        (("schema = 1\n", "schema = true\n"), ("", "schema"), "reads schema = 1", None),
        (('name = "Oleo"', 'nam = "Oleo"'), ("", "nam"), "did you mean `name`", None),
        (('name = "Oleo"', "name = 3"), ("", "name"), "a text is wanted", None),
        (("[parameters]", "[parametres]"), ("", "parametres"), "did you mean `parameters`", None),
        (("[rates]", "[rate]"), ("", "rate"), "did you mean `rates`", None),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(change, place, words, at):
    text = edited(OLEO, change)
    if place is None:
        assert loads(text)
        return
    error = refusal(text)
    assert words in error.message
    assert (error.table, error.key) == place
    if at is not None:
        assert pointed(error).startswith(at)


@pytest.mark.parametrize(
    ("initial", "place", "words"),
    [
        ("y = 0.0", ("initial", "y"), "no state `y`"),
        ("closure = 0.0", ("initial", "closure"), "is an output, not a state"),
        ('x = "v"', ("initial", "x"), "is a state"),
        ('x = "h**2"', ("initial", "x"), "linear in the contacts"),
        ('x = "h*der(h)"', ("initial", "x"), "linear in the contacts"),
        ('x = "der(h, 2)"', ("initial", "x"), "infinite variance"),
        ('x = "abs(h)"', ("initial", "x"), "linear in the contacts"),
        ('x = "t"', ("initial", "x"), "time, `t`"),
        ('ground = "rough"', ("initial", "ground"), '"stationary" or "smooth"'),
        ('whole = "yes"', ("initial", "whole"), "or left out"),
        ('whole = "stationary"\nx = 0.0', ("initial", "whole"), "leave `x` out"),
        ('whole = "stationary"\nground = "smooth"', ("initial", "whole"), "leave `ground` out"),
        ('[initial.covariance]\n"x,v" = 0.1', ("initial.covariance", ""), "not positive semidefinite"),
        ('[initial.covariance]\n"x,x" = -0.1', ("initial.covariance", ""), "not positive semidefinite"),
        ('[initial.covariance]\n"x,x" = 1\n"v,v" = 1\n"x,v" = 1.01', ("initial.covariance", ""), "not positive"),
        ('[initial.covariance]\n"x,v" = 0\n"v,x" = 0', ("initial.covariance", "v,x"), "given twice"),
        ('[initial.covariance]\n"x" = 1', ("initial.covariance", "x"), "two states"),
        ('[initial.covariance]\n"x,h" = 1', ("initial.covariance", "h,x"), "is a contact, not a state"),
        ('[initial.covariance]\n"x,x" = "x"', ("initial.covariance", "x,x"), "is a state"),
    ],
)
def test_a_wrong_start_is_named(initial, place, words):
    error = refusal(f"{OLEO}\n[initial]\n{initial}\n")
    assert words in error.message
    assert (error.table, error.key) == place


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        (("+ w", "+ x*w"), ("rates", "v"), "not by a state"),
        (("+ w", "+ w**2"), ("rates", "v"), "not by a state"),
        (("+ w", "+ abs(w)"), ("rates", "v"), "not by a state"),
        (("+ w", "+ (w if x > 0 else 0)"), ("rates", "v"), "not by a state"),
        (("+ w", "+ der(w)"), ("rates", "v"), "taken of a contact"),
        (("+ w", "+ s*w"), ("rates", "v"), "distance, `s`"),
        (('w = "Q"', 'w = "x"'), ("noise", "w"), "is a state"),
        (('w = "Q"', 'w = "-Q"'), ("noise", ""), "not positive semidefinite"),
        (('w = "Q"', 'w = "Q*(5 - t)"'), ("noise", ""), "at t = 6"),
        (('w = "Q"', 'names = ["w"]'), ("noise", ""), "`intensity` is missing"),
        (('w = "Q"', 'names = ["w"]\nintensity = [[1, 2]]'), ("noise", "intensity"), "1 x 1 matrix"),
        (('w = "Q"', 'names = ["w", "u"]\nintensity = [[1, 2], [2, 1]]'), ("noise", ""), "not positive semidefinite"),
        (('w = "Q"', 'names = ["w", "u"]\nintensity = [[1, 0.1], [0.2, 1]]'), ("noise", "intensity"), "not symmetric"),
        (('w = "Q"', 'names = ["w", "w"]\nintensity = [[1, 0], [0, 1]]'), ("noise", "w"), "twice"),
        (('[noise]\nw = "Q"', '[noise]\nw = "Q"\n[outputs]\ny = "x + w"'), ("outputs", "y"), "white noise"),
        (('[noise]\nw = "Q"', '[noise]\nw = "Q"\n[travel]\nspeed = 3'), None, ""),
        (('[noise]\nw = "Q"', '[noise]\nw = "Q"\n[contacts]\nh = {}'), ("contacts", "h"), "declare [ground]"),
    ],
)
def test_wrong_noise_is_named(change, place, words):
    text = edited(DUFFING, change)
    if place is None:
        assert loads(text)
        return
    error = refusal(text)
    assert words in error.message
    assert (error.table, error.key) == place


def test_white_noise_may_be_multiplied_by_parameters_and_time():
    assert loads(edited(DUFFING, ("+ w", "+ sqrt(Q)*sin(t)*w")))


def test_a_frozen_state_and_a_constant_rate_are_legal():
    assert loads(edited(DUFFING, ('x = "v"', "x = 0\ny = 1.5")))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "schema = 1",
        "schema = 1\nrates = 3",
        "schema = 1\n[rates]\n[elements]\na = 1",
        "schema = 1\n[rates]\nx = ''",
        "[" * 5000,
        "a." * 100_000 + "a = 1",
        "[" + "a." * 100_000 + "a]",
        "a = " + "{a=" * 5000,
        "a = " + "[" * 5000,
        "schema = 1" + "0" * 5000,
        "schema = 1\n[rates]\nx = 1\nx = 2",
        "schema = 1\n[rates]\nx = 'unfinished",
        "schema = 1\n[rates]\nx = '''a\nb'''",
        'schema = 1\n"\\u0000" = 2',
    ],
)
def test_what_is_no_model_is_refused_in_one_message(text):
    refusal(text)


def test_a_line_that_is_not_toml_is_pointed_at():
    error = refusal("schema = 1\n[rates]\nx = v\n")
    assert "line 3" in error.message
    assert pointed(error) == "v"


def test_a_path_that_is_no_file_is_named(tmp_path):
    wrong = ((tmp_path, "is a folder"), (tmp_path / "none.toml", "does not exist"), (Path(os.devnull), "is not a file"))
    for path, words in wrong:
        with pytest.raises(ModelError, match=words) as caught:
            load(path)
        assert str(path) in str(caught.value)


def test_a_file_that_is_not_text_is_refused(tmp_path):
    (tmp_path / "m.toml").write_bytes(b"schema = 1\n\xff\xfe")
    with pytest.raises(ModelError, match="line 2: this is not UTF-8"):
        load(tmp_path / "m.toml")


def test_a_file_beyond_the_limit_is_not_read(tmp_path):
    (tmp_path / "m.toml").write_text(OLEO)
    with limits(bytes=100), pytest.raises(ModelError, match="larger than 100 bytes"):
        load(tmp_path / "m.toml")


# ------------------------------------------------------------------ other parameters


def test_parameters_are_changed_by_name_or_symbol_or_text():
    model = loads(OLEO)
    assert model.with_parameters({"r": 1}).parameter_values()["r"] == 1
    assert model.with_parameters({sp.Symbol("r"): 0.5}).parameter_values()["r"] == 0.5
    assert model.with_parameters({"r": "zeta*10"}).parameter_values()["r"] == pytest.approx(0.1)
    assert model.with_parameters({"r": 0.1}) == model
    assert model.with_parameters({"r": 1}) != model
    assert model.with_parameters({"omega_n": 1}).parameters["omega_n"].unit == "rad/s"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"omga_n": 1}, "did you mean `omega_n`"),
        ({"r": float("nan")}, "not finite"),
        ({"r": "x"}, "is a state"),
        ({"r": "2*r"}, "circle"),
        ({"r": "1 +"}, "too early"),
        ({"a": -1}, "speed is negative"),
        ({"r": [1]}, "a number or a SymPy expression"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(values, words):
    with pytest.raises(ModelError, match=words):
        loads(OLEO).with_parameters(values)


# ------------------------------------------------------------------ any content


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@settings(max_examples=100, deadline=None)
@given(name=texts, text=texts, unit=texts, value=st.floats(allow_nan=False, allow_infinity=False))
def test_any_words_and_any_number_survive_the_round_trip(name, text, unit, value):
    from dataclasses import replace

    from cadet_sym.language.model import Parameter

    model = replace(loads(DUFFING), name=name, text=text, parameters={"Q": 0.2, "p": Parameter(parse("1"), unit, text)})
    model = model.with_parameters({"p": value})
    again = loads(model.to_toml())
    assert again == model
    assert (again.name, again.text, again.parameters["p"].unit) == (name, text, unit)
    assert again.parameter_values()["p"] == value


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(data):
    """Cut, doubled or changed anywhere, a file is a model or one message."""
    start = data.draw(st.integers(0, len(OLEO) - 1))
    length = data.draw(st.integers(0, 20))
    inserted = data.draw(st.text(alphabet="xvh_t019.+-*/()[]{}=,<>\"'\n#", max_size=8))
    text = OLEO[:start] + inserted + OLEO[start + length :]
    try:
        model = loads(text)
    except ModelError:
        return
    assert loads(model.to_toml()) == model


# -- elements of the library ------------------------------------------------------------------------------------------

FRICTION = """
schema = 1
name = "rubbing"
[parameters]
F = 2
[elements.seal]
library = "coulomb"
force = "F/2"
[rates]
x = "v"
v = "w - x - seal(v)"
[noise]
w = 1
[run]
duration = 1
"""


def test_an_element_of_the_library_is_the_expression_it_stands_for():
    model = loads(FRICTION)
    written = FRICTION.replace('library = "coulomb"\nforce = "F/2"', 'arguments = ["v"]\nvalue = "F*sign(v)/2"')
    assert model == loads(written)
    assert loads(model.to_toml()) == model
    assert "friction" in model.vehicle.elements["seal"].text.lower()


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (('"coulomb"', '"colomb"'), ["elements.seal", "library", "did you mean `coulomb`"]),
        (('force = "F/2"', 'forze = "F/2"'), ["elements.seal", "forze", "did you mean `force`"]),
        (('force = "F/2"', ""), ["elements.seal", "needs its coefficient `force`"]),
        (('"F/2"', '"G/2"'), ["elements.seal", "force", "`G`"]),
        (('"coulomb"', "3"), ["elements.seal", "library", "a text is wanted"]),
        (("seal(v)", "seal(v, x)"), ["rates", "seal", "1 argument"]),
    ],
)
def test_a_wrong_use_of_the_library_is_refused(change, wanted):
    with pytest.raises(ModelError) as caught:
        loads(FRICTION.replace(*change))
    assert all(part in str(caught.value) for part in wanted), str(caught.value)
