//! The node whose tube holds a state best, among thousands: exact, a plain scan by all lanes of the processor.
//!
//! `(x - x*)' S (x - x*) / level` is a quadratic form of `x`: ten coefficients of the products, four of the state, one
//! constant. Mirroring changes the sign of the four alone, so both images cost one evaluation:
//! `even - |odd|`. Nodes stand in blocks of eight, coefficient by coefficient.
//!
//! The instruction set is chosen when the table is built. Every lane computes what the plain code computes, in the same
//! order and without fused operations, so all instruction sets give the same bits: a replay elsewhere is exact.
//! RT: look-up yes; building before arming only.
#![expect(clippy::disallowed_types, reason = "filled before arming")]

use super::{Branch, State};
use crate::msg::Leg;

/// Nodes of a block.
pub const LANES: usize = 8;

/// Coefficients: ten products, four of the state, one constant.
const TERMS: usize = 15;

type Lanes = [f64; LANES];

/// Instruction set of the scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Isa {
    /// What every processor of the family has.
    #[default]
    Baseline,
    /// Four doubles at once.
    Avx2,
    /// Eight doubles at once.
    Avx512,
}

impl Isa {
    /// The widest that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if std::is_x86_feature_detected!("avx512f") {
                return Self::Avx512;
            }
            if std::is_x86_feature_detected!("avx2") {
                return Self::Avx2;
            }
        }
        Self::Baseline
    }

    /// All that this processor has.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let widest = Self::detect();
        let all = [Self::Baseline, Self::Avx2, Self::Avx512];
        all.into_iter().take_while(|isa| (*isa as usize) <= widest as usize).collect()
    }
}

#[derive(Clone, Debug)]
struct Block {
    terms: [Lanes; TERMS],
}

/// What a look-up found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Branch of the node.
    pub branch: u32,
    /// Its place in the branch.
    pub node: u32,
    /// The mirrored image.
    pub mirrored: bool,
    /// Cost over level: at most 1 inside its tube.
    pub share: f64,
}

/// All nodes of one leg.
#[derive(Clone, Debug, Default)]
pub struct Scan {
    blocks: Vec<Block>,
    names: Vec<(u32, u32)>,
    isa: Isa,
}

impl Scan {
    /// Before arming only.
    #[must_use]
    pub fn new(branches: &[Branch], stance: Leg, isa: Isa) -> Self {
        let mut out = Self { blocks: Vec::new(), names: Vec::new(), isa };
        for (b, branch) in branches.iter().enumerate().filter(|(_, branch)| branch.stance == stance) {
            out.add(b, branch);
        }
        out
    }

    /// Adds the nodes of branch number `b`. Before arming only.
    pub fn add(&mut self, b: usize, branch: &Branch) {
        for (k, node) in branch.nodes.iter().enumerate() {
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 4 billion")]
            self.push((b as u32, k as u32), &terms(&node.state, &node.cost, node.level));
        }
    }

    /// The nearest nodes of so many different branches, nearest first; for planning, it allocates.
    #[must_use]
    pub fn nearest(&self, x: &State, count: usize) -> Vec<Found> {
        let p = products(x);
        let mut out: Vec<Found> = Vec::new();
        for (k, block) in self.blocks.iter().enumerate() {
            for (lane, share) in evaluate(block, &p).into_iter().enumerate() {
                let far = out.len() == count && out.last().is_some_and(|last| share >= last.share || share.is_nan());
                let (false, Some(&(branch, node))) = (far, self.names.get(k * LANES + lane)) else { continue };
                let mirrored = odd(block, &p, lane).is_some_and(|odd| odd > 0.0);
                match out.iter().position(|found| found.branch == branch) {
                    Some(same) if out.get(same).is_some_and(|found| found.share <= share) => continue,
                    Some(same) => drop(out.remove(same)),
                    None => {}
                }
                let at = out.partition_point(|found| found.share <= share);
                out.insert(at, Found { branch, node, mirrored, share });
                out.truncate(count);
            }
        }
        out
    }

    /// The same nodes for another instruction set, which this processor must have; else the baseline.
    #[must_use]
    pub fn with(mut self, isa: Isa) -> Self {
        self.isa = if Isa::available().contains(&isa) { isa } else { Isa::Baseline };
        self
    }

    fn push(&mut self, name: (u32, u32), coefficients: &[f64; TERMS]) {
        let lane = self.names.len() % LANES;
        if lane == 0 {
            // Lanes without a node are infinitely far.
            let mut terms = [[0.0; LANES]; TERMS];
            let [.., constant] = &mut terms;
            *constant = [f64::INFINITY; LANES];
            self.blocks.push(Block { terms });
        }
        if let Some(block) = self.blocks.last_mut() {
            for (lanes, value) in block.terms.iter_mut().zip(coefficients) {
                if let Some(at) = lanes.get_mut(lane) {
                    *at = *value;
                }
            }
        }
        self.names.push(name);
    }

    /// Nodes in the table.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.names.len()
    }

    /// No node at all.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// The node with the least cost over level; `None` for an empty table or a state that is not finite. RT: yes.
    #[must_use]
    pub fn best(&self, x: &State) -> Option<Found> {
        let (best, block) = self.least(x);
        let block_at = block?;
        let lanes = evaluate(self.blocks.get(block_at)?, &products(x));
        let lane = lanes.iter().position(|share| share.to_bits() == best.to_bits())?;
        let (branch, node) = *self.names.get(block_at * LANES + lane)?;
        let odd = odd(self.blocks.get(block_at)?, &products(x), lane)?;
        Some(Found { branch, node, mirrored: odd > 0.0, share: best })
    }

    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "a function for an instruction set may be called only where the processor has it")]
    fn least(&self, x: &State) -> (f64, Option<usize>) {
        match self.isa {
            Isa::Baseline => least(&self.blocks, x),
            // SAFETY: `isa` is set by `Isa::detect` and `Isa::available` alone, which asked the processor.
            Isa::Avx2 => unsafe { least_avx2(&self.blocks, x) },
            // SAFETY: as above.
            Isa::Avx512 => unsafe { least_avx512(&self.blocks, x) },
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn least(&self, x: &State) -> (f64, Option<usize>) {
        least(&self.blocks, x)
    }
}

/// Coefficients of a node's form in the order of [`products`].
fn terms([a, b, c, d]: &State, s: &[f64; 10], level: f64) -> [f64; TERMS] {
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd] = s.map(|x| x / level);
    let [ea, eb, ec, ed] = [
        aa * a + ab * b + ac * c + ad * d,
        ab * a + bb * b + bc * c + bd * d,
        ac * a + bc * b + cc * c + cd * d,
        ad * a + bd * b + cd * c + dd * d,
    ];
    let constant = ea * a + eb * b + ec * c + ed * d;
    [
        aa,
        2.0 * ab,
        2.0 * ac,
        2.0 * ad,
        bb,
        2.0 * bc,
        2.0 * bd,
        cc,
        2.0 * cd,
        dd,
        -2.0 * ea,
        -2.0 * eb,
        -2.0 * ec,
        -2.0 * ed,
        constant,
    ]
}

/// What the coefficients are multiplied with, the constant aside.
fn products([a, b, c, d]: &State) -> [f64; 14] {
    [a * a, a * b, a * c, a * d, b * b, b * c, b * d, c * c, c * d, d * d, *a, *b, *c, *d]
}

/// Cost over level of eight nodes, the nearer image of each.
#[inline(always)]
fn evaluate(block: &Block, p: &[f64; 14]) -> Lanes {
    let [aa, ab, ac, ad, bb, bc, bd, cc, cd, dd, a, b, c, d, constant] = &block.terms;
    let [paa, pab, pac, pad, pbb, pbc, pbd, pcc, pcd, pdd, pa, pb, pc, pd] = p;
    let mut out = *constant;
    let mut odd = [0.0; LANES];
    for (term, product) in
        [(aa, paa), (ab, pab), (ac, pac), (ad, pad), (bb, pbb), (bc, pbc), (bd, pbd), (cc, pcc), (cd, pcd), (dd, pdd)]
    {
        out.iter_mut().zip(term).for_each(|(out, term)| *out += term * product);
    }
    for (term, product) in [(a, pa), (b, pb), (c, pc), (d, pd)] {
        odd.iter_mut().zip(term).for_each(|(odd, term)| *odd += term * product);
    }
    out.iter_mut().zip(&odd).for_each(|(out, odd)| *out -= odd.abs());
    out
}

/// The odd part of one lane: positive where the mirrored image is the nearer one.
fn odd(block: &Block, p: &[f64; 14], lane: usize) -> Option<f64> {
    let [.., a, b, c, d, _] = &block.terms;
    let [.., pa, pb, pc, pd] = p;
    let mut out = 0.0;
    for (term, product) in [(a, pa), (b, pb), (c, pc), (d, pd)] {
        out += term.get(lane)? * product;
    }
    Some(out)
}

#[inline(always)]
fn least(blocks: &[Block], x: &State) -> (f64, Option<usize>) {
    let p = products(x);
    let (mut best, mut at) = (f64::INFINITY, None);
    for (k, block) in blocks.iter().enumerate() {
        let lanes = evaluate(block, &p);
        let mut least = f64::INFINITY;
        for share in &lanes {
            least = if *share < least { *share } else { least };
        }
        if least < best {
            (best, at) = (least, Some(k));
        }
    }
    (best, at)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn least_avx2(blocks: &[Block], x: &State) -> (f64, Option<usize>) {
    least(blocks, x)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn least_avx512(blocks: &[Block], x: &State) -> (f64, Option<usize>) {
    least(blocks, x)
}
