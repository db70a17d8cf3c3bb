"""Everything numeric that a run of paths needs, worked out once and shared by all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["GroundTables", "OutputTables", "StartTables", "StepTables"]


class GroundTables(NamedTuple):
    """The ground as a chain of exact steps for each track, and where each wheel stands in it at each node.

    Node j of a chain follows from node j - 1 and r normal deviates z by laws[law_of[...]] @ (node, z).
    """

    size: int  # filter states, r
    width: int  # rows of a time node: filter states of all copies, then noises in time
    laws: np.ndarray  # (laws, r, 2 r)
    law_of: np.ndarray  # (all steps of all chains,) int: which law
    law_start: np.ndarray  # (tracks,) int: where a track's steps begin in law_of
    root: np.ndarray  # (r, r): factor of the covariance at the first node
    pick: np.ndarray  # (copies, time nodes) int: chain node under the wheel
    track_of: np.ndarray  # (copies,) int
    leader: np.ndarray  # (tracks,) int: the copy furthest ahead
    ring_start: np.ndarray  # (tracks,) int: where a track's ring buffer begins, in nodes
    ring_room: np.ndarray  # (tracks,) int: nodes that it holds
    ring_total: int
    has_mean: bool
    mean: np.ndarray  # (copies, time nodes, r): what the ground's own forcing adds, or empty
    noises: int  # noises in time: the last rows of a time node
    root_step: np.ndarray  # (steps,): square root of each step's duration


class StartTables(NamedTuple):
    """Vehicle at the start: x = offset + map @ (filter states) + root @ z."""

    offset: np.ndarray  # (nv,)
    map: np.ndarray  # (nv, nf)
    root: np.ndarray  # (nv, nv)


class StepTables(NamedTuple):
    """Coefficients of the vehicle's rates, one row a step."""

    S: np.ndarray  # (steps, coefficients): just after the start of the step
    E: np.ndarray  # (steps, coefficients): just before its end
    K: np.ndarray  # (steps, kicks and noise entries): factors of increments, the mean of both ends
    H: np.ndarray  # (steps,): duration
    q: np.ndarray  # constants
    T: np.ndarray  # tables of measured curves


class OutputTables(NamedTuple):
    """When and how paths are recorded."""

    node: np.ndarray  # (times,) int: time node of each output
    rows: int  # vehicle states, filter states, outputs
    C: np.ndarray  # (times, coefficients)
    q: np.ndarray
    T: np.ndarray
