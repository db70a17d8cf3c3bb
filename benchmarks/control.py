"""What the quasi-linear system saves: variance of plain estimates over that of estimates by control variates.

    python benchmarks/control.py [--paths 8000]

For mean and variance of one quantity of each case, at several times: how many times more paths plain simulation needs for
the same standard error. The last column is the time that simulation with the twin takes over that without it, same paths
and step.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cadet_sym as cs
from cadet_sym.language.modelfile import loads

MODELS = Path(__file__).resolve().parent.parent / "models"
START = "schema = 1\n"
COULOMB = '[rates]\nv = "-sign(v) + w"\n[noise]\nw = 1.0\n[run]\nduration = 10.0'
FRICTION = (
    '[rates]\nx = "v"\nv = "-x - 0.1*v - 0.3*sign(v) + w"\n[noise]\nw = 0.4\n[outputs]\nplace = "x"\n[run]\nduration = 10.0'
)
DUFFING = '[rates]\nx = "v"\nv = "-0.1*v - x - x**3 + w"\n[noise]\nw = 0.2\n[outputs]\nplace = "x"\n[run]\nduration = 20.0'
BOUC_WEN = """
[rates]
x = "v"
v = "-0.1*v - 0.1*x - 0.9*z + w"
z = "v - 0.5*abs(v)*z - 0.5*v*abs(z)"
[noise]
w = 0.2
[outputs]
place = "x"
[run]
duration = 20.0
"""


def cases() -> Iterator[tuple[str, cs.Model, str, list[float]]]:
    """Name, model, quantity, times."""
    names = ("oleo_constant_speed", "oleo_acceleration")
    slow, fast = (cs.load(MODELS / f"{name}.toml").with_parameters({"r": 0.1}) for name in names)
    yield "Figure 2, r = 0.1", slow, "closure", [3.0, 10.0, 20.0]
    yield "Figure 3, r = 0.1", fast, "closure", [4.0, 8.0, 10.0]
    yield "half car, accelerating", cs.load(MODELS / "half_car_acceleration.toml"), "stroke_1", [1.0, 3.0, 5.0]
    yield "Coulomb, scalar", loads(START + COULOMB), "v", [1.0, 3.0, 10.0]
    yield "Coulomb, oscillator", loads(START + FRICTION), "place", [1.0, 3.0, 10.0]
    yield "Duffing, eps = 1", loads(START + DUFFING), "place", [1.0, 5.0, 20.0]
    yield "Bouc-Wen", loads(START + BOUC_WEN), "place", [1.0, 5.0, 20.0]


def seconds(model: cs.Model, paths: int, times: list[float], step: float, control: bool) -> float:
    """Time of the paths alone; compiled before."""
    given = {"times": times, "seed": 1, "step": step, "check_step": False, "control": control}
    cs.simulate(model, 32, **given)
    return cs.simulate(model, paths, **given).seconds["paths"]


def main() -> None:
    """Print one line a case and time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=8000)
    paths = parser.parse_args().paths
    print(f"{paths} paths; times fewer than plain simulation needs")
    print(f"{'case':26}{'t':>6}{'variance':>10}{'mean':>10}{'time':>8}")
    for name, model, quantity, times in cases():
        run = cs.simulate(model, paths, times=times, seed=1, control=True)
        cost = seconds(model, paths, times, run.step, True) / seconds(model, paths, times, run.step, False)
        for k, t in enumerate(times):
            saved = [run.saved(moment)[quantity][k] for moment in ("variance", "mean")]
            first, last = (name, f"{cost:.2g}") if k == 0 else ("", "")
            print(f"{first:26}{t:6g}{saved[0]:10.3g}{saved[1]:10.3g}{last:>8}")


if __name__ == "__main__":
    main()
