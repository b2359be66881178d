"""Check that a scene's parts are consistent: one number per link, joints within limits, jumps only at step ends.

Messages name the path, the value and what is allowed. `wrong_lists` yields all mistakes; other checks raise the first.
"""

from collections.abc import Iterator, Mapping, Sequence

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError, errors_at
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.actions import PrescribedMotion, Wrench
from flexlink.describe.arm import BASE, Arm
from flexlink.describe.drive import Drive
from flexlink.describe.hinges import hinges_of
from flexlink.describe.initial import BaseState, InitialState
from flexlink.describe.joint import outside_limits, refuse_beyond
from flexlink.describe.joint_units import OF_JOINT, misplaced
from flexlink.describe.numbers import whole
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.run_settings import RunSettings, check_method
from flexlink.describe.spec import check_all, fields_of, is_per_link, link_key


def wrong_lists(arm: Arm, initial: InitialState, drive: Drive) -> Iterator[Diagnostic]:
    """Mistakes in lists of one number per link: missing, wrong length or unit, or nonzero for a locked joint."""
    links, names = arm.links, [link.name for link in arm.links]
    reference = drive.reference.per_link if drive.reference is not None else {}
    parts: dict[str, InitialState | Drive] = {"initial": initial, "drive": drive}
    per_link: dict[str, tuple[float, ...] | None] = {
        f"{path}.{field.name}": getattr(part, field.name)
        for path, part in parts.items() for field in fields_of(type(part)) if is_per_link(field.type)
    }  # fmt: skip
    per_link |= {f"drive.torques[{k}]": row for k, row in enumerate(drive.torques or ())}
    per_link |= {f"drive.reference.{key}": row for key, row in reference.items() if len(row) == len(links)}
    allowed_for_locked = "initial.joint_", "drive.target_", "drive.effort", "drive.max_rate_"
    fitting = {}
    for key, values in per_link.items():
        if values is None:
            continue
        if len(values) != len(links):
            yield Diagnostic(f"{key} = {truncated(values)}: expected one number per link, {len(links)}", "one-per-link")
            continue
        fitting[key] = values
        for k, link in enumerate(links if not key.startswith("drive.reference.") else ()):
            if link.joint.locked and values[k] and not key.startswith(allowed_for_locked):
                path = f"{arm.path(k + 1, key)} = {values[k]!r}"
                yield Diagnostic(f"{path}: the joint of {link.name!r} is locked; must be 0", "locked-and-moving")
    for k, key, wrong in misplaced(arm.slides, names, fitting):
        if key.startswith("initial.") or not links[k].joint.locked:
            path = f"{arm.path(k + 1, key)} = {fitting[key][k]!r}"
            yield Diagnostic(f"{path}: {wrong}", "unit-of-joint")
    targets = {"target_deg": False, "target_m": True} if drive.controls and not reference else {}
    for key, slides in targets.items():
        aimed = [link.name for link in links if not link.joint.locked and link.joint.slides == slides]
        if aimed and getattr(drive, key) is None:
            yield Diagnostic(f"drive.{key}: missing; joint {aimed[0]!r} is {OF_JOINT[slides].name}", "missing-key")
    for k, each in enumerate(drive.filter):
        if each.link and each.link not in names:
            allowed = f"no such link; allowed are {', '.join(names)}{did_you_mean(each.link, names)}"
            yield Diagnostic(f"drive.filter[{k}].link = {each.link!r}: {allowed}", "unknown-name")


def check_limits(arm: Arm, initial: InitialState, names: Mapping[str, str]) -> None:
    """Check that joints start within their limits."""
    for k, (link, position) in enumerate(zip(arm.links, arm.own(initial.joint_deg, initial.joint_m), strict=True)):
        outside = outside_limits(link.name, link.joint, position)
        if outside and (initial.q is None or link.joint.locked):
            key = names["joint_m" if link.joint.slides else "joint_deg"].replace("joint_", "initial.joint_")
            raise SceneError(f"{arm.path(k + 1, key)} = {outside}", id="outside-limits")


def check_motions(arm: Arm, initial: InitialState, drive: Drive, motions: Sequence[PrescribedMotion]) -> None:
    """Check that each link has at most one prescribed motion, and that a link with a motion has no gains."""
    moved: set[int] = set()
    for motion in motions:
        number = _check_motion(arm, initial, motion)
        if number in moved:
            raise SceneError(f"motion.{motion.link}: the second motion of this link; give only one", id="motion-twice")
        moved.add(number)
        for name in ("kp", "kd", "ki", "inertia"):
            gains = getattr(drive, name)
            if gains is not None and gains[number - 1]:
                gain = f"{arm.path(number, f'drive.{name}')} = {gains[number - 1]!r}"
                text = f"{gain}: the motion of {motion.link!r} is prescribed; must be 0"
                raise SceneError(text, id="joint-prescribed")


def _check_motion(arm: Arm, initial: InitialState, motion: PrescribedMotion) -> int:
    """Check a motion, and return the number of the link that it moves."""
    path = f"motion.{link_key([str(motion.link)], 0)}"
    with errors_at(f"{path}.", ArgumentError):
        number = arm.number(motion.link)
    if arm.links[number - 1].joint.locked:
        raise SceneError(f"{path}: its joint is locked; a motion needs a free joint", id="motion-of-locked-joint")
    joint = arm.links[number - 1].joint
    if motion.slides != joint.slides:
        key, wanted = motion.keys[0], ", ".join(joint.terms.motion)
        given = f"{path}.{key} = {truncated(motion.columns[0])}"
        text = f"{given}: joint {arm.links[number - 1].name!r} is {joint.kind}; give {wanted}"
        raise SceneError(text, id="sensor-of-joint")
    position, *_ = motion.keys
    positions, rates = arm.own(initial.joint_deg, initial.joint_m), arm.own(initial.rate_deg, initial.rate_m)
    starts = (positions[number - 1], initial.q), (rates[number - 1], initial.qd)
    for key, (first, *_), (start, elsewhere) in zip(motion.keys, motion.columns, starts, strict=False):
        if start != first and initial.time == 0 and elsewhere is None:
            text = f"{path}.{key}[0] = {first!r}: must be the initial value, {start!r}"
            raise SceneError(text, id="start-differs-from-motion")
    middle = sum(joint.limits or (0.0, 0.0)) / 2
    k, value = max(enumerate(motion.columns[0]), key=lambda each: abs(each[1] - middle))
    if outside := outside_limits(arm.links[number - 1].name, joint, value):
        raise SceneError(f"{path}.{position}[{k}] = {outside}", id="outside-limits")
    return number


def check_base(arm: Arm, initial: InitialState, drive: Drive) -> None:
    """Refuse an initial state of a fixed base, and drives that assume a fixed base if the base is free."""
    free = arm.base.free
    if initial.base != BaseState() and not free:
        text = "leave it out, or give base = { kind = 'free', mass = …, inertia = … }"
        raise SceneError(f"initial.base: has no effect, the base is fixed; {text}", id="no-effect")
    if free and initial.passive == "static":
        text = "initial.passive = 'static': an arm on a free base has no equilibrium; leave passive out"
        raise SceneError(text, id="rest-of-free-base")
    for key, value in (("kind", drive.kind), ("gravity", drive.gravity)):
        if free and value in {"computed_torque", "rigid", "static"}:
            text = f"drive.{key} = {value!r}: assumes a fixed base, but the base is free"
            raise SceneError(f"{text}; use kind 'pd' without gravity, or a custom controller", id="drive-of-free-base")


def check_wrench(arm: Arm, wrench: Wrench) -> None:
    """Check that the wrench acts on a link without children."""
    on, tips = wrench.on, [arm.links[k - 1].name for k in arm.tips]
    if on and on not in tips:
        why = "no such link"
        if on == BASE:
            why = "is not a link; attach a locked link of zero length to it (link.on = 'base'), and name that"
        elif on in {link.name for link in arm.links}:
            why = "other links are attached to it; attach a locked link of zero length, and name that"
        text = f"wrench.on = {on!r}: {why}; allowed are {', '.join(tips)}{did_you_mean(on, tips)}"
        raise SceneError(text, id="unknown-name")


def check_reference(arm: Arm, drive: Drive, course: ReferenceTrajectory | None, run: RunSettings) -> None:
    """Check that the reference stays within the joint limits, even between knots, and jumps only at step ends."""
    if course is None or drive.reference is None:
        return
    if drive.reference.follows == "tip":
        for wrong, why in (
            (drive.kind != "pd", f"needs drive.kind = 'pd', not {drive.kind!r}"),
            (drive.torques is not None, "drive.torques are also given; leave them out"),
            (drive.gravity != "none", f"drive.gravity = {drive.gravity!r} is also given; leave it out"),
            (drive.reference.shaper is not None, "drive.reference.shaper is also given; leave it out"),
        ):
            if wrong:
                id = "both-given" if drive.kind == "pd" else "needs-pd"
                raise SceneError(f"drive.reference.follows = 'tip': {why}", id=id)
    with errors_at("drive.reference "):
        refuse_beyond(course, [(link.name, link.joint) for link in arm.links if not link.joint.locked])
        for time in [] if run.controlled or drive.rate else course.jumps:
            run.require_steps("has a jump in angle or rate: t", float(f"{time:.12g}"))


def check_rate(initial: InitialState, drive: Drive, run: RunSettings) -> None:
    """Check that the controller's sampling times match steps, samples and the start of the run."""
    rate = drive.rate
    if rate is None:
        return
    period = 1 / rate
    intervals = (run.label("sample", "run."), run.spacing), ("1 / rate", period)
    short_one, long = sorted(intervals, key=lambda interval: interval[1])
    try:
        run.require_steps("1 / rate", period)
        whole("initial.time", initial.time, "1 / rate", period)
        whole(*long, *short_one)
    except SceneError as error:
        fits = (k / rate for k in range(1, 1000) if not (run.duration * rate % k or initial.time * rate % k))
        written = [sample for sample in fits if float(f"{sample:g}") == sample]
        near = min(written, key=lambda sample: abs(sample - run.spacing), default=None)
        hint = f"; give run.sample, such as {near:g}" if near and run.sample is None and run.controlled else ""
        raise SceneError(f"drive.rate = {rate!r}: {error}{hint}") from None
    run.require_steps("drive.delay", drive.delay)


def check_grid(initial: InitialState, drive: Drive, wrench: Wrench, run: RunSettings) -> None:
    """Check that the start of the run, and the times of tables with `hold`, are multiples of the fixed step."""
    run.require_steps("initial.time", initial.time)
    for name, table in (("drive", drive), ("wrench", wrench)):
        for k, time in enumerate(table.times or () if table.hold else ()):
            run.require_steps(f"{name}.times[{k}]", time)


def check_named(arm: Arm, run: RunSettings) -> None:
    """Check that the lumping rules and the method named in a scene exist, and that they can be used in it."""
    check_all([lambda: hinges_of(arm), lambda: check_method(run)])
