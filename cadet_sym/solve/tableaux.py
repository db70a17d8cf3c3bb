"""Embedded explicit Runge-Kutta pairs, as the numbers that `runge_kutta.march` takes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import fsum

import numpy as np
import numpy.typing as npt

__all__ = ["BEGINS", "DORMAND_PRINCE", "GROUP", "LONG", "MOST_STAGES", "PLACES", "RANOCHA_3", "RANOCHA_5", "Pair"]

Row = tuple[float, ...]

MOST_STAGES = 12
"""Rates of a step at most."""

GROUP = 4
"""Slopes that are added in one pass."""

PLACES, BEGINS = 2, 2 + MOST_STAGES
"""Where the places of the stages stand in a packed pair, and where the groups of every row begin."""

HEAD = BEGINS + MOST_STAGES + 3

LONG = 256
"""Numbers of a packed pair."""


@dataclass(frozen=True)
class Pair:
    """An explicit pair whose last stage is the first of the next step; c_k is the sum of row k.

    y_k = y + h sum_j a_kj f(y_j),    y_new = y + h sum_j b_j f(y_j),    errors e_i = sum_j (b_j - b*_j) f(y_j)

    The error of a step is h |e_1|^2 / sqrt(|e_1|^2 + |e_2|^2 / 100), which is h |e_1| where there is no second.
    """

    name: str
    order: int  # of what the estimated error grows with
    stages: tuple[Row, ...]  # a_1, a_2, ...; the last is b
    errors: tuple[Row, Row]
    strictness: float = 1.0  # what the estimated error counts for: those of low order add up over many steps

    @cached_property
    def packed(self) -> npt.NDArray[np.float64]:
        """Stages, 1 over order, places, where the groups of every row begin, and those: columns, then weights."""
        errors = [tuple(self.strictness * weight for weight in row) for row in self.errors]
        groups = [_groups(row) for row in (*self.stages, *errors)]
        begins = list(accumulate((len(each) * 2 * GROUP for each in groups), initial=HEAD))
        table = np.zeros(LONG)
        table[:2] = len(self.stages), 1.0 / self.order
        table[PLACES : PLACES + len(self.stages) - 1] = [fsum(row) for row in self.stages[:-1]]
        table[BEGINS : BEGINS + len(begins)] = begins
        numbers = [number for each in groups for group in each for number in group]
        table[HEAD : HEAD + len(numbers)] = numbers
        return table


def _groups(row: Row) -> list[list[float]]:
    """The weights that are not zero, in groups; one that is short gets the first slope with no weight."""
    used = [(float(j), weight) for j, weight in enumerate(row) if weight]
    used += [(0.0, 0.0)] * (-len(used) % GROUP)
    parts = [used[k : k + GROUP] for k in range(0, len(used), GROUP)]
    return [[*(j for j, _ in part), *(weight for _, weight in part)] for part in parts]


# fmt: off
DORMAND_PRINCE = Pair(
    "8(5,3)",
    8,
    (
        (0.05260015195876773,),
        (0.0197250569845379, 0.0591751709536137),
        (0.02958758547680685, 0.0, 0.08876275643042054),
        (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
        (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
        (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
        (0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023),
        (0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894,
        -43.48988418106996),
        (0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423,
        -33.28821096898486, -0.020331201708508627),
        (-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696,
        22.739487099350505, 2.4936055526796523, -3.0467644718982196),
        (2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996,
        -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636),
        (0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259),
    ),
    (
        (0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
        -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294),
        (-0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082),
    ),
)
"""DOP853 of Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, section II.10 (the pair of
Prince & Dormand, J. Comput. Appl. Math. 7, 67, 1981)."""

RANOCHA_3 = Pair(
    "3(2)",
    3,
    (
        (0.23002986245180762,),
        (0.1028611905146702, 0.30214341669482886),
        (0.06278872625842052, 0.029432944569291734, 0.8025606185416311),
        (0.047715578851412185, 0.03637030463243372, 0.20321191503846886, 0.4362158943603441),
        (0.11479359710235412, 0.08933442853113313, 0.43558710250086163, 0.2473576188201451, 0.11292725304550591),
    ),
    (
        (0.019951930051997094, -0.08330270541190224, 0.03576278359242452, 0.07555593806212724, 0.05410810882394851,
         -0.10207605511859524),
        (),
    ),
    strictness=8.0,
)
"""RDPK3SpFSAL35 of Ranocha, Dalcin, Parsani & Ketcheson, Commun. Appl. Math. Comput. 4, 1191, 2022: made for the spectra
of discontinuous Galerkin formulas, whose steps stability limits."""
RANOCHA_5 = Pair(
    "5(4)",
    5,
    (
        (0.2597883554788674,),
        (0.08127564358153594, 0.017770088894388678),
        (-0.033546148656510795, 0.0009336747373664706, 0.24816366297155018),
        (0.17433473197129268, 0.04542300095891677, -0.5131364111484422, 0.7941736871152005),
        (-0.09494322884524575, -0.0030351504243927435, 0.614664045333071, -0.3459996034587701, 0.3885391285642019),
        (-0.4472686975456024, -0.060013910983893394, 2.1895148764495733, -1.8122031634114841, 0.5294644275851393,
         0.1455051657916305),
        (-0.029528514221994012, 0.010258916564622392, 0.36420467077637064, -0.06295325382012795, 0.4396356681018617,
         -0.11884675654394868, 0.15875173859647493),
        (-0.00912158985685294, 0.012362086790446295, 0.2544985536317036, 0.01719844338692365, 0.39740851999080073,
         -0.1197497821278874, 0.12504941472359687, 0.16506056178800535),
        (-0.0003761018081567414, 0.014343651580929298, 0.22416854783466078, 0.05585389892469156, 0.4100517686033263,
         -0.1298941791785867, 0.11953776143286902, 0.009726304622318119, 0.2118093284937154),
        (-0.002280100321836969, 0.014073931157901856, 0.2332691775508459, 0.04808266741353827, 0.41190032177069535,
         -0.12914610678077362, 0.12207460138487103, 0.04357858583174419, 0.10250768775680807, 0.15593923423620598),
    ),
    (
        (0.01791245407828369, -0.013305103651689989, -0.06961268606375068, 0.08465110621976049, 0.01363384430301856,
         -0.07198651256936678, 0.02357605034638545, -0.022967429692816663, 0.011772892329326948, 0.07161634098289794,
         -0.04529095628204897),
        (),
    ),
)
"""RDPK3SpFSAL510 of the same: for higher accuracy."""
# fmt: on
