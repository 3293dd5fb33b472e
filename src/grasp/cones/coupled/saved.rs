//! What the constraints hand on to the next step, to save and restore.

use super::{ActiveSet, CoupledConstraint, CoupledConstraints, MAX_ROWS, Owner};

/// What a constraint hands on to the next step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct SavedConstraint {
    owner: Owner,
    rows: usize,
    main: [f64; MAX_ROWS],
    force: [f64; MAX_ROWS],
    active_sets: [ActiveSet; 2],
}

impl CoupledConstraints {
    /// What the next step remembers, into `out`. Contacts of other grasps are not in it: the grasp whose contacts they are remembers them.
    pub(in crate::grasp) fn save_into(&self, out: &mut Vec<SavedConstraint>) {
        out.clear();
        out.extend(self.list.iter().filter(|n| n.foreign().is_none()).map(|n| SavedConstraint {
            owner: n.owner,
            rows: n.rows,
            main: n.main,
            force: n.force,
            active_sets: n.active_sets,
        }));
    }

    /// The next step remembers `past`.
    pub(in crate::grasp) fn restore(&mut self, past: &[SavedConstraint]) {
        self.forget();
        self.list.extend(past.iter().map(SavedConstraint::constraint));
    }
}

impl SavedConstraint {
    /// A constraint that has this to remember, and no part in any solve.
    fn constraint(&self) -> CoupledConstraint {
        let SavedConstraint { owner, rows, main, force, active_sets } = *self;
        CoupledConstraint { main, force, active_sets, ..CoupledConstraint::new(owner, rows) }
    }

    /// The geoms that it names, if it is a contact.
    pub(in crate::grasp) fn geoms(&self) -> Option<(usize, usize)> {
        if let Owner::Geoms(a, b, _) = self.owner { Some((a, b)) } else { None }
    }

    /// True if it is the engine's, its rows are those of one constraint, and every number is finite.
    pub(in crate::grasp) fn is_sound(&self) -> bool {
        !matches!(self.owner, Owner::Foreign(_))
            && (1..=MAX_ROWS).contains(&self.rows)
            && self.main.iter().chain(&self.force).all(|x| x.is_finite())
    }
}
