"""URDF files of random robots: trees with every kind of joint and physically possible links."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

Array = np.ndarray


def saved(folder: Path, text: str, name: str = "robot") -> Path:
    """Write a file of this text; return its path."""
    path = folder / f"{name}.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def words(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def link(name: str, random: np.random.Generator) -> str:
    """A link whose mass properties are those of a few point masses."""
    points, masses = random.normal(size=(6, 3)) * random.uniform(0.02, 0.2, 3), random.uniform(0.05, 0.5, 6)
    center = masses @ points / masses.sum()
    Σ = ((points - center).T * masses) @ (points - center)
    I = np.trace(Σ) * np.eye(3) - Σ
    moments = {"ixx": I[0, 0], "iyy": I[1, 1], "izz": I[2, 2], "ixy": I[0, 1], "ixz": I[0, 2], "iyz": I[1, 2]}
    inertia = " ".join(f'{key}="{float(value)!r}"' for key, value in moments.items())
    origin = f'<origin xyz="{words(center)}" rpy="{words(random.uniform(-1, 1, 3))}"/>'
    mass = f'<mass value="{float(masses.sum())!r}"/>'
    return f'<link name="{name}"><inertial>{origin}{mass}<inertia {inertia}/></inertial></link>'


def joint(name: str, kind: str, parent: str, child: str, random: np.random.Generator, more: str = "") -> str:
    """A joint at a random place about a random axis."""
    origin = f'<origin xyz="{words(random.uniform(-0.4, 0.4, 3))}" rpy="{words(random.uniform(-3, 3, 3))}"/>'
    axis = "" if kind in {"fixed", "floating"} else f'<axis xyz="{words(random.normal(size=3))}"/>'
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>' if kind in {"revolute", "prismatic"} else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{origin}{axis}{limit}{more}</joint>'


@dataclass
class RandomRobot:
    """A robot with a base, three free joints with fixed and locked joints between them, and branches on every link."""

    seed: int
    posture: dict[str, float] = field(default_factory=dict)
    locked: dict[str, float] = field(default_factory=dict)
    base: str = "p1"
    tip: str = "p9"
    free: tuple[str, ...] = ("j3", "j5", "j8")

    def text(self) -> str:
        random = np.random.default_rng(self.seed)
        kinds = {1: "revolute", 2: "fixed", 3: "revolute", 4: "prismatic", 5: "continuous", 6: "fixed", 9: "fixed"}
        parts = [link("p0", random)]
        for k in range(1, 10):
            kind = kinds.get(k, "revolute")
            dynamics = f'<dynamics damping="{0.1 * k!r}" friction="{0.05 * k!r}"/>'
            parts += [link(f"p{k}", random), joint(f"j{k}", kind, f"p{k - 1}", f"p{k}", random, dynamics)]
            parts += [link(f"a{k}", random), joint(f"b{k}", "revolute", f"p{k}", f"a{k}", random)]
            follows = f'<mimic joint="b{k}" multiplier="-0.7" offset="0.2"/>'
            parts += [link(f"c{k}", random), joint(f"d{k}", "revolute", f"a{k}", f"c{k}", random, follows)]
            self.posture[f"b{k}"] = float(random.uniform(-2, 2))
        self.posture |= {"j1": 0.4, "j3": 0.3, "j5": 0.9, "j8": -0.5}
        self.locked |= {"j4": 0.25, "j7": -0.6}
        return f'<robot name="random">{"".join(parts)}</robot>'


def named_tree(seed: int) -> tuple[str, dict[str, str]]:
    """A tree of hinges and slides whose names are easily confused; also return the link that each joint moves."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 10))
    odd = [
        "base",
        "tip",
        "x",
        "x_joint",
        "x_link",
        "x_2",
        "base_link",
        "tip_joint",
        "knie höhe",
        "a.1.z",
        "x::y",
        "tool",
    ]
    links = ["root", *(str(name) for name in random.permutation(odd)[:n])]
    joints = [str(name) for name in random.permutation([*odd, *(f"{link}_joint" for link in links[1:])])]
    joints = list(dict.fromkeys(joints))[: 2 * n]
    parts = [f'<link name="{links[0]}"/>', *(link(name, random) for name in links[1:])]
    for k, child in enumerate(links[1:], 1):
        parent, kind = links[random.integers(k)], str(random.choice(["revolute", "continuous", "prismatic"]))
        parts.append(joint(joints[k - 1], kind, parent, child, random))
        if random.uniform() < 0.3:
            parts += [link(f"f{k}", random), joint(joints[n + k - 1], "fixed", child, f"f{k}", random)]
    return f'<robot name="tree">{"".join(parts)}</robot>', dict(zip(joints, links[1:], strict=False))
