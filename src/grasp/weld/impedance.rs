//! Fingers and bodies as the merged grasp needs them: how easily the hand's joints let a contact move, and the motion of
//! a body under generalised velocities or accelerations.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree, `L` coupling a joint to its ancestors only.
//! A contact's row `J` becomes `Y = J L^-1 D^-1/2`, with `J M^-1 J^T = Y Y^T`: entries for the finger's own joints, which
//! no other finger has, and entries for the joints that carry the palm.

use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg::{self, Spatial};
use crate::mujoco::{CompiledModel, Simulation};
use nalgebra::{Matrix6, Vector3, Vector6};

/// Rows of a contact: a force along each of its axes, a torque about each.
pub(in crate::grasp) const ROWS: usize = 6;

/// Which finger each degree of freedom belongs to, and its place there; those that carry the palm are the base.
#[derive(Clone, Debug, Default)]
pub(in crate::grasp) struct Fingers {
    place: Vec<Place>,
    joints: Vec<usize>,
    base: usize,
    /// Entries of one contact's rows, the nearest joint first.
    chain: Vec<f64>,
    whitened: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    Finger(usize),
    Base(usize),
    Outside,
}

impl Fingers {
    /// Reads the fingers of a hand.
    pub(in crate::grasp) fn new(model: &CompiledModel, topology: &Topology) -> Fingers {
        let mut joints = vec![0; topology.fingers().len()];
        let mut place: Vec<Place> = model
            .dof_bodyid()
            .iter()
            .map(|&body| match topology.finger(body as usize) {
                Some(finger) => {
                    joints[finger] += 1;
                    Place::Finger(joints[finger] - 1)
                }
                None => Place::Outside,
            })
            .collect();
        let mut base = 0;
        let mut dof = topology.leaf(topology.palm());
        while let Some(i) = dof {
            place[i] = Place::Base(base);
            base += 1;
            dof = usize::try_from(model.dof_parentid()[i]).ok();
        }
        Fingers { place, joints, base, chain: Vec::new(), whitened: Vec::new() }
    }

    /// Number of fingers.
    pub(in crate::grasp) fn count(&self) -> usize {
        self.joints.len()
    }

    /// Number of joints that carry the palm.
    pub(in crate::grasp) fn base(&self) -> usize {
        self.base
    }

    /// The stacked rows of contacts `of` that touch one finger (`None`: the palm, which has no joints of its own), as many
    /// of each as its condim: `J M_ff^-1 J^T` over the finger's own joints into `mobility`, row-major, and the rows of `Y`
    /// for the base's joints into `base`.
    pub(in crate::grasp) fn mobility(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        finger: Option<usize>,
        (contacts, of): (&[GraspContact], &[usize]),
        mobility: &mut Vec<f64>,
        base: &mut Vec<f64>,
    ) {
        let n: usize = of.iter().map(|&i| condim(&contacts[i])).sum();
        let joints = finger.map_or(0, |finger| self.joints[finger]);
        self.whitened.clear();
        self.whitened.resize(joints * n, 0.0);
        base.clear();
        base.resize(n * self.base, 0.0);
        let mut first = 0;
        for &i in of {
            let rows = condim(&contacts[i]);
            // most contacts have three rows or four: a vector's worth
            if rows <= 4 {
                self.whiten::<4>(sim, topology, &contacts[i], (first, n), base);
            } else {
                self.whiten::<ROWS>(sim, topology, &contacts[i], (first, n), base);
            }
            first += rows;
        }
        mobility.clear();
        mobility.resize(n * n, 0.0);
        for y in self.whitened.chunks_exact(n.max(1)) {
            for (i, entry) in y.iter().enumerate() {
                linalg::axpy(*entry, y, &mut mobility[i * n..(i + 1) * n]);
            }
        }
    }

    /// The rows of `Y` of one contact, which has at most `N`, row `first` of `n` and those after it, into `whitened`
    /// (joints x n) and `base`.
    fn whiten<const N: usize>(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        contact: &GraspContact,
        (first, n): (usize, usize),
        base: &mut [f64],
    ) {
        let rows = condim(contact);
        let point = reference_point(sim, contact.link);
        let directions: [_; N] = std::array::from_fn(|row| direction(contact, row, &point));
        self.chain.clear();
        for_each_dof(sim, topology, contact.link, |dof| {
            let axis = &sim.cdof()[6 * dof..6 * dof + 6];
            self.chain.extend(directions.iter().map(|(turn, push)| power(axis, turn, push)));
        });
        let factor = sim.mass_factor();
        let mut rest = self.chain.as_chunks_mut::<N>().0;
        for_each_dof(sim, topology, contact.link, |dof| {
            let Some((entries, ancestors)) = std::mem::take(&mut rest).split_first_mut() else { return };
            for (ancestor, l) in ancestors.iter_mut().zip(factor.ancestors(dof)) {
                for (a, entry) in ancestor.iter_mut().zip(&*entries) {
                    *a -= l * entry;
                }
            }
            rest = ancestors;
            let scale = sim.qLDiagInv()[dof].sqrt();
            for (row, entry) in entries[..rows].iter().enumerate() {
                match self.place[dof] {
                    Place::Finger(joint) => self.whitened[joint * n + first + row] = entry * scale,
                    Place::Base(joint) => base[(first + row) * self.base + joint] = entry * scale,
                    Place::Outside => {}
                }
            }
        });
    }
}

/// Number of a contact's rows.
pub(in crate::grasp) fn condim(contact: &GraspContact) -> usize {
    contact.parameters.condim.min(ROWS)
}

/// Direction of row `row` of a contact as a torque about `point` and a force, world axes.
pub(in crate::grasp) fn direction(
    contact: &GraspContact,
    row: usize,
    point: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let axis = contact.axes[row % 3];
    if row < 3 { ((contact.position - point).cross(&axis), axis) } else { (axis, Vector3::zeros()) }
}

/// Wrench `[force; torque about point]` of a unit force in row `row` of a contact.
pub(in crate::grasp) fn row_wrench(contact: &GraspContact, row: usize, point: &Vector3<f64>) -> Vector6<f64> {
    let (turn, push) = direction(contact, row, point);
    Vector6::new(push.x, push.y, push.z, turn.x, turn.y, turn.z)
}

/// Power of a torque and a force on a motion `[rotation; translation]`.
pub(in crate::grasp) fn power(motion: &[f64], turn: &Vector3<f64>, push: &Vector3<f64>) -> f64 {
    motion[0] * turn.x
        + motion[1] * turn.y
        + motion[2] * turn.z
        + motion[3] * push.x
        + motion[4] * push.y
        + motion[5] * push.z
}

/// The point that the motions of `body`'s kinematic tree refer to: the tree's centre of mass.
pub(in crate::grasp) fn reference_point(sim: &Simulation, body: usize) -> Vector3<f64> {
    let root = sim.model().body_rootid()[body] as usize;
    Vector3::from_column_slice(&sim.subtree_com()[3 * root..3 * root + 3])
}

/// Calls `f` with each degree of freedom that moves `body`, the nearest first.
#[inline]
pub(in crate::grasp) fn for_each_dof(sim: &Simulation, topology: &Topology, body: usize, f: impl FnMut(usize)) {
    for_each_dof_below(sim, topology.leaf(body), None, f);
}

/// Calls `f` with degree of freedom `first` and those that carry it, up to but without `end`.
#[inline]
pub(in crate::grasp) fn for_each_dof_below(
    sim: &Simulation,
    first: Option<usize>,
    end: Option<usize>,
    mut f: impl FnMut(usize),
) {
    let parent = sim.model().dof_parentid();
    let mut dof = first;
    while let Some(i) = dof.filter(|_| dof != end) {
        f(i);
        dof = usize::try_from(parent[i]).ok();
    }
}

/// Motion `[rotation; translation]` about the reference point of unit speed of a degree of freedom.
pub(in crate::grasp) fn dof_motion(sim: &Simulation, dof: usize) -> Spatial {
    Spatial::from_column_slice(&sim.cdof()[6 * dof..6 * dof + 6])
}

/// Motion of `body` about its reference point under generalised rates `rates`: `J rates`.
pub(in crate::grasp) fn motion(sim: &Simulation, topology: &Topology, body: usize, rates: &[f64]) -> Spatial {
    let mut out = Spatial::zeros();
    for_each_dof(sim, topology, body, |dof| out += dof_motion(sim, dof) * rates[dof]);
    out
}

/// The six-vector motion that a link's motion `[rotation; translation]` about its reference point adds to a whole, where
/// its motion along row `row` of a contact adds `share(row)`.
pub(in crate::grasp) fn link_motion(
    sim: &Simulation,
    contact: &GraspContact,
    share: impl Fn(usize) -> Vector6<f64>,
) -> Matrix6<f64> {
    let point = reference_point(sim, contact.link);
    let mut map = Matrix6::zeros();
    for row in 0..ROWS {
        let (turn, push) = direction(contact, row, &point);
        let along = Vector6::new(turn.x, turn.y, turn.z, push.x, push.y, push.z);
        map += share(row) * along.transpose();
    }
    map
}
