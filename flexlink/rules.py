"""Lumping rules as data: a rule places N hinges on a link of length 1 and gives each its weight.

A chain of rigid segments and springs is a quadrature of the curvature integral θ = ∫ M/EI dx:
a hinge is a node, and its stiffness is k = EI / (weight · length).
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from flexlink import catalogue
from flexlink.errors import SceneError
from flexlink.spec import NonNegative, Positive, Spec, decode

Array = NDArray[np.float64]


class Grid(Spec, frozen=True):
    """Equally spaced nodes: x_j = (first + j − 1) h, j = 1 … N, with h = 1 / (first + N − 1 + last).

    All weights are h, except those listed, in units of h, from the base and from the tip inward.
    """

    first: NonNegative
    last: NonNegative
    first_weights: tuple[Positive, ...] = ()
    last_weights: tuple[Positive, ...] = ()


class Element(Spec, frozen=True):
    """Nodes and weights on [0, 1], repeated in equal elements along the link."""

    nodes: tuple[NonNegative, ...]
    weights: tuple[Positive, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.nodes or len(self.nodes) != len(self.weights):
            raise SceneError(f"weights = {self.weights}: must be as many as nodes = {self.nodes}, at least one")
        if self.nodes[-1] > 1 or np.any(np.diff(self.nodes) <= 0):
            raise SceneError(f"nodes = {self.nodes}: must increase within [0, 1]")


class LumpingRule(Spec, frozen=True):
    """Where the hinges of a flexible link sit and what stretch of the beam each stands for."""

    about: str
    source: str
    grid: Grid | None = None
    element: Element | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.grid is None) == (self.element is None):
            raise SceneError("grid, element: a rule has exactly one of the two")

    def hinges(self, count: int) -> tuple[Array, Array]:
        """Nodes and weights of `count` hinges on [0, 1].

        Raises
        ------
        SceneError
            The rule does not exist for that many hinges.
        """
        if self.grid is not None:
            return _grid_hinges(self.grid, count)
        assert self.element is not None
        size = len(self.element.nodes)
        if count % size:
            raise SceneError(f"segments = {count + 1}: this rule takes a multiple of {size} hinges, plus 1 segments")
        elements = count // size
        nodes = (np.arange(elements)[:, None] + np.array(self.element.nodes)) / elements
        return nodes.ravel(), np.tile(self.element.weights, elements) / elements


def _grid_hinges(grid: Grid, count: int) -> tuple[Array, Array]:
    corrected = len(grid.first_weights) + len(grid.last_weights)
    spaces = grid.first + count - 1 + grid.last
    if count < max(1, corrected) or spaces <= 0:
        raise SceneError(f"segments = {count + 1}: this rule needs at least {max(1, corrected) + 1}")
    weights = np.ones(count)
    weights[: len(grid.first_weights)] = grid.first_weights
    weights[count - len(grid.last_weights) :] = grid.last_weights[::-1]
    return (grid.first + np.arange(count)) / spaces, weights / spaces


@functools.cache
def lumping_rule(name: str) -> LumpingRule:
    """Load a rule that comes with flexlink, or the user's own TOML file.

    Raises
    ------
    SceneError
        Unknown name, or a file that is not a valid rule.
    """
    try:
        path = catalogue.find("lumping", name)
    except SceneError as error:
        raise SceneError(f"lumping = {error}") from None
    try:
        return decode(catalogue.read_toml(path), LumpingRule)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
