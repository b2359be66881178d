"""Written files do not depend on the CPU, its BLAS kernels or fused multiply-adds."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import flexlink as fl
from flexlink.common.products import cross, dot, product
from flexlink.dynamics import rounding
from flexlink.formats.mjcf import principal_axes
from tests.conftest import MODELS, ROOT
from tests.machines.run import FILE, Machine, environment, missing

EPS = np.finfo(float).eps
OTHERS = [machine for machine in FILE.machine if machine.env and not machine.plugin and machine.name != "no_home"]
ROBOTS = sorted((ROOT / "models" / "robots").glob("*.toml"))[::6]

EXPORT = """
import sys
from pathlib import Path
import flexlink as fl
for path in map(Path, sys.argv[2:]):
    scene = fl.load_scene(path)
    chain = fl.lump(scene)
    texts = fl.to_urdf(chain), fl.to_sdf(chain), fl.to_mjcf(chain, initial=fl.initial_state(scene, chain))
    (Path(sys.argv[1]) / path.stem).write_text("".join(texts), encoding="utf-8")
"""


def exported_as(machine: Machine | None, folder: Path) -> dict[str, str]:
    """Files written on a machine; for another CPU, kernels run as Python, without fused multiply-adds."""
    folder.mkdir()
    command = [sys.executable, "-c", EXPORT, str(folder), *map(str, [*MODELS, *ROBOTS])]
    own = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}  # set by the tests
    if machine:
        own = environment(machine, own) | ({"NUMBA_DISABLE_JIT": "1"} if "NUMBA_CPU_NAME" in machine.env else {})
    subprocess.run(command, env=own, cwd=ROOT, check=True)
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return exported_as(None, tmp_path_factory.mktemp("exported") / "here")


@pytest.mark.slow
@pytest.mark.parametrize("machine", OTHERS, ids=lambda machine: machine.name)
def test_exported_files_are_the_same_to_the_byte(machine: Machine, here: dict[str, str], tmp_path: Path) -> None:
    if why := missing(machine):
        pytest.skip(why)
    other = exported_as(machine, tmp_path / machine.name)
    assert other.keys() == here.keys()
    assert [name for name, text in other.items() if text != here[name]] == []


def test_our_matrix_products_agree_with_numpy(rng: np.random.Generator) -> None:
    A, B, v = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    assert_allclose(product(A, B), A @ B, rtol=0, atol=20 * EPS)
    assert_allclose(product(A, B.T, v), A @ B.T @ v, rtol=0, atol=50 * EPS)
    assert dot(v, v) == pytest.approx(v @ v, rel=4 * EPS)


@pytest.mark.parametrize("shapes", [((3,), (3,)), ((5, 3), (3,)), ((4, 1, 3), (5, 3)), ((900, 3), (900, 3))])
def test_cross_products_are_bit_equal_to_numpy(shapes: tuple[tuple[int, ...], ...], rng: np.random.Generator) -> None:
    a, b = (rng.normal(size=shape) for shape in shapes)
    for factor in (a, a + 1j):
        found, wanted = cross(factor, b), np.cross(factor, b)
        assert_array_equal(found, wanted)
        assert (found.dtype, found.flags.c_contiguous) == (wanted.dtype, True)


@pytest.mark.parametrize("moments", [(1.0, 2.0, 2.5), (1.0, 1.0, 1.5), (0.0, 1.0, 1.0), (1e-12, 1.0, 1.0), (2, 2, 2)])
def test_principal_axes_diagonalize_the_inertia(moments: tuple[float, ...], rng: np.random.Generator) -> None:
    for _ in range(20):
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        I = R @ np.diag(moments) @ R.T
        I = (I + I.T) / 2
        found, axes = principal_axes(I)
        assert_allclose(axes @ np.diag(found) @ axes.T, I, rtol=0, atol=20 * EPS * max(moments))
        assert_allclose(axes.T @ axes, np.eye(3), rtol=0, atol=20 * EPS)
        assert np.linalg.det(axes) == pytest.approx(1.0, rel=20 * EPS)
        assert_allclose(found, np.linalg.eigvalsh(I), rtol=0, atol=10 * EPS * max(moments))
    assert_array_equal(principal_axes(np.diag([3.0, 1.0, 2.0]))[0], [1.0, 2.0, 3.0])


def test_only_significant_digits_of_an_equilibrium_are_reported() -> None:
    """Angles that vanish by symmetry are reported as 0, because spring torques are known only up to rounding."""
    chain = fl.lump(fl.load_scene(next(path for path in MODELS if path.stem == "three_links")))
    rest = fl.solve_static(chain, np.where(chain.stiffness > 0, 0.0, 0.5), locked=chain.active.tolist())
    sideways = [k for k in range(chain.n) if chain.joint_name(k).endswith(".y")]
    assert sideways
    assert_array_equal(rest.q[sideways], 0.0)
    known = rounding.of_loads(chain, np.zeros(chain.n), np.zeros(6))
    bent = (chain.stiffness > 0) & (rest.q != 0)
    assert (np.abs(chain.stiffness * rest.q)[bent] > known[bent] / 20).all()
    assert rest.residual <= 2 * known.max()
