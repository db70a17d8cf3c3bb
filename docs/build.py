"""Write the gallery of the models that ship, page and figures, and the page of the elements: ``make docs``."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path

import cadet_sym as cs
from cadet_sym.language.library import LIBRARY, Kind

DOCS = Path(__file__).resolve().parent
MODELS = sorted((DOCS.parent / "models").glob("*.toml"))
PATHS = 2000
UNSIMULATED = {"measured_road"}  # 2000 paths of it take minutes: its figure shows CADET alone

HEAD = """# The models that ship

One file each in `models/`, ready to run. The numbers are CADET's at the end of the run; in the figures lines
are CADET, points are {paths} simulated paths of the original nonlinear model with 99 % limits. This page is
written by `make docs`.
"""

ELEMENTS = """# The library of elements

Nonlinearities by the names of the field, to be used in a model file,

```toml
[elements.seal]
library = "coulomb"
force = "F_c"
```

or in Python, `cs.from_library("coulomb", "seal", force="F_c")`. Each is an expression in the language of the model
file, printed here, so that the next one can be written like it. Coefficients are numbers or expressions in parameters
and `t`. Displacements and speeds are positive in extension (rebound); values are forces that act against them, so that
they enter a rate with a minus sign. `cadet-sym show MODEL --check` holds the describing functions of a model against
adaptive integration. This page is written by `make docs`.
"""


def drawing(path: Path) -> str:
    """The comment that opens a model file: its drawing, source and units."""
    comment = takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    return "\n".join(line.removeprefix("#").removeprefix(" ").rstrip() for line in comment)


def section(path: Path) -> str:
    """One model: drawing, numbers, figure, and the command that draws it."""
    model = cs.load(path)
    history = cs.compile(model).propagate(points=11)
    rows = "\n".join(
        f"| {name} | {history.mean[name][-1]:.4g} | {history.variance[name][-1]:.4g} |"
        for name in history.outputs or history.states
    )
    return f"""
## {model.name}

    {"    ".join(drawing(path).splitlines(keepends=True))}

{model.text}

| at t = {history.time[-1]:g} | mean | variance |
|---|---:|---:|
{rows}

![{model.name}]({path.stem}.png)

`{command(path)}`
"""


def command(path: Path) -> str:
    """What draws a model's figure."""
    judged = f"validate models/{path.name} --paths {PATHS}"
    return f"cadet-sym {f'moments models/{path.name}' if path.stem in UNSIMULATED else judged} --plot {path.stem}.png"


def page() -> str:
    """The whole gallery as markdown."""
    return HEAD.format(paths=PATHS) + "".join(map(section, MODELS))


def elements_page() -> str:
    """The library of elements as markdown."""
    return ELEMENTS + "".join(map(element_section, LIBRARY.values()))


def element_section(kind: Kind) -> str:
    """One kind: what it is for, how it is declared, its expression."""
    keys = "\n".join(f"    {key} = {default or '...'}" for key, default in kind.coefficients.items())
    return f"""
## {kind.name}

{kind.text}

    library = "{kind.name}"
{keys}

    {kind.name}({", ".join(kind.arguments)}) = {kind.value}
"""


def draw(path: Path) -> None:
    """Simulate one model and draw it."""
    model = cs.load(path)
    if path.stem in UNSIMULATED:
        from cadet_sym.plotting import moments_figure, save_figure

        save_figure(moments_figure(cs.compile(model).propagate()), DOCS / f"{path.stem}.png")
        return
    comparison = cs.compare(cs.compile(model).propagate(), cs.simulate(model, paths=PATHS, seed=0))
    print(f"{path.stem}.png", comparison.verdict[comparison.names[0]].text, sep=": ")
    comparison.plot(DOCS / f"{path.stem}.png")


def draw_trade_off() -> None:
    """Comfort against working space: the linear quarter car and the one with a passenger car's damper."""
    from cadet_sym.plotting import save_figure, trade_off_figure

    curves = [
        cs.trade_off(
            DOCS.parent / "models" / f"{name}.toml",
            minimise="variance(body_acceleration)",
            against="std(stroke)",
            limits=[0.008 + 0.0005 * k for k in range(21)],
            over={"c_s": (100, 5000)},
        )
        for name in ("quarter_car_linear", "quarter_car_damper")
    ]
    figure = trade_off_figure(*curves, names=("linear damper", "asymmetric, digressive damper"))
    save_figure(figure, DOCS / "trade_off.png")


if __name__ == "__main__":
    draw_trade_off()
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
    (DOCS / "elements.md").write_text(elements_page(), encoding="utf-8")
    for each in MODELS:
        draw(each)
