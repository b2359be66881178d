"""notes(scene): valid but probably unintended input; defaults(scene): defaults that determine the result."""

import math
from collections.abc import Iterator

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.chain.odd_bodies import of_odd_bodies
from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.hinges import hinges_of
from flexlink.describe.joint import Joint
from flexlink.describe.joint_units import in_words
from flexlink.describe.link import Link
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.plausibility.loads import bodies
from flexlink.describe.run_settings import DEFAULT_TOLERANCE
from flexlink.describe.scene import Scene
from flexlink.describe.spec import fields_of
from flexlink.dynamics.forces import deflections
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.dynamics.terms import elastic_torque, gravity_torque


def notes(scene: Scene) -> tuple[Diagnostic, ...]:
    """Notes on probably unintended input: keys without effect, an unusual start. Each names a remedy."""
    require_type("scene", scene, Scene)
    at_rest = () if scene.ties else (slack_springs, unheld_joints, weak_gains, weak_drives, balance)  # ties hold joints
    start, scene = (_parallel_gravity, _odd_reference, _odd_shaper, *at_rest), open_chain(scene)
    unusual = _tip_without_length, _falling_base, _few_hinges, _on_edge, _wide_strips
    with np.errstate(all="ignore"):  # values beyond float64 are refused when a run is built from them
        return *(note for each in (*start, _unused, *unusual) for note in each(scene)), *of_odd_bodies(scene.arm)


def defaults(scene: Scene) -> tuple[Diagnostic, ...]:
    """Defaults that determine the result: gravity, the width of dry friction, and the step or tolerance."""
    return tuple(note for f in (_unsaid_gravity, _width_of_friction, _unsaid_steps) for note in f(open_chain(scene)))


def _unsaid_gravity(scene: Scene) -> Iterator[Diagnostic]:
    """Gravity that is not given: the scene then has the default object."""
    if any(scene.gravity is field.default for field in fields_of(Scene)):
        where = f"not given: {scene.gravity[2]:g} m/s² along +z, as Z points down"
        yield Diagnostic(f"gravity: {where}; if Z points up, set gravity = [0, 0, -9.81]", "gravity-not-given")


def _width_of_friction(scene: Scene) -> Iterator[Diagnostic]:
    """Smoothed friction holds nothing at rest: a load of a share s of it creeps at artanh(s) times its width."""
    width = Joint().coulomb_width
    for slides, unit in ((False, "mrad/s"), (True, "mm/s")):
        joints = ((scene.arm.path(k), link.joint) for k, link in enumerate(scene.arm.links, 1) if link.joint.coulomb)
        paths = [path for path, j in joints if j.coulomb_width == width and j.slides == slides and not j.locked]
        if paths:
            creep = f"a load of half the dry friction creeps at {1e3 * math.atanh(0.5) * width:.2g} {unit}"
            given = f"coulomb_width = {1e3 * width:g} {unit}, the default"
            less = f"for a tenth of it, set coulomb_width = {width / 10:g}"
            text = f"{short_list([f'{path}.joint' for path in paths])}: {given}: {creep}; {less}"
            yield Diagnostic(text, "friction-width-not-given")


def _unsaid_steps(scene: Scene) -> Iterator[Diagnostic]:
    """The default steps or tolerance."""
    run = scene.run
    if run.duration == 0 or (run.step is not None or run.has_tolerance):
        return
    if not run.by_default:
        steps = f"fixed steps of {run.fixed_step:g} s by {run.method}, unless a tolerance is given"
        yield Diagnostic(f"run: no step given; {steps}", "no-step-given")
        return
    chain = lump(scene)
    tolerance, of = run.tolerance_within(chain.size), f"{DEFAULT_TOLERANCE:g} of the {chain.size_name}"
    length = f"{1e3 * tolerance:.3g} mm"
    if not chain.reach:
        of += f", {chain.size:.3g} m"
    if not chain.has_levers:
        length = f"{tolerance / chain.size:.3g} rad or {length}"
    yield Diagnostic(f"run: no step given; tolerance {length} ({of}), method auto", "no-step-given")


def _on_edge(scene: Scene) -> Iterator[Diagnostic]:
    """A flat rectangle that bends only about its stiffer axis may have its height and width exchanged."""
    flat = 25.0  # second moments of a rectangle that is 5 times as high as wide
    for k, link in enumerate(scene.arm.links, 1):
        EI = scene.arm.bending_stiffness(link)
        if EI and link.flex == "z" and EI[1] >= flat * EI[0] and scene.arm.sections[link.section or ""].height:
            size = f"EI = {EI[1]:.4g} N m², {EI[1] / EI[0]:.3g} × the other"
            text = f"{scene.arm.path(k)}.section = {link.section!r}: bends about z, its stiffer axis, {size}"
            yield Diagnostic(f"{text}; to bend about the other, exchange height and width", "bends-on-edge")


def _wide_strips(scene: Scene) -> Iterator[Diagnostic]:
    """State the stiffness that a beam leaves out where it is a plate: a link at least ten times as wide as thick.

    A clamp holds its section flat: bending frequencies of a cantilever rise by 0.8 ν² b / L, as long as b / L is small.
    Bent to a curvature κ with b² κ beyond its thickness it stays flat everywhere, EI / (1 − ν²) (Ashwell, 1950).
    """
    for k, link in enumerate(scene.arm.links, 1):
        section = scene.arm.sections.get(link.section or "")
        if section is None or section.shape != "rectangle" or not link.material:
            continue
        h, b = sorted((section.height or 0.0, section.width or 0.0))
        ν, soft = scene.arm.materials[link.material].poisson, "z" if section.height == h else "y"
        path = f"material.{link.material}.young"
        if b >= 10 * h and ν > 0 and soft in link.flex and path not in scene.uncertain:
            flat = 1 / math.sqrt(1 - ν**2) - 1
            clamped = min(0.8 * ν**2 * b / link.beam.length, flat)
            higher = f"higher by {100 * clamped:.2g} % by its clamp, by up to {100 * flat:.2g} % if bent far"
            text = f"a plate, {b / h:.3g} times as wide as thick: its true frequencies of bending are {higher}"
            text = f"{scene.arm.path(k)}.section = {link.section!r}: {text}"
            yield Diagnostic(f'{text}; set uncertain."{path}" = {flat:.2g}', "wide-strip")


def _parallel_gravity(scene: Scene) -> Iterator[Diagnostic]:
    """Gravity parallel to all joint axes drives no joint: links do not sag, and without other loads nothing moves."""
    g = np.array(scene.gravity) / (np.abs(scene.gravity).max() or 1.0)
    pushed = [
        *scene.joint_rates, scene.wrench.acts, *(scene.drive.torque or ()),
        *np.ravel(scene.drive.torques or ()), *(scene.drive.kp or ()), len(scene.motion),
    ]  # fmt: skip
    if not g.any() or any(scene.arm.slides) or scene.arm.base.free:
        return
    if any(pushed) and not any(link.elastic for link in scene.arm.links):
        return
    chain = lump(scene)
    sprung = scene.initial.q is not None and bool(elastic_torque(chain, scene.initial.q).any())
    if not sprung and chain.all_axes_parallel_to(g / np.linalg.norm(g)):
        what = "so links do not sag" if any(pushed) else "so it moves no joint, and no other load acts"
        yield Diagnostic(
            f"gravity = {list(scene.gravity)}: is parallel to all joint axes, {what}; change gravity, or the first "
            "joint's axis, link.1.joint.axis" + "; or let links bend in both planes, flex = 'yz'" * any(pushed),
            "no-effect",
        )


def _odd_reference(scene: Scene) -> Iterator[Diagnostic]:
    """A reference that begins elsewhere makes the torque jump; one that ends after the run is cut off."""
    course, run = scene.course, scene.run
    if course is None or scene.initial.q is not None:
        return
    free = [k for k, link in enumerate(scene.arm.links) if not link.joint.locked]
    away = np.abs(course(scene.initial.time)[0] - scene.joint_positions[free])
    if away.max() > 1e-2:  # [rad, m]
        k = free[int(away.argmax())]
        far, name = in_words(scene.arm.slides[k], away.max(), ".3g"), scene.arm.links[k].name
        text = f"begins {far} away from the initial position of the joint of {name!r}, so the torque jumps at the start"
        text += "; leave from_deg and from_m out, or let both agree"
        yield Diagnostic(f"drive.reference: {text}", "reference-begins-elsewhere")
    end = scene.initial.time + run.duration
    if run.duration and end < course.knots[-1]:
        text = f"ends at {course.knots[-1]:.4g} s, after the run, which ends at {end:.4g} s"
        part = run.sample or run.step or 1e-3
        complete = part * np.ceil((course.knots[-1] - scene.initial.time) / part)
        text += f"; for the complete move set run.duration = {complete:.9g}"
        fastest = max(getattr(scene.drive.reference, "max_rate_deg", None) or (0.0,))
        if 0.0 < fastest < 2 * math.pi:
            text += f"; max_rate_deg = {fastest:g} °/s is slow, {math.degrees(fastest):.3g} °/s if meant in rad/s"
        yield Diagnostic(f"drive.reference: {text}", "reference-cut-off")


def _odd_shaper(scene: Scene) -> Iterator[Diagnostic]:
    """A shaper whose frequency is 2π times that of the slowest mode with the driven joints held."""
    shaper = scene.drive.reference.shaper if scene.drive.reference else None
    if shaper is not None and shaper.frequency_hz:
        from flexlink.dynamics.vibration.modal import natural_frequencies  # noqa: PLC0415  few scenes have shapers

        chain = lump(scene)
        if not np.setdiff1d(chain.free, chain.active).size:
            return  # rigid links
        ω = natural_frequencies(chain, _angles(scene, chain), locked=chain.active)[0]
        if abs(shaper.frequency_hz[0] / ω - 1) < 0.05:
            given = f"{shaper.frequency_hz[0]:.4g} Hz, but the slowest mode with held joints has {ω / math.tau:.4g} Hz"
            text = f"drive.reference.shaper.frequency_hz: {given} = {ω:.4g} rad/s; likely given in rad/s"
            yield Diagnostic(text, "likely-unit")


def _unused(scene: Scene) -> Iterator[Diagnostic]:
    """Settings without effect."""
    for each in (_unused_drive, _unused_targets, _unused_keys_of_parts):
        for key, why in each(scene):
            yield Diagnostic(f"{key}; {why}", "no-effect")


Unused = Iterator[tuple[str, str]]  # what has no effect, and why


def _unused_drive(scene: Scene) -> Unused:
    """Springs of rigid links bend no further; a prescribed joint gets the torque that its motion requires."""
    if scene.initial.passive == "static" and not any(link.elastic for link in scene.arm.links):
        yield "initial.passive = 'static': has no effect", "all links are rigid"
    drive = scene.drive
    for motion in scene.motion:
        k = scene.arm.number(motion.link) - 1
        keys = ["torque"] if drive.torque and drive.torque[k] else []
        keys += ["torques"] if any(row[k] for row in drive.torques or ()) else []
        for key in keys:
            yield f"drive.{key}: has no effect on {motion.link!r}", "the motion of this joint is prescribed"


def _unused_targets(scene: Scene) -> Unused:
    """A locked joint stays at its initial position, whatever its target."""
    drive, reference = scene.drive, scene.drive.reference
    targets = {"target_deg": drive.target_deg, "target_m": drive.target_m}
    targets |= {f"reference.{key}": getattr(reference, key, None) for key in ("to_deg", "to_m")}
    for key, values in targets.items():
        for k, link in enumerate(scene.arm.links):
            if link.joint.locked and values and values[k] and values[k] != scene.starts[k]:
                path = scene.arm.path(k + 1, f"drive.{key}")
                why = f"the joint of {link.name!r} is locked; set joint.locked = false"
                yield f"{path} = {values[k]:g}: has no effect", why


def _tip_without_length(scene: Scene) -> Iterator[Diagnostic]:
    """Warn about a payload or wrench at the arm's tip if the last link, such as a wheel, has zero length."""
    arm, last = scene.arm, scene.arm.links[-1]
    if len(arm.tips) < 2 or any(last.stop) or last.line is not None:
        return
    others = ", ".join(repr(arm.links[number - 1].name) for number in arm.tips[:-1])
    where = f"at {last.name!r}, the last link, which has zero length; other tips: {others}"
    if arm.tip.mass or any(arm.tip.inertia):
        text = f"tip: the payload is {where}; move it to the end of another link, or list that link last"
        yield Diagnostic(text, "tip-without-length")
    if scene.wrench.acts and not scene.wrench.on:
        yield Diagnostic(f"wrench: acts {where}; set wrench.on to choose another", "tip-without-length")


def _falling_base(scene: Scene) -> Iterator[Diagnostic]:
    """A free base falls under the default gravity, which is easily forgotten for an arm in orbit."""
    if scene.arm.base.free and any(scene.gravity) and not scene.wrench.acts:
        text = f"gravity = {list(scene.gravity)}: the free base is unsupported and falls; for an orbit set [0, 0, 0]"
        yield Diagnostic(text, "base-falls")


def _few_hinges(scene: Scene) -> Iterator[Diagnostic]:
    """Warn about strain gauges on links with fewer hinges than the parabolic moment of a uniform load needs: three."""
    placed = hinges_of(scene.arm)
    for sensor in scene.sensor:
        if sensor.kind == "strain" and (found := len(placed[scene.arm.number(sensor.link) - 1][0])) < 3:
            course = "1 hinge, so its strain is constant" if found == 1 else "2 hinges, so its strain varies linearly"
            text = f"sensor.{sensor.name}: link {sensor.link!r} has only {course}; use 5 segments or more"
            yield Diagnostic(text, "few-hinges")


def _unused_keys_of_parts(scene: Scene) -> Unused:
    for k, link in enumerate(scene.arm.links, 1):
        if link.drag is not None and scene.air_density is None:
            yield f"{scene.arm.path(k)}.drag: has no effect", "there is no air; give air_density = 1.2, or leave it out"
        for key, value, why in _idle(link):
            yield f"{scene.arm.path(k)}.{key} = {value!r}: has no effect", why
    for key, body in bodies(scene.arm):
        if any(body.center) and not body.mass:
            yield f"{key}.center = {body.center!r}: has no effect", "the body has no mass"


def _idle(link: Link) -> Iterator[tuple[str, object, str]]:
    if link.flex == "rigid" and link.damping is not None:
        yield "damping.ratio", link.damping.ratio, f"{link.name!r} is rigid"
    if link.flex == "rigid" and link.friction is not None:
        yield "friction.coulomb", link.friction.coulomb, f"{link.name!r} is rigid"
    if link.up is not None and link.material is None:
        yield "up", link.up, f"{link.name!r} has no section"
    if link.joint.locked:
        for key in ("viscous", "coulomb", "armature"):
            value = getattr(link.joint, key)
            if value != getattr(Joint(), key):
                yield f"joint.{key}", value, f"the joint of {link.name!r} is locked"


def is_free_fall(scene: Scene) -> bool:
    """Whether gravity acts and no joint is driven, held or braked."""
    free = [link.joint for link in scene.arm.links if not link.joint.locked]
    braked = any(joint.viscous or joint.coulomb for joint in free)
    return bool(free) and scene.drive.kind == "none" and not scene.motion and any(scene.gravity) and not braked


def slack_springs(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if joints are held against gravity while the springs of links and gears start slack."""
    drive, initial = scene.drive, scene.initial
    fed = f"drive.gravity = {drive.gravity!r}" if drive.kind in {"pd", "cascade"} else f"drive.kind = {drive.kind!r}"
    holds = drive.kind == "computed_torque" or drive.gravity != "none"
    if not holds or initial.passive != "zero" or initial.q is not None or not any(scene.gravity):
        return
    if hints(scene):  # a wrong unit explains a large drop better
        return
    chain = lump(scene)
    q = _angles(scene, chain)
    bent = q - deflections(chain, gravity_torque(chain, q))  # to first order
    drop = float(np.linalg.norm(tip_position(chain, bent) - tip_position(chain, q)))
    if drop > 1e-4 * chain.size:  # a smaller drop is hardly visible
        slack = f"initial.passive = 'zero', the default: the springs start slack while {fed} holds the joints"
        drops = f"so the tip drops by about {1e3 * drop:.3g} mm at t = 0 and swings; set initial.passive = 'static'"
        yield Diagnostic(f"{slack}, {drops}", "springs-start-slack")


def unheld_joints(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if undriven joints fall while others are driven."""
    if scene.drive.kind == "none" or not any(scene.gravity):
        return
    moved, drive = {scene.arm.number(motion.link) for motion in scene.motion}, scene.drive
    driven = [row for row in (drive.torque, drive.kp, drive.kd, *(drive.torques or ())) if row is not None]
    chain, pulls = _pulls(scene)
    names, small = [], _small(chain)
    for k, number, pulled in pulls:
        joint = scene.arm.links[number - 1].joint
        held = joint.viscous or joint.coulomb or any(row[number - 1] for row in driven)
        if number not in moved and pulled > small[k] and not held:
            names.append(scene.arm.links[number - 1].name)
    if names:
        remedy = "add a torque, gains or friction there, or set joint.locked = true"
        why = f"drive.kind = {scene.drive.kind!r}: gravity moves {short_list(names)}, with no drive or friction"
        yield Diagnostic(f"{why}; {remedy}", "joint-unheld")


def weak_gains(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if gains do not hold the initial configuration within a radian; they may have been given per degree."""
    drive = scene.drive
    if drive.kind != "pd" or drive.kp is None or drive.gravity != "none" or not any(scene.gravity):
        return
    chain, pulls = _pulls(scene)
    for joint, k, needed in pulls:
        gain = drive.kp[k - 1]
        if not chain.slides[joint] and 0 < gain < needed:
            weight = f"the weight, {needed:.3g} N m"
            why = f"{scene.arm.path(k, 'drive.kp')} = {gain:g} N m/rad: {weight}, turns the joint by more than 1 rad"
            remedy = f"set drive.gravity = 'rigid', or a larger gain; if meant per degree, {math.degrees(gain):.4g}"
            yield Diagnostic(f"{why}; {remedy}", "weak-drive")


def weak_drives(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if a torque limit does not hold the initial configuration; it may have been given in kN m."""
    effort = scene.drive.effort
    if effort is None or not any(scene.gravity):
        return
    chain, pulls = _pulls(scene)
    for k, number, needed in pulls:
        limit, unit = effort[number - 1], chain.torque_units[k]
        if limit < needed:
            # a limit below a twentieth of the holding torque suggests a wrong unit
            in_k = f", or if given in k{unit}, {1000 * limit:g} {unit}" if 20 * limit < needed <= 1000 * limit else ""
            takes = f"holding the initial configuration takes {needed:.3g} {unit}, so the joint gives way"
            text = f"{scene.arm.path(number, 'drive.effort')} = {limit:g} {unit}: {takes}; give a larger limit{in_k}"
            yield Diagnostic(text, "weak-drive")


def balance(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if an arm starts at rest in equilibrium: it never moves, or only after a long time."""
    initial = scene.initial
    acts = scene.drive.kind != "none" or scene.motion or scene.wrench.acts or scene.joint_rates.any() or initial.qd
    if acts or initial.q is not None or initial.passive != "zero" or not any(scene.gravity):
        return
    chain = lump(scene)
    q = _angles(scene, chain)
    small = _small(chain)
    if (np.abs(gravity_torque(chain, q) + elastic_torque(chain, q)) > small).any():
        return
    if not (np.abs(gravity_torque(chain, q + 0.1)) > small).any():
        return  # gravity drives no joint in any configuration
    unstable = False
    if chain.n <= 300:  # with more joints, eigenvalues take seconds
        K = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
        unstable = bool(np.isfinite(K).all() and np.linalg.eigvalsh(K)[0] < 0)
    how = "in unstable equilibrium and hardly moves for a long time" if unstable else "in equilibrium and stays there"
    text = f"initial.joint_deg = {list(initial.joint_deg)}: the arm starts {how}; change the angles, or apply a load"
    yield Diagnostic(text, "unstable-equilibrium" if unstable else "equilibrium")


def _angles(scene: Scene, chain: Chain) -> Array:
    """Initial joint coordinates, springs slack [rad, m]."""
    q, starts = chain.rest.copy(), scene.joint_positions
    q[chain.active] = [starts[chain.coordinates[int(k)].link - 1] for k in chain.active]
    return q


def _pulls(scene: Scene) -> tuple[Chain, list[tuple[int, int, float]]]:
    """The chain, and for each driven joint its index, the number of its link, and the load of gravity at the start."""
    chain = lump(scene)
    pulled = np.abs(gravity_torque(chain, _angles(scene, chain)))
    return chain, [(k, chain.coordinates[k].link, float(pulled[k])) for k in chain.active.tolist()]


def _small(chain: Chain) -> Array:
    """Load of gravity below which a joint hardly moves, (n,): 0.2 % of the largest that the arm's weight can exert."""
    return np.asarray(2e-3 * chain.weight * np.where(chain.slides, 1.0, chain.size))
