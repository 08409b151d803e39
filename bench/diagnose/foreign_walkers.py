"""Healthy walkers of MuJoCo for `foreign.py --walkers`: two legs on a foot of soft contact, or on one that is held softly.

The model of docs/equations.md with a body without inertia (c3 = c6 = 0). The swing foot is drawn in, so it touches nothing
until it has passed. The hip follows the gait of src/trial/generator/gait.rs: the swing leg mirrors the stance leg, a little ahead.
"""
import math

import mujoco
import numpy as np

LENGTH_M, MASS_KG, GRAVITY = 1.045, 15.2, 9.81
SCALE = MASS_KG * LENGTH_M**2
LIMIT_NM = 30.0


class Walker:
    """MuJoCo: hip with two slides, a leg on each of two hinges; `contact` or `held` feet."""

    def __init__(self, rng, step_s, pinned):
        self.step_s, self.pinned = step_s, pinned
        self.c = {
            "c1": rng.uniform(0.095, 0.106), "c2": rng.uniform(0.138, 0.15), "c3": 0.0,
            "c4": rng.uniform(0.112, 0.118), "c5": rng.uniform(0.12, 0.13), "c6": 0.0,
        }
        self.viscous, self.coulomb = rng.uniform(0.3, 1.2), rng.uniform(0.1, 1.0)
        self.feet = "held" if pinned or rng.random() < 0.4 else "contact"
        # Fractions of the whole mass; the rest is at the hip. Moments and inertias about the hip are those of c1, c2, c4, c5.
        shares = [0.3, 0.3]
        self.substeps, integrator = int(rng.choice([2, 4, 8])), str(rng.choice(["Euler", "implicitfast", "RK4"]))
        softness = float(rng.choice([0.004, 0.008, 0.015]))
        softness = max(softness, 2.2 * step_s / self.substeps)
        legs, names = "", ("inner", "outer")
        for name, share, first, second in zip(names, shares, ("c1", "c2"), ("c4", "c5")):
            mass = share * MASS_KG
            arm = self.c[second] * MASS_KG * LENGTH_M / mass
            own = self.c[first] * SCALE - mass * arm**2
            legs += (
                f'<body name="{name}"><joint name="{name}" type="hinge" axis="0 -1 0"/>'
                f'<inertial pos="0 0 {-arm}" mass="{mass}" diaginertia="{own} {own} {0.5 * own}"/>'
                f'<geom name="{name}" type="sphere" size="0.002" pos="0 0 {-LENGTH_M + 0.002}" mass="0"/>'
                f'<site name="{name}" pos="0 0 {-LENGTH_M}"/></body>'
            )
        hold = "".join(
            f'<connect name="{name}" site1="{name}" site2="at_{name}" active="false" solref="{softness} 1"/>' for name in names
        )
        places = "".join(f'<body name="m_{n}" mocap="true"><site name="at_{n}"/></body>' for n in names)
        if pinned:
            self.stiffness, self.rest = rng.uniform(180.0, 260.0), rng.uniform(-0.03, 0.03)
        xml = f"""<mujoco><compiler balanceinertia="true"/>
            <option timestep="{step_s / self.substeps}" gravity="0 0 {-GRAVITY}" integrator="{integrator}" cone="elliptic"/>
            <default><geom friction="1.5 0 0" solref="{softness} 1" condim="3"/></default>
            <worldbody><geom name="ground" type="plane" size="50 1 1" contype="1" conaffinity="1"/>{places}
            <body name="hip"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
            <inertial pos="0 0 0" mass="{(1 - sum(shares)) * MASS_KG}" diaginertia="1e-4 1e-4 1e-4"/>{legs}</body></worldbody>
            <tendon><fixed name="hip" damping="{self.viscous}" frictionloss="{self.coulomb}">
            <joint joint="inner" coef="1"/><joint joint="outer" coef="-1"/></fixed></tendon>
            <equality>{hold}</equality></mujoco>"""
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.note = f"MuJoCo {integrator}, {self.substeps} steps a row, {self.feet} feet, {softness * 1e3:.1f} ms"
        self.geoms = [self.model.geom(n).id for n in names]
        self.sites = [self.model.site(n).id for n in names]
        self.draw_gait(rng)

    def draw_gait(self, rng):
        self.half = rng.uniform(0.13, 0.19)
        self.ahead = self.half * rng.uniform(0.3, 0.6)
        self.rate, self.stiff = -rng.uniform(0.65, 0.85), rng.uniform(9.0, 14.0)
        self.sway = (rng.uniform(0.0, 0.02), rng.uniform(1.5, 4.0), rng.uniform(0, 2 * math.pi))

    def start(self, q, v):
        """On the inner foot, at the origin."""
        mujoco.mj_resetData(self.model, self.data)
        d, l = self.data, LENGTH_M
        d.qpos[:] = [-l * math.sin(q[0]), l * math.cos(q[0]), q[0], q[1]]
        d.qvel[:] = [-l * math.cos(q[0]) * v[0], -l * math.sin(q[0]) * v[0], v[0], v[1]]
        self.stance, self.released = 0, math.inf
        self.touch(1, False)
        self.touch(0, True)
        mujoco.mj_forward(self.model, d)

    def touch(self, leg, on):
        """Gives this foot its contact, or holds it where it is."""
        contact = int(on and self.feet == "contact")
        self.model.geom_contype[self.geoms[leg]] = self.model.geom_conaffinity[self.geoms[leg]] = contact
        if self.feet == "contact":
            return
        if on:
            mujoco.mj_kinematics(self.model, self.data)
            self.data.mocap_pos[leg] = self.data.site_xpos[self.sites[leg]]
        self.data.eq_active[leg] = int(on)

    def state(self):
        return self.data.qpos[2:4].copy(), self.data.qvel[2:4].copy()

    def step(self, torque):
        """One row; `torque`: + on the inner leg. The robot may fall: then the angles say so."""
        swing, legs = 1 - self.stance, slice(2, 4)
        for _ in range(self.substeps):
            q = self.data.qpos[legs]
            push = np.array([torque, -torque])
            if self.pinned:
                push[0] -= self.stiffness * (q[0] - self.rest)
            self.data.qfrc_applied[legs] = push
            mujoco.mj_step(self.model, self.data)
            if self.pinned:
                continue
            swing, q = 1 - self.stance, self.data.qpos[legs]
            if q[self.stance] < -0.3 * self.half and q[swing] > 0.3 * self.half:
                mujoco.mj_kinematics(self.model, self.data)
                if self.data.site_xpos[self.sites[swing]][2] <= 0.0:
                    self.touch(swing, True)
                    self.stance, self.released = swing, self.data.time + (0.0 if self.feet == "held" else 0.02)
                    if self.feet == "held":
                        self.touch(1 - self.stance, False)
            if self.data.time >= self.released:
                self.touch(1 - self.stance, False)
                self.released = math.inf

    def command(self, t):
        """Hip torque of the gait, + on the inner leg."""
        q, v = self.state()
        s, w = self.stance, 1 - self.stance
        share, (amplitude, hz, phase) = q[s] / self.half, self.sway
        wanted = -q[s] + self.ahead * (1 - share**2) + amplitude * math.sin(2 * math.pi * hz * t + phase)
        wanted_rate = -v[s] * (1 + 2 * self.ahead * share / self.half)
        swing = 2.3 * self.stiff**2 * (wanted - q[w]) + 1.4 * 2.3 * self.stiff * (wanted_rate - v[w])
        return float(np.clip(-swing if s == 0 else swing, -LIMIT_NM, LIMIT_NM))


def record(rng, walker, seconds):
    """Rows of time, command, angles, stance; none if the robot fell."""
    if walker.pinned:
        tones = [(f, rng.uniform(0.2, 1.0), rng.uniform(0, 2 * math.pi)) for f in np.geomspace(0.2, 3.5, 6)]
        level = rng.uniform(3.0, 7.0)
        walker.start([walker.rest + rng.uniform(-0.03, 0.03), rng.uniform(-0.1, 0.1)], [0.0, 0.0])
    else:
        walker.draw_gait(rng)
        walker.start([walker.half, -walker.half], [walker.rate, -0.5 * walker.rate])
    rows = []
    for k in range(int(seconds / walker.step_s)):
        t = k * walker.step_s
        torque = (
            level * sum(a * math.sin(2 * math.pi * f * t + p) for f, a, p in tones) / 1.5 if walker.pinned else walker.command(t)
        )
        q, _ = walker.state()
        if np.abs(q).max() > 0.6:
            return None
        rows.append((t, torque, q[0], q[0] - q[1], walker.stance))
        walker.step(torque)
    return rows


def write_case(rng, folder, truth, name, noise_like, files):
    """A healthy walker or a leg pair on a pinned toe: recordings, rig, truth. A robot that falls is drawn anew."""
    pinned = rng.random() < 0.35
    while True:
        walker = Walker(rng, float(rng.choice([0.002, 0.0025, 0.004])), pinned)
        runs = [record(rng, walker, 5.0) for _ in range(3)]
        if all(run is not None and (pinned or run[-1][4] != run[0][4] or len({row[4] for row in run}) > 1) for run in runs):
            break
    gain, form = rng.uniform(0.7, 3.0), files["noise"][int(rng.integers(len(files["noise"])))]
    spread = [np.std([row[i] for run in runs for row in run]) for i in (2, 3)]
    stds = [s * 10 ** rng.uniform(-2.7, -2) for s in spread]
    quantum = float(2 * math.pi / 2 ** int(rng.integers(12, 15))) if rng.random() < 0.5 else 0.0
    tables = []
    for run in runs:
        inner = np.array([row[2] for row in run]) + noise_like(rng, form, stds[0], len(run))
        hip = np.array([row[3] for row in run]) + noise_like(rng, form, stds[1], len(run))
        hip = np.round(hip / quantum) * quantum if quantum else hip
        columns = {"t_s": [row[0] for row in run], "u_hip": [row[1] / gain for row in run], "imu_inner_rad": inner, "hip_rad": hip}
        tables.append(columns if pinned else {**columns, "stance": [row[4] for row in run]})
    note = f"{'pinned toe' if pinned else 'walk'}, {walker.note}, {form} noise, row {walker.step_s} s"
    files["write"](folder, truth, name, tables, rig(rng, name, walker, gain, quantum), note)


def rig(rng, name, walker, gain, quantum):
    """The rig as given: free numbers up to 15 % off, what a leg weighs within a factor of two."""
    free = ("c1", "c2", "c4", "c5") if walker.pinned else ("c2", "c5")
    off = lambda: rng.uniform(0.85, 1.15) if rng.random() < 0.7 else 1.0
    near = lambda v, low, high: f"{{ value = {v * off():.6g}, min = {low:.6g}, max = {high:.6g} }}"
    text = f'schema = 1\nname = "{name}"\nmechanism = "compass_gait"\n\n[parameters]\n'
    text += f"leg_length_m = {{ value = {LENGTH_M} }}\ntotal_mass_kg = {{ value = {MASS_KG} }}\ngravity_m_s2 = {{ value = {GRAVITY} }}\n"
    for key, value in walker.c.items():
        text += f"{key} = {near(value, value / 2, 2 * value) if key in free else f'{{ value = {value:.9g} }}'}\n"
    text += f'\n[[actuator]]\njoint = "hip"\ncolumn = "u_hip"\ngain = {{ value = {gain:.9g} }}\n'
    text += '\n[[sensor]]\nmeasures = "inner"\ncolumn = "imu_inner_rad"\n'
    text += '\n[[sensor]]\nmeasures = "hip"\ncolumn = "hip_rad"\n' + (f"quantum = {quantum:.9g}\n" if quantum else "")
    for effect, key, value in (("viscous_friction", "viscous", walker.viscous), ("coulomb_friction", "coulomb", walker.coulomb)):
        text += f'\n[[effect]]\neffect = "{effect}"\nat = "hip"\n{key} = {near(value, 0, 5 * value)}\n'
    if walker.pinned:
        text += f'\n[[effect]]\neffect = "parallel_spring"\nat = "inner"\nstiffness = {{ value = {walker.stiffness:.9g} }}\nrest = {{ value = {walker.rest:.9g} }}\n'
    window = 2.0 if walker.pinned else round(rng.uniform(0.7, 1.0), 3)
    for n, use in enumerate(["fit", "fit", "heldout"]):
        text += f'\n[[recording]]\nfile = "run_{"abc"[n]}.csv"\nuse = "{use}"\nwindow_s = {window}\n'
        text += 'setup = "inner_stance"\n' if walker.pinned else 'setup = "walk"\nstance_column = "stance"\n'
    return text
