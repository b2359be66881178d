"""Random loops: growth and poles are those of 40-digit arithmetic.

    python -m tests.campaigns.random_loops 500  # seeds 0 … 499, with a summary at the end; exit code 1 if one is wrong

The reference follows from the matrices of arm and law by matrix exponentials with 40 digits. The condition number of an
eigenvalue is ‖Z‖/|yᴴx|, with left and right eigenvectors y and x of the balanced matrix Z of the closed loop.
"""

import sys

import numpy as np
import scipy
from mpmath import mp

import flexlink as fl
from flexlink.motion.loop.loop import STABLE, Loop
from validation.random_arms import Dice

WRONG = 1e-9  # an error is wrong above this multiple of the condition number


def random_loop(seed: int) -> Loop:
    """The loop of a random arm."""
    dice = Dice(seed)
    planar, number = dice.chance(0.3), dice.one_of(1, 2, 2, 3)
    links = tuple(_link(dice, f"l{k}", "z" if planar or number == 3 else "xyz", planar) for k in range(number))
    sizes = {name: {key: dice.decades(-2.4, -1.4) for key in ("height", "width")} for name in ("slim", "wide")}
    loss = dice.one_of(0.0, dice.decades(-5, -3.5))
    deg = tuple(0.0 if link.joint.slides else dice.linear(-90, 90) for link in links)
    scene = fl.Scene(
        name=f"random loop {seed}",
        arm=fl.Arm(
            links=links, materials={"alloy": fl.Material(young=7e10, density=2700.0, poisson=0.33, loss_time=loss)},
            sections={name: fl.Section(shape="rectangle", **size) for name, size in sizes.items()},
            tip=fl.RigidBody(mass=dice.decades(-1, 0.5), inertia=(1e-3, 1e-3, 1e-3)),
        ),
        gravity=dice.one_of((0.0, 0.0, 0.0), (0.0, -9.81, 0.0), (0.0, 0.0, -9.81), dice.three(9.81)),
        initial=fl.InitialState(joint_deg=deg),
    )  # fmt: skip
    chain = fl.lump(scene)
    J = np.diag(fl.mass_matrix(chain, chain.rest))[chain.active]
    ω, ζ, rate = dice.decades(0.0, 1.5), dice.linear(0.3, 1.5), dice.one_of(None, 50.0, 100.0, 160.0, 250.0, 1000.0)
    kind = dice.one_of("pd", "pd", "computed_torque", "cascade" if rate else "pd")
    units = {"pd": (ω * J, J), "cascade": (J**0, J), "computed_torque": (ω * J**0, J**0)}[kind]
    kp, kd = (tuple((gain * unit).tolist()) for gain, unit in zip((ω, 2 * ζ * ω), units, strict=True))
    late = dice.one_of(0.0, 0.0, dice.linear(0, 1)) / rate if rate else 0.0
    more = {"ki": tuple((0.1 * ω**2 * J).tolist())} if kind == "cascade" else {}
    more |= {"target_m": (0.0,) * number} if any(link.joint.slides for link in links) else {}
    drive = fl.Drive(kind=kind, kp=kp, kd=kd, **more, target_deg=deg, rate=rate, delay=late)
    run = fl.RunSettings(duration=0.1, sample=1 / (rate or 10.0))
    return fl.loop(scene.varied({"drive": drive, "run": run}))


def _link(dice: Dice, name: str, flex: str, planar: bool) -> fl.Link:
    lag = dice.one_of(0.0, 0.0, 0.05)
    joint = {"armature": dice.decades(-2, 0), "viscous": dice.decades(-3, 0.5), "viscous_lag": lag}
    if dice.chance(0.5):
        joint |= {"gear_stiffness": dice.decades(2, 5), "gear_damping": dice.one_of(0.0, 0.1)}
    tilted = {} if planar else {"mount": fl.Mount(rpy=dice.three(1.5))}
    slides = not planar and dice.chance(0.15)
    kind = fl.Joint(kind="prismatic" if slides else "revolute", axis=(0, 0, 1) if planar else dice.direction(), **joint)
    flex = dice.one_of("rigid", "z", flex[-2:], flex)
    return fl.Link(
        name=name, length=dice.linear(0.2, 1.0), flex=flex, segments=1 if flex == "rigid" else 3, material="alloy",
        section=dice.one_of("slim", "wide"), joint=kind, **tilted,
    )  # fmt: skip


def closed(loop: Loop) -> mp.matrix:
    """Matrix of the closed loop for (x, the torques before if they are late, memory of the law)."""
    A, B, C, F, G, H, K = (mp.matrix(each.tolist()) for each in (*loop.plant.matrices[:3], *loop.law))
    if not loop.rate:
        return A + B * K * C
    s, m, late = B.rows, B.cols, mp.mpf(loop.delay)
    both, p = mp.zeros(s + m), s + m * bool(late)
    both[:s, :s], both[:s, s:] = A, B
    first, rest = (mp.expm(both * t) for t in (late, 1 / mp.mpf(loop.rate) - late))
    Z, law = mp.zeros(p + len(loop.law.F)), mp.zeros(m, p + len(loop.law.F))
    law[:, :s] = K * C
    if len(loop.law.F):
        law[:, p:], Z[p:, :s], Z[p:, p:] = H, G * C, F
    Z[:s, :] = rest[:s, s:] * law
    Z[:s, :s] += rest[:s, :s] * first[:s, :s]
    if late:
        Z[s:p, :], Z[:s, s:p] = law, Z[:s, s:p] + rest[:s, :s] * first[:s, s:]
    return Z


def judged(loop: Loop) -> tuple[float, bool]:
    """Largest error of a pole or the growth, relative to the condition number; whether `stable` is right."""
    with mp.workdps(40):
        Z = closed(loop)
        exact = np.array([complex(z) for z in mp.eig(Z, left=False, right=False)])
    Z, _ = scipy.linalg.matrix_balance(np.array(Z.tolist(), float))
    near, y, x = scipy.linalg.eig(Z, left=True)
    condition = np.linalg.norm(Z, 2) / np.abs((y.conj() * x).sum(axis=0))
    condition = condition[np.abs(near - exact[:, None]).argmin(axis=1)]
    off = np.abs(np.array([pole.z for pole in loop.poles])[:, None] - exact)
    of_poles = (off.min(axis=1) / condition[off.argmin(axis=1)]).max()
    size = np.abs(exact) if loop.rate else np.exp(exact.real)
    of_growth = abs(loop.growth / size.max() - 1.0) / condition[size.argmax()]
    return float(max(of_poles, of_growth)), loop.stable == (size.max() <= STABLE)


if __name__ == "__main__":
    found = [judged(random_loop(seed)) for seed in range(int(sys.argv[1]))]
    wrong = {seed: each for seed, each in enumerate(found) if each[0] > WRONG or not each[1]}
    print(f"{len(found)} loops, error / condition number up to {max(error for error, _ in found):.2g}, wrong: {wrong}")
    sys.exit(bool(wrong))
