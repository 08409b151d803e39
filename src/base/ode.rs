//! One fixed step of an ordinary differential equation. RT: yes, no allocation.

use super::linalg::add_scaled;
use super::scalar::Scalar;

/// Classical Runge-Kutta step of `h` seconds for `ẋ = f(x)`; error per step of order h⁵.
#[inline]
pub fn rk4<S: Scalar, const N: usize>(x: &[S; N], h: f64, mut f: impl FnMut(&[S; N]) -> [S; N]) -> [S; N] {
    let half = S::constant(h / 2.0);
    let k1 = f(x);
    let k2 = f(&add_scaled(x, half, &k1));
    let k3 = f(&add_scaled(x, half, &k2));
    let k4 = f(&add_scaled(x, S::constant(h), &k3));
    let mut out = *x;
    for i in 0..N {
        out[i] += (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shows_its_order_on_a_pendulum() {
        let run = |steps: i32| {
            let mut x = [1.0, 0.0];
            for _ in 0..steps {
                x = rk4(&x, 2.0 / f64::from(steps), |x| [x[1], -libm::sin(x[0])]);
            }
            x[0]
        };
        let (coarse, fine, exact) = (run(20), run(40), run(4000));
        assert!(((coarse - exact) / (fine - exact)).abs().log2() > 3.8);
    }
}
