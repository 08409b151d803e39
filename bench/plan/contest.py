"""The same periodic gait (.4 m, .4 m/s) by CasADi + IPOPT and by compass: whole time, cost, defect.

The program is that of src/design/collocation: Hermite-Simpson, compressed; motor torque with friction compensation,
friction cone and normal force at knots and midpoints; impact cone and lift-off at touchdown; the same guess.
usage: contest.py COMPASS_BENCH [RUNS]         contest.py --oracle KNOTS...   (prints IPOPT's costs, for tests)
"""
import json
import statistics
import subprocess
import sys
import time

import casadi as ca
import numpy as np

C = [0.1007, 0.1434, 0.000596, 0.1151, 0.1264, 0.0026]
LEG, MASS, GRAVITY = 1.045, 15.2, 9.81
INERTIA, W2 = MASS * LEG * LEG, GRAVITY / LEG
VISCOUS, COULOMB = 0.0418, 0.1109
TORQUE, MU, STEP, SPEED = 30.0 / INERTIA, 0.6, 0.4, 0.4


def swapped(c):
    return [c[1], c[0], c[2], c[4], c[3], c[5]]


def parts(c, x):
    """H, C q' + G, momentum rows J, J' q': sections 3 of the model notes."""
    s, w, vs, vw = x[0], x[1], x[2], x[3]
    sigma, body = s - w, (s + w) / 2
    h11 = 1 + c[0] - 2 * c[3] + 4 * c[5] * ca.cos(sigma / 2)
    h12 = c[2] - c[4] * ca.cos(sigma) + 2 * c[5] * ca.cos(sigma / 2)
    b, k = c[5] * ca.sin(sigma / 2), c[4] * ca.sin(sigma)
    bias = [b * (2 * vw - vs) * vs + (b - k) * vw**2 + W2 * ((c[3] - 1) * ca.sin(s) - 2 * c[5] * ca.sin(body)),
            (k - 2 * b) * vs**2 + W2 * (c[4] * ca.sin(w) - 2 * c[5] * ca.sin(body))]
    jx = [-(1 - c[3]) * ca.cos(s) - 2 * c[5] * ca.cos(body), c[4] * ca.cos(w) - 2 * c[5] * ca.cos(body)]
    jy = [-(1 - c[3]) * ca.sin(s) - 2 * c[5] * ca.sin(body), c[4] * ca.sin(w) - 2 * c[5] * ca.sin(body)]
    vb = (vs + vw) / 2
    bx = (1 - c[3]) * ca.sin(s) * vs**2 - c[4] * ca.sin(w) * vw**2 + 4 * c[5] * ca.sin(body) * vb**2
    by = -(1 - c[3]) * ca.cos(s) * vs**2 + c[4] * ca.cos(w) * vw**2 - 4 * c[5] * ca.cos(body) * vb**2
    return (h11, h12, c[1]), bias, (jx, jy), (bx, by)


def flow(c, x, u):
    (h11, h12, h22), bias, _, _ = parts(c, x)
    r1, r2, det = u - bias[0], -u - bias[1], h11 * h22 - h12 * h12
    return ca.vertcat(x[2], x[3], (h22 * r1 - h12 * r2) / det, (h11 * r2 - h12 * r1) / det)


def rows(c, x, u, f):
    _, _, (jx, jy), (bx, by) = parts(c, x)
    fx, fy = jx[0] * f[2] + jx[1] * f[3] + bx, jy[0] * f[2] + jy[1] * f[3] + by + W2
    r = x[2] - x[3]
    return ca.vertcat(u + VISCOUS * r + COULOMB * ca.tanh(100 * r), MU * fy - fx, MU * fy + fx, fy)


def impact(c, x):
    """State after touchdown and exchange of legs; bounds of the impact."""
    (h11, h12, h22), _, (jx, jy), _ = parts(c, x)
    m = ca.vertcat(ca.horzcat(h11, h12, jx[0], jy[0]), ca.horzcat(h12, h22, jx[1], jy[1]),
                   ca.horzcat(jx[0], jx[1], 1, 0), ca.horzcat(jy[0], jy[1], 0, 1))
    a = ca.vertcat(ca.horzcat(-ca.cos(x[0]), ca.cos(x[1]), 1, 0), ca.horzcat(-ca.sin(x[0]), ca.sin(x[1]), 0, 1))
    v = ca.vertcat(x[2], x[3], 0, 0)
    w = ca.solve(m, a.T)
    impulse = ca.solve(a @ w, -(a @ v))
    after = v + w @ impulse
    bounds = ca.vertcat(MU * impulse[1] - impulse[0], MU * impulse[1] + impulse[0], after[3])
    return ca.vertcat(x[1], x[0], after[1], after[0]), bounds


def build(knots, jit=False):
    """The program, as functions expanded to scalar operations."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    legs = [C, swapped(C)]
    flows = [ca.Function("f", [x, u], [flow(c, x, u)]) for c in legs]
    bounded = [ca.Function("g", [x, u], [rows(c, x, u, flow(c, x, u))]) for c in legs]
    impacts = [ca.Function("i", [x], list(impact(c, x))) for c in legs]
    n = knots - 1
    half = np.arcsin(STEP / 2 / LEG)
    w, w0, g, low, high, cost = [], [], [], [], [], 0

    def new(size, guess):
        v = ca.SX.sym(f"v{len(w)}", size)
        w.append(v)
        w0.extend(guess)
        return v

    def bound(e, lo, hi):
        g.append(e)
        size = e.shape[0]
        low.extend([lo] * size if np.isscalar(lo) else lo)
        high.extend([hi] * size if np.isscalar(hi) else hi)

    total = 2 * STEP / SPEED
    times = [new(1, [total / 2]) for _ in range(2)]
    first, last_x = None, None
    row_low, row_high = [-TORQUE, 0, 0, 0], [TORQUE, np.inf, np.inf, np.inf]
    for p in range(2):
        h = times[p] / n
        rate = -2 * half / (total / 2)
        for k in range(knots):
            s = k / n
            xk = new(4, [half - 2 * half * s, -half + 2 * half * s, rate, -rate])
            uk = new(1, [0])
            fk = flows[p](xk, uk)
            if k == 0:
                if p == 0:
                    first = xk
                else:
                    bound(xk - impacts[0](last_x)[0], 0, 0)
            else:
                um = new(1, [0])
                mid = (xb + xk) / 2 + h / 8 * (fb - fk)
                fm = flows[p](mid, um)
                bound(xk - xb - h / 6 * (fb + 4 * fm + fk), 0, 0)
                bound(bounded[p](mid, um), row_low, row_high)
                cost += h / 6 * (ub**2 + 4 * um**2 + uk**2)
            bound(bounded[p](xk, uk), row_low, row_high)
            xb, ub, fb = xk, uk, fk
        last_x = xb
        if p == 0:
            bound(ca.vertcat(ca.cos(xb[0]) - ca.cos(xb[1]), ca.sin(xb[1]) - ca.sin(xb[0]) - STEP / LEG), 0, 0)
        bound(impacts[p](xb)[1], 0, np.inf)
        bound(times[p], 0.1, 3.0)
    bound(impacts[1](last_x)[0] - first, 0, 0)
    bound(ca.vertcat(ca.cos(first[1]) - ca.cos(first[0]), ca.sin(first[0]) - ca.sin(first[1]) - STEP / LEG), 0, 0)
    bound(times[0] + times[1] - total, 0, 0)
    program = {"x": ca.vertcat(*w), "f": cost, "g": ca.vertcat(*g)}
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-8}
    if jit:
        options |= {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}
    return ca.nlpsol("s", "ipopt", program, options), w0, low, high, flows, n


def solve(built):
    solver, w0, low, high, _, _ = built
    result = solver(x0=w0, lbg=low, ubg=high)
    stats = solver.stats()
    return np.array(result["x"]).ravel(), float(result["f"]), stats["iter_count"], stats["success"]


def defect(built, w, steps=200):
    """Largest difference between planned states and an integration of the planned torque, as compass measures it."""
    flows, n = built[4], built[5]
    at, worst = 2, 0.0
    for p in range(2):
        h = w[p] / n
        xs, us, mids = [], [], []
        for k in range(n + 1):
            xs.append(w[at:at + 4])
            us.append(w[at + 4])
            at += 5
            if k:
                mids.append(w[at])
                at += 1
        f, d = flows[p], h / steps
        x = np.array(xs[:-1]).T
        a, m, b = np.array(us[:-1]), np.array(mids), np.array(us[1:])
        torque = lambda s: a * (1 - s) * (1 - 2 * s) + 4 * m * s * (1 - s) + b * s * (2 * s - 1)
        go = lambda x, s: np.array(f(ca.DM(x), ca.DM(torque(s)).T))
        for j in range(steps):
            s = j / steps
            k1 = go(x, s)
            k2 = go(x + d / 2 * k1, s + 0.5 / steps)
            k3 = go(x + d / 2 * k2, s + 0.5 / steps)
            k4 = go(x + d * k3, s + 1 / steps)
            x = x + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        worst = max(worst, np.abs(x - np.array(xs[1:]).T).max())
    return worst


def main():
    if sys.argv[1] == "--oracle":
        for knots in map(int, sys.argv[2:]):
            w, cost, iterations, success = solve(build(knots))
            print(json.dumps({"knots": knots, "cost": cost, "iterations": iterations, "success": success,
                              "t_inner_s": w[0], "t_outer_s": w[1], "start": list(w[2:6])}))
        return
    runs = int(sys.argv[2]) if len(sys.argv) > 2 else 9
    ours = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(line):
        ours.stdin.write(line + "\n")
        ours.stdin.flush()
        return json.loads(ours.stdout.readline())

    for knots in (12, 60):
        built = build(knots)
        theirs, whole, mine, staged = [], [], [], []
        for _ in range(runs):
            begin = time.perf_counter()
            solve(build(knots))
            whole.append(time.perf_counter() - begin)
            begin = time.perf_counter()
            w, cost, iterations, success = solve(built)
            theirs.append(time.perf_counter() - begin)
            mine.append(ask(f"{knots}"))
            staged.append(ask(f"staged {knots}"))
        ms = lambda seconds: 1e3 * statistics.median(seconds)
        of = lambda answers: ms([a["seconds"] for a in answers])
        print(f"{knots} knots per phase, medians of {runs} interleaved runs")
        print(f"  CasADi + IPOPT   {ms(whole):8.1f} ms whole (building included), {ms(theirs):8.1f} ms the solve alone, "
              f"{iterations} iterations, cost {cost:.12f}, defect {defect(built, w):.2e}, success {success}")
        for name, answers in (("compass, cold  ", mine), ("compass, staged", staged)):
            a = answers[-1]
            print(f"  {name}  {of(answers):8.1f} ms whole, {a['iterations']} iterations, cost {a['cost']:.12f}, "
                  f"defect {a['defect']:.2e}: {ms(whole) / of(answers):.1f} x faster whole, "
                  f"{ms(theirs) / of(answers):.1f} x against the solve alone")


if __name__ == "__main__":
    main()
