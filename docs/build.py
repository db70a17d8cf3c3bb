"""Write the gallery of the models that ship, page and figures, and the page of the elements: ``make docs``."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path

import cadet_sym as cs
from cadet_sym.language.library import LIBRARY, Kind

DOCS = Path(__file__).resolve().parent
MODELS = sorted((DOCS.parent / "models").glob("*.toml"))
PATHS = 2000
FIGURES = {2: "oleo_constant_speed", 3: "oleo_acceleration"}  # of the paper
CASES = {"symmetric damping, r = 1": 1.0, "asymmetric damping, r = 0.1": 0.1}

HEAD = """# The models that ship

One file each in `models/`, ready to run. The numbers are CADET's at the end of the run; in the figures lines
are CADET, points are {paths} simulated paths of the original nonlinear model with 99 % limits. This page is
written by `make docs`.
"""

PAPER = f"""# The figures of the paper

Figures 2 and 3 of Harrison and Hammond (1986), drawn again by `make docs`: mean and variance of the closure by CADET
(lines) and by {PATHS} simulated paths of the nonlinear model with 99 % limits (points). The damping ratio of Figure 2 is
not printed in the paper; 0.01, that of Figure 3, is assumed.
"""

ELEMENTS = """# The library of elements

Nonlinearities by the names of the field, to be used in a model file,

    [elements.seal]
    library = "coulomb"
    force = "F_c"

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
    return f"cadet-sym validate models/{path.name} --paths {PATHS} --plot {path.stem}.png"


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
    compiled = cs.compile(model)
    comparison = cs.compare(compiled.propagate(), cs.simulate(compiled, paths=PATHS, seed=0))
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


def draw_paper() -> str:
    """Draw Figures 2 and 3 of the paper, four panels each; returns the page that shows them."""
    from cadet_sym.plotting import cases_figure, save_figure

    page = PAPER
    for number, stem in FIGURES.items():
        model, drawn, said = cs.load(DOCS.parent / "models" / f"{stem}.toml"), {}, []
        for case, r in CASES.items():
            compiled = cs.compile(model.with_parameters({"r": r}))
            history, simulation = compiled.propagate(), cs.simulate(compiled, paths=PATHS, seed=0)
            drawn[case] = history, simulation
            said.append(f"- {case}: {cs.compare(history, simulation).verdict['closure'].text} {simulation.method}")
        title = f"Figure {number}: {model.name[0].lower()}{model.name[1:]}"
        save_figure(cases_figure(title, "closure", drawn), DOCS / f"figure_{number}.png")
        page += f"\n## {title}\n\n![{title}](figure_{number}.png)\n\n" + "\n".join(said) + "\n"
    return page


if __name__ == "__main__":
    (DOCS / "paper.md").write_text(draw_paper(), encoding="utf-8")
    draw_trade_off()
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
    (DOCS / "elements.md").write_text(elements_page(), encoding="utf-8")
    for each in MODELS:
        draw(each)
