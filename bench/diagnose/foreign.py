#!/usr/bin/env python3
"""Cases of other simulators, in the form of docs/contract.md, with their truth in the form that `compass score` reads.

    pip install mujoco numpy drake
    bench/diagnose/foreign.py --seed 1 --cases 100 --out /tmp/foreign            healthy ones
    bench/diagnose/foreign.py --seed 2 --cases 100 --out /tmp/foreign-ill --ill  one effect each, for the intervals
    bench/diagnose/foreign.py --seed 3 --cases 100 --out /tmp/walkers --walkers  healthy walkers, of MuJoCo alone
    compass score /tmp/foreign/cases --truth /tmp/foreign/truth

Healthy: the rig has every effect of the machine, its free numbers are up to 20 % off. What differs is what differs between
simulators: integrator and step, friction that is regularised (MuJoCo's soft constraints, a smooth sign), noise that is
white, filtered or coloured, rounding. MuJoCo: Euler, implicit and Runge-Kutta. Drake: its discrete and continuous plants.
"""
import argparse
import json
import math
import pathlib

import numpy as np

STEP_S = [0.002, 0.0025, 0.004, 0.005]  # between two rows
NOISE = ["white", "filtered", "coloured"]


# ---------------------------------------------------------------- machines

def machine(rng):
    """Mechanism, true numbers, friction of each joint."""
    kind = rng.choice(["pendulum", "slider", "double_pendulum"], p=[0.45, 0.25, 0.3])
    friction = lambda scale: {
        "viscous": scale * rng.uniform(0.02, 0.1),
        "coulomb": scale * rng.uniform(0.02, 0.12) if rng.random() < 0.5 else 0.0,
    }
    if kind == "pendulum":
        mass, length = rng.uniform(0.2, 3.0), rng.uniform(0.15, 0.6)
        inertia = mass * length**2 * rng.uniform(1.05, 1.6)
        gravity = mass * 9.81 * length
        numbers = {"inertia_kg_m2": inertia, "gravity_nm": gravity}
        return kind, numbers, {"mass": mass, "length": length}, [friction(gravity * 0.2)], [gravity]
    if kind == "slider":
        mass = rng.uniform(0.5, 20.0)
        return kind, {"mass_kg": mass}, {}, [friction(mass * 2.0)], [mass * 4.0]
    m1, m2, l1 = rng.uniform(0.3, 2.0), rng.uniform(0.2, 1.2), rng.uniform(0.2, 0.5)
    c1, c2 = l1 * rng.uniform(0.35, 0.7), rng.uniform(0.1, 0.3)
    i1, i2 = m1 * c1**2 * rng.uniform(1.1, 1.5), m2 * c2**2 * rng.uniform(1.1, 1.5)
    numbers = {
        "inertia1_kg_m2": i1, "inertia2_kg_m2": i2, "moment1_kg_m": m1 * c1, "moment2_kg_m": m2 * c2,
        "mass2_kg": m2, "length1_m": l1, "gravity_m_s2": 9.81,
    }
    hold = [9.81 * (m1 * c1 + m2 * (l1 + c2)), 9.81 * m2 * c2]
    return kind, numbers, {"m1": m1, "c1": c1, "c2": c2}, [friction(0.1 * h) for h in hold], hold


def joints_of(kind):
    return ["q1", "q2"] if kind == "double_pendulum" else ["q1"]


# ---------------------------------------------------------------- simulators: step(torques) -> positions, rates

class MuJoCo:
    def __init__(self, kind, numbers, extra, friction, rng, step_s):
        import mujoco

        self.mujoco = mujoco
        substeps = int(rng.choice([1, 2, 4]))
        self.substeps, self.note = substeps, rng.choice(["Euler", "implicitfast", "RK4"])
        soft = rng.choice(["", 'solreffriction="0.004 1"'])
        joint = lambda j, f, kind_: (
            f'<joint name="{j}" type="{kind_}" axis="{"1 0 0" if kind_ == "slide" else "0 1 0"}" '
            f'damping="{f["viscous"]}" frictionloss="{f["coulomb"]}" {soft}/>'
        )
        body = lambda at, joint_, com, mass, inertia, inside="": (
            f'<body pos="0 0 {at}">{joint_}<inertial pos="0 0 {com}" mass="{mass}" '
            f'diaginertia="{inertia} {inertia} {0.9 * inertia}"/>{inside}</body>'
        )
        if kind == "pendulum":
            own = numbers["inertia_kg_m2"] - extra["mass"] * extra["length"] ** 2
            world = body(0, joint("q1", friction[0], "hinge"), -extra["length"], extra["mass"], own)
        elif kind == "slider":
            world = body(0, joint("q1", friction[0], "slide"), 0, numbers["mass_kg"], 0.01)
        else:
            i1 = numbers["inertia1_kg_m2"] - extra["m1"] * extra["c1"] ** 2
            i2 = numbers["inertia2_kg_m2"] - numbers["mass2_kg"] * extra["c2"] ** 2
            second = body(-numbers["length1_m"], joint("q2", friction[1], "hinge"), -extra["c2"], numbers["mass2_kg"], i2)
            world = body(0, joint("q1", friction[0], "hinge"), -extra["c1"], extra["m1"], i1, second)
        gravity = 0 if kind == "slider" else -9.81
        xml = (
            f'<mujoco><compiler balanceinertia="true"/><option timestep="{step_s / substeps}" '
            f'gravity="0 0 {gravity}" integrator="{self.note}"/><worldbody>{world}</worldbody></mujoco>'
        )
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.note = f"MuJoCo {self.note}, {substeps} steps a row, friction {'stiff' if soft else 'soft'}"

    def start(self, q, rate):
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q, rate

    def state(self):
        return self.data.qpos.copy(), self.data.qvel.copy()

    def step(self, torque):
        for _ in range(self.substeps):
            self.data.qfrc_applied[:] = torque(self.data.qpos, self.data.qvel, self.model.opt.timestep)
            self.mujoco.mj_step(self.model, self.data)


class Drake:
    """A MultibodyPlant: discrete (its own time stepping) or continuous (an integrator with error control)."""

    def __init__(self, kind, numbers, extra, friction, rng, step_s):
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, SpatialInertia, UnitInertia
        from pydrake.systems.analysis import Simulator

        discrete = bool(rng.random() < 0.5)
        self.step_s, self.friction = step_s, friction
        self.inner = 2 if discrete else 1
        self.plant = MultibodyPlant(step_s / self.inner if discrete else 0.0)
        about = lambda mass, com, own: SpatialInertia(
            mass, [0, 0, com], UnitInertia(*([(own + mass * com**2) / mass] * 2), 0.9 * own / mass)
        )
        place = self.plant.world_frame()
        if kind == "slider":
            parts = [(numbers["mass_kg"], 0.0, 0.01)]
        elif kind == "pendulum":
            own = numbers["inertia_kg_m2"] - extra["mass"] * extra["length"] ** 2
            parts = [(extra["mass"], -extra["length"], own)]
        else:
            i1 = numbers["inertia1_kg_m2"] - extra["m1"] * extra["c1"] ** 2
            i2 = numbers["inertia2_kg_m2"] - numbers["mass2_kg"] * extra["c2"] ** 2
            parts = [(extra["m1"], -extra["c1"], i1), (numbers["mass2_kg"], -extra["c2"], i2)]
        from pydrake.math import RigidTransform

        for n, (mass, com, own) in enumerate(parts):
            link = self.plant.AddRigidBody(f"link{n}", about(mass, com, own))
            if n > 0:
                from pydrake.multibody.tree import FixedOffsetFrame

                offset = RigidTransform([0, 0, -numbers["length1_m"]])
                place = self.plant.AddFrame(FixedOffsetFrame("hub", place, offset))
            if kind == "slider":
                self.plant.AddJoint(PrismaticJoint("q1", place, link.body_frame(), [1, 0, 0], damping=friction[0]["viscous"]))
            else:
                self.plant.AddJoint(
                    RevoluteJoint(f"q{n + 1}", place, link.body_frame(), [0, 1, 0], friction[n]["viscous"])
                )
            place = link.body_frame()
        if kind == "slider":
            self.plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
        self.plant.Finalize()
        self.simulator = Simulator(self.plant)
        self.context = self.simulator.get_mutable_context()
        self.port = self.plant.get_applied_generalized_force_input_port()
        self.width = 10 ** rng.uniform(-3, -2)
        self.note = f"Drake {'discrete' if discrete else 'continuous'}, smooth sign"

    def start(self, q, rate):
        self.context.SetTime(0.0)
        self.steps = 0
        self.plant.SetPositions(self.context, q)
        self.plant.SetVelocities(self.context, rate)
        self.simulator.Initialize()

    def state(self):
        return self.plant.GetPositions(self.context).copy(), self.plant.GetVelocities(self.context).copy()

    def step(self, torque):
        for _ in range(self.inner):
            q, rate = self.state()
            smooth = -np.array([f["coulomb"] for f in self.friction]) * np.tanh(rate / self.width)
            self.port.FixValue(self.context, torque(q, rate, self.step_s / self.inner) + smooth)
            # From whole steps: a sum of them is rounded, and the plant then leaves out an update now and then.
            self.steps += 1
            self.simulator.AdvanceTo(self.steps * (self.step_s / self.inner))


class Symplectic:
    """Semi-implicit Euler on the equations themselves, a smooth sign for friction: what a script of a student does."""

    def __init__(self, kind, numbers, extra, friction, rng, step_s):
        self.kind, self.p, self.friction = kind, numbers, friction
        self.substeps, self.width = int(rng.choice([4, 10])), 10 ** rng.uniform(-3, -2)
        self.step_s, self.note = step_s, f"semi-implicit Euler, {self.substeps} steps a row, smooth sign"

    def start(self, q, rate):
        self.q, self.rate = np.array(q, float), np.array(rate, float)

    def state(self):
        return self.q.copy(), self.rate.copy()

    def acceleration(self, force):
        p, q, r = self.p, self.q, self.rate
        if self.kind == "slider":
            return force / p["mass_kg"]
        if self.kind == "pendulum":
            return (force - p["gravity_nm"] * np.sin(q)) / p["inertia_kg_m2"]
        g, l1, h = p["gravity_m_s2"], p["length1_m"], p["moment2_kg_m"] * p["length1_m"]
        m22 = p["inertia2_kg_m2"]
        m12 = m22 + h * math.cos(q[1])
        m11 = p["inertia1_kg_m2"] + p["mass2_kg"] * l1**2 + m22 + 2 * h * math.cos(q[1])
        weight2 = g * p["moment2_kg_m"] * math.sin(q[0] + q[1])
        weight1 = g * (p["moment1_kg_m"] + p["mass2_kg"] * l1) * math.sin(q[0]) + weight2
        s = h * math.sin(q[1])
        right = np.array([
            force[0] - weight1 + s * (2 * r[0] + r[1]) * r[1],
            force[1] - weight2 - s * r[0] ** 2,
        ])
        return np.linalg.solve(np.array([[m11, m12], [m12, m22]]), right)

    def step(self, torque):
        h = self.step_s / self.substeps
        viscous = np.array([f["viscous"] for f in self.friction])
        coulomb = np.array([f["coulomb"] for f in self.friction])
        for _ in range(self.substeps):
            force = torque(self.q, self.rate, h) - viscous * self.rate - coulomb * np.tanh(self.rate / self.width)
            self.rate = self.rate + h * self.acceleration(force)
            self.q = self.q + h * self.rate


# ---------------------------------------------------------------- what is hidden

def drawn_effect(rng, mechanism, scale, step_s):
    """One hidden effect at the last joint: contract id, place, keys, and what it does in the loop."""
    joints = joints_of(mechanism)
    j = len(joints) - 1
    at, force = joints[j], scale[j]
    kinds = [
        "actuator_lag", "transport_delay", "torque_limit", "quadratic_drag", "parallel_spring", "torque_offset",
        "sensor_lag", "sensor_scale", "sensor_bias", "torque_ripple", "encoder_eccentricity",
    ]
    waves = 1
    if mechanism == "slider":
        # Where nothing depends on the position its zero shows nowhere, and its scale is the mass's; half a metre is no part of an
        # encoder's turn, nor of a ripple with a few waves per rad: a ball screw has them every 6 to 17 cm here.
        kinds = [k for k in kinds if k not in ("sensor_bias", "sensor_scale", "encoder_eccentricity")]
        waves = 12
    kind = rng.choice(kinds)
    command, sensor = f"u_{at}", f"{at}_pos"
    draw = {
        "actuator_lag": lambda: (command, {"time_constant": rng.uniform(0.005, 0.03)}),
        "transport_delay": lambda: (command, {"delay": int(rng.integers(1, 6)) * step_s}),
        "torque_limit": lambda: (command, {"limit": force * rng.uniform(0.25, 0.5)}),
        "quadratic_drag": lambda: (at, {"quadratic": force * rng.uniform(0.005, 0.05)}),
        "parallel_spring": lambda: (at, {"stiffness": force * rng.uniform(0.1, 0.5), "rest": rng.uniform(-0.3, 0.3)}),
        "torque_offset": lambda: (at, {"torque": force * rng.uniform(0.05, 0.2) * rng.choice([-1, 1])}),
        "sensor_lag": lambda: (sensor, {"time_constant": rng.uniform(0.005, 0.03)}),
        "sensor_scale": lambda: (sensor, {"scale": rng.uniform(0.9, 1.1)}),
        "sensor_bias": lambda: (sensor, {"bias": rng.uniform(0.02, 0.08) * rng.choice([-1, 1])}),
        "torque_ripple": lambda: (
            at, {"amplitude": force * rng.uniform(0.03, 0.1), "order": waves * int(rng.integers(3, 9)), "phase": rng.uniform(-3, 3)}),
        "encoder_eccentricity": lambda: (sensor, {"amplitude": rng.uniform(0.01, 0.04), "phase": rng.uniform(-3, 3)}),
    }
    at, keys = draw[kind]()
    return str(kind), at, {k: float(v) for k, v in keys.items()}, j


# ---------------------------------------------------------------- recordings

def noise_like(rng, kind, std, count):
    white = rng.normal(size=count)
    if kind == "white":
        return std * white
    if kind == "filtered":  # a low pass that nobody told of
        out = np.convolve(white, np.ones(3) / 3, mode="same")
    else:
        pole, out, x = rng.uniform(0.4, 0.8), np.empty(count), 0.0
        for k, w in enumerate(white):
            x = pole * x + w
            out[k] = x
    return std * out / np.std(out)


def record(rng, simulator, shape, hidden, seconds):
    """Runs one recording: rows of time, commands, readings without noise."""
    joints, scale, step_s, kind = shape
    count = int(seconds / step_s)
    tones = [[(f, rng.uniform(0.2, 1.0), rng.uniform(0, 2 * math.pi)) for f in np.geomspace(0.2, 3.5, 6)] for _ in joints]
    levels = [rng.uniform(0.25, 0.5) * s for s in scale]
    simulator.start([rng.uniform(-0.4, 0.4) for _ in joints], [0.0] * len(joints))
    effect, keys, j = (hidden[0], hidden[2], hidden[3]) if hidden else (None, {}, 0)
    rows, lagged, queue = [], None, []
    memory = [None]
    for k in range(count):
        t = k * step_s
        q, rate = simulator.state()
        command = np.array([
            level * sum(a * math.sin(2 * math.pi * f * t + p) for f, a, p in of) / 1.5
            for level, of in zip(levels, tones)
        ])
        if kind == "slider":
            command -= scale[0] * np.clip(2.0 * q, -2, 2) + 0.2 * scale[0] * rate
        queue.append(command.copy())
        late = round(keys.get("delay", 0.0) / step_s) if effect == "transport_delay" else 0
        sent = command.copy()
        sent[j] = queue[max(0, len(queue) - 1 - late)][j]
        if effect == "torque_limit":
            sent[j] = np.clip(sent[j], -keys["limit"], keys["limit"])
        reading, spun = q.copy(), rate.copy()
        if effect == "sensor_lag":
            lagged = q[j] if lagged is None else lagged
            reading[j] = lagged
        elif effect == "sensor_scale":
            reading[j] *= keys["scale"]
        elif effect == "sensor_bias":
            reading[j] += keys["bias"]
        elif effect == "encoder_eccentricity":
            reading[j] += keys["amplitude"] * math.sin(q[j] + keys["phase"])
        rows.append((t, command, reading, spun))

        def torque(q, rate, h):
            out = sent.copy()
            if effect == "actuator_lag":
                memory[0] = out[j] if memory[0] is None else memory[0]
                part = math.exp(-h / keys["time_constant"])
                mean = out[j] + (memory[0] - out[j]) * (1 - part) * keys["time_constant"] / h
                memory[0] = out[j] + (memory[0] - out[j]) * part
                out[j] = mean
            elif effect == "quadratic_drag":
                out[j] -= keys["quadratic"] * rate[j] * abs(rate[j])
            elif effect == "parallel_spring":
                out[j] -= keys["stiffness"] * (q[j] - keys["rest"])
            elif effect == "torque_offset":
                out[j] += keys["torque"]
            elif effect == "torque_ripple":
                out[j] += keys["amplitude"] * math.sin(keys["order"] * q[j] + keys["phase"])
            return out

        before = q[j]
        simulator.step(torque)
        if effect == "sensor_lag":  # exact for a reading that moves evenly between two rows
            after, tau = simulator.state()[0][j], keys["time_constant"]
            part, slope = math.exp(-step_s / tau), (after - before) / step_s
            lagged = after - slope * tau + (lagged - before + slope * tau) * part
    return rows


def write_case(rng, folder, truth, name, engines, ill):
    kind, numbers, extra, friction, scale = machine(rng)
    step_s = float(rng.choice(STEP_S))
    engine = engines[int(rng.integers(len(engines)))]
    simulator = engine(kind, numbers, extra, friction, rng, step_s)
    joints = joints_of(kind)
    hidden = drawn_effect(rng, kind, scale, step_s) if ill else None
    runs = [record(rng, simulator, (joints, scale, step_s, kind), hidden, 6.0) for _ in range(3)]
    has_rate = rng.random() < 0.5
    form = str(rng.choice(NOISE))
    spread = [np.std([row[2][j] for run in runs for row in run]) for j in range(len(joints))]
    fast = [np.std([row[3][j] for run in runs for row in run]) for j in range(len(joints))]
    stds, rate_stds = [s * 10 ** rng.uniform(-3, -2) for s in spread], [s * 10 ** rng.uniform(-2.3, -1.5) for s in fast]
    quantum = float(2 * math.pi / 2 ** int(rng.integers(12, 16))) if rng.random() < 0.5 and kind != "slider" else 0.0
    tables = []
    for run in runs:
        columns = {"t_s": [row[0] for row in run]} | {f"u_{j}": [row[1][i] for row in run] for i, j in enumerate(joints)}
        for i, j in enumerate(joints):
            y = np.array([row[2][i] for row in run]) + noise_like(rng, form, stds[i], len(run))
            columns[f"{j}_pos"] = np.round(y / quantum) * quantum if quantum else y
        for i, j in enumerate(joints if has_rate else []):
            columns[f"{j}_gyro"] = np.array([row[3][i] for row in run]) + noise_like(rng, form, rate_stds[i], len(run))
        tables.append(columns)
    effects = []
    if hidden:
        effect, at, keys, _ = hidden
        twins = [{"effect": effect, "at": at}]
        if effect == "torque_offset":
            twins.append({"effect": "friction_asymmetry", "at": at})
        # The contract's other twins (docs/contract.md, section 3): with one sensor nothing tells a late command from a late reading.
        if effect == "transport_delay" and len(joints) == 1 and not has_rate:
            twins.append({"effect": "sensor_delay", "at": f"{joints[0]}_pos"})
        effects = [{"effect": effect, "at": at, "one_of": twins, "parameters": keys}]
    note = f"{kind}, {simulator.note}, {form} noise, row {step_s} s"
    text = rig(rng, name, kind, numbers, friction, joints, has_rate, quantum, ill)
    write_files(folder, truth, name, tables, text, note, effects)


def write_files(folder, truth, name, tables, rig_text, note, effects=()):
    """A case in the form of docs/contract.md, and its truth beside it."""
    case = folder / name
    case.mkdir(parents=True)
    for n, columns in enumerate(tables):
        lines = [",".join(columns)] + [",".join(f"{x:.7g}" for x in row) for row in zip(*columns.values())]
        (case / f"run_{'abc'[n]}.csv").write_text("\n".join(lines) + "\n")
    (case / "rig.toml").write_text(rig_text)
    truth.mkdir(parents=True, exist_ok=True)
    verdict = ["explained", "ambiguous"] if effects else ["consistent", "parameters"]
    content = {"verdict": verdict, "note": note, "effects": list(effects)}
    (truth / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")


def rig(rng, name, kind, numbers, friction, joints, has_rate, quantum, exact):
    """The rig as given: numbers up to 20 % off within bounds of a factor of two; known ones exact."""
    known = {"length1_m", "gravity_m_s2", "mass2_kg"}
    off = lambda: 1.0 if exact and rng.random() < 0.3 else rng.uniform(0.8, 1.2)
    free = lambda v: f"{{ value = {v * off():.6g}, min = {v / 2:.6g}, max = {2 * v:.6g} }}"
    text = f'schema = 1\nname = "{name}"\nmechanism = "{kind}"\n\n[parameters]\n'
    for key, value in numbers.items():
        text += f"{key} = {{ value = {value:.9g} }}\n" if key in known else f"{key} = {free(value)}\n"
    for j in joints:
        text += f'\n[[actuator]]\njoint = "{j}"\ncolumn = "u_{j}"\ngain = {{ value = 1.0 }}\n'
    for j in joints:
        text += f'\n[[sensor]]\nmeasures = "{j}"\ncolumn = "{j}_pos"\n' + (f"quantum = {quantum:.9g}\n" if quantum else "")
        if has_rate:
            text += f'\n[[sensor]]\nmeasures = "{j}_rate"\ncolumn = "{j}_gyro"\n'
    for j, f in zip(joints, friction):
        text += f'\n[[effect]]\neffect = "viscous_friction"\nat = "{j}"\nviscous = {{ value = {f["viscous"] * off():.6g}, min = 0.0, max = {4 * f["viscous"]:.6g} }}\n'
        if f["coulomb"] > 0:
            text += f'\n[[effect]]\neffect = "coulomb_friction"\nat = "{j}"\ncoulomb = {{ value = {f["coulomb"] * off():.6g}, min = 0.0, max = {4 * f["coulomb"]:.6g} }}\n'
    for n, use in enumerate(["fit", "fit", "heldout"]):
        text += f'\n[[recording]]\nfile = "run_{"abc"[n]}.csv"\nuse = "{use}"\nwindow_s = {1.5 if kind == "double_pendulum" else 3.0}\n'
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--ill", action="store_true", help="one hidden effect each")
    parser.add_argument("--walkers", action="store_true", help="healthy walking robots")
    parser.add_argument("--engines", default="mujoco,drake,script", help="of these")
    args = parser.parse_args()
    names = {"mujoco": MuJoCo, "drake": Drake, "script": Symplectic}
    engines = [names[name] for name in args.engines.split(",")]
    for n in range(args.cases):
        rng, name = np.random.default_rng([args.seed, n]), f"foreign-{n + 1:03d}"
        if args.walkers:
            import foreign_walkers

            files = {"noise": NOISE, "write": write_files}
            foreign_walkers.write_case(rng, args.out / "cases", args.out / "truth", name, noise_like, files)
            continue
        write_case(rng, args.out / "cases", args.out / "truth", name, engines, args.ill)


if __name__ == "__main__":
    main()
