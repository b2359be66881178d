"""References of drives: moves within limits, tables and refused values, all as exact piecewise polynomials."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flexlink as fl
from flexlink.describe.profiles import MOVES
from flexlink.describe.reference_trajectory import ReferenceTrajectory, still
from flexlink.motion.inputs.references import reference_arrays
from tests.conftest import make_scene
from tests.support.words import refused, reviewed

EPS = np.finfo(float).eps
MAY_LIMIT = {
    "quintic": ("max_rate_deg", "max_acceleration_deg", "max_jerk_deg"),
    "trapezoidal": ("max_rate_deg", "max_acceleration_deg"),
    "s_curve": ("max_rate_deg", "max_acceleration_deg", "max_jerk_deg"),
}
ZV = fl.InputShaper(kind="ZV", frequency_hz=(2.0,))
TABLE = {"times": (0.0, 0.5, 2.0), "angle_deg": ((0.0,), (30.0,), (-10.0,))}
Move = tuple[fl.Reference, tuple[float, ...]]


@st.composite
def moves(draw: st.DrawFn, limited: bool | None = None) -> Move:
    """A move of a few joints, of given duration or within limits, and its start [deg]."""
    profile, joints = draw(st.sampled_from(sorted(MAY_LIMIT))), draw(st.integers(1, 3))
    start, to = (tuple(round(draw(st.floats(-180, 180)), 3) for _ in range(joints)) for _ in range(2))
    how: dict[str, object] = {"duration": draw(st.floats(0.05, 20))}
    if draw(st.booleans()) if limited is None else limited:
        how = {name: tuple(draw(st.floats(0.1, 1e4)) for _ in range(joints)) for name in MAY_LIMIT[profile]}
    return fl.Reference(profile=profile, to_deg=to, start=draw(st.floats(0, 5)), **how), start


def derivatives(course: ReferenceTrajectory, number: int) -> list[ReferenceTrajectory]:
    """The reference, its rate, its acceleration, …, each as a trajectory."""
    found = [course]
    for _ in range(number):
        c = found[-1].coefficients
        found.append(
            ReferenceTrajectory(course.knots, c[:, 1:] * np.arange(1, c.shape[1])[:, None] if c.shape[1] > 1 else 0 * c)
        )
    return found


def peaks(course: ReferenceTrajectory, number: int = 3) -> np.ndarray:
    """Exact largest |value| of the reference and its first `number` derivatives, shape (number + 1, d)."""
    return np.array([np.abs(each.extremes()).max(axis=0) for each in derivatives(course, number)])


def came_to(course: ReferenceTrajectory, piece: int) -> np.ndarray:
    """Angle, rate and acceleration at the end of a piece, shape (3, d)."""
    x = course.knots[piece + 1] - course.knots[piece]
    c = [each.coefficients[piece] for each in derivatives(course, 2)]
    return np.array([(part * x ** np.arange(len(part))[:, None]).sum(axis=0) for part in c])


@pytest.mark.slow
@given(moves())
def test_a_move_starts_and_ends_at_rest_at_the_given_angles(move: Move) -> None:
    """The last polynomial also ends there, up to the rounding of a dozen products and of the end time."""
    reference, start = move
    course = reference.course(start)
    a, b = np.radians(start), np.radians(reference.to_deg)
    end = course.knots[-1]
    np.testing.assert_array_equal(course([-1.0, reference.start, end, end + 1.0])[0], [a, a, b, b])
    assert not np.any(course([-1.0, end, end + 1.0])[1:])
    if len(course.knots) > 1:
        assert not course(reference.start)[1].any()
        angle, rate, acceleration = came_to(course, -2)
        largest = peaks(course)
        np.testing.assert_array_less(np.abs(angle - b), 16 * EPS * (largest[0] + np.abs(a)) + 1e-300)
        assert np.all(np.abs(rate) <= 16 * EPS * (largest[1] + end * largest[2]))
        if reference.profile != "trapezoidal":
            assert np.all(np.abs(acceleration) <= 64 * EPS * (largest[2] + end * largest[3]))


@pytest.mark.slow
@given(moves(limited=True))
def test_no_limit_is_exceeded_and_the_slowest_joint_reaches_a_limit(move: Move) -> None:
    """Limits are checked at and between the exact extremes of every piece; knots are rounded by ε of their time."""
    reference, start = move
    course = reference.course(start)
    if len(course.knots) == 1:
        return
    given = np.radians([getattr(reference, name) for name in MAY_LIMIT[reference.profile]])
    largest = peaks(course)
    shortest = np.diff(course.knots).min()
    rounding = 64 * EPS * (1 + course.knots[-1] / shortest)
    used = largest[1 : len(given) + 1] / given
    assert used.max() <= 1 + rounding
    assert used.max() >= 1 - rounding
    t = np.linspace(reference.start, course.knots[-1], 300)
    for values, most in zip(course(t)[1:], given, strict=False):
        assert np.all(np.abs(values) <= most * (1 + rounding))


@pytest.mark.parametrize("profile", sorted(MOVES))
def test_joints_start_and_end_together_with_time_scaled_profiles(profile: str) -> None:
    """Profiles are stretched to the duration of the slowest joint; a joint without a move keeps its exact value."""
    own = dict.fromkeys(MAY_LIMIT[profile], (60.0, 60.0, 60.0))
    course = fl.Reference(profile=profile, to_deg=(90.0, -20.0, 7.0), **own).course((0.0, 0.0, 7.0))
    alone = [fl.Reference(profile=profile, to_deg=(to,), **dict.fromkeys(own, (60.0,))) for to in (90.0, -20.0)]
    slow, fast = (each.course((0.0,)) for each in alone)
    T = course.knots[-1]
    assert abs(T - slow.knots[-1]) <= 8 * EPS * T
    t = np.linspace(0, T, 200)
    np.testing.assert_allclose(course(t)[0][:, 0], slow(t)[0][:, 0], atol=1e-14)
    np.testing.assert_allclose(course(t)[0][:, 1], fast(t / T * fast.knots[-1])[0][:, 0], atol=1e-14)
    assert np.all(course(t)[0][:, 2] == np.radians(7.0))


def test_short_moves_have_no_cruise_and_shorter_ones_no_constant_acceleration() -> None:
    """The distance is a t_a² for a trapezoid without cruise, 2 j t_j³ for an S-curve without constant acceleration."""
    triangle = fl.Reference(profile="trapezoidal", to_deg=(9.0,), max_rate_deg=(10.0,), max_acceleration_deg=(4.0,))
    assert triangle.course((0.0,)).knots[1:].tolist() == [0.0, 1.5, 3.0]
    most = {"max_rate_deg": (10.0,), "max_acceleration_deg": (10.0,), "max_jerk_deg": (1.0,)}
    course = fl.Reference(profile="s_curve", to_deg=(16.0,), **most).course((0.0,))
    np.testing.assert_allclose(course.knots[1:], [0.0, 2.0, 4.0, 6.0, 8.0], rtol=4 * EPS)
    np.testing.assert_allclose(np.degrees(peaks(course)[1:, 0]), [4.0, 2.0, 1.0], rtol=16 * EPS)


def test_a_move_of_given_duration_has_ramps_of_one_third() -> None:
    """For D = T = 1: trapezoid v = 3/2, a = 9/2; S-curve a = 27/4, j = 243/4; quintic v = 15/8, a = 10/√3, j = 60."""
    D, T = np.radians(40.0), 1.5
    wanted = {"quintic": (15 / 8, 10 / np.sqrt(3), 60.0), "trapezoidal": (1.5, 4.5), "s_curve": (1.5, 6.75, 60.75)}
    for profile, ratios in wanted.items():
        course = fl.Reference(profile=profile, to_deg=(50.0,), duration=T, start=0.25).course((10.0,))
        found = peaks(course)[1:, 0] * T ** np.arange(1, 4) / D
        np.testing.assert_allclose(found[: len(ratios)], ratios, rtol=1e-13)
        assert course.knots[-1] == pytest.approx(1.75, rel=4 * EPS)


def test_a_linear_table_is_straight_between_its_times_and_constant_outside() -> None:
    course = fl.Reference(profile="linear", **TABLE).course((5.0,))
    angle, rate, acceleration = course([-1.0, 0.25, 1.25, 2.0, 9.0])
    np.testing.assert_allclose(np.degrees(angle[:, 0]), [0.0, 15.0, 10.0, -10.0, -10.0], rtol=4 * EPS)
    np.testing.assert_allclose(np.degrees(rate[:, 0]), [0.0, 60.0, -40.0 / 1.5, 0.0, 0.0], rtol=4 * EPS)
    assert not acceleration.any()
    assert course.jumps.tolist() == [0.0, 0.5, 2.0]


def test_a_held_table_jumps_without_a_ramp() -> None:
    course = fl.Reference(profile="hold", **TABLE).course((5.0,))
    angle, rate, _ = course([0.0, np.nextafter(0.5, 0), 0.5, 1.9, 2.0, 9.0])
    np.testing.assert_array_equal(angle[:, 0], np.radians([0.0, 30.0, 30.0, 30.0, -10.0, -10.0]))
    assert not rate.any()
    np.testing.assert_allclose(course.jumps, [0.5, 2.0], rtol=10 * EPS)


@pytest.mark.parametrize(("known", "smooth"), [(1, 2), (2, 1), (3, 2)])
def test_a_smooth_table_passes_through_all_its_values_with_continuous_derivatives(known: int, smooth: int) -> None:
    names = ("angle_deg", "rate_deg", "acceleration_deg")
    rows = {"angle_deg": ((0.0,), (30.0,), (-10.0,)), "rate_deg": ((0.0,), (12.0,), (0.0,)),
            "acceleration_deg": ((0.0,), (-7.0,), (0.0,))}  # fmt: skip
    course = fl.Reference(
        profile="smooth", times=TABLE["times"], **{name: rows[name] for name in names[:known]}
    ).course((0.0,))
    found = np.degrees(course(TABLE["times"]))
    for k in range(known):
        np.testing.assert_allclose(found[k], rows[names[k]], atol=1e-12)
    for piece in range(len(course.knots) - 1):
        before, after = came_to(course, piece), np.array(course(course.knots[piece + 1]))
        inside = slice(smooth + 1) if 0 < piece < len(course.knots) - 2 else slice(2)
        np.testing.assert_allclose(before[inside], after[inside], atol=1e-12)
    assert course.jumps.size == 0


@pytest.mark.slow
@given(st.integers(0, 2**32))
def test_extremes_are_the_largest_and_smallest_values_of_all_pieces(seed: int) -> None:
    """The extremes are compared with a thousand samples per piece, which miss an extreme by up to max |r̈| dt²/8."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.1, 1.0, 5))
    parts = [tuple(map(tuple, rng.uniform(-90, 90, (5, 2)))) for _ in range(3)]
    parts[1] = (0.0, 0.0), *parts[1][1:-1], (0.0, 0.0)
    table = dict(zip(("angle_deg", "rate_deg", "acceleration_deg"), parts, strict=True))
    course = fl.Reference(profile="smooth", times=tuple(t), **table).course((0.0, 0.0))
    sampled = course(np.linspace(t[0], t[-1], 4001))[0]
    low, high = course.extremes()
    passed = peaks(course)[2] * ((t[-1] - t[0]) / 4000) ** 2 / 8
    for found, seen in ((high, sampled.max(axis=0)), (-low, -sampled.min(axis=0))):
        assert np.all(found >= seen - 64 * EPS * peaks(course)[0])
        assert np.all(found <= seen + passed + 64 * EPS * peaks(course)[0])


def test_a_reference_restated_on_other_knots_is_unchanged(rng: np.random.Generator) -> None:
    """A Taylor shift of a quintic has about twenty sums, so its error is below 64 ε times the largest term."""
    course = fl.Reference(profile="quintic", to_deg=(90.0, -45.0), duration=1.0).course((0.0, 10.0))
    knots = np.union1d(course.knots, rng.uniform(0, 1.2, 9))
    other = ReferenceTrajectory(knots, course.restated(knots))
    t = np.linspace(-0.5, 2.0, 500)
    for ours, theirs in zip(other(t), course(t), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=64 * EPS * 60)


REFUSED = {
    "no time": ({"profile": "quintic", "to_deg": (9.0,)}, "missing-key", "duration"),
    "two times": ({"profile": "quintic", "to_deg": (9.0,), "duration": 1.0, "max_rate_deg": (1.0,)}, "both-given",
                  "duration = 1.0: max_rate_deg"),
    "no acceleration": ({"profile": "trapezoidal", "to_deg": (9.0,), "max_rate_deg": (1.0,)}, "missing-key",
                        "max_acceleration_deg"),
    "no jerk": ({"profile": "s_curve", "to_deg": (9.0,), "max_acceleration_deg": (1.0,)}, "missing-key",
                "max_jerk_deg"),
    "a trapezoid's jerk": ({"profile": "trapezoidal", "to_deg": (9.0,), "duration": 1.0, "max_jerk_deg": (1.0,)},
                           "key-of-another-kind", "max_jerk_deg = (1.0,)"),
    "no goal": ({"profile": "quintic", "duration": 1.0}, "missing-key", "to_deg"),
    "limit of zero": ({"profile": "quintic", "to_deg": (9.0,), "max_rate_deg": (0.0,)}, "out-of-range",
                      "max_rate_deg.1 = 0.0"),
    "a table's goal": ({"profile": "hold", **TABLE, "to_deg": (1.0,)}, "key-of-another-kind", "to_deg = (1.0,)"),
    "unsorted": ({"profile": "linear", **TABLE, "times": (0.0, 3.0, 2.0)}, "times-not-increasing", "times[2] = 2.0"),
    "a repeated time": ({"profile": "linear", **TABLE, "times": (0.0, 0.0, 2.0)}, "times-not-increasing",
                        "times[1] = 0.0"),
    "nan as time": ({"profile": "linear", **TABLE, "times": (0.0, np.nan, 2.0)}, "not-finite", "times[1] = nan"),
    "a gap": ({"profile": "linear", **TABLE, "angle_deg": ((0.0,), (np.nan,), (1.0,))}, "not-finite",
              "angle_deg[1].1 = nan"),
    "a row too few": ({"profile": "linear", **TABLE, "angle_deg": ((0.0,), (1.0,))}, "one-per-time", "angle_deg"),
    "an empty row": ({"profile": "linear", **TABLE, "angle_deg": ((0.0,), None, (1.0,))}, "wrong-value",
                     "angle_deg[1] = None"),
    "nothing": ({"profile": "linear", "times": (), "angle_deg": ()}, "file-empty", "times = ()"),
    "no rates": ({"profile": "smooth", **TABLE, "acceleration_deg": TABLE["angle_deg"]}, "missing-key",
                 "rate_deg"),
    "misspelt": ({"profile": "quintik", "to_deg": (9.0,)}, "wrong-value", "'quintic'?"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_bad_reference_is_refused_by_key_and_row(what: str) -> None:
    fields, id, part = REFUSED[what]
    with refused(fl.errors.SceneError, id) as caught:
        fl.Reference(**fields)
    assert part in str(caught.value)


def test_references_that_do_not_fit_the_arm_or_float64_are_refused() -> None:
    with refused(fl.errors.SceneError, "one-per-link"):
        fl.Reference(profile="linear", **TABLE).course((0.0, 0.0))
    with refused(fl.errors.SceneError, "overflow"):
        fl.Reference(profile="linear", **TABLE | {"times": (0.0, 5e-324, 1.0)}).course((0.0,))
    with refused(fl.errors.SceneError, "start-too-late"):
        fl.Reference(profile="quintic", to_deg=(1.0,), start=100.0, duration=1e-15).course((0.0,))


def test_a_trajectory_from_coefficients_is_checked() -> None:
    for knots, c, id in (
        ([0.0, 1.0], np.zeros((1, 1, 1)), "wrong-shape"),
        ([0.0, 0.0], np.zeros((2, 1, 1)), "times-not-increasing"),
        ([0.0], np.full((1, 1, 1), np.inf), "overflow"),
        ([0.0], np.ones((1, 2, 1)), "not-at-rest"),
    ):
        with refused(fl.errors.ArgumentError, id):
            ReferenceTrajectory(knots, c)
    text = repr(still([1.0, 2.0]))
    reviewed("repr: reference", text)
    assert re.findall(r"\d+", text) == ["2", "1", "0", "0", "0"]


def driven(reference: fl.Reference, **fields: object) -> fl.Scene:
    """Three joints with PD drives; the middle joint is locked, the others have limits."""
    near, far = fl.Joint(limits_deg=(-90.0, 45.0)), fl.Joint(limits_deg=(-10.0, 10.0))
    links = fl.Link(name="near", length=1.0, joint=near), fl.Link(name="mid", joint=fl.Joint(locked=True))
    drive = fl.Drive(kind="pd", kp=(9.0, 0.0, 9.0), kd=(1.0, 0.0, 1.0), reference=reference)
    fields = {"initial": fl.InitialState(joint_deg=(5.0, 30.0, -5.0)), "drive": drive, **fields}
    return make_scene(*links, fl.Link(name="far", length=1.0, joint=far), tip=fl.RigidBody(mass=1.0), **fields)


def test_a_reference_moves_free_joints_from_their_initial_angles() -> None:
    scene = driven(fl.Reference(profile="quintic", to_deg=(40.0, 0.0, 7.0), duration=1.0))
    for arrays in (scene.course, reference_arrays(scene, fl.lump(scene))):
        np.testing.assert_allclose(
            np.degrees(arrays.coefficients[[0, -1], 0]), [[5.0, -5.0], [40.0, 7.0]], rtol=4 * EPS
        )
    assert driven(fl.Reference(profile="quintic", to_deg=(45.0, 0.0, -10.0), duration=1.0)), "may end at limits"


OUT = {
    "a move": (fl.Reference(profile="quintic", to_deg=(46.0, 0.0, 0.0), duration=1.0),
               "wrench-out-of-reach", (" 46 deg", "limits_deg = [-90.0, 45.0]", "'near'")),
    "between rows": (fl.Reference(profile="smooth", times=(0.0, 1.0, 2.0, 3.0),
                                  angle_deg=((0.0, 0.0, 0.0), (0.0, 0.0, 9.9), (0.0, 0.0, 9.9), (0.0, 0.0, 0.0))),
                     "wrench-out-of-reach", (" 12.375 deg", "limits_deg = [-10.0, 10.0]", "'far'")),
    "a jump within a step": (fl.Reference(profile="hold", times=(0.0, 0.10003), angle_deg=((0.0,) * 3, (1.0,) * 3)),
                             "not-a-multiple", ("drive.reference ", "t = 0.10003", "run.step")),
    "an unknown shaper": (fl.Reference(profile="quintic", to_deg=(1.0,) * 3, duration=1.0,
                                      shaper=fl.InputShaper(kind="ZZ", frequency_hz=(1.0,))),
                         "unknown-name", ("drive.reference.shaper.kind = 'ZZ'",)),
    "a link too few": (fl.Reference(profile="quintic", to_deg=(1.0, 1.0), duration=1.0),
                       "one-per-link", ("drive.reference.to_deg = (1.0, 1.0)", " 3")),
}  # fmt: skip


@pytest.mark.parametrize("what", OUT)
def test_a_reference_that_does_not_fit_the_scene_is_refused(what: str) -> None:
    reference, id, parts = OUT[what]
    with refused(fl.errors.SceneError, id) as caught:
        driven(reference)
    assert all(part in str(caught.value) for part in parts)


def test_a_shaper_with_negative_impulses_that_exceeds_joint_limits_is_refused(tmp_path: Path) -> None:
    """For a jump from −5° to 9° with impulses 2, −2, 1, the first impulse leads to −5° + 2 · 14° = 23°."""
    path = tmp_path / "own.toml"
    rule = 'about = "a"\nsource = "b"\nzeros = 0\nhalf_periods = [0, 0.5, 1]\nweights = [2, -2, 1]\n'
    path.write_text(rule, encoding="utf-8")
    shaper = fl.InputShaper(kind=str(path), frequency_hz=(1.0,))
    move = fl.Reference(profile="quintic", to_deg=(5.0, 0.0, 9.0), duration=1e-3, shaper=shaper)
    with refused(fl.errors.SceneError, "wrench-out-of-reach"):
        driven(move)


def test_a_reference_may_jump_with_adaptive_steps() -> None:
    jump = fl.Reference(profile="hold", times=(0.0, 0.10003), angle_deg=((0.0,) * 3, (1.0,) * 3))
    assert driven(jump, run=fl.RunSettings(tolerance=1e-4)).course is not None


def test_the_start_of_a_reference_is_required_if_the_run_starts_elsewhere() -> None:
    move, here = {"profile": "quintic", "to_deg": (1.0,) * 3, "duration": 1.0}, (0.0, 0.0)
    with refused(fl.errors.SceneError, "missing-key"):
        driven(fl.Reference(**move), initial=fl.InitialState(q=here))
    scene = driven(fl.Reference(**move), initial=fl.InitialState(q=here, joint_deg=(5.0, 30.0, -5.0)))
    with refused(fl.errors.SceneError, "missing-key"):
        reference_arrays(scene, fl.lump(scene))
    later = scene.varied({"initial.time": 1.0})  # a continued run keeps the reference of the first run
    np.testing.assert_array_equal(reference_arrays(later, fl.lump(later)).knots, scene.course.knots)
    given_here = driven(fl.Reference(**move, from_deg=(0.0,) * 3), initial=fl.InitialState(q=here))
    assert not reference_arrays(given_here, fl.lump(given_here)).coefficients[0].any()


def test_a_pd_drive_needs_exactly_one_target() -> None:
    gains = {"kind": "pd", "kp": (9.0,), "kd": (1.0,)}
    move = fl.Reference(profile="quintic", to_deg=(9.0,), duration=1.0)
    with refused(fl.errors.SceneError, "missing-key"):
        fl.Drive(**gains)
    with refused(fl.errors.SceneError, "both-given"):
        fl.Drive(**gains, target_deg=(9.0,), reference=move)
    with refused(fl.errors.SceneError, "key-of-another-kind"):
        fl.Drive(kind="constant", torque=(1.0,), reference=move)


def test_parts_of_a_reference_are_varied_by_path() -> None:
    scene = driven(fl.Reference(profile="quintic", to_deg=(40.0, 0.0, 7.0), duration=1.0))
    fields = {"drive.reference.to_deg.far": -3.0, "drive.reference.profile": "s_curve", "drive.reference.shaper": ZV}
    other = scene.varied(fields).drive.reference
    assert other == fl.Reference(profile="s_curve", to_deg=(40.0, 0.0, -3.0), duration=1.0, shaper=ZV)


def test_a_shaper_file_is_searched_next_to_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rule = 'about = "a"\nsource = "b"\nzeros = 1\nhalf_periods = [0, 1]\nweights = [1, 1]\n'
    (tmp_path / "own.toml").write_text(rule, encoding="utf-8")
    move = fl.Reference(profile="quintic", to_deg=(40.0, 0.0, 7.0), duration=1.0, shaper=ZV)
    text = driven(move).to_toml().replace('"ZV"', '"own.toml"')
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    scene = fl.load_scene(tmp_path / "scene.toml")
    np.testing.assert_array_equal(scene.course.knots, driven(move).course.knots)
    monkeypatch.chdir("/")
    assert fl.load_scene(tmp_path / "scene.toml") == scene
    (tmp_path / "own.toml").write_text(rule.replace("zeros = 1", "zeros = 2"), encoding="utf-8")
    with refused(fl.errors.DataFileError, "shaper-zeros"):
        fl.load_scene(tmp_path / "scene.toml")


def test_a_reference_below_a_lower_limit_is_refused() -> None:
    rod = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))
    move = {"profile": "quintic", "to_deg": [-46.0], "duration": 1.0}
    drive = {"kind": "pd", "kp": [9.0], "kd": [1.0], "reference": move}
    with refused(fl.errors.SceneError, "wrench-out-of-reach"):
        rod.varied({"link.rod.joint.limits_deg": (-45.0, 90.0), "drive": drive})
