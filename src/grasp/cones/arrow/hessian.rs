//! A factored Hessian of an [`Arrow`](super::Arrow), and where on their cones the contacts were for it.

use super::branch::Branch;
use super::single::{Side, Single};
use super::{Block, ROOT, RootMatrix, RootVector};
use crate::grasp::contact::cost::ActiveSet;

/// Serves until an active set changes: the second derivative is constant on an affine one.
#[derive(Clone, Debug)]
pub(super) struct Hessian {
    /// Factor and inverse pivots, of each branch and of the root.
    pub factor: Vec<f64>,
    pub pivots: Vec<f64>,
    pub root_factor: RootMatrix,
    pub root_pivots: RootVector,
    /// What each branch adds to the root's Hessian once it is eliminated.
    pub eliminated: Vec<RootMatrix>,
    /// By branch: false if its part is to be made.
    known: Vec<bool>,
    /// Where each block and each single stood.
    sets: Vec<ActiveSet>,
    sides: Vec<Side>,
}

impl Default for Hessian {
    fn default() -> Self {
        Hessian {
            factor: Vec::new(),
            pivots: Vec::new(),
            root_factor: [0.0; ROOT * ROOT],
            root_pivots: [0.0; ROOT],
            eliminated: Vec::new(),
            known: Vec::new(),
            sets: Vec::new(),
            sides: Vec::new(),
        }
    }
}

impl Hessian {
    /// Nothing is known of a new problem.
    pub fn forget(&mut self) {
        self.known.clear();
        self.sets.clear();
        self.sides.clear();
    }

    /// Makes room for a problem of so many entries, unknowns, branches, blocks and singles.
    pub fn fit(&mut self, [entries, unknowns, branches, blocks, singles]: [usize; 5]) {
        self.factor.resize(entries, 0.0);
        self.pivots.resize(unknowns, 0.0);
        self.eliminated.resize(self.eliminated.len().max(branches), [0.0; ROOT * ROOT]);
        self.known.resize(branches, false);
        self.sets.resize(blocks, ActiveSet::Open);
        self.sides.resize(singles, Side::Inside);
    }

    /// Whether block `block` is in an affine active set, and in that of the factor.
    #[inline(always)]
    pub fn is_of(&self, block: usize, active_set: ActiveSet) -> bool {
        self.sets[block] == active_set && active_set.is_affine()
    }

    /// Whether single `single` is on the side of the factor.
    #[inline(always)]
    pub fn is_of_side(&self, single: usize, side: Side) -> bool {
        self.sides[single] == side
    }

    /// Whether branch `k` has to be made anew, as of now with what its costs stand at.
    #[inline(always)]
    pub fn renews(&mut self, k: usize, branch: &Branch, blocks: &[Block], singles: &[Single]) -> bool {
        let (b, s) = (branch.blocks.0..branch.blocks.1, branch.singles.0..branch.singles.1);
        let same = self.known[k]
            && b.clone().all(|i| self.is_of(i, blocks[i].response.active_set))
            && s.clone().all(|i| self.is_of_side(i, singles[i].side()));
        if !same {
            self.known[k] = true;
            b.for_each(|i| self.sets[i] = blocks[i].response.active_set);
            s.for_each(|i| self.sides[i] = singles[i].side());
        }
        !same
    }
}
