//! Planar machines as bodies on arms: mass matrix and bias forces by projection (Newton and Euler per body, own
//! derivation). `model` writes the same machines as closed Lagrangian forms; nothing is shared. RT: no.
//!
//! A body's centre stands at `Σ length · d(row · q)`, `d(α) = (-sin α, cos α)`, and turns with `turn · q`; or it slides
//! along x with `q1`. `M = Σ m JᵀJ + I turn turnᵀ`, `h = Σ m Jᵀ (J̇ q̇ + g ŷ)`, `M q̈ + h = Q`.

/// Two coordinates at most.
pub(super) type Pair = [f64; 2];

/// One rigid body.
#[derive(Debug, Clone, Default)]
pub(super) struct Body {
    /// kg.
    pub mass: f64,
    /// About its own centre, kg m².
    pub inertia: f64,
    /// Length in m and the row that gives the angle.
    pub arms: Vec<(f64, Pair)>,
    /// The row that gives its own rotation.
    pub turn: Pair,
    /// Moves along x with the first coordinate.
    pub slides: bool,
}

/// `M` and `h`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Equations {
    /// Mass matrix.
    pub mass: [Pair; 2],
    /// Bias: velocity terms and gravity.
    pub bias: Pair,
}

/// Adds up the bodies; `base_m_s2` is the acceleration of the ground along x.
pub(super) fn equations(bodies: &[Body], q: Pair, v: Pair, gravity_m_s2: f64, base_m_s2: f64) -> Equations {
    let mut sum = Equations::default();
    for body in bodies {
        let (jx, jy, bias) = centre(body, q, v);
        let push = [bias[0] + base_m_s2, bias[1] + gravity_m_s2];
        for i in 0..2 {
            for j in 0..2 {
                sum.mass[i][j] +=
                    body.mass * (jx[i] * jx[j] + jy[i] * jy[j]) + body.inertia * body.turn[i] * body.turn[j];
            }
            sum.bias[i] += body.mass * (jx[i] * push[0] + jy[i] * push[1]);
        }
    }
    sum
}

/// Mass matrix and bias with the first arm's foot as two more coordinates, x and y; `gravity_m_s2` is a vector.
pub(super) fn floating(bodies: &[Body], q: Pair, v: Pair, gravity_m_s2: Pair) -> ([[f64; 4]; 4], [f64; 4]) {
    let (mut mass, mut force) = ([[0.0; 4]; 4], [0.0; 4]);
    for body in bodies {
        let (jx, jy, bias) = centre(body, q, v);
        let (jx, jy) = ([jx[0], jx[1], 1.0, 0.0], [jy[0], jy[1], 0.0, 1.0]);
        let turn = [body.turn[0], body.turn[1], 0.0, 0.0];
        for i in 0..4 {
            for j in 0..4 {
                mass[i][j] += body.mass * (jx[i] * jx[j] + jy[i] * jy[j]) + body.inertia * turn[i] * turn[j];
            }
            force[i] += body.mass * (jx[i] * (bias[0] - gravity_m_s2[0]) + jy[i] * (bias[1] - gravity_m_s2[1]));
        }
    }
    (mass, force)
}

/// Rows of the centre's Jacobian and its acceleration at q̈ = 0.
fn centre(body: &Body, q: Pair, v: Pair) -> (Pair, Pair, Pair) {
    let (mut jx, mut jy, mut bias) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    if body.slides {
        jx[0] = 1.0;
    }
    for (length, row) in &body.arms {
        let angle = row[0] * q[0] + row[1] * q[1];
        let rate = row[0] * v[0] + row[1] * v[1];
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        for i in 0..2 {
            jx[i] -= length * cos * row[i];
            jy[i] -= length * sin * row[i];
        }
        bias[0] += length * sin * rate * rate;
        bias[1] -= length * cos * rate * rate;
    }
    (jx, jy, bias)
}

/// `M q̈ = force`, coordinates that are held left out.
pub(super) fn solve(mass: [Pair; 2], force: Pair, held: [bool; 2]) -> Pair {
    match held {
        [false, true] => [force[0] / mass[0][0], 0.0],
        [true, false] => [0.0, force[1] / mass[1][1]],
        [true, true] => [0.0, 0.0],
        [false, false] => {
            let det = mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0];
            [
                (mass[1][1] * force[0] - mass[0][1] * force[1]) / det,
                (mass[0][0] * force[1] - mass[1][0] * force[0]) / det,
            ]
        }
    }
}
