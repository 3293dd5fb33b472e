//! Fingers and bodies as the merged grasp needs them: how easily a finger's own joints let a contact move, and the
//! motion of a body under generalised velocities or accelerations.
//!
//! MuJoCo factors the mass matrix as `M = L^T D L` from the leaves of the kinematic tree to its base, so the part of the
//! factor that belongs to a finger's own joints is the factor of `M_ff`, the inertia of the finger with the palm held.

use super::contacts::GraspContact;
use super::dense;
use super::topology::Topology;
use crate::mujoco::{CompiledModel, Simulation};
use nalgebra::{Matrix6, Vector3, Vector6};

/// Rows of a contact: a force along each of its axes, a torque about each.
pub(super) const ROWS: usize = 6;

/// Which finger each degree of freedom belongs to, and its place there.
#[derive(Clone, Debug, Default)]
pub(super) struct Fingers {
    place: Vec<Option<(usize, usize)>>,
    joints: Vec<usize>,
    row: Vec<f64>,
    whitened: Vec<f64>,
}

impl Fingers {
    /// Reads the fingers of a hand.
    pub(super) fn new(model: &CompiledModel, topology: &Topology) -> Fingers {
        let mut joints = vec![0; topology.fingers().len()];
        let place = model
            .dof_bodyid()
            .iter()
            .map(|&body| {
                let finger = topology.finger(body as usize)?;
                joints[finger] += 1;
                Some((finger, joints[finger] - 1))
            })
            .collect();
        Fingers {
            place,
            joints,
            row: Vec::new(),
            whitened: Vec::new(),
        }
    }

    /// Number of fingers.
    pub(super) fn count(&self) -> usize {
        self.joints.len()
    }

    /// `J M_ff^-1 J^T` of the stacked rows of contacts `of` that touch one finger (`None`: the palm, which has no joints
    /// of its own, so zero), row-major, into `out`.
    pub(super) fn mobility(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        finger: Option<usize>,
        contacts: &[GraspContact],
        of: &[usize],
        out: &mut Vec<f64>,
    ) {
        let n = ROWS * of.len();
        out.clear();
        out.resize(n * n, 0.0);
        let Some(finger) = finger else { return };
        let joints = self.joints[finger];
        self.whitened.clear();
        self.whitened.resize(n * joints, 0.0);
        for (k, &i) in of.iter().enumerate() {
            for row in 0..ROWS {
                self.whiten(sim, topology, &contacts[i], row, (ROWS * k + row) * joints);
            }
        }
        for i in 0..n {
            let a = &self.whitened[i * joints..(i + 1) * joints];
            for j in 0..=i {
                let b = &self.whitened[j * joints..(j + 1) * joints];
                let value = dense::dot(a, b);
                out[i * n + j] = value;
                out[j * n + i] = value;
            }
        }
    }

    /// `J L^-1 D^-1/2` of one row over the finger's joints, into the whitened rows from `at` on.
    fn whiten(
        &mut self,
        sim: &Simulation,
        topology: &Topology,
        contact: &GraspContact,
        row: usize,
        at: usize,
    ) {
        let model = sim.model();
        let (parent, address) = (model.dof_parentid(), model.dof_Madr());
        let place = &self.place;
        let own = |dof: &usize| place[*dof].is_some();
        let next = |dof: usize| usize::try_from(parent[dof]).ok().filter(own);
        let first = topology.leaf(contact.link).filter(own);
        let (turn, push) = direction(contact, row, &reference_point(sim, contact.link));
        self.row.clear();
        let mut dof = first;
        while let Some(i) = dof {
            self.row.push(power(&sim.cdof()[6 * i..], &turn, &push));
            dof = next(i);
        }
        let mut dof = first;
        let mut k = 0;
        while let Some(i) = dof {
            let value = self.row[k];
            let ancestors = self.row.len() - k - 1;
            let start = address[i] as usize + 1;
            dense::axpy(
                -value,
                &sim.qLD()[start..start + ancestors],
                &mut self.row[k + 1..],
            );
            if let Some((_, index)) = self.place[i] {
                self.whitened[at + index] = value * sim.qLDiagInv()[i].sqrt();
            }
            k += 1;
            dof = next(i);
        }
    }
}

/// Direction of row `row` of a contact as a torque about `point` and a force, world axes.
pub(super) fn direction(
    contact: &GraspContact,
    row: usize,
    point: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let axis = contact.axes[row % 3];
    if row < 3 {
        ((contact.position - point).cross(&axis), axis)
    } else {
        (axis, Vector3::zeros())
    }
}

/// Wrench `[force; torque about point]` of a unit force in row `row` of a contact.
pub(super) fn row_wrench(contact: &GraspContact, row: usize, point: &Vector3<f64>) -> Vector6<f64> {
    let (turn, push) = direction(contact, row, point);
    Vector6::new(push.x, push.y, push.z, turn.x, turn.y, turn.z)
}

/// Power of a torque and a force on a motion `[rotation; translation]`.
pub(super) fn power(motion: &[f64], turn: &Vector3<f64>, push: &Vector3<f64>) -> f64 {
    motion[0] * turn.x
        + motion[1] * turn.y
        + motion[2] * turn.z
        + motion[3] * push.x
        + motion[4] * push.y
        + motion[5] * push.z
}

/// The point that the motions of `body`'s kinematic tree refer to: the tree's centre of mass.
pub(super) fn reference_point(sim: &Simulation, body: usize) -> Vector3<f64> {
    let root = sim.model().body_rootid()[body] as usize;
    Vector3::from_column_slice(&sim.subtree_com()[3 * root..3 * root + 3])
}

/// Calls `f` with each degree of freedom that moves `body`, the nearest first.
pub(super) fn for_each_dof(
    sim: &Simulation,
    topology: &Topology,
    body: usize,
    mut f: impl FnMut(usize),
) {
    let parent = sim.model().dof_parentid();
    let mut dof = topology.leaf(body);
    while let Some(i) = dof {
        f(i);
        dof = usize::try_from(parent[i]).ok();
    }
}

/// Motion `[rotation; translation]` of `body` about its reference point under generalised rates `rates`: `J rates`.
pub(super) fn motion(sim: &Simulation, topology: &Topology, body: usize, rates: &[f64]) -> [f64; 6] {
    let mut out = [0.0; 6];
    for_each_dof(sim, topology, body, |dof| {
        dense::axpy(rates[dof], &sim.cdof()[6 * dof..6 * dof + 6], &mut out);
    });
    out
}

/// The six-vector motion that a link's motion `[rotation; translation]` about its reference point adds to a whole, where
/// its motion along row `row` of a contact adds `share(row)`.
pub(super) fn link_motion(
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
pub(super) fn relative_rows(
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
