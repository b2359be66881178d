"""Claims about arms at rest, and small motion about it."""

import numpy as np
import scipy.linalg

import flexlink as fl
from flexlink.dynamics.forces import force_torque
from tests.matrix.case import Case, close, difference


def statics(case: Case) -> None:
    """At an equilibrium, springs, gravity and wrench balance; held joints need their holding torque."""
    wrench, (q, _) = 0.1 * case.state()[3], case.start()
    found = fl.solve_static(case.chain, q, tip_wrench=wrench, locked=case.held)
    J = fl.jacobian(case.chain, found.q, tip=case.tip)
    left = fl.gravity_torque(case.chain, found.q) + fl.elastic_torque(case.chain, found.q)
    left -= np.concatenate([J.linear, J.angular]).T @ wrench
    bent = case.motions(case.passive).T @ left
    close(bent, np.zeros(len(bent)), 0.0, 1e-8)
    close(found.tau[case.chain.active], left[case.chain.active], 1e-8, 1e-10)
    close(found.q[case.chain.active], q[case.chain.active], 0.0)


def slow_run(case: Case) -> None:
    """A run with locked joints and well damped springs ends at the equilibrium."""
    changes = {"drive": None, "motion": None, "sensor": None, "initial.q": None, "initial.qd": None}
    changes |= {"initial.rate_deg": None, "initial.rate_m": None}
    changes |= {f"link.{link.name}.joint.locked": True for link in case.scene.arm.links} | case.damped(0.1)
    settings = fl.RunSettings(duration=20.0, sample=0.5, tolerance=1e-7, method="Radau5")
    run = fl.simulate(case.scene.varied(changes | {"run": settings}))
    found = fl.solve_static(run.chain, run.q[0], tip_wrench=run.tip_wrench[-1])
    assert np.linalg.norm(fl.tip_position(run.chain, found.q) - run.tip[-1]) <= 1e-6


def modes(case: Case) -> None:
    """At rest and in motion, λ are eigenvalues of λ² M + λ (D + G) + K, with matrices from torque differences."""
    q, qd, _, _ = case.state()
    B = case.motions(case.free)
    n = B.shape[1]
    for rates in (0.0 * qd, 0.3 * qd):
        M, K, D = (B.T @ part @ B for part in _matrices(case.chain, q, rates))
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
        _paired(fl.modes(case.chain, q, rates).eigenvalues, np.linalg.eigvals(A))


def _matrices(chain: fl.Chain, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, and derivatives of torques with respect to angles and rates; the slope of friction is taken at rest."""

    def torques(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return fl.bias_torque(chain, q, qd) + fl.elastic_torque(chain, q) + force_torque(chain, q, qd)

    I = np.eye(chain.n)
    K = [difference(lambda h, e=e: torques(q + h * e, qd)) for e in I]
    G = [difference(lambda h, e=e: fl.bias_torque(chain, q, qd + h * e)) for e in I]
    joints = chain.without_forces()
    D = [
        difference(lambda h, e=e: fl.friction_torque(joints, h * e), 1e-5)
        + difference(lambda h, e=e: force_torque(chain, q, qd + h * e), 1e-5)
        for e in I
    ]
    return fl.mass_matrix(chain, q), np.array(K).T, np.array(G).T + np.array(D).T


def _paired(found: np.ndarray, dense: np.ndarray) -> None:
    """Check that each eigenvalue is close to one of the dense matrix; double ones may have its square root as error."""
    size = np.abs(dense).max()
    for value in found:
        assert np.abs(dense - value).min() <= 1e-6 * abs(value) + 1e-4 * size**0.5, (value, dense)


def frequencies(case: Case) -> None:
    """Modes solve K φ = ω² M φ about an equilibrium, for held joints and springs without dampers."""
    chain = fl.lump(case.scene.varied(case.damped(0.0)))
    q, _, _, _ = case.state()
    B = case.motions(case.passive)
    M, K, _ = (B.T @ part @ B for part in _matrices(chain, q, np.zeros(chain.n)))
    squares = scipy.linalg.eigh(K, M, eigvals_only=True)
    found = fl.natural_frequencies(chain, q, locked=case.held)
    close(np.sort(found[~np.isnan(found)]) ** 2, np.sort(squares[squares > 0]), 1e-7)
    assert np.isnan(found).sum() == (squares <= 0).sum(), "an unstable equilibrium"
