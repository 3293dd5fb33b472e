//! Which joint belongs where: palm, fingers, target.
//!
//! The hand's kinematic tree is cut at the palm. The degrees of freedom from the world to the palm and those of the
//! target are the *root*; each subtree that hangs from the palm is a *finger* of its own.

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

/// Place of a degree of freedom in the grasp problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// Unknown `index` of the root.
    Root(usize),
    /// Unknown `index` of finger `finger`.
    Finger {
        /// Which finger.
        finger: usize,
        /// Which of its unknowns.
        index: usize,
    },
    /// Not a part of hand or target.
    Outside,
}

/// Hand and target as the solver sees them. Computed once for a grasp.
#[derive(Clone, Debug)]
pub struct Topology {
    slots: Vec<Slot>,
    /// Last degree of freedom on the way from the world to each body.
    leaf: Vec<Option<usize>>,
    /// Number of unknowns of each finger.
    fingers: Vec<usize>,
    root: usize,
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
    /// the subtrees (children of the world) that hold an effector.
    pub fn new(tree: &Tree<'_>, palm: usize, effectors: &[usize], target: usize) -> Topology {
        let bodies = tree.body_parent.len();
        let base = |mut body: usize| {
            while body != 0 && tree.body_parent[body] != 0 {
                body = tree.body_parent[body] as usize;
            }
            body
        };
        let target_base = base(target);
        let in_target: Vec<bool> = (0..bodies).map(|b| b != 0 && base(b) == target_base).collect();
        let in_hand: Vec<bool> = (0..bodies)
            .map(|b| {
                !in_target[b]
                    && if palm == 0 {
                        b != 0 && effectors.iter().any(|&e| base(e) == base(b))
                    } else {
                        is_ancestor(tree.body_parent, palm, b)
                    }
            })
            .collect();
        let leaf: Vec<Option<usize>> = (0..bodies)
            .map(|mut b| {
                while b != 0 && tree.body_dofnum[b] == 0 {
                    b = tree.body_parent[b] as usize;
                }
                (tree.body_dofnum[b] > 0).then(|| (tree.body_dofadr[b] + tree.body_dofnum[b] - 1) as usize)
            })
            .collect();

        let dofs = tree.dof_parent.len();
        let mut topology = Topology {
            slots: vec![Slot::Outside; dofs],
            leaf,
            fingers: Vec::new(),
            root: 0,
            in_hand,
            in_target,
        };
        if palm != 0 {
            let mut dof = topology.leaf[palm];
            while let Some(i) = dof {
                topology.slots[i] = Slot::Root(topology.root);
                topology.root += 1;
                dof = usize::try_from(tree.dof_parent[i]).ok();
            }
        }
        for i in 0..dofs {
            let body = tree.dof_body[i] as usize;
            if topology.slots[i] != Slot::Outside {
                continue;
            }
            if topology.in_target[body] {
                topology.slots[i] = Slot::Root(topology.root);
                topology.root += 1;
            } else if topology.in_hand[body] {
                // parents come before their children
                let parent = usize::try_from(tree.dof_parent[i]).ok().map(|p| topology.slots[p]);
                let finger = match parent {
                    Some(Slot::Finger { finger, .. }) => finger,
                    _ => {
                        topology.fingers.push(0);
                        topology.fingers.len() - 1
                    }
                };
                let index = topology.fingers[finger];
                topology.slots[i] = Slot::Finger { finger, index };
                topology.fingers[finger] += 1;
            }
        }
        topology
    }

    /// Place of degree of freedom `dof`.
    pub fn slot(&self, dof: usize) -> Slot {
        self.slots[dof]
    }

    /// Last degree of freedom on the way from the world to `body`.
    pub fn leaf(&self, body: usize) -> Option<usize> {
        self.leaf[body]
    }

    /// The finger that `body` belongs to; `None` for the palm and bodies fixed to it.
    pub fn finger(&self, body: usize) -> Option<usize> {
        match self.slots[self.leaf[body]?] {
            Slot::Finger { finger, .. } => Some(finger),
            _ => None,
        }
    }

    /// Number of unknowns of each finger.
    pub fn fingers(&self) -> &[usize] {
        &self.fingers
    }

    /// Number of shared unknowns: the palm's degrees of freedom and the target's.
    pub fn root(&self) -> usize {
        self.root
    }

    /// True for the palm and all below it.
    pub fn in_hand(&self, body: usize) -> bool {
        self.in_hand[body]
    }

    /// True for the target and all that hangs on it.
    pub fn in_target(&self, body: usize) -> bool {
        self.in_target[body]
    }

    /// True if the target can move.
    pub fn target_moves(&self) -> bool {
        (0..self.slots.len()).any(|i| matches!(self.slots[i], Slot::Root(_)))
            && self.in_target.iter().zip(&self.leaf).any(|(&t, l)| t && l.is_some())
    }
}
