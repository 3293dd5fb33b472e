//! Which joint belongs where: palm, fingers, target.
//!
//! The hand's kinematic tree is cut at the palm. The degrees of freedom from the world to the palm and those of the
//! target are the *root*; each subtree that hangs from the palm is a *finger* of its own.

use crate::mujoco::BodyId;

/// The parts of a model that describe its kinematic tree; see MuJoCo's `mjModel`.
#[derive(Clone, Copy, Debug)]
pub struct Tree<'a> {
    /// Parent of each body.
    pub body_parent: &'a [i32],
    /// First degree of freedom of each body.
    pub body_dofadr: &'a [i32],
    /// Number of degrees of freedom of each body.
    pub body_dofnum: &'a [i32],
    /// Parent of each degree of freedom, -1 at the base.
    pub dof_parent: &'a [i32],
    /// Body of each degree of freedom.
    pub dof_body: &'a [i32],
}

/// Hand and target as the solver sees them. Computed once for a grasp.
#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    palm: usize,
    target: usize,
    /// Last degree of freedom on the way from the world to each body.
    leaf: Vec<Option<usize>>,
    /// Finger of each body of the hand; `None` for the palm and what is fixed to it.
    finger: Vec<Option<usize>>,
    /// Degrees of freedom of each finger, parents first.
    fingers: Vec<Vec<usize>>,
    in_hand: Vec<bool>,
    in_target: Vec<bool>,
}

/// True if `ancestor` lies on the way from `body` to the world, or is `body`.
pub fn is_ancestor(body_parent: &[i32], ancestor: usize, mut body: usize) -> bool {
    loop {
        if body == ancestor {
            return true;
        }
        if body == 0 {
            return false;
        }
        body = body_parent[body] as usize;
    }
}

/// The lowest body that is an ancestor of (or the same as) each of `bodies`; the world for none.
pub fn lowest_common_ancestor(body_parent: &[i32], bodies: &[usize]) -> usize {
    let Some(&first) = bodies.first() else { return 0 };
    let mut candidate = first;
    while !bodies.iter().all(|&b| is_ancestor(body_parent, candidate, b)) {
        candidate = body_parent[candidate] as usize;
    }
    candidate
}

impl Topology {
    /// Cuts the tree. `palm` is the base of the fingers (0, the world, for fingers that stand on it), `effectors` the
    /// links that may hold the target. With a palm, every body below it is part of the hand; without, the bodies of
    /// the subtrees (children of the world) that hold an effector. The target is its body with all that is fixed to it.
    pub fn new(tree: &Tree<'_>, palm: usize, effectors: &[usize], target: usize) -> Topology {
        let bodies = tree.body_parent.len();
        let base = |mut body: usize| {
            while body != 0 && tree.body_parent[body] != 0 {
                body = tree.body_parent[body] as usize;
            }
            body
        };
        let rigid_base = |mut body: usize| {
            while body != 0 && tree.body_dofnum[body] == 0 {
                body = tree.body_parent[body] as usize;
            }
            body
        };
        let in_target: Vec<bool> = (0..bodies).map(|b| b != 0 && rigid_base(b) == rigid_base(target)).collect();
        let in_hand: Vec<bool> = (0..bodies)
            .map(|b| {
                base(b) != base(target)
                    && if palm == 0 {
                        b != 0 && effectors.iter().any(|&e| base(e) == base(b))
                    } else {
                        is_ancestor(tree.body_parent, palm, b)
                    }
            })
            .collect();
        let leaf: Vec<Option<usize>> = (0..bodies)
            .map(rigid_base)
            .map(|b| (tree.body_dofnum[b] > 0).then(|| (tree.body_dofadr[b] + tree.body_dofnum[b] - 1) as usize))
            .collect();

        let mut fingers: Vec<Vec<usize>> = Vec::new();
        let mut finger_of_dof: Vec<Option<usize>> = vec![None; tree.dof_parent.len()];
        for dof in 0..tree.dof_parent.len() {
            let body = tree.dof_body[dof] as usize;
            if !in_hand[body] || is_ancestor(tree.body_parent, body, palm) {
                continue;
            }
            // parents come before their children
            let parent = usize::try_from(tree.dof_parent[dof]).ok().and_then(|p| finger_of_dof[p]);
            let finger = parent.unwrap_or_else(|| {
                fingers.push(Vec::new());
                fingers.len() - 1
            });
            fingers[finger].push(dof);
            finger_of_dof[dof] = Some(finger);
        }
        let finger = leaf.iter().map(|leaf| leaf.and_then(|dof| finger_of_dof[dof])).collect();
        Topology { palm, target, leaf, finger, fingers, in_hand, in_target }
    }

    /// Base of the fingers.
    pub fn palm(&self) -> usize {
        self.palm
    }

    /// The body that is held.
    pub fn target(&self) -> usize {
        self.target
    }

    /// Last degree of freedom on the way from the world to `body`.
    pub fn leaf(&self, body: usize) -> Option<usize> {
        self.leaf[body]
    }

    /// The finger that `body` belongs to; `None` for the palm and bodies fixed to it.
    pub fn finger(&self, body: usize) -> Option<usize> {
        self.finger[body]
    }

    /// Degrees of freedom of each finger.
    pub fn fingers(&self) -> &[Vec<usize>] {
        &self.fingers
    }

    /// True for the palm and all below it.
    pub fn in_hand(&self, body: usize) -> bool {
        self.in_hand[body]
    }

    /// True for the target and all that is fixed to it.
    pub fn in_target(&self, body: usize) -> bool {
        self.in_target[body]
    }

    /// True if one of two bodies is in the hand and the other in the target.
    pub fn joins(&self, [a, b]: [BodyId; 2]) -> bool {
        let [a, b] = [a.index(), b.index()];
        (self.in_hand[a] && self.in_target[b]) || (self.in_hand[b] && self.in_target[a])
    }

    /// A body that is in both hands where both hold the same target: its contacts would belong to both grasps.
    pub fn shared_with(&self, other: &Topology) -> Option<usize> {
        let both = |a: &[bool], b: &[bool]| a.iter().zip(b).position(|(a, b)| *a && *b);
        both(&self.in_target, &other.in_target).and_then(|_| both(&self.in_hand, &other.in_hand))
    }

    /// True if the target hangs on the hand's own tree, so that hand and target are one mechanism.
    pub fn shares_tree(&self, tree: &Tree<'_>) -> bool {
        self.palm != 0 && (is_ancestor(tree.body_parent, self.palm, self.target) || !self.in_hand.iter().any(|&h| h))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// world - arm(1) - palm(2) - fingers 3, 4 (two links: 4, 5), fixed tip 6 on 5; target 7 with a fixed part 8.
    #[allow(clippy::type_complexity)]
    fn hand() -> ([i32; 9], [i32; 9], [i32; 9], Vec<i32>, Vec<i32>) {
        let parent = [0, 0, 1, 2, 2, 4, 5, 0, 7];
        let dofnum = [0, 2, 1, 2, 1, 1, 0, 6, 0];
        let dofadr = [-1, 0, 2, 3, 5, 6, -1, 7, -1];
        let dof_parent = vec![-1, 0, 1, 2, 3, 2, 5, -1, 7, 8, 9, 10, 11];
        let dof_body = vec![1, 1, 2, 3, 3, 4, 5, 7, 7, 7, 7, 7, 7];
        (parent, dofadr, dofnum, dof_parent, dof_body)
    }

    #[test]
    fn fingers_are_the_subtrees_of_the_palm() {
        let (parent, dofadr, dofnum, dof_parent, dof_body) = hand();
        let tree = Tree {
            body_parent: &parent,
            body_dofadr: &dofadr,
            body_dofnum: &dofnum,
            dof_parent: &dof_parent,
            dof_body: &dof_body,
        };
        let topology = Topology::new(&tree, 2, &[3, 6], 7);
        assert_eq!(topology.fingers(), [vec![3, 4], vec![5, 6]]);
        assert_eq!(topology.finger(6), Some(1));
        assert_eq!(topology.finger(2), None);
        assert_eq!(topology.leaf(6), Some(6));
        assert_eq!(topology.leaf(8), Some(12));
        assert!(topology.in_target(8) && !topology.in_target(0) && !topology.in_hand(7));
        assert!(topology.in_hand(2) && !topology.in_hand(1));
        assert!(!topology.shares_tree(&tree));
        // fingers that stand on the world
        let world = Topology::new(&tree, 0, &[3, 6], 7);
        assert_eq!(world.fingers(), [vec![0, 1, 2, 3, 4, 5, 6]]);
        // the hand's own link as target
        assert!(Topology::new(&tree, 2, &[3], 6).shares_tree(&tree));
    }

    #[test]
    fn lowest_common_ancestor_of_two_fingers_is_the_palm() {
        let (parent, ..) = hand();
        assert_eq!(lowest_common_ancestor(&parent, &[3, 6]), 2);
        assert_eq!(lowest_common_ancestor(&parent, &[6]), 6);
        assert_eq!(lowest_common_ancestor(&parent, &[3, 7]), 0);
    }
}
