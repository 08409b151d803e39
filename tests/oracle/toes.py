"""Reference motions of MuJoCo for a walker whose toes move (src/model/machine/toes_oracle.rs).

python3 -m venv v && v/bin/pip install mujoco==4.0.0 && v/bin/python tests/oracle/toes.py > tests/data/toes_mujoco.csv

MuJoCo gives mass matrix, bias forces and Jacobians of a robot with a floating hip, two legs, a body and two toes on
slide joints. Its own contacts are soft, so the constraints are solved here: the stance toe stands, the body bisects the
legs, the slides have the acceleration they are told. The landing is a rigid impulse at the swing toe, slides and body
still constrained. RK4 at 100 us; at 50 us no printed digit changes by more than one.
"""

import csv
import sys

import mujoco
import numpy as np

H = 1e-4
L, MASS, G = 1.045, 15.2, 9.81
C1, C2, C3, C4, C5, C6 = 0.1007, 0.1434, 0.000596, 0.1151, 0.1264, 0.0026
SHARES = (0.3, 0.3, 0.4)  # of the mass: inner leg, outer leg, body; they do not enter the motion
TINY = 1e-9  # a toe has no mass; MuJoCo asks for some
X, Z, INNER, OUTER, BODY, TOE = 0, 1, 2, 3, 4, 5  # TOE, TOE + 1: what each leg is shorter


def link(name, moment, inertia, share, up, inside=""):
    """About the hip: mass share, moment and inertia in units of MASS L and MASS L^2; the hinge turns by -y."""
    mass, centre = share * MASS, moment * L / share
    own = inertia * MASS * L**2 - mass * centre**2
    return (f'<body name="{name}"><joint name="{name}" type="hinge" axis="0 -1 0"/><inertial pos="0 0 {up * centre}" '
            f'mass="{mass}" diaginertia="{own} {own} {own}"/>{inside}</body>')


def toe(name):
    return (f'<body name="{name}" pos="0 0 {-L}"><joint name="{name}" type="slide" axis="0 0 1"/><inertial pos="0 0 0" '
            f'mass="{TINY}" diaginertia="{TINY} {TINY} {TINY}"/><site name="{name}"/></body>')


def robot():
    legs = (link("inner", C4, C1 - C3, SHARES[0], -1, toe("inner_toe"))
            + link("outer", C5, C2 - C3, SHARES[1], -1, toe("outer_toe")))
    body = link("body", 4 * C6, 4 * C3, SHARES[2], 1)
    xml = (f'<mujoco><option gravity="0 0 {-G}"/><worldbody><body name="hip"><joint name="x" type="slide" axis="1 0 0"/>'
           f'<joint name="z" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="{TINY}" '
           f'diaginertia="{TINY} {TINY} {TINY}"/>{legs}{body}</body></worldbody></mujoco>')
    return mujoco.MjModel.from_xml_string(xml)


MODEL = robot()
DATA = mujoco.MjData(MODEL)
# qpos follows the tree: x, z, inner, inner toe, outer, outer toe, body.
ORDER = [MODEL.joint(n).qposadr[0] for n in ("x", "z", "inner", "outer", "body", "inner_toe", "outer_toe")]


def look(q, v):
    DATA.qpos[ORDER], DATA.qvel[ORDER] = q, v
    mujoco.mj_forward(MODEL, DATA)
    mass = np.zeros((MODEL.nv, MODEL.nv))
    mujoco.mj_fullM(MODEL, DATA, mass)
    return mass[np.ix_(ORDER, ORDER)], DATA.qfrc_bias[ORDER].copy()


def toe_at(q, leg):
    """Place of a toe and its Jacobian, x and z."""
    DATA.qpos[ORDER] = q
    mujoco.mj_kinematics(MODEL, DATA)
    mujoco.mj_comPos(MODEL, DATA)
    name, jac = ("inner_toe", "outer_toe")[leg], np.zeros((3, MODEL.nv))
    mujoco.mj_jacSite(MODEL, DATA, jac, None, MODEL.site(name).id)
    return DATA.site(name).xpos[[0, 2]].copy(), jac[:, ORDER][[0, 2]]


def rows(toe_jacobian):
    """Stance or landing toe, the bisecting body, both slides."""
    body = np.zeros((1, 7))
    body[0, [INNER, OUTER, BODY]] = 0.5, 0.5, -1.0
    slides = np.zeros((2, 7))
    slides[0, TOE] = slides[1, TOE + 1] = 1.0
    return np.vstack((toe_jacobian, body, slides))


def constrained(mass, force, constraint, target):
    """Accelerations and the forces that keep `constraint a = target`."""
    k = len(constraint)
    kkt = np.block([[mass, -constraint.T], [constraint, np.zeros((k, k))]])
    solution = np.linalg.solve(kkt, np.concatenate((force, target)))
    return solution[:7], solution[7:]


def accelerations(q, v, stance, torque, slides):
    mass, bias = look(q, v)
    _, jac = toe_at(q, stance)
    step = 1e-5
    turning = (toe_at(q + step * v, stance)[1] - toe_at(q - step * v, stance)[1]) @ v / (2 * step)
    force = -bias
    force[INNER] += torque
    force[OUTER] -= torque
    return constrained(mass, force, rows(jac), np.concatenate((-turning, [0.0], slides)))


def step_rk4(q, v, h, *inputs):
    def slope(x):
        return np.concatenate((x[7:], accelerations(x[:7], x[7:], *inputs)[0]))

    x = np.concatenate((q, v))
    k1 = slope(x)
    k2 = slope(x + 0.5 * h * k1)
    k3 = slope(x + 0.5 * h * k2)
    k4 = slope(x + h * k3)
    x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x[:7], x[7:]


def start(stance, angles, rates, short):
    """The stance toe at the origin, at rest."""
    q, v = np.zeros(7), np.zeros(7)
    q[[INNER, OUTER]], q[BODY] = angles, sum(angles) / 2
    v[[INNER, OUTER]], v[BODY] = rates, sum(rates) / 2
    q[[TOE, TOE + 1]] = short
    place, jac = toe_at(q, stance)
    q[[X, Z]] -= place
    v[[X, Z]] -= jac @ v
    return q, v


def walk(case, stance, angles, rates, short, torque, slides, out):
    """Until the swing toe comes to the ground, falling. `slides`: from when, acceleration of each."""
    q, v = start(stance, angles, rates, short)
    swing, k = 1 - stance, 0
    while True:
        t = k * H
        inputs = (stance, torque(t), next(a for since, a in reversed(slides) if t >= since - 1e-9))
        if k % 500 == 0:
            force = accelerations(q, v, *inputs)[1][:2]
            out.writerow([case, "flow", f"{t:.9f}", *(f"{x:.9f}" for x in (*q[[2, 3]], *v[[2, 3]], *force)), "", ""])
        nq, nv = step_rk4(q, v, H, *inputs)
        place, jac = toe_at(nq, swing)
        if place[1] < 0 and (jac @ nv)[1] < 0 and t > 0.1:
            break
        q, v, k = nq, nv, k + 1
    low, high = 0.0, H
    for _ in range(50):
        mid = 0.5 * (low + high)
        if toe_at(step_rk4(q, v, mid, *inputs)[0], swing)[0][1] < 0:
            high = mid
        else:
            low = mid
    q, v = step_rk4(q, v, high, *inputs)
    mass, _ = look(q, v)
    _, jac = toe_at(q, swing)
    before = jac @ v
    after, impulse = constrained(mass, mass @ v, rows(jac), np.concatenate(([0.0, 0.0, 0.0], v[[TOE, TOE + 1]])))
    values = (*q[[2, 3]], *after[[2, 3]], *impulse[:2], *before)
    out.writerow([case, "landing", f"{t + high:.9f}", *(f"{x:.9f}" for x in values)])


def main():
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow("case kind t_s inner_rad outer_rad inner_rad_s outer_rad_s x z vx_m_s vz_m_s".split())
    # Push-off of the inner toe before the vertical, the outer toe reaches for the ground and lands while it extends.
    walk("push_off", 0, (0.16, -0.2), (-0.95, 1.6), (0.015, 0.04), lambda t: -4.0 if t < 0.15 else 6.0,
         [(0.0, (0.0, 0.0)), (0.1, (-5.0, 0.0)), (0.12, (5.0, 0.0)), (0.14, (0.0, -5.0)), (0.16, (0.0, 0.0))], out)
    # The stance toe gives way while the robot passes; the swing toe draws in, then comes out.
    walk("give_way", 1, (-0.15, 0.13), (1.6, -0.9), (0.02, 0.0), lambda t: 3.0 if t < 0.1 else -5.0,
         [(0.0, (5.0, 5.0)), (0.03, (-5.0, -5.0)), (0.06, (0.0, 0.0)), (0.2, (-5.0, 0.0)), (0.23, (0.0, 0.0))], out)


if __name__ == "__main__":
    main()
