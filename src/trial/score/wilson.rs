//! Confidence interval of a counted share. RT: no.

/// 97.5 % point of the normal distribution: two-sided 95 %.
const Z: f64 = 1.959_963_984_540_054;

/// So many of so many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Share {
    /// Hits.
    pub hits: usize,
    /// Of.
    pub of: usize,
}

impl Share {
    /// Counts the true ones.
    pub fn count(flags: impl IntoIterator<Item = bool>) -> Self {
        flags
            .into_iter()
            .fold(Self::default(), |share, hit| Self { hits: share.hits + usize::from(hit), of: share.of + 1 })
    }

    /// Hits / of; NaN of nothing.
    pub fn value(&self) -> f64 {
        self.hits as f64 / self.of as f64
    }

    /// 95 % interval after Wilson (1927): sane at 0 and 1, unlike the normal one.
    pub fn interval(&self) -> (f64, f64) {
        if self.of == 0 {
            return (0.0, 1.0);
        }
        let (n, p) = (self.of as f64, self.value());
        let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        ((centre - half).max(0.0), (centre + half).min(1.0))
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.of == 0 {
            return write!(out, "none of this kind");
        }
        let (low, high) = self.interval();
        let (value, low, high) = (100.0 * self.value(), 100.0 * low, 100.0 * high);
        write!(out, "{}/{} = {value:.1} %  [{low:.1}, {high:.1}]", self.hits, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_of_ten_is_not_certainty() {
        // Wilson 95 % of 10/10 is [0.7225, 1]: Agresti and Coull 1998, table.
        let (low, high) = Share { hits: 10, of: 10 }.interval();
        assert!((low - 0.7225).abs() < 1e-4 && (high - 1.0).abs() < 1e-12);
    }
}
