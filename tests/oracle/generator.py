"""Reference motions of MuJoCo for the machines of the trial generator (src/trial/generator/oracle.rs).

python3 -m venv v && v/bin/pip install mujoco==4.0.0 && v/bin/python tests/oracle/generator.py
Prints coordinates and rates (as the diagnosis contract defines them) after 0.5, 1.0, 1.5 and 2.0 s.
RK4 at 50 us; halving the step moves the last printed digit by less than two.
"""

import math
import mujoco

H = 5e-5


def body(name, pos, joint, damping, centre, mass, inertia, inside=""):
    # Planar motion about y: only that moment of inertia acts.
    return (f'<body name="{name}" pos="0 0 {pos}"><joint name="{joint}" type="hinge" axis="0 1 0" damping="{damping}"/>'
            f'<inertial pos="0 0 {centre}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>{inside}</body>')


def simulate(bodies, actuators, q, v, torque, report):
    xml = (f'<mujoco><option gravity="0 0 -9.81" timestep="{H}" integrator="RK4"><flag contact="disable"/></option>'
           f'<worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>')
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:] = q, v
    for k in range(1, int(round(2.0 / H)) + 1):
        d.ctrl[:] = torque((k - 1) * H)
        mujoco.mj_step(m, d)
        if k % int(round(0.5 / H)) == 0:
            print(f"    {k * H:.1f} s", ", ".join(f"{x:.7f}" for x in report(d.qpos, d.qvel)))


def double_pendulum():
    """q1 from hanging, q2 relative; a hanging link turns by -y, hence the mirrored signs cancel out."""
    second = body("b", -0.3, "q2", 0.006, -0.15, 0.5, 0.016 - 0.5 * 0.15**2)
    first = body("a", 0, "q1", 0.012, -0.2, 0.6, 0.031 - 0.6 * 0.2**2, second)
    # Piecewise constant, so that any integrator sees the same torque.
    torque = lambda t: (0.4 if int(t / 0.25) % 2 == 0 else -0.4, 0.15 if int(t / 0.125) % 2 == 0 else -0.15)
    simulate(first, '<motor joint="q1"/><motor joint="q2"/>', [0.8, -0.5], [0, 0], torque, lambda q, v: (*q, *v))


def compass_gait():
    """Inner stance on its spring; c1 .09, c2 .14, c4 .115, c5 .126, c3 = c6 = 0 (the body is a point at the hip)."""
    l, total = 1.045, 15.2
    unit = total * l * l
    mass = 0.3 * total
    inner_centre, outer_centre = 0.115 * total * l / mass, 0.126 * total * l / mass
    # Tree: stance leg on its toe, swing leg at the hip. Absolute angles: inner = q0, outer = q0 + q1.
    # d(theta) = (-sin, cos) turns by -y here; both angles mirror together.
    outer = body("outer", l, "hip", 0.7, -outer_centre, mass, 0.14 * unit - mass * outer_centre**2)
    hip = f'<body pos="0 0 {l}"><inertial pos="0 0 0" mass="{0.4 * total}" diaginertia="1e-12 1e-12 1e-12"/></body>'
    centre = l - inner_centre
    inner = (f'<body name="inner"><joint name="toe" type="hinge" axis="0 1 0" stiffness="220" springref="0"/>'
             f'<inertial pos="0 0 {centre}" mass="{mass}" diaginertia="{" ".join([str(0.09 * unit - mass * inner_centre**2)] * 3)}"/>{hip}{outer}</body>')
    torque = lambda t: (-(5.0 if int(t / 0.25) % 2 == 0 else -5.0),)   # + on inner, - on outer: minus on (outer - inner)
    simulate(inner, '<motor joint="hip"/>', [0.1, -0.3], [0.2, -0.5], torque,
             lambda q, v: (q[0], q[0] + q[1], v[0], v[0] + v[1]))


if __name__ == "__main__":
    print("mujoco", mujoco.__version__)
    print("double_pendulum: q1, q2, rates")
    double_pendulum()
    print("compass_gait: inner, outer, rates")
    compass_gait()
