"""Namespace of the examples in docstrings: an arm of two links, its chain, a state, and a run."""

import numpy as np

import flexlink as fl

bends = {"material": "aluminium", "section": "tube", "flex": "z", "segments": 3}
motor, damping = fl.Joint(armature=0.5), fl.Damping(ratio=0.01, at_hz=5.0)
upper = fl.Link(name="upper", length=1.0, joint=motor, damping=damping, **bends)
fore = fl.Link(name="fore", length=0.8, joint=motor, damping=damping, **bends)
arm = fl.Arm(
    links=(upper, fore),
    materials={"aluminium": fl.Material(young=70e9, density=2700.0)},
    sections={"tube": fl.Section(shape="tube", outer=0.05, inner=0.044)},
    tip=fl.RigidBody(mass=4.0),
)
move = fl.Reference(profile="quintic", to_deg=(60.0, -60.0), duration=0.5)
scene = fl.Scene(
    name="two_links",
    arm=arm,
    gravity=(0.0, -9.81, 0.0),
    initial=fl.InitialState(joint_deg=(30.0, -60.0), passive="static"),
    drive=fl.Drive(kind="pd", kp=(2e4, 1e4), kd=(600.0, 250.0), gravity="static", reference=move),
    run=fl.RunSettings(method="RK4", step=2e-4, duration=1.0, sample=0.01),
)
chain = fl.lump(scene)
q, qd = fl.initial_state(scene, chain)
qdd = tau = np.zeros(chain.n)
run = fl.simulate(scene)
