"""Actions of a random scene: initial state, run, drive, prescribed motions, wrench, sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import flexlink as fl
from tests.campaigns.fresh_scene_maker import FOLDER, Made, Table, csv

if TYPE_CHECKING:
    from tests.campaigns.fresh_scene_maker import Maker

OWN_METHOD = """about = "own"\nsource = "own"\norder = 4\nc = ["0", "1/2", "1/2", "1"]\nb = ["1/6", "1/3", "1/3", "1/6"]
A = [[], ["1/2"], ["0", "1/2"], ["0", "0", "1"]]\n"""
OWN_SHAPER = 'about = "own"\nsource = "own"\nzeros = 1\nhalf_periods = [0, 1]\nweights = [1, 1]\n'


def act(maker: Maker, table: Table) -> None:
    """Add all actions to the table of an arm."""
    Actor(maker, table).act()


class Actor:
    """Actions for the arm of a maker."""

    def __init__(self, maker: Maker, table: Table) -> None:
        self.m, self.table, self.links = maker, table, maker.links
        self.slides = [link["joint"].get("kind") == "prismatic" for link in self.links]
        self.locked = [bool(link["joint"].get("locked")) for link in self.links]
        self.moved = [False] * len(self.links)
        self.sample, self.time = self.m.pick(0.01, 0.005, 0.02), 0.0
        self.start = [0.0] * len(self.links)
        self.rate = [0.0] * len(self.links)

    def act(self) -> None:
        """Add all actions, in the order of their dependencies."""
        m = self.m
        start: Table = {}
        if m.chance(0.85):
            scale = 1e5 if m.extreme == "far" else 60.0
            self.start = [m.uniform(-0.3, 0.3) * m.size if s else m.uniform(-scale, scale) for s in self.slides]
        fast = 60.0 if m.extreme == "fast" else 1.0
        if m.chance(0.5):
            self.rate = [fast * (m.uniform(-0.3, 0.3) * m.size if s else m.uniform(-60, 60)) for s in self.slides]
            self.rate = [0.0 if lock else r for r, lock in zip(self.rate, self.locked, strict=True)]
        self.motions()
        self.set(start, "joint", self.start)
        if any(self.rate):
            self.set(start, "rate", self.rate)
        if m.chance(0.12) and not self.table.get("motion"):
            self.time = start["time"] = 1e7 if m.extreme == "late" else m.pick(0.1, 0.2, 1.0)
        if m.free and m.chance(0.8):
            start["base"] = self.base()
        elif not m.free and m.chance(0.3):
            start["passive"] = m.pick("static", "static", "zero")
        self.table["initial"] = start
        self.run()
        self.drive()
        self.wrench()
        self.sensors()
        self.whole_state(start)

    def set(self, into: Table, key: str, values: Sequence[float], units: tuple[str, str] = ("deg", "m")) -> None:
        """Store one number per link in the lists in degrees and in metres; a list that no joint needs is left out."""
        for unit, own in zip(units, (False, True), strict=True):
            if own in self.slides or (not own and key == "joint"):
                into[f"{key}_{unit}"] = [v if s == own else 0.0 for v, s in zip(values, self.slides, strict=True)]

    def base(self) -> Table:
        """Add the initial state of a free base."""
        m, base = self.m, dict[str, Any]()
        keys: tuple[tuple[str, Any], ...] = (
            ("xyz", m.uniform(-2, 2, 3)), ("velocity", m.uniform(-0.5, 0.5, 3)), ("rpy_deg", m.uniform(-170, 170, 3)),
            ("spin_deg", m.uniform(-60, 60, 3)),
        )  # fmt: skip
        for key, value in keys:
            if m.chance(0.6):
                base[key] = value
        if "rpy_deg" not in base and m.chance(0.6):
            base["quaternion"] = m.uniform(-1, 1, 4)
        if "spin_deg" not in base and m.chance(0.6):
            base["spin"] = m.uniform(-1, 1, 3)
        return base

    def run(self) -> None:
        """Add the integration settings."""
        m, run = self.m, dict[str, Any]()
        run["duration"] = {"instant": 0.0, "long": 20.0}.get(m.extreme, m.drop)
        if m.chance(0.8) or m.extreme == "long":
            run["sample"] = 0.1 if m.extreme == "long" else self.sample
        reach = m.size * sum(link.get("length") or 0.3 for link in self.links)
        kind = m.pick("tolerance", "tolerance", "relative", "relative", "deflection", "default", "step", "implicit")
        if kind == "tolerance":
            run["tolerance"] = reach * {"fine": 1e-13, "coarse": 1e3}.get(m.extreme, m.spread(1e-5, 1e-3))
        elif kind == "relative":
            run["relative_tolerance"] = m.pick(1e-3, 1e-4, 1e-5)
        elif kind == "deflection" and any(link.get("flex") for link in self.links):
            run |= {"relative_tolerance": m.pick(1e-2, 1e-3), "accuracy": "deflection"}
        elif kind == "step":
            run |= {
                "step": 5e-5,
                "sample": self.sample,
                "method": m.pick("RK4", "RK2", "RK3", "RK10", "DOPRI5", "DOP853"),
            }
            if m.chance(0.2):
                run["method"], m.files["own_method.toml"] = "own_method.toml", OWN_METHOD
        elif kind == "implicit":
            step = 0.02 if m.extreme == "coarse" else m.pick(5e-4, 1e-3)
            run |= {"step": step, "sample": 0.02, "method": m.pick("Radau5", "Radau9", "Gauss4", "Gauss6")}
        if kind in {"tolerance", "relative"} and m.chance(0.5):
            run["method"] = m.pick("auto", "DOP853", "Radau5", "Radau9")
        if kind == "relative" and m.chance(0.3):
            run["accuracy"] = "tip"
        if m.chance(0.25):
            run["solver"] = m.pick("articulated", "lu", "cholesky")
        if m.chance(0.08):
            run["unstable"] = m.pick("allow", "refuse")
        if m.chance(0.1):
            run["max_evaluations"] = m.pick(1e6, 3e6)
        self.table["run"] = run

    def motions(self) -> None:
        """Add prescribed motions of joints."""
        m, motions = self.m, list[Table]()
        for k, link in enumerate(self.links):
            if self.locked[k] or not m.chance(0.12):
                continue
            a, w = (0.2 * m.size if self.slides[k] else 30.0), m.uniform(2.0, 8.0)
            t = np.linspace(0.0, 0.6, m.pick(4, 7, 13))
            x = self.start[k] + a * (1 - np.cos(w * t)) if m.chance(0.5) else self.start[k] + a * np.sin(w * t) ** 3
            rates, again = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
            self.moved[k] = True
            keys = (
                ("position_m", "rate_m", "acceleration_m")
                if self.slides[k]
                else ("angle_deg", "rate_deg", "acceleration_deg")
            )
            unit = "m" if self.slides[k] else "deg"
            motion: Table = {"link": m.pick(link["name"], k + 1)}
            if m.chance(0.5):
                self.rate[k] = float(rates[0])
                motion |= {"times": t} | dict(zip(keys, (x, rates, again), strict=True))
            elif m.chance(0.5):
                heads = (
                    f"q {link['name']} [{unit}]",
                    f"qd {link['name']} [{unit}/s]",
                    f"qdd {link['name']} [{unit}/s²]",
                )
                m.files[f"motion{k}.csv"] = csv(**dict(zip(("t [s]", *heads), (t, x, rates, again), strict=True)))
                motion["file"], self.rate[k] = f"motion{k}.csv", float(rates[0])
            else:
                t = np.linspace(0, 0.6, 121)
                x = self.start[k] + a * (1 - np.cos(w * t))
                m.files[f"motion{k}.csv"] = csv(**{"t [s]": t, f"q {link['name']} [{unit}]": x})
                motion |= {"file": f"motion{k}.csv", "cutoff": 20.0}
                self.rate[k] = self.start[k] = 0.0  # the motion's file gives the initial state of this joint
            motions.append(motion)
        if motions:
            self.table["motion"] = motions

    def drive(self) -> None:
        """Add drives of the joints."""
        m = self.m
        laws = ("none", "constant", "table", "pd", "pd", "pd") + (
            () if m.free else ("computed_torque", "computed_torque")
        )
        kind, drive = m.pick(*laws), dict[str, Any]()
        driven = np.array([not (a or b) for a, b in zip(self.locked, self.moved, strict=True)])
        weight = 3.0 * m.inertia / m.size * driven
        if kind == "none":
            if m.chance(0.3):
                self.table["drive"] = {"kind": "none"}
            return
        drive["kind"] = kind
        if kind == "constant":
            drive["torque"] = (weight * m.rng.uniform(-1, 1, len(driven))).tolist()
        elif kind == "table":
            self.torques(drive, weight, driven)
        else:
            self.law(drive, driven)
        if m.chance(0.2):
            drive["effort"] = (np.where(weight, weight, 1.0) * m.uniform(1.0, 20.0)).tolist()
        if kind != "none" and m.chance(0.2):
            drive["rate"] = m.pick(200.0, 500.0, 1000.0)
            self.sampled(drive)
        self.table["drive"] = drive

    def sampled(self, drive: Table) -> None:
        """Choose a rate of the control law that fits the samples, and add rotors."""
        run = self.table["run"]
        for key in drive.keys() & {"kp", "kd"}:
            drive[key] = (0.2 * np.array(drive[key])).tolist()
        run.setdefault("sample", 0.01)
        run["sample"] = 0.01 if run["sample"] == 0.005 else run["sample"]
        for link, inertia in zip(self.links, self.m.inertia, strict=True):
            link["joint"].setdefault("armature", 0.3 * float(inertia))

    def torques(self, drive: Table, weight: Any, driven: Any) -> None:
        """Add a table of torques."""
        m = self.m
        times = np.round(np.linspace(0.0, m.pick(0.2, 0.4), m.pick(3, 5)), 2)
        rows = weight * m.rng.uniform(-1, 1, (len(times), len(driven)))
        drive |= {m.pick("smooth", "hold"): True} if m.chance(0.6) else {}
        if m.chance(0.5):
            drive |= {"times": times, "torques": rows}
            return
        units = ["N" if s else "N m" for s in self.slides]
        heads = {
            f"tau {link['name']} [{u}]": rows[:, k] for k, (link, u) in enumerate(zip(self.links, units, strict=True))
        }
        kept = {head: row for (head, row), on in zip(heads.items(), driven, strict=True) if on}
        kept = kept if any(self.moved) is False and kept else heads
        m.files["torques.csv"] = csv(**{"t [s]": times, **kept})
        drive["file"] = "torques.csv"

    def law(self, drive: Table, driven: Any) -> None:
        """Add gains and a reference."""
        m = self.m
        w = 2 * np.pi * m.uniform(0.5, 3.0) * (1e3 if m.extreme == "gains" else 1.0)
        inertia = m.inertia if drive["kind"] == "pd" else np.ones(len(driven))
        drive["kp"], drive["kd"] = (inertia * w**2 * driven).tolist(), (1.4 * inertia * w * driven).tolist()
        if drive["kind"] == "pd" and not m.free and m.chance(0.5):
            drive["gravity"] = m.pick("rigid", "static", "none")
        goal = [
            a + (0.2 * m.size if s else 25.0) * m.uniform(-1, 1) for a, s in zip(self.start, self.slides, strict=True)
        ]
        goal = [g if d else a for g, d, a in zip(goal, driven, self.start, strict=True)]
        if m.chance(0.3):
            self.set(drive, "target", goal)
        else:
            drive["reference"] = self.reference(goal, driven)

    def reference(self, goal: list[float], driven: Any) -> Table:
        """Reference of a control law in time."""
        m, profile = (
            self.m,
            self.m.pick("quintic", "trapezoidal", "s_curve", "s_curve", "linear", "smooth", "smooth", "hold"),
        )
        reference: Table = {"profile": profile}
        if profile in {"linear", "smooth", "hold"}:
            self.rows(reference, goal)
        else:
            self.set(reference, "to", goal)
            if m.chance(0.3):
                self.set(reference, "from", self.start)
            if m.chance(0.3):
                reference["start"] = 0.05
            if m.chance(0.4):
                reference["duration"] = m.uniform(0.1, 0.5)
            else:
                limits = {"max_rate": 100.0, "max_acceleration": 1500.0, "max_jerk": 4e4}
                must = {"quintic": "max_rate", "trapezoidal": "max_acceleration", "s_curve": "max_jerk"}[profile]
                for key, limit in limits.items():
                    takes = key != "max_jerk" or profile != "trapezoidal"
                    if key == must or (takes and m.chance(0.5)):
                        self.set(reference, key, [limit * m.size / 60 if s else limit for s in self.slides])
        rough = profile in {"linear", "hold"}  # steps must end at its jumps
        if m.chance(0.3) and not (rough and "step" in self.table["run"]):
            kinds = ("ZV", "ZVD", "ZVDD", "EI", "own_shaper.toml")
            shaper: Table = {"kind": m.pick(*kinds)}
            if m.chance(0.5):
                shaper["frequency_hz"] = m.uniform(3, 12, m.pick(1, 2))
                shaper |= {"damping": [0.05] * len(shaper["frequency_hz"])} if m.chance(0.6) else {}
            else:
                shaper["poles"] = [[-0.5, m.uniform(20, 60)]]
            if shaper["kind"] == "own_shaper.toml":
                m.files["own_shaper.toml"] = OWN_SHAPER
            reference["shaper"] = shaper
        return reference

    def rows(self, reference: Table, goal: list[float]) -> None:
        """Table of angles, in the scene file or in a file next to it."""
        m = self.m
        times = np.round(
            np.linspace(0.0, m.pick(0.2, 0.4), 41 if (by_file := m.chance(0.4)) else 5), 2 if not by_file else 4
        )
        w, way = np.pi / times[-1], (np.array(goal) - self.start) / 2
        columns = {
            "angle": np.array(self.start) + np.outer(1 - np.cos(w * times), way),
            "rate": np.outer(w * np.sin(w * times) * (times < times[-1]), way),
            "acceleration": np.outer(w**2 * np.cos(w * times), way),
        }
        smooth = reference["profile"] == "smooth"
        with_rates = smooth and m.chance(0.8)
        kept = ["angle"] + (["rate"] + (["acceleration"] if m.chance(0.75) else []) if with_rates else [])
        if not by_file:
            reference["times"] = times
            for key in kept:
                for unit, own in (("deg", False), ("m", True)):
                    if own in self.slides:
                        name = {"angle_m": "position_m"}.get(f"{key}_{unit}", f"{key}_{unit}")
                        reference[name] = np.where(np.array(self.slides) == own, columns[key], 0.0)
            return
        heads: dict[str, Any] = {"t [s]": times}
        for key, sign, per in zip(kept, ("q", "qd", "qdd"), ("", "/s", "/s²"), strict=False):
            for k, link in enumerate(self.links):
                heads[f"{sign} {link['name']} [{'m' if self.slides[k] else 'deg'}{per}]"] = columns[key][:, k]
        if smooth and m.chance(0.5):
            heads = {head: column for head, column in heads.items() if head.startswith(("t ", "q "))}
            reference["cutoff"] = 30.0
        m.files["reference.csv"] = csv(**heads)
        reference["file"] = "reference.csv"

    def wrench(self) -> None:
        """Add a force and a moment at a tip."""
        m, wrench = self.m, dict[str, Any]()
        if not m.chance(0.45):
            return
        force, moment = 3.0 * m.size**3, 0.3 * m.size**4
        parents = {link.get("on") or (self.links[k - 1]["name"] if k else "base") for k, link in enumerate(self.links)}
        tips = [link["name"] for link in self.links if link["name"] not in parents]
        if m.chance(0.4):
            wrench["on"] = m.pick(*tips)
        if m.chance(0.5):
            wrench["frame"] = m.pick("tip", "tip", "world")
        if m.chance(0.4):
            wrench |= {"force": m.rng.uniform(-force, force, 3)}
            wrench |= {"moment": m.rng.uniform(-moment, moment, 3)} if m.chance(0.6) else {}
        else:
            times = np.round(self.time + np.linspace(0.0, m.pick(0.1, 0.3), m.pick(2, 4, 6)), 2)
            forces, moments = (
                m.rng.uniform(-force, force, (len(times), 3)),
                m.rng.uniform(-moment, moment, (len(times), 3)),
            )
            if m.chance(0.35):
                m.files["wrench.csv"] = csv(
                    **{"t [s]": times, "force x [N]": forces[:, 0], "moment z [N m]": moments[:, 2]}
                )
                wrench["file"] = "wrench.csv"
            else:
                wrench |= {"times": times, "forces": forces} | ({"moments": moments} if m.chance(0.6) else {})
            wrench |= {m.pick("smooth", "hold"): True} if m.chance(0.6) else {}
        self.table["wrench"] = wrench

    def sensors(self) -> None:
        """Add up to three sensors."""
        m, sensors = self.m, list[Table]()
        kinds = ("strain", "accelerometer", "gyroscope", "joint", "torque", "current", "position")
        for number in range(m.pick(0, 0, 1, 2, 3)):
            kind, k = m.pick(*kinds), int(m.rng.integers(len(self.links)))
            bent = [
                j
                for j, link in enumerate(self.links)
                if link.get("flex", "rigid") != "rigid" and "rigidity" not in link
            ]
            if kind == "strain" and not bent:
                kind = "position"
            k = bent[0] if kind == "strain" else k
            if kind != "strain" and self.locked[k]:
                k = self.locked.index(False)  # a sensor on a link at rest shows nothing
            link = self.links[k]
            if kind in {"joint", "torque", "current"} and link["joint"].get("locked"):
                kind = "position"
            sensor: Table = {"name": f"sensor {number}", "kind": kind, "link": m.pick(link["name"], k + 1)}
            length = link.get("length", 0.0)
            if kind == "strain":
                sensor |= {"x": 0.3 * (length or 0.5 * m.size), "fibre": [0.005 * m.size, -0.002 * m.size]}
            elif kind in {"position", "gyroscope", "accelerometer"}:
                if m.free and m.chance(0.3):
                    sensor["link"] = "base"
                elif m.chance(0.3) and length:
                    sensor["x"] = 0.5 * length
                elif m.chance(0.4):
                    sensor["point"] = [0.3 * length, 0.01, 0.0]
                if m.chance(0.5):
                    sensor["axis"] = m.pick([0.0, 0.0, 1.0], [1.0, 1.0, 0.0])
            elif kind == "current":
                sensor["torque_constant"] = 0.8
            sensors.append(sensor | self.instrument(kind))
        if sensors:
            self.table["sensor"] = sensors

    def instrument(self, kind: str) -> Table:
        """Choose the filter, rate and noise of a sensor."""
        m = self.m
        keys: Table = {
            "gain": -2.0, "bias": 0.1, "delay": m.pick(0.01, 0.003), "low_pass": 40.0, "rate": m.pick(50.0, 100.0),
            "resolution": 1e-3, "noise": 1e-3,
        }  # fmt: skip
        kept = {key: value for key, value in keys.items() if m.chance(0.3)}
        if "low_pass" in kept and m.chance(0.6):
            kept |= {"order": m.pick(1, 2, 3, 4)} if m.chance(0.7) else {"damping": m.pick(0.3, 0.9, 2.0)}
        if "noise" in kept and m.chance(0.6):
            kept["seed"] = int(m.rng.integers(100))
        if kind in {"strain", "accelerometer"} and m.chance(0.3):
            kept |= {"gain": 1e6, "unit": "µm/m"} if kind == "strain" else {"gain": 1 / 9.80665, "unit": "g"}
        return kept

    def whole_state(self, start: Table) -> None:
        """Sometimes give the coordinates of the chain instead of joint angles."""
        m = self.m
        reference = self.table.get("drive", {}).get("reference", {})
        leads = "to_deg" in reference and not reference.keys() & {"from_deg", "from_m"}
        if (
            leads
            or "to_m" in reference
            or self.table.get("motion")
            or m.free
            or "passive" in start
            or not m.chance(0.12)
        ):
            return

        try:
            scene = fl.load_scene(Made(self.table, m.files, "").write(FOLDER / "state"))
            q, qd = fl.initial_state(scene, fl.lump(scene))
        except fl.FlexlinkError:  # reported when the scene itself is loaded
            return
        kept = {"joint_deg": [a if lock and not s else 0.0 for a, lock, s in
                              zip(self.start, self.locked, self.slides, strict=True)]}  # fmt: skip
        for key in ("joint_deg", "joint_m", "rate_deg", "rate_m"):
            start.pop(key, None)
        if any(self.locked) and not any(s and lock for s, lock in zip(self.slides, self.locked, strict=True)):
            start |= kept
        start["q"] = q + 0.01 * m.rng.uniform(-1, 1, len(q)) * (np.abs(q) >= 0)
        if m.chance(0.7):
            start["qd"] = qd + 0.1 * m.rng.uniform(-1, 1, len(qd))
