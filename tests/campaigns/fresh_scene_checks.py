"""Checks of a random scene: numbers equal independent references, files read back equal, only intended errors occur."""

import contextlib
import functools
import io
import math
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy import signal as filters
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.cli.main import main as command_line
from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method
from tests.campaigns.fresh_scene_maker import FOLDER, Made, make
from tests.campaigns.fresh_scene_truth import TooSlowError, Truth, compliance, places
from tests.matrix.case import Case
from tests.matrix.files import toml
from tests.matrix.rest import modes, statics
from tests.matrix.runs import archive
from tests.matrix.states import inverse_of_forward, linear_model, mass_matrices, potential, power

EQUATIONS = (inverse_of_forward, mass_matrices, potential, power, linear_model)


class Judged:
    """One scene and its findings."""

    def __init__(self, seed: int) -> None:
        self.seed, self.found, self.notes = seed, list[tuple[str, str]](), list[str]()
        self.result: Any = None
        self.rng = np.random.default_rng([7, seed])
        self.made: Made = make(seed)
        self.folder = FOLDER / f"scene{seed}"
        self.path = self.made.write(self.folder)

    def report(self, kind: str, text: str) -> None:
        """Record a finding."""
        self.found.append((kind, " ".join(str(text).split())[:300]))

    def expect(self, name: str, difference: float, allowed: float) -> None:
        """Check that a difference is small."""
        if not difference <= allowed:
            self.report("silent", f"{name}: off by {difference:.3g}, allowed {allowed:.3g}")

    def guarded(self, name: str, check: Callable[[], None]) -> bool:
        """Run a check. A FlexlinkError counts as an error, any other exception as a traceback."""
        began = time.process_time()
        try:
            check()
        except fl.FlexlinkError as error:
            on_purpose = name == "other engines" and isinstance(error, fl.errors.ArgumentError)  # limits of the formats
            self.report(
                "error" if not on_purpose and not self.made.extreme else "told",
                f"{name}: {type(error).__name__}: {error}",
            )
        except AssertionError as error:
            self.report("silent", f"{name}: {error}")
        except TooSlowError:
            self.report("weak", f"{name}: reference too slow")
        except np.linalg.LinAlgError as error:
            self.report("weak", f"{name}: truth: {error}")
        except AlarmError:
            raise
        except Exception as error:  # tracebacks are what the test looks for
            where = traceback.extract_tb(error.__traceback__)[-1]
            self.report(
                "traceback", f"{name}: {type(error).__name__}: {error} at {Path(where.filename).name}:{where.lineno}"
            )
        else:
            return True
        finally:
            if (spent := time.process_time() - began) > 1.0:
                self.notes.append(f"({name} {spent:.1f} s)")
        return False

    def judge(self) -> None:
        """Run all checks, in the order of their dependencies."""
        if not self.guarded("load", self.load) or not self.guarded("lump", self.lump):
            return
        for check in (self.claims, self.geometry, self.stiffness, self.linear):
            self.guarded(check.__name__, check)
        if self.guarded("run", self.run) and self.result is not None:
            for check in (self.against_truth, self.run_checks, self.archive, self.sensors, self.stepped):
                self.guarded(check.__name__, check)
        if self.rng.random() < 0.12:
            self.guarded("other engines", self.other_engines)
        if self.rng.random() < 0.12 and not self.made.extreme:
            self.guarded("command line", self.command_line)

    def load(self) -> None:
        """Load the file."""
        self.scene = fl.load_scene(self.path)

    def lump(self) -> None:
        """Make the chain and its initial state."""
        self.chain = fl.lump(self.scene)
        self.q, self.qd = fl.initial_state(self.scene, self.chain)
        self.size = self.chain.size

    def claims(self) -> None:
        """Check claims of the test matrix; those with tolerances are made for ordinary scenes."""
        case, rests = Case(self.scene), not self.chain.has_free_base and self.chain.n > len(self.chain.active)
        toml(case)
        if not self.made.extreme and len(case.free):
            for claim in (*EQUATIONS, *([statics, modes] if rests else [])):
                self.guarded(claim.__name__, functools.partial(claim, case))

    def geometry(self) -> None:
        """Check mass, centre of mass and tip against independent transforms."""
        if self.scene.initial.q is not None:
            return
        mass, centre, tip = places(self.scene)
        q = np.where(np.isin(np.arange(self.chain.n), self.chain.active), self.q, 0.0)
        q[: 6 * self.chain.has_free_base] = self.q[: 6 * self.chain.has_free_base]
        on_base = [link for k, link in enumerate(self.scene.arm.links) if not k or link.on == "base"]
        if not self.chain.has_free_base and any(link.joint.locked for link in on_base):  # bodies at rest have no mass
            mass, centre = self.chain.mass, self.chain.com(q)
        tapers = any(link.section_tip or link.rigidity for link in self.scene.arm.links)
        self.expect("mass", abs(self.chain.mass / mass - 1), 1e-5 if tapers else 1e-9)
        far = 1e-9 * (self.size + np.abs(tip).max())
        self.expect("centre of mass", np.abs(self.chain.com(q) - centre).max(), 1e-2 * self.size if tapers else far)
        self.expect("tip", np.abs(fl.tip_position(self.chain, q) - tip).max(), far)

    def stiffness(self) -> None:
        """Check each beam alone and clamped: a tip moment M turns its end by M ∫ dx/EI."""
        arm = self.scene.arm
        for link in arm.links:
            if link.flex == "rigid" or link.lumping in {"paper", "hencky", "clamped"} or self.made.extreme:
                continue
            changes = {
                "name": "beam",
                "on": "",
                "joint": fl.Joint(axis=link.joint.axis, locked=True),
                "mount": fl.Mount(),
            }
            changes |= dict.fromkeys(("dh", "root_stiffness", "root_damping", "drag", "damping")) | {
                "hub": fl.RigidBody()
            }
            if link.dh is not None and link.line is None:
                changes |= {"length": 0.0, "line": ((0.0, 0.0, 0.0), link.stop)}
            alone = msgspec.structs.replace(arm, links=(msgspec.structs.replace(link, **changes),), base=fl.Base())
            chain = fl.lump(fl.Scene(name="beam", arm=alone, gravity=(0.0, 0.0, 0.0)))
            x = np.subtract(*(link.line or ((0, 0, 0), link.stop))[::-1])
            x, up = x / np.linalg.norm(x), np.array(link.up or link.joint.axis, float)
            z = up - (up @ x) * x
            if np.linalg.norm(z) < 1e-6 * np.linalg.norm(up):
                continue
            z /= np.linalg.norm(z)
            axes = {"x": x, "y": np.cross(z, x), "z": z}
            for axis, per in compliance(arm, link).items():
                if math.isnan(per):
                    continue
                turned = fl.solve_static(chain, tip_wrench=[0, 0, 0, *(axes[axis] * 1e-4 / per)]).q
                end, straight = (fl.frames(chain, q).rotations[-1] for q in (turned, 0 * turned))
                angle = Rotation.from_matrix(end @ straight.T).as_rotvec()
                loose = 0.2 if link.section_tip else 3e-2 if link.rigidity else 1e-6
                self.expect(f"stiffness about {axis}, {link.lumping[-20:]}, {link.segments - 1} hinges",
                            float(np.abs(angle / 1e-4 - axes[axis]).max()), loose)  # fmt: skip

    def linear(self) -> None:
        """Check that a linear model with all sensors as outputs is finite."""
        kinds = {"torque", "current"} if self.scene.motion else set()  # prescribed joints have no such outputs
        shown = [sensor.name for sensor in self.scene.sensor if sensor.kind not in kinds]
        seen = [fl.small_motion.SensorOutputs(self.scene, *shown)] if shown else []
        model = fl.linearize(self.chain, self.q, self.qd, outputs=("tip", "tip_rate", "joints", *seen))
        self.expect(
            "linear model, finite", 0.0 if np.isfinite(model.A).all() and np.isfinite(model.C).all() else 1.0, 0.5
        )

    def run(self) -> None:
        """Simulate the scene; store the result, or report why the run failed."""
        began = time.process_time()
        try:
            with warnings.catch_warnings(record=True) as self.heard:
                warnings.simplefilter("always")
                self.result = fl.simulate(self.scene)
        except (fl.errors.DivergenceError, fl.errors.UnstableStepError) as error:
            if self.truly_wild():
                self.report("told", f"run: {error}")
                self.result = None
                return
            raise
        finally:
            self.notes.append(f"{time.process_time() - began:.2f} s")
        self.tolerance = self.scene.run.tolerance_within(self.size)
        if self.result is None:
            return
        bent = np.delete(self.result.q - self.chain.rest, self.chain.active, axis=1)[:, 6 * self.chain.has_free_base :]
        true = ["no end stops", *(["beyond 84°"] if np.abs(bent).max(initial=0.0) > math.radians(83.9) else [])]
        self.doubts = [w for w in self.result.warnings if not any(each in w for each in true)]
        self.notes.append(str(self.result.steps).split(":")[0].split(" ")[0])

    def truly_wild(self) -> bool:
        """Return whether the reference also diverges, or a step or sampling period is too long for the motion."""
        run = self.scene.run
        truth = Truth(self.scene, self.chain)
        if self.scene.drive.rate and self.scene.drive.kp and self.growth() > 1.02:
            return True
        if not run.controlled and method(run.method).explicit:
            most = 0.05 if run.method == "RK2" else 1.5  # vibrations grow with RK2
            return run.unstable == "allow" or truth.fastest(self.q, self.qd) * run.fixed_step > most
        if not run.controlled:
            return False
        try:
            begin = self.scene.initial.time
            _, qd = truth.end_state(self.q, self.qd, begin, begin + run.duration, 1e-7)
        except (TooSlowError, fl.FlexlinkError, ValueError):
            return False
        return bool(np.abs(qd).max() > 1e3)

    def growth(self) -> float:
        """Growth factor of a small motion between two samples of a sampled control law, at the initial state."""
        model, drive, n = fl.linearize(self.chain, self.q, self.qd), self.scene.drive, self.chain.n
        free = [k for k, link in enumerate(self.scene.arm.links) if not link.joint.locked]
        gains = np.zeros((len(free), 2 * n))
        gains[range(len(free)), self.chain.active] = np.array(drive.kp)[free]
        gains[range(len(free)), n + self.chain.active] = np.array(drive.kd)[free]
        whole = np.zeros((2 * n + len(free),) * 2)
        whole[: 2 * n] = np.hstack([model.A, model.B])
        held = expm(whole / (drive.rate or 1.0))[: 2 * n]
        return float(np.abs(np.linalg.eigvals(held[:, : 2 * n] - held[:, 2 * n :] @ gains)).max())

    def against_truth(self) -> None:
        """Check the final state against an integration by SciPy."""
        run, scene = self.result, self.scene
        if not scene.run.duration:
            return
        tolerance = self.tolerance
        if scene.run.accuracy == "deflection":
            tolerance = max(1e-9, float(scene.run.relative_tolerance or 0) * self.deflection())
        if not scene.run.controlled:
            tolerance = 1e-3 * self.size
        there, kind = fl.frames(self.chain, run.q[-1]).points, ""
        try:
            for part, most in ((1e-2, 15_000), (1e-4, 60_000)):  # stricter if an error is found
                tight = float(np.clip(part * tolerance / self.size, 1e-10, 1e-6))
                truth = Truth(scene, self.chain, most)
                q, _ = truth.end_state(self.q, self.qd, float(run.t[0]), float(run.t[-1]), tight)
                error = float(np.abs(there - fl.frames(self.chain, q).points).max())
                if error <= 0.3 * tolerance:
                    break
        except TooSlowError:
            length = min(tolerance * 1e-2, 1e-6 * self.size)
            finer = fl.simulate(scene.varied({"run.accuracy": "tip"}), tolerance=length, method="Radau9")
            error, kind = float(np.abs(there - fl.frames(self.chain, finer.q[-1]).points).max()), "weak: "
            self.report("weak", "compared with a finer run")
        self.notes.append(f"error {error / tolerance:.2g} tol")
        if error > 10 * tolerance and not self.doubts:
            self.report("silent", f"{kind}end is off by {error:.3g} m, tolerance {tolerance:.3g} m")
        elif error > tolerance and scene.run.controlled and not self.doubts:
            self.report("told", f"{kind}above the tolerance: {error / tolerance:.2g}")
        if self.doubts and error <= tolerance:
            self.report(
                "told" if self.made.extreme else "doubt", f"{kind}error {error / tolerance:.2g} tol, but {self.doubts}"
            )

    def deflection(self) -> float:
        """Upper bound of the tip motion due to springs."""
        q = self.result.q
        rigid = np.where(
            np.isin(np.arange(self.chain.n), [*self.chain.active, *range(6 * self.chain.has_free_base)]),
            q,
            self.chain.rest,
        )
        there, straight = fl.frames(self.chain, q).points, fl.frames(self.chain, rigid).points
        return float(np.linalg.norm(there - straight, axis=-1).max())

    def run_checks(self) -> None:
        """Check limit warnings, the energy balance, conserved momentum and the torques of the control law."""
        run, chain = self.result, self.chain
        for name, column in run.columns.items():
            if len(column) != len(run.t) or not np.isfinite(column).all():
                self.report("silent", f"column {name!r}: not finite, or of another length")
        passed = False
        for link, k in zip([link for link in self.scene.arm.links if not link.joint.locked], chain.active, strict=True):
            limits = link.joint.limits
            if limits is not None:
                low, high = limits if link.joint.slides else np.radians(limits)
                passed |= bool((run.q[:, k] > high + 1e-9).any() or (run.q[:, k] < low - 1e-9).any())
        reported = any("no end stops" in w for w in run.warnings)
        if passed != reported:
            self.report("silent" if passed else "doubt", f"limits passed: {passed}, reported: {reported}")
        if run.momentum_error is not None and not self.doubts and not self.made.extreme:
            momentum = run.base.momentum.linear if run.base is not None else np.zeros(1)
            scale = np.abs(momentum).max() + chain.mass * self.tolerance / max(run.t[-1] - run.t[0], 1e-9)
            if not any(link.joint.armature for link in self.scene.arm.links):
                self.expect("momentum", run.momentum_error[0], 1e-2 * scale)
        if not self.doubts and not self.made.extreme and len(run.t) > 1:
            share = np.abs(run.imbalance[-1]) / max(float(run.exchanged[-1]), 1e-12)
            self.expect("energy", float(share), 0.1)
        again = fl.tip_position(chain, run.q)
        self.expect("tip of run", float(np.abs(again - run.tip).max()), 1e-9 * (self.size + np.abs(run.tip).max()))
        if run.q.size and not self.made.extreme:
            truth = Truth(self.scene, chain)
            truth.start, truth.end = float(run.t[0]), float(max(run.t[-1], run.t[0] + 1e-9))
            k = len(run.t) // 2
            if not self.scene.drive.rate and not self.scene.motion and k:
                expected = truth.law(float(run.t[k]), run.q[k], run.qd[k])
                scale = np.abs(expected).max() + np.abs(run.tau).max() + 1e-9
                self.expect("torque of run", float(np.abs(run.tau[k][chain.active] - expected).max() / scale), 1e-4)

    def archive(self) -> None:
        """Check that a saved archive and a saved table read back equal."""
        case = Case(self.scene)
        vars(case)["run"] = self.result
        archive(case)
        self.result.save(self.folder / "run.csv")
        table = np.genfromtxt(self.folder / "run.csv", delimiter=",", skip_header=1, encoding="utf-8")
        if not np.array_equal(np.atleast_2d(table)[:, 0], self.result.t):
            self.report("silent", "table: other times")
        if self.rng.random() < 0.03:
            self.result.plot()

    def sensors(self) -> None:
        """Check sensor readings against independent filters."""
        run = self.result
        for sensor in self.scene.sensor:
            if sensor.kind == "strain" or self.made.extreme or len(run.t) < 2:
                continue
            for name, u in self.signals(sensor).items():
                got = run.readings[name]
                y = instrument(sensor, run.t, u)
                slack = (sensor.resolution or 0.0) + 7 * sensor.noise + 2e-6 * (np.abs(y).max() + np.ptp(y)) + 1e-9
                self.expect(
                    f"sensor {sensor.kind} {sorted(msgspec.to_builtins(sensor))}", float(np.abs(got - y).max()), slack
                )

    def signals(self, sensor: Any) -> dict[str, Array]:
        """Quantity measured by a sensor, by column."""
        run, arm = self.result, self.scene.arm
        number = arm.number(sensor.link) - 1 if sensor.link != "base" else -1
        names = [name for name in run.readings if name.startswith(f"{sensor.name} ")]
        if sensor.kind in {"position", "accelerometer", "gyroscope"}:
            if number != len(arm.links) - 1 or sensor.x is not None or sensor.point is not None or arm.links[number].dh:
                return {}
            seen = self.at_tip(sensor.kind)
            if sensor.axis is not None:
                return {names[0]: seen @ (np.array(sensor.axis) / np.linalg.norm(sensor.axis))}
            return dict(zip(names, seen.T, strict=True))
        free = [k for k, link in enumerate(arm.links) if not link.joint.locked]
        rows = run.q if sensor.kind == "joint" else run.tau
        return {names[0]: rows[:, self.chain.active[free.index(number)]] / (sensor.torque_constant or 1.0)}

    def at_tip(self, kind: str) -> Array:
        """Quantities measured by a sensor at the tip, (samples, 3)."""
        run, chain = self.result, self.chain
        turn = fl.frames(chain, run.q).rotations[:, chain.tip_body()]
        if kind == "position":
            return np.asarray(run.tip)
        if kind == "gyroscope":
            seen = np.array([fl.jacobian(chain, q).angular @ qd for q, qd in zip(run.q, run.qd, strict=True)])
        else:
            slopes = [fl.jacobian(chain, q).linear for q in run.q]
            ahead = [fl.jacobian(chain, q + 1e-6 * qd).linear for q, qd in zip(run.q, run.qd, strict=True)]
            back = [fl.jacobian(chain, q - 1e-6 * qd).linear for q, qd in zip(run.q, run.qd, strict=True)]
            seen = np.array([J @ a + (A - B) @ v / 2e-6 - chain.gravity for J, A, B, v, a in
                             zip(slopes, ahead, back, run.qd, run.qdd, strict=True)])  # fmt: skip
        return np.array(np.einsum("sij,si->sj", turn, seen))

    def stepped(self) -> None:
        """Check that a Simulator gives the same results."""
        if self.made.extreme or not self.scene.run.duration:
            return
        arm = fl.Simulator(self.scene)
        for _ in range(min(len(self.result.t) - 1, 8)):
            arm.step()
        k = min(len(self.result.t) - 1, 8)
        difference = np.abs(
            fl.frames(self.chain, arm.state.q).points - fl.frames(self.chain, self.result.q[k]).points
        ).max()
        self.expect(
            "simulator",
            float(difference),
            max(2 * self.tolerance if self.scene.run.controlled else 0.0, 1e-9 * self.size),
        )
        arm.step(np.zeros(len(self.chain.active)))
        for name, value in arm.readings.items():
            if name not in self.result.readings or not math.isfinite(value):
                self.report("silent", f"reading {name!r} of a simulator")

    def other_engines(self) -> None:
        """Export to all formats; Pinocchio and MuJoCo must agree."""
        for write in (fl.to_mjcf, fl.to_urdf, fl.to_sdf):
            write(self.chain)
        found = fl.compare(self.scene, samples=4)
        if not found.passed:
            self.report("silent", f"compare: {found.diagnosis}")

    def command_line(self) -> None:
        """Run the command `simulate` in this process."""
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = command_line(["simulate", str(self.path), "--out", str(self.folder / "command.csv")])
        lines = err.getvalue().strip().splitlines()
        odd = [line for line in lines if not line.startswith(("note: ", "warning: ", "flexlink: ", "compiling"))]
        if code not in {0, 2} or odd or sum(line.startswith("flexlink: ") for line in lines) != (code == 2):
            self.report("traceback", f"command line: {code}: {err.getvalue()}")
        if code == 0 and (self.folder / "command.csv").read_text(encoding="utf-8") != (
            self.folder / "run.csv"
        ).read_text(encoding="utf-8"):
            self.report("silent", "command line: another table")


def instrument(sensor: Any, t: Array, u: Array) -> Array:
    """Apply a sensor's delay, low-pass filter, gain, bias, rate and quantization to u(t), on a grid of 1 ms."""
    fine = t[0] + 1e-3 * np.arange(round((t[-1] - t[0]) / 1e-3) + 1)
    y = np.interp(fine - sensor.delay, t, u)
    if sensor.low_pass:
        ω = 2 * math.pi * sensor.low_pass
        b, a = filters.butter(sensor.order or 1, ω, analog=True)
        if sensor.damping:
            b, a = [ω**2], [1.0, 2 * sensor.damping * ω, ω**2]
        y = y[0] + filters.lsim((b, a), y - y[0], fine - fine[0], interp=True)[1]
    y = sensor.gain * y + sensor.bias
    sampled = t if not sensor.rate else np.floor(t * sensor.rate + 1e-6) / sensor.rate
    y = y[np.clip(np.round((sampled - t[0]) / 1e-3).astype(int), 0, len(y) - 1)]
    rounded = sensor.resolution and not sensor.noise
    return np.asarray(np.round(y / sensor.resolution) * sensor.resolution if rounded else y)


class AlarmError(Exception):
    """A scene takes too long."""
