//! Fingers and bodies as the merged grasp needs them: how easily the hand's joints let a contact move, and the motion of
//! a body under generalised velocities or accelerations.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` along the kinematic tree, `L` coupling a joint to its ancestors only.
//! A contact's row `J` becomes `Y = J L^-1 D^-1/2`, with `J M^-1 J^T = Y Y^T`: entries for the finger's own joints, which
//! no other finger has, and entries for the joints that carry the palm.

use crate::grasp::contact::contacts::GraspContact;
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg;
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
    row: Vec<f64>,
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
        Fingers { place, joints, base, row: Vec::new(), whitened: Vec::new() }
    }

    /// Number of fingers.
    pub(in crate::grasp) fn count(&self) -> usize {
        self.joints.len()
    }

    /// Number of joints that carry the palm.
    pub(in crate::grasp) fn base(&self) -> usize {
        self.base
    }

    /// The stacked rows of contacts `of` that touch one finger (`None`: the palm, which has no joints of its own):
    /// `J M_ff^-1 J^T` over the finger's own joints into `mobility`, row-major, and the rows of `Y` for the base's joints
    /// into `base`. Rows beyond a contact's condim stay zero.
    pub(in crate::grasp) fn mobility(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        finger: Option<usize>,
        (contacts, of): (&[GraspContact], &[usize]),
        mobility: &mut Vec<f64>,
        base: &mut Vec<f64>,
    ) {
        let n = ROWS * of.len();
        let joints = finger.map_or(0, |finger| self.joints[finger]);
        self.whitened.clear();
        self.whitened.resize(n * joints, 0.0);
        base.clear();
        base.resize(n * self.base, 0.0);
        for (k, &i) in of.iter().enumerate() {
            for row in 0..contacts[i].parameters.condim.min(ROWS) {
                let at = ROWS * k + row;
                let own = &mut self.whitened[at * joints..(at + 1) * joints];
                let shared = &mut base[at * self.base..(at + 1) * self.base];
                whiten(sim, topology, &contacts[i], row, &self.place, &mut self.row, own, shared);
            }
        }
        mobility.clear();
        mobility.resize(n * n, 0.0);
        for i in 0..n {
            let a = &self.whitened[i * joints..(i + 1) * joints];
            for j in 0..=i {
                let value = linalg::dot(a, &self.whitened[j * joints..(j + 1) * joints]);
                mobility[i * n + j] = value;
                mobility[j * n + i] = value;
            }
        }
    }
}

/// One row of `Y`, into the finger's own joints and those of the base.
#[allow(clippy::too_many_arguments)]
fn whiten(
    sim: &Simulation,
    topology: &Topology,
    contact: &GraspContact,
    row: usize,
    place: &[Place],
    chain: &mut Vec<f64>,
    own: &mut [f64],
    shared: &mut [f64],
) {
    let (turn, push) = direction(contact, row, &reference_point(sim, contact.link));
    chain.clear();
    for_each_dof(sim, topology, contact.link, |dof| {
        chain.push(power(&sim.cdof()[6 * dof..], &turn, &push));
    });
    let factor = sim.mass_factor();
    let mut k = 0;
    for_each_dof(sim, topology, contact.link, |dof| {
        let value = chain[k];
        k += 1;
        for (ancestor, l) in chain[k..].iter_mut().zip(factor.ancestors(dof)) {
            *ancestor -= value * l;
        }
        let whitened = value * sim.qLDiagInv()[dof].sqrt();
        match place[dof] {
            Place::Finger(index) => own[index] = whitened,
            Place::Base(index) => shared[index] = whitened,
            Place::Outside => {}
        }
    });
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
pub(in crate::grasp) fn for_each_dof(sim: &Simulation, topology: &Topology, body: usize, mut f: impl FnMut(usize)) {
    let parent = sim.model().dof_parentid();
    let mut dof = topology.leaf(body);
    while let Some(i) = dof {
        f(i);
        dof = usize::try_from(parent[i]).ok();
    }
}

/// Motion `[rotation; translation]` of `body` about its reference point under generalised rates `rates`: `J rates`.
pub(in crate::grasp) fn motion(sim: &Simulation, topology: &Topology, body: usize, rates: &[f64]) -> [f64; 6] {
    let mut out = [0.0; 6];
    for_each_dof(sim, topology, body, |dof| {
        linalg::axpy(rates[dof], &sim.cdof()[6 * dof..6 * dof + 6], &mut out);
    });
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

/// Motion of the target minus that of the link in the rows of a contact, for the bodies' motions as from [`motion`].
pub(in crate::grasp) fn relative_rows(
    sim: &Simulation,
    contact: &GraspContact,
    target: &[f64; 6],
    link: &[f64; 6],
) -> [f64; ROWS] {
    let points = [contact.target, contact.link].map(|body| reference_point(sim, body));
    std::array::from_fn(|row| {
        let (turn, push) = direction(contact, row, &points[0]);
        let of_target = power(target, &turn, &push);
        let (turn, push) = direction(contact, row, &points[1]);
        of_target - power(link, &turn, &push)
    })
}
