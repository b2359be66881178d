"""Beam properties tabulated from root to end: rigidities and mass per length, measured or computed."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import msgspec
import numpy as np

from flexlink.common.errors import DataFileError, SceneError, errors_at
from flexlink.common.types import Array
from flexlink.common.wording import both_given
from flexlink.data.csv_table import head_of, read_csv
from flexlink.describe.rest_shape import check_rows
from flexlink.describe.spec import NonNegative, Positive, Spec, build_unchecked, measured_in

COLUMNS = {
    "ei_y": "N m²", "ei_z": "N m²", "gj": "N m²", "k_xy": "N m²", "k_xz": "N m²", "k_yz": "N m²",
    "ea": "N", "kga_y": "N", "kga_z": "N", "rho_a": "kg/m", "rho_i_y": "kg m", "rho_i_z": "kg m",
}  # fmt: skip
"""Columns of a table other than x, with units."""
HELD = {"z": ("ei_z",), "yz": ("ei_y", "ei_z"), "xyz": ("ei_y", "ei_z", "gj")}
"""Rigidities that a link needs, by its flex."""
COUPLED = {"k_xy": ("gj", "ei_y"), "k_xz": ("gj", "ei_z"), "k_yz": ("ei_y", "ei_z")}
"""Couplings of two axes, and the rigidities about them."""
Matrices = tuple[tuple[float | tuple[float, ...], ...], ...]
"""A matrix for the complete beam, or one per row of x."""


class Rigidity(Spec, frozen=True):
    """Rigidities and mass of a beam as a table along it, instead of a material and a section.

    Columns are linear between rows and jump where two rows have the same x. Hinge springs have the exact compliance
    ∫ dx/EI of their part of the beam; segments have its exact mass, centre and inertia. By rules with cells, masses are
    lumped at the cell's points, which leaves a second-order error where ρA jumps.
    A link with flex = "z" needs `ei_z`; "yz" also needs `ei_y`; "xyz" also needs `gj` and inertia about its x. With
    `stretch` it needs `ea`, with `shear` `kga_y`, and if it bends about y also `kga_z`.
    Moments of a section with couplings, such as a composite blade, follow from its twist and curvature by

        (M_x, M_y, M_z) = K (twist, κ_y, κ_z)        K = [[GJ, K_xy, K_xz], [K_xy, EI_y, K_yz], [K_xz, K_yz, EI_z]]

    `stiffness` and `mass` are matrices 6 × 6 instead of columns, with stretch ε and shear γ, in axes of the section:

        (N, Q_y, Q_z, M_x, M_y, M_z) = K (ε, γ_y, γ_z, twist, κ_y, κ_z)                 momenta = M (v_x, …, ω_x, …)

    In a link without `shear` or `stretch` these strains follow from zero forces in their directions (K is condensed),
    and curvatures about axes about which it does not bend are zero.

    Examples
    --------
    >>> spar = fl.Rigidity(x=(0.0, 0.4, 0.4, 2.0), ei_z=(90.0, 90.0, 30.0, 10.0), rho_a=(0.5, 0.5, 0.2, 0.1))
    >>> wing = fl.Link(name="wing", length=2.0, flex="z", segments=9, rigidity="spar")
    >>> chain = fl.lump(fl.Scene(name="wing", arm=fl.Arm(links=(wing,), rigidities={"spar": spar})))
    >>> print(f"{chain.mass:.3f} kg, {chain.stiffness.max():.0f} … {chain.stiffness[-1]:.0f} N m/rad")
    0.440 kg, 429 … 45 N m/rad
    """

    x: Annotated[tuple[NonNegative, ...], measured_in("m")] = ()
    """Positions of the rows, from 0 at the beam's root to its length [m]."""
    rho_a: Annotated[tuple[Positive, ...], measured_in("kg/m")] = ()
    """Mass per length ρA [kg/m]."""
    ei_y: Annotated[tuple[Positive, ...] | None, measured_in("N m²")] = None
    """Bending rigidity EI about the section's y [N m²]."""
    ei_z: Annotated[tuple[Positive, ...] | None, measured_in("N m²")] = None
    """Bending rigidity EI about the section's z [N m²]."""
    gj: Annotated[tuple[Positive, ...] | None, measured_in("N m²")] = None
    """Torsional rigidity GJ [N m²]."""
    k_xy: Annotated[tuple[float, ...] | None, measured_in("N m²")] = None
    """Coupling of twist and bending about y [N m²]. Default: 0. A link that does not bend about an axis of a coupling
    ignores it."""
    k_xz: Annotated[tuple[float, ...] | None, measured_in("N m²")] = None
    """Coupling of twist and bending about z [N m²]. Default: 0."""
    k_yz: Annotated[tuple[float, ...] | None, measured_in("N m²")] = None
    """Coupling of bending about y and about z [N m²]. Default: 0, for principal axes."""
    ea: Annotated[tuple[Positive, ...] | None, measured_in("N")] = None
    """Axial rigidity EA [N], for links with `stretch`."""
    kga_y: Annotated[tuple[Positive, ...] | None, measured_in("N")] = None
    """Shear rigidity κGA along the section's y [N], for links with `shear`."""
    kga_z: Annotated[tuple[Positive, ...] | None, measured_in("N")] = None
    """Shear rigidity κGA along the section's z [N], for links with `shear`."""
    rho_i_y: Annotated[tuple[NonNegative, ...] | None, measured_in("kg m")] = None
    """Inertia per length about the section's y, ∫ ρ z² dA [kg m]. Default: 0, for a thin beam."""
    rho_i_z: Annotated[tuple[NonNegative, ...] | None, measured_in("kg m")] = None
    """Inertia per length about the section's z, ∫ ρ y² dA [kg m]. Default: 0, for a thin beam."""
    stiffness: Annotated[Matrices | None, measured_in("N", "N m", "N m²")] = None
    """K of the sections, 6 × 6, instead of other rigidities and couplings: one for the complete beam, or one per row of
    x; of forces by strains [N], by curvatures [N m], and of moments by curvatures [N m²]."""
    mass: Annotated[Matrices | None, measured_in("kg/m", "kg", "kg m")] = None
    """M of the sections about the beam's axis, 6 × 6, instead of ρA and ρI: mass per length [kg/m], its first moments
    m y and m z [kg], and inertia I_x, I_y, I_z, I_yz [kg m]."""
    relative: bool = False
    """Whether x is relative to the beam's length, from 0 to 1 [1]."""
    file: str | None = None
    """A CSV file instead of columns, with headers "x [m]", "EI_z [N m²]", "EI_y [N m²]", "GJ [N m²]", "K_xy [N m²]",
    "K_xz [N m²]", "K_yz [N m²]", "EA [N]", "kGA_y [N]", "kGA_z [N]", "rhoA [kg/m]", "rhoI_y [kg m]", "rhoI_z [kg m]";
    or a blade file of BeamDyn, or a primary file that names one. The path is relative to the scene's folder; the file
    is read once."""
    loss_time: Annotated[NonNegative, measured_in("s")] = 0.0
    """Kelvin-Voigt loss time η [s], as for a material."""
    stiffness_factor: Positive = 1.0
    """Factor by which stiffnesses of sections are multiplied along the complete beam, a number to vary or fit [1]."""
    mass_factor: Positive = 1.0
    """Factor by which ρA and ρI are multiplied along the complete beam [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.file is not None:
            self._read(self.file)
        check_rows(self, self.x)
        for name in COLUMNS:
            column = getattr(self, name)
            instead = name.startswith("rho") and self.mass is not None and not column
            if column is not None and len(column) != len(self.x) and not instead:
                raise self._refused(name, f"expected one number per row of x, {len(self.x)}", "one-per-row")
        if self.relative and abs(self.x[-1] - 1) > 1e-9:  # rounding of positions in a file
            raise self._refused("relative", f"x is {self.x[-1]:g} at the end; expected 1", "rigidity-table")
        for name in ("stiffness", "mass"):
            self._check_matrices(name)
        self._check_couplings()

    def _check_matrices(self, name: str) -> None:
        """Refuse matrices beside columns, of another shape or not symmetric, and masses that no section has."""
        if (value := getattr(self, name)) is None:
            return
        for column in COLUMNS:
            if column.startswith("rho") == (name == "mass") and getattr(self, column):
                raise both_given(name, value, column)
        try:
            given = np.array(value, dtype=np.float64)
        except ValueError:  # rows of different lengths
            given = np.empty(0)
        if given.shape not in {(6, 6), (len(self.x), 6, 6)}:
            raise self._refused(name, f"expected a 6 × 6 matrix, or one per row of x, {len(self.x)}", "one-per-row")
        for row, matrix in enumerate(self.matrices(name)):
            like = _section_mass(matrix) if name == "mass" else matrix.T
            rounding, sizes = 1e-6, np.sqrt(np.abs(np.diag(matrix)))  # relative, of numbers in files
            wrong = np.argwhere(np.abs(matrix - like) > rounding * np.outer(sizes, sizes))
            if len(wrong):
                i, j = wrong[0].tolist()
                text = f"{name}[{row}][{i}][{j}] = {matrix[i, j].item()!r}: expected {like[i, j].item()!r}"
                why = "M of a section with its centre of mass at (y, z)" if name == "mass" else "K is symmetric"
                raise SceneError(f"{text}: {why}", id="section-matrix")
            centred = matrix if name == "stiffness" else _section_inertia(matrix)
            most = 0.0 if name == "stiffness" else -rounding * max(np.trace(centred), np.finfo(float).tiny)
            if (least := np.linalg.eigvalsh(centred).min()) <= most:
                text = f"{name}[{row}]: " + ("K" if name == "stiffness" else "the inertia about the centre of mass")
                why = f"is not positive definite; its least eigenvalue is {least:.3g}"
                raise SceneError(f"{text} {why}", id="section-not-stiff")

    def matrices(self, name: str) -> Array:
        """`stiffness` or `mass` of every row, shape (rows, 6, 6)."""
        return np.broadcast_to(np.array(getattr(self, name)), (len(self.x), 6, 6))

    def _check_couplings(self) -> None:
        """Refuse couplings without the rigidities about both axes, and sections that would give way by themselves."""
        for name, own in COUPLED.items():
            if getattr(self, name) is not None and (absent := [one for one in own if getattr(self, one) is None]):
                raise self._refused(name, f"also needs {' and '.join(absent)}", "needs-another-key")
        if any(map(self._given, COUPLED)) and (least := np.linalg.eigvalsh(self.rows.stiffness).min(axis=1)).min() <= 0:
            row = int(np.argmin(least))
            name = max(filter(self._given, COUPLED), key=lambda name: abs(getattr(self, name)[row]))
            text = (
                f"{name}[{row}] = {getattr(self, name)[row]!r}: is too large: K of the section is not positive definite"
            )
            raise SceneError(f"{text}; for two axes, |K_xy| < √(GJ EI_y)", id="section-not-stiff")

    def _given(self, name: str) -> bool:
        return any(getattr(self, name) or ())

    @property
    def coupled(self) -> bool:
        """Whether the sections couple two axes, or are matrices because they are given so or have EA or κGA."""
        return self.stiffness is not None or any(map(self._given, (*COUPLED, *self.strained)))

    @property
    def strained(self) -> tuple[str, ...]:
        """Columns of EA and κGA that are given, in the order of strains ε, γ_y, γ_z."""
        return tuple(name for name, unit in COLUMNS.items() if unit == "N" and self._given(name))

    def of_flex(self, flex: str, strains: Collection[int] = (0, 1, 2)) -> Rigidity:
        """The table of a link with this flex: without couplings to axes about which it does not bend, or with strains.

        Without `strains` it has no EA and κGA.
        """
        held = HELD.get(flex, ())
        if self.stiffness is not None and len(held) < len(HELD["xyz"]):
            free = np.array([True, True, True, *(name in held for name in ("gj", "ei_y", "ei_z"))])
            K = self.matrices("stiffness") * (np.outer(free, free) | np.eye(6, dtype=bool))
            return self._replaced(stiffness=_tuples(K))
        ignored = [name for name, own in COUPLED.items() if self._given(name) and not {*own} <= {*held}]
        ignored += [] if strains else self.strained
        return self._replaced(**dict.fromkeys(ignored)) if ignored else self

    def _replaced(self, **fields: Matrices | None) -> Rigidity:
        return cast("Rigidity", build_unchecked(msgspec.structs.replace, self, **fields))

    def _read(self, file: str) -> None:
        """Fill the columns from a file, and clear `file`."""
        for name in ("x", *COLUMNS, "stiffness", "mass", "relative"):
            if getattr(self, name):
                raise both_given("file", file, name)
        with errors_at(f"file = {file!r}: ", file=file):
            for name, column in (_blade(Path(file), self.loss_time) or _columns(Path(file))).items():
                msgspec.structs.force_setattr(self, name, column)
        msgspec.structs.force_setattr(self, "file", None)

    def lacks(self, flex: str) -> Iterator[str]:
        """Missing columns that a link with this flex needs, including rotary inertia if it twists."""
        if self.stiffness is None:
            yield from (name for name in HELD.get(flex, ()) if getattr(self, name) is None)
        if flex == "xyz" and not self.rows.masses[3].any():
            yield "rho_i_y or rho_i_z" if self.mass is None else "inertia about x in mass"

    def jump_at(self, x: float, flex: str) -> float | None:
        """Position of a jump of a needed rigidity (see `lacks`) at x, up to rounding; None if there is none."""
        own = self.of_flex(flex)
        columns = [getattr(own, name) or () for name in (*HELD[flex], *COUPLED, *self.strained)]
        columns += [] if own.stiffness is None else [_tuples(own.matrices("stiffness"))]
        for k in range(1, len(self.x)):
            # relative distance below which two positions count as equal
            if self.x[k] == self.x[k - 1] and abs(x - self.x[k]) <= 1e-9 * self.x[-1]:
                return self.x[k] if any(column[k] != column[k - 1] for column in columns if column) else None
        return None

    @property
    def rows(self) -> Rows:
        """The table as arrays, multiplied by its scale factors."""
        return _rows(self)


def _columns(file: Path) -> dict[str, tuple[float, ...]]:
    """Columns of a file by key; an unknown header is an error, because ignoring it silently would hide a mistake."""
    tiny = float(np.finfo(np.float64).tiny)
    known = ["EI_y", "EI_z", "GJ", "K_xy", "K_xz", "K_yz", "EA", "kGA_y", "kGA_z", "rhoA", "rhoI_y", "rhoI_z"]
    heads = {head: head.replace("rho", "rho_").casefold() for head in known}
    table = read_csv(file)
    given = [head_of(head)[0] for head in table.heads]
    for head, quantity in zip(table.heads, given, strict=True):
        if quantity != "x" and quantity not in heads:
            known = [f"{known} [{COLUMNS[name]}]" for known, name in heads.items()]
            text = f"{file}: column {head!r}: not known; expected {', '.join(['x [m]', *known])}"
            raise DataFileError(text, id="unknown-column")
    found = {"x": table.column("x", "m"), "rho_a": table.column("rhoA", COLUMNS["rho_a"])}
    found |= {name: table.column(head, COLUMNS[name]) for head, name in heads.items() if head in given}
    for name, column in found.items():
        low = -np.inf if name in COUPLED else 0.0 if name in {"x", "rho_i_y", "rho_i_z"} else tiny
        if not (column >= low).all():
            text = f"{file}: line {table.lines[int(np.argmax(column < low))]}: {name} must be positive"
            raise DataFileError(text, id="out-of-range")
    return {name: tuple(column.tolist()) for name, column in found.items()}


def _blade(file: Path, loss_time: float) -> dict[str, Any]:
    """Values of a blade file of BeamDyn, in axes of the section; {} of another file."""
    from flexlink.data.blade_file import read_blade  # noqa: PLC0415  few scenes name one

    if (blade := read_blade(file)) is None:
        return {}
    x, stiffness, mass, loss_times = blade
    own = [2, 0, 1, 5, 3, 4]  # BeamDyn's z is along the blade: our x, y, z are its z, x, y
    turned = (_tuples(matrices[:, own][:, :, own]) for matrices in (stiffness, mass))
    found = {"x": tuple(x.tolist()), "relative": True} | dict(zip(("stiffness", "mass"), turned, strict=True))
    if loss_time == 0 and (len(set(loss_times)) > 1 or min(loss_times) < 0):
        text = f"{file}: mu = {loss_times}: must be equal, for the one loss_time of a link; give loss_time"
        raise DataFileError(text, id="unequal-loss-times")
    return found | {"loss_time": loss_time or loss_times[0]}


def _tuples(matrices: Array) -> Matrices:
    return tuple(tuple(map(tuple, matrix)) for matrix in matrices.tolist())


def _section_mass(matrix: Array) -> Array:
    """The mass matrix of a section that has the mass, centre and inertia of a matrix (6, 6)."""
    m, (mz, my) = matrix[0, 0], (matrix[0, 4], -matrix[0, 5])
    across = np.array([[0.0, mz, -my], [-mz, 0.0, 0.0], [my, 0.0, 0.0]])  # −m [c]×
    inertia = np.diag(np.diag(matrix)[3:])
    inertia[1, 2] = inertia[2, 1] = matrix[4, 5]
    return np.block([[m * np.eye(3), across], [across.T, inertia]])


def _section_inertia(matrix: Array) -> Array:
    """Inertia of a section about its centre of mass, (3, 3); of no mass, a negative one."""
    across = matrix[:3, 3:]
    return np.asarray(matrix[3:, 3:] - across.T @ across / matrix[0, 0]) if matrix[0, 0] > 0 else -np.eye(3)


class Rows(NamedTuple):
    """A rigidity table as arrays."""

    x: Array  # (rows,) [m], or relative to the length
    rigidities: Array  # (3, rows) GJ, EI_y, EI_z [N m²], 1 if missing
    stiffness: Array  # (rows, 3, 3) K of twist, κ_y, κ_z [N m²], or (rows, 6, 6) with ε, γ_y, γ_z after them
    masses: Array  # (7, rows) mass, first moments along y and z, I_x, I_y, I_z, I_yz about the axis, per length


@functools.lru_cache(maxsize=64)
def _rows(table: Rigidity) -> Rows:
    none, nothing = (1.0,) * len(table.x), (0.0,) * len(table.x)
    if table.stiffness is not None:
        turns_first = [3, 4, 5, 0, 1, 2]
        stiffness = table.matrices("stiffness")[:, turns_first][:, :, turns_first]
        rigidities = stiffness.diagonal(axis1=1, axis2=2).T[:3]
    else:
        rigidities = np.array([table.gj or none, table.ei_y or none, table.ei_z or none])
        K_xy, K_xz, K_yz = (getattr(table, name) or nothing for name in COUPLED)
        gj, ei_y, ei_z = rigidities
        stiffness = np.array([[gj, K_xy, K_xz], [K_xy, ei_y, K_yz], [K_xz, K_yz, ei_z]]).transpose(2, 0, 1)
        if table.strained:  # what is not given does no work in its links
            K = np.array([getattr(table, name) or none for name, unit in COLUMNS.items() if unit == "N"])
            stiffness = np.pad(stiffness, ((0, 0), (0, 3), (0, 3)))
            stiffness[:, range(3, 6), range(3, 6)] = K.T
    if table.mass is not None:
        M = table.matrices("mass").transpose(1, 2, 0)
        masses = np.array([M[0, 0], -M[0, 5], M[0, 4], M[3, 3], M[4, 4], M[5, 5], M[4, 5]])
    else:
        y, z = np.array(table.rho_i_y or nothing), np.array(table.rho_i_z or nothing)
        masses = np.array([table.rho_a, nothing, nothing, y + z, y, z, nothing])
    factor = table.stiffness_factor
    return Rows(np.array(table.x), factor * rigidities, factor * stiffness, table.mass_factor * masses)
