"""Force laws of single joints, rows of dtypes in `layout.FORCES`.

Quadratic dampers, as in a hydraulic brake: T = c |q̇| q̇ resists motion; c |q̇|³ is dissipated.
Hardening springs: T = c q³, with the potential V = ¼ c q⁴.

Gyrators between two hinges: T_i = g q̇_j and T_j = −g q̇_i, which together dissipate no power.

A force law with an internal state is a gyrator between its joint and an internal coordinate, whose rate is the state.
The internal coordinate is a hinge with a rotor and no body. Example: viscous friction d that lags behind the rate by
the time constant τ, as in a damper in series with a spring. The state ζ of this law is the rate of a hinge with rotor
inertia d τ and damping d, connected to the joint by a gyrator with g = d:

    T = d ζ        d τ ζ̇ = d q̇ − d ζ
"""

from flexlink.kernels.tools.compiler import recursion


@recursion
def damper_torque(rows, q, qd, torque):
    """Add T to `torque` (n,); returns the dissipated power [W]."""
    power = 0.0
    for damper in rows:
        k = damper.hinge
        taken = damper.quadratic * abs(qd[k]) * qd[k]
        torque[k] += taken
        power += taken * qd[k]
    return power


@recursion
def damper_slopes(rows, q, qd, by_angle, by_rate):
    """Add ∂T/∂q̇ = 2 c |q̇| to the diagonal of `by_rate` (n, n)."""
    for damper in rows:
        k = damper.hinge
        by_rate[k, k] += 2.0 * damper.quadratic * abs(qd[k])


@recursion
def damper_own_slopes(rows, q, qd, own):
    """Add ∂T/∂q̇ = 2 c |q̇| to `own` (2, n)."""
    for damper in rows:
        k = damper.hinge
        own[1, k] += 2.0 * damper.quadratic * abs(qd[k])


@recursion
def hardening_torque(rows, q, qd, torque):
    """Add T to `torque` (n,); returns the dissipated power, 0."""
    for spring in rows:
        θ = q[spring.hinge]
        torque[spring.hinge] += spring.cubic * θ * θ * θ
    return 0.0


@recursion
def hardening_energy(rows, q):
    """Elastic energy V [J]."""
    energy = 0.0
    for spring in rows:
        energy += 0.25 * spring.cubic * q[spring.hinge] ** 4
    return energy


@recursion
def hardening_slopes(rows, q, qd, by_angle, by_rate):
    """Add ∂T/∂q = 3 c q² to the diagonal of `by_angle` (n, n)."""
    for spring in rows:
        k = spring.hinge
        by_angle[k, k] += 3.0 * spring.cubic * q[k] * q[k]


@recursion
def hardening_own_slopes(rows, q, qd, own):
    """Add ∂T/∂q = 3 c q² to `own` (2, n)."""
    for spring in rows:
        k = spring.hinge
        own[0, k] += 3.0 * spring.cubic * q[k] * q[k]


@recursion
def gyrator_torque(rows, q, qd, torque):
    """Add T to `torque` (n,); returns the dissipated power, 0."""
    for gyrator in rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        torque[i] += g * qd[j]
        torque[j] -= g * qd[i]
    return 0.0


@recursion
def gyrator_slopes(rows, q, qd, by_angle, by_rate):
    """Add g and −g to ∂T/∂q̇, `by_rate` (n, n)."""
    for gyrator in rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        by_rate[i, j] += g
        by_rate[j, i] -= g
