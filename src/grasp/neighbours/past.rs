//! What the constraints hand on to the next step, to save and restore.

use super::{Law, MAX_ROWS, Neighbour, Neighbours, Owner, Zone};

/// What a constraint hands on to the next step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(in crate::grasp) struct Past {
    owner: Owner,
    rows: usize,
    main: [f64; MAX_ROWS],
    force: [f64; MAX_ROWS],
    zones: [Zone; 2],
}

impl Neighbours {
    /// What the next step remembers, into `out`. Guests are not in it: the grasp whose contacts they are remembers them.
    pub(in crate::grasp) fn save_into(&self, out: &mut Vec<Past>) {
        out.clear();
        out.extend(self.list.iter().filter(|n| n.guest().is_none()).map(|n| Past {
            owner: n.owner,
            rows: n.rows,
            main: n.main,
            force: n.force,
            zones: n.zones,
        }));
    }

    /// The next step remembers `past`.
    pub(in crate::grasp) fn restore(&mut self, past: &[Past]) {
        self.forget();
        self.list.extend(past.iter().map(Past::constraint));
    }
}

impl Past {
    /// A constraint that has this to remember, and no part in any solve.
    fn constraint(&self) -> Neighbour {
        let Past { owner, rows, main, force, zones } = *self;
        let (law, pairs, gives, solved) = (Law::Still, [0.0; 5], false, false);
        Neighbour { law, rows, first: 0, main, force, zones, pairs, gives, solved, row: 0, owner }
    }

    /// The geoms that it names, if it is a contact.
    pub(in crate::grasp) fn geoms(&self) -> Option<(usize, usize)> {
        if let Owner::Geoms(a, b, _) = self.owner { Some((a, b)) } else { None }
    }

    /// True if it is the engine's, its rows are those of one constraint, and every number is finite.
    pub(in crate::grasp) fn is_sound(&self) -> bool {
        !matches!(self.owner, Owner::Guest(_))
            && (1..=MAX_ROWS).contains(&self.rows)
            && self.main.iter().chain(&self.force).all(|x| x.is_finite())
    }
}
