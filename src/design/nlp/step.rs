//! Slacks, multipliers and softened rows of the interior point, and their Newton step. RT: no.
//!
//! A row with bounds has a slack `s`, `g(w) = s`, and multipliers `zl/(s - low)`, `zu/(high - s)` of the barrier. A soft
//! row may be broken by `p - n` at a price ρ (p + n): `c(w) = p - n`, `g(w) = s + p - n`. Both are eliminated by hand,
//! so the matrix keeps its shape: slacks add `Jgᵀ Σ Jg`, soft equations put `-D` beneath the Jacobian.

use super::{Nlp, Size};

/// Everything that the method moves.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) w: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) s: Vec<f64>,
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    pub(super) zl: Vec<f64>,
    pub(super) zu: Vec<f64>,
    /// Soft rows: first the equations, then the inequalities. Empty when nothing is soft.
    pub(super) soft: Vec<Soft>,
    /// Price of a broken soft row.
    pub(super) price: f64,
}

/// How far a soft row is broken, upwards and downwards, and the multipliers that keep both positive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Soft {
    pub(super) on: bool,
    pub(super) p: f64,
    pub(super) n: f64,
    pub(super) zp: f64,
    pub(super) zn: f64,
}

impl Soft {
    /// Best split of a residual at this barrier: the minimiser of ρ(p+n) - μ ln p - μ ln n with p - n = r.
    fn split(on: bool, r: f64, price: f64, mu: f64) -> Self {
        let half = (mu - price * r) / (2.0 * price);
        let n = half + (half * half + mu * r / (2.0 * price)).sqrt();
        let p = r + n;
        let (n, p) = (n.max(1e-10), p.max(1e-10));
        Self { on, p, n, zp: mu / p, zn: mu / n }
    }

    /// D and e of the eliminated pair (head of this file).
    fn eliminated(&self, price: f64, mu: f64) -> (f64, f64) {
        if !self.on {
            return (0.0, 0.0);
        }
        let (up, down) = (self.p / self.zp, self.n / self.zn);
        (up + down, down * (mu / self.n - price) - up * (mu / self.p - price))
    }

    fn broken(&self) -> f64 {
        if self.on { self.p - self.n } else { 0.0 }
    }
}

/// Residuals of equations and of `g - s`.
#[derive(Clone, Debug, Default)]
pub(super) struct Residual {
    pub(super) c: Vec<f64>,
    pub(super) g: Vec<f64>,
}

impl Residual {
    pub(super) fn sum(&self) -> f64 {
        self.c.iter().chain(&self.g).map(|x| x.abs()).sum()
    }
    pub(super) fn largest(&self) -> f64 {
        self.c.iter().chain(&self.g).fold(0.0, |a, x| if x.is_nan() { f64::INFINITY } else { a.max(x.abs()) })
    }
}

/// A Newton step.
#[derive(Clone, Debug, Default)]
pub(super) struct Step {
    pub(super) w: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) s: Vec<f64>,
    pub(super) zl: Vec<f64>,
    pub(super) zu: Vec<f64>,
    /// p, n, zp, zn.
    pub(super) soft: Vec<[f64; 4]>,
}

impl State {
    /// Slacks within their bounds, `push` away from them.
    pub(super) fn new(nlp: &mut dyn Nlp, w: Vec<f64>, price: Option<f64>, push: f64, mu: f64) -> Self {
        let Size { m, p, .. } = nlp.size();
        let (low, high) = (nlp.bounds().0.to_vec(), nlp.bounds().1.to_vec());
        let (mut c, mut g) = (vec![0.0; m], vec![0.0; p]);
        nlp.values(&w, &mut c, &mut g);
        let s: Vec<f64> = (0..p).map(|i| inside(g[i], low[i], high[i], push)).collect();
        let zl = (0..p).map(|i| if low[i].is_finite() { mu / (s[i] - low[i]) } else { 0.0 }).collect();
        let zu = (0..p).map(|i| if high[i].is_finite() { mu / (high[i] - s[i]) } else { 0.0 }).collect();
        let soft = price.map_or_else(Vec::new, |price| {
            let equations = (0..m).map(|i| Soft::split(nlp.may_soften(i), c[i], price, mu));
            let rows = (0..p)
                .map(|i| Soft::split(bounded(low[i], high[i]) && nlp.may_soften_bound(i), g[i] - s[i], price, mu));
            equations.chain(rows).collect()
        });
        Self { w, lambda: vec![0.0; m], y: vec![0.0; p], s, low, high, zl, zu, soft, price: price.unwrap_or(0.0) }
    }

    pub(super) fn residual(&self, c: &[f64], g: &[f64]) -> Residual {
        let m = c.len();
        let broken = |i: usize| self.soft.get(i).map_or(0.0, Soft::broken);
        Residual {
            c: c.iter().enumerate().map(|(i, c)| c - broken(i)).collect(),
            g: (0..g.len()).map(|i| if self.is_bounded(i) { g[i] - self.s[i] - broken(m + i) } else { 0.0 }).collect(),
        }
    }

    pub(super) fn is_bounded(&self, i: usize) -> bool {
        bounded(self.low[i], self.high[i])
    }

    /// Barrier function without the cost.
    pub(super) fn barrier(&self, mu: f64) -> f64 {
        let mut sum = 0.0;
        for i in 0..self.s.len() {
            if self.low[i].is_finite() {
                sum -= mu * libm::log(self.s[i] - self.low[i]);
            }
            if self.high[i].is_finite() {
                sum -= mu * libm::log(self.high[i] - self.s[i]);
            }
        }
        for soft in self.soft.iter().filter(|soft| soft.on) {
            sum += self.price * (soft.p + soft.n) - mu * (libm::log(soft.p) + libm::log(soft.n));
        }
        sum
    }

    /// Its slope along a step.
    pub(super) fn barrier_slope(&self, step: &Step, mu: f64) -> f64 {
        let mut sum: f64 = (0..self.s.len()).map(|i| self.barrier_gradient(i, mu) * step.s[i]).sum();
        for (soft, d) in self.soft.iter().zip(&step.soft).filter(|(soft, _)| soft.on) {
            sum += (self.price - mu / soft.p) * d[0] + (self.price - mu / soft.n) * d[1];
        }
        sum
    }

    /// `μ/(high - s) - μ/(s - low)`.
    fn barrier_gradient(&self, i: usize, mu: f64) -> f64 {
        let low = if self.low[i].is_finite() { mu / (self.s[i] - self.low[i]) } else { 0.0 };
        let high = if self.high[i].is_finite() { mu / (self.high[i] - self.s[i]) } else { 0.0 };
        high - low
    }

    /// Stiffness Σ of the slacks.
    fn stiffness(&self, i: usize) -> f64 {
        let low = if self.low[i].is_finite() { self.zl[i] / (self.s[i] - self.low[i]) } else { 0.0 };
        let high = if self.high[i].is_finite() { self.zu[i] / (self.high[i] - self.s[i]) } else { 0.0 };
        low + high
    }

    fn eliminated(&self, row: usize, mu: f64) -> (f64, f64) {
        self.soft.get(row).map_or((0.0, 0.0), |soft| soft.eliminated(self.price, mu))
    }

    /// Σ with softening, and D of the equations.
    pub(super) fn weights(&self) -> (Vec<f64>, Vec<f64>) {
        let m = self.lambda.len();
        let sigma = (0..self.s.len()).map(|i| {
            let stiff = self.stiffness(i);
            stiff / (1.0 + stiff * self.eliminated(m + i, 0.0).0)
        });
        (sigma.collect(), (0..m).map(|i| self.eliminated(i, 0.0).0).collect())
    }

    /// Newton step for these residuals; the matrix is factored with [`State::weights`].
    pub(super) fn step(&self, nlp: &mut dyn Nlp, sigma: &[f64], r: &Residual, mu: f64) -> Step {
        let Size { n, m, p } = nlp.size();
        // y⁺ = Σ_eff Jg Δw + constant.
        let constant: Vec<f64> = (0..p)
            .map(|i| {
                if !self.is_bounded(i) {
                    return 0.0;
                }
                sigma[i] * (r.g[i] + self.eliminated(m + i, mu).1 + self.barrier_gradient(i, mu) / self.stiffness(i))
            })
            .collect();
        let mut dw = nlp.cost_gradient().to_vec();
        nlp.add_transposed(&vec![0.0; m], &constant, &mut dw);
        dw.iter_mut().for_each(|x| *x = -*x);
        let mut lambda: Vec<f64> = (0..m).map(|i| -(r.c[i] + self.eliminated(i, mu).1)).collect();
        nlp.back_solve(&mut dw, &mut lambda);
        let (mut dc, mut dg) = (vec![0.0; m], vec![0.0; p]);
        nlp.jacobian_times(&dw, &mut dc, &mut dg);
        debug_assert_eq!(dw.len(), n);
        let y: Vec<f64> = (0..p).map(|i| sigma[i] * dg[i] + constant[i]).collect();
        self.complete(dw, lambda, y, &dg, mu)
    }

    /// The eliminated parts of a step.
    fn complete(&self, w: Vec<f64>, lambda: Vec<f64>, y: Vec<f64>, dg: &[f64], mu: f64) -> Step {
        let (m, p) = (lambda.len(), y.len());
        let mut step = Step { s: vec![0.0; p], zl: vec![0.0; p], zu: vec![0.0; p], ..Step::default() };
        for i in 0..p {
            step.s[i] =
                if self.is_bounded(i) { (y[i] - self.barrier_gradient(i, mu)) / self.stiffness(i) } else { dg[i] };
            if self.low[i].is_finite() {
                let gap = self.s[i] - self.low[i];
                step.zl[i] = mu / gap - self.zl[i] - self.zl[i] / gap * step.s[i];
            }
            if self.high[i].is_finite() {
                let gap = self.high[i] - self.s[i];
                step.zu[i] = mu / gap - self.zu[i] + self.zu[i] / gap * step.s[i];
            }
        }
        for (i, soft) in self.soft.iter().enumerate() {
            let multiplier = if i < m { lambda[i] } else { y[i - m] };
            let up = soft.p / soft.zp * (multiplier - self.price + mu / soft.p);
            let down = soft.n / soft.zn * (mu / soft.n - self.price - multiplier);
            let (zp, zn) = (self.price - multiplier - soft.zp, self.price + multiplier - soft.zn);
            step.soft.push(if soft.on { [up, down, zp, zn] } else { [0.0; 4] });
        }
        step.lambda = lambda.iter().zip(&self.lambda).map(|(new, old)| new - old).collect();
        step.y = y.iter().zip(&self.y).map(|(new, old)| new - old).collect();
        step.w = w;
        step
    }

    /// Longest shares of a step that keep slacks and multipliers positive, primal and dual.
    pub(super) fn to_the_boundary(&self, step: &Step, tau: f64) -> (f64, f64) {
        let (mut primal, mut dual) = (1.0_f64, 1.0_f64);
        let shorten = |share: &mut f64, gap: f64, d: f64| {
            if d < 0.0 {
                *share = share.min(-tau * gap / d);
            }
        };
        for i in 0..self.s.len() {
            shorten(&mut primal, self.s[i] - self.low[i], step.s[i]);
            shorten(&mut primal, self.high[i] - self.s[i], -step.s[i]);
            shorten(&mut dual, self.zl[i], step.zl[i]);
            shorten(&mut dual, self.zu[i], step.zu[i]);
        }
        for (soft, d) in self.soft.iter().zip(&step.soft) {
            shorten(&mut primal, soft.p, d[0]);
            shorten(&mut primal, soft.n, d[1]);
            shorten(&mut dual, soft.zp, d[2]);
            shorten(&mut dual, soft.zn, d[3]);
        }
        (primal, dual)
    }

    /// The primal part moved.
    pub(super) fn moved(&self, step: &Step, share: f64) -> Self {
        let mut to = self.clone();
        advance(&mut to.w, &step.w, share);
        advance(&mut to.s, &step.s, share);
        for (soft, d) in to.soft.iter_mut().zip(&step.soft) {
            soft.p += share * d[0];
            soft.n += share * d[1];
        }
        to
    }

    /// The multipliers moved, and held near μ over their gap so that they never run away.
    pub(super) fn move_multipliers(&mut self, step: &Step, primal: f64, dual: f64, mu: f64) {
        const RANGE: f64 = 1e10;
        advance(&mut self.lambda, &step.lambda, primal);
        advance(&mut self.y, &step.y, primal);
        advance(&mut self.zl, &step.zl, dual);
        advance(&mut self.zu, &step.zu, dual);
        let hold = |z: &mut f64, gap: f64| *z = z.clamp(mu / gap / RANGE, mu / gap * RANGE);
        for i in 0..self.s.len() {
            if self.low[i].is_finite() {
                hold(&mut self.zl[i], self.s[i] - self.low[i]);
            }
            if self.high[i].is_finite() {
                hold(&mut self.zu[i], self.high[i] - self.s[i]);
            }
        }
        for (soft, d) in self.soft.iter_mut().zip(&step.soft) {
            soft.zp += dual * d[2];
            soft.zn += dual * d[3];
            hold(&mut soft.zp, soft.p);
            hold(&mut soft.zn, soft.n);
        }
    }

    /// Largest complementarity error.
    pub(super) fn complementarity(&self, mu: f64) -> f64 {
        let mut worst = 0.0_f64;
        for i in 0..self.s.len() {
            if self.low[i].is_finite() {
                worst = worst.max(((self.s[i] - self.low[i]) * self.zl[i] - mu).abs());
            }
            if self.high[i].is_finite() {
                worst = worst.max(((self.high[i] - self.s[i]) * self.zu[i] - mu).abs());
            }
        }
        for soft in self.soft.iter().filter(|soft| soft.on) {
            worst = worst.max((soft.p * soft.zp - mu).abs()).max((soft.n * soft.zn - mu).abs());
        }
        worst
    }

    /// Largest error of stationarity in the slacks and softened rows: `y = zu - zl`, `zp = ρ - λ`, `zn = ρ + λ`.
    pub(super) fn slack_stationarity(&self) -> f64 {
        let m = self.lambda.len();
        let slack = |i: usize| if self.is_bounded(i) { (self.y[i] - self.zu[i] + self.zl[i]).abs() } else { 0.0 };
        let mut worst = (0..self.s.len()).map(slack).fold(0.0, f64::max);
        for (i, soft) in self.soft.iter().enumerate().filter(|(_, soft)| soft.on) {
            let multiplier = if i < m { self.lambda[i] } else { self.y[i - m] };
            worst = worst.max((self.price - multiplier - soft.zp).abs().max((self.price + multiplier - soft.zn).abs()));
        }
        worst
    }

    /// Scales of the two errors: large multipliers deserve less.
    pub(super) fn scales(&self) -> f64 {
        const ORDINARY: f64 = 100.0;
        let count = self.lambda.len() + self.zl.len() + self.zu.len();
        let sum: f64 = self.lambda.iter().chain(&self.zl).chain(&self.zu).map(|x| x.abs()).sum();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let mean = sum / count.max(1) as f64;
        mean.max(ORDINARY) / ORDINARY
    }
}

fn bounded(low: f64, high: f64) -> bool {
    low.is_finite() || high.is_finite()
}

fn inside(value: f64, low: f64, high: f64, push: f64) -> f64 {
    let room = if low.is_finite() && high.is_finite() { push * (high - low) } else { f64::INFINITY };
    let from = |bound: f64| (push * bound.abs().max(1.0)).min(room);
    let mut s = value;
    if low.is_finite() {
        s = s.max(low + from(low));
    }
    if high.is_finite() {
        s = s.min(high - from(high));
    }
    s
}

fn advance(x: &mut [f64], d: &[f64], share: f64) {
    for (x, d) in x.iter_mut().zip(d) {
        *x += share * d;
    }
}
