"""Everything numeric that a run of paths needs, worked out once and shared by all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["GroundTables", "OutputTables", "StartTables", "StepTables"]


class GroundTables(NamedTuple):
    """The ground as a chain of exact steps for each track, and where each wheel stands in it at each node.

    Node j of the chain of a track with r filter states follows from node j - 1 and r normal deviates z by a law, an
    r x 2 r matrix: node j = law @ (node j - 1, z). Laws lie one after the other in `laws`, row by row.
    """

    width: int  # rows of a time node: states and integrals of all copies of the filter, then noises in time
    size: np.ndarray  # (tracks,) int: states and integrals r of a filter
    laws: np.ndarray  # (numbers of all laws,)
    law_of: np.ndarray  # (all steps of all chains,) int: where in `laws` the step's law begins
    law_start: np.ndarray  # (tracks,) int: where a track's steps begin in law_of
    pick: np.ndarray  # (copies, time nodes) int: chain node under the wheel
    track_of: np.ndarray  # (copies,) int
    row_of: np.ndarray  # (copies,) int: first row of the copy in a time node
    leader: np.ndarray  # (tracks,) int: the copy furthest ahead
    ring_start: np.ndarray  # (tracks,) int: where a track's ring buffer begins, in rows
    ring_room: np.ndarray  # (tracks,) int: nodes that it holds
    ring_rows: int  # of all ring buffers
    has_mean: bool
    mean: np.ndarray  # (time nodes, rows of all copies): what the ground's own forcing adds, or empty
    noises: int  # noises in time: the last rows of a time node
    root_step: np.ndarray  # (steps,): square root of each step's duration, by which sums of unit noises grow
    mix: np.ndarray  # (laws, noises, noises): else the rows are those of a step alone, lower triangular times deviates
    mix_of: np.ndarray  # (steps,) int: the law of every step


class StartTables(NamedTuple):
    """Vehicle at the start, x = offset + map @ (ground rows) + root @ z, and the ground where the chains begin."""

    offset: np.ndarray  # (nv,)
    map: np.ndarray  # (rows, ground rows of a node)
    root: np.ndarray  # (nv, nv)
    rows: np.ndarray  # (rows,) int: for every row of a path the vehicle state that it starts from, or -1 for zero
    ground: tuple[np.ndarray, ...]  # a track each: factor (r, r) of the covariance


class StepTables(NamedTuple):
    """Coefficients of the vehicle's rates, one row a step."""

    S: np.ndarray  # (steps, coefficients): just after the start of the step
    E: np.ndarray  # (steps, coefficients): just before its end
    K: np.ndarray  # (steps, columns): those of the rule (see `rules`), then those of `within_tables`
    H: np.ndarray  # (steps,): duration
    q: np.ndarray  # constants
    T: np.ndarray  # tables of measured curves


class OutputTables(NamedTuple):
    """When and how paths are recorded."""

    node: np.ndarray  # (times,) int: time node of each output
    rows: int  # vehicle states, filter states, outputs, riders
    C: np.ndarray  # (times, coefficients)
    q: np.ndarray
    T: np.ndarray
