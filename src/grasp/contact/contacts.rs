//! The contacts between hand and target, read from the engine's collision stage.

use crate::grasp::cones::dynamics::Dynamics;
use crate::grasp::contact::cost::ActiveSet;
use crate::grasp::contact::softness::ContactParameters;
use crate::grasp::error::Error;
use crate::grasp::hand::topology::Topology;
use crate::grasp::linalg::Spatial;
use crate::grasp::monitor::wrench::LoadedContact;
use crate::mujoco::{BodyId, Cone, Contact, GeomId, Simulation};
use nalgebra::Vector3;
use std::borrow::Borrow;

mod memory;
mod motion;

pub(in crate::grasp) use memory::{SavedContact, WarmStart};
pub(in crate::grasp) use motion::Turning;

/// A contact that moves as far between two whole steps, seen from the link and from the target, has jumped, as the one point that
/// stands for a face may do in every step \[m\].
const JUMP: f64 = 1e-4;

/// One contact between a link of the hand and the target, with the force that it exerts.
///
/// Frame: world. Signs: `axes[0]`, the normal, points into the target; forces are those on the target; velocities are
/// target minus link.
#[derive(Clone, Debug)]
pub struct GraspContact {
    /// Body of the hand.
    pub link_id: BodyId,
    /// Index of the link's body.
    pub link: usize,
    /// Index of the target's body.
    pub target: usize,
    /// The two geoms, in the engine's order.
    pub geoms: (usize, usize),
    /// True if the target is the engine's first body of this contact.
    pub target_first: bool,
    /// Index in the engine's contact list of this step.
    pub index: usize,
    /// Finger that the link belongs to; `None` for the palm.
    pub finger: Option<usize>,
    /// Midpoint between the two surfaces \[m\].
    pub position: Vector3<f64>,
    /// Normal into the target, and two tangents.
    pub axes: [Vector3<f64>; 3],
    /// Distance, friction and softness.
    pub parameters: ContactParameters,
    /// Force of each row: normal, two tangents \[N\], spin, two rolling \[N m\].
    pub force_rows: [f64; 6],
    /// Force on the target \[N\].
    pub force: Vector3<f64>,
    /// Torque on the target besides that of `force` at `position` \[N m\].
    pub torque: Vector3<f64>,
    /// Where the contact stands on its cone: in the pass with soft contacts, and in the friction pass.
    pub active_sets: [ActiveSet; 2],
    /// Force of each row in the pass with soft contacts.
    pub(in crate::grasp) main: [f64; 6],
    /// `J a - aref` of each friction row in the friction pass.
    pub(in crate::grasp) residual: [f64; 5],
    /// The last degrees of freedom that move the link and the target.
    pub(in crate::grasp) leaves: [Option<usize>; 2],
    /// What the geometry, had it not been frozen, would have added to the target's velocity relative to the link: rotation and
    /// translation.
    drift: [Vector3<f64>; 2],
    /// True if the grasp's solver solved it, in both passes.
    pub(in crate::grasp) solved: bool,
    /// Tangential velocity of the target relative to the link \[m/s\].
    pub slip_velocity: Vector3<f64>,
    /// The same contact in the last step, if it existed.
    warm_start: Option<WarmStart>,
    /// How far the same contact's normal has tilted (as a rotation) and its point has come since it was read last.
    displacement: Option<[Vector3<f64>; 2]>,
    /// Its position in the frames of link and target \[m\].
    anchors: [Vector3<f64>; 2],
    /// How far it has come since it was read last, seen from that of the two from which it is less \[m\].
    jump: Option<f64>,
}

impl GraspContact {
    /// Normal force \[N\], never negative. In a merged grasp (limits "box" and "rigid") a contact can pull, since its
    /// row is bilateral: that counts as no force here.
    pub fn normal_force(&self) -> f64 {
        self.force_rows[0].max(0.0)
    }

    /// Rows' forces from the world force and torque.
    fn set_force(&mut self, force: Vector3<f64>, torque: Vector3<f64>) {
        for (i, axis) in self.axes.iter().enumerate() {
            self.force_rows[i] = axis.dot(&force);
            self.force_rows[i + 3] = axis.dot(&torque);
        }
        self.force = force;
        self.torque = torque;
    }

    /// World force and torque from the rows' forces.
    pub fn update_force(&mut self) {
        let [n, t1, t2] = &self.axes;
        let f = &self.force_rows;
        self.force = n * f[0] + t1 * f[1] + t2 * f[2];
        self.torque = n * f[3] + t1 * f[4] + t2 * f[5];
    }

    /// Friction over its limit: 0 for none, 1 at the edge of the friction cone of this shape; `None` without normal force or
    /// friction.
    pub fn friction_share(&self, cone: Cone) -> Option<f64> {
        let rows = self.parameters.condim.saturating_sub(1).min(5);
        let normal = self.normal_force();
        let limited = self.force_rows[1..].iter().zip(self.parameters.friction).take(rows).filter(|(_, mu)| *mu > 0.0);
        let shares = limited.map(|(force, mu)| (force / (mu * normal)).abs());
        let sum = |share: fn(f64) -> f64| shares.clone().map(share).reduce(|sum, share| sum + share);
        let share = match cone {
            Cone::Elliptic => sum(|share| share * share).map(f64::sqrt),
            _ => sum(|share| share),
        };
        share.filter(|_| normal > 0.0)
    }

    /// True while friction is at its limit.
    pub fn is_sliding(&self) -> bool {
        match self.active_sets[1] {
            ActiveSet::Slide => true,
            ActiveSet::Facet(saturated) => saturated != 0,
            ActiveSet::Open | ActiveSet::Stick => false,
        }
    }

    /// True if it is neither new nor has jumped.
    fn is_where_it_was(&self) -> bool {
        self.jump.is_some_and(|way| way < JUMP)
    }

    /// The same contact in the last step; `None` for a new contact.
    pub(in crate::grasp) fn warm_start(&self) -> Option<&WarmStart> {
        self.warm_start.as_ref()
    }

    /// The forces of the rows that the engine would have for this contact, and their number: the contact's own, or those
    /// of a pyramid's edges. The axes of a contact and the engine's point opposite ways if the target comes first, and so do
    /// the forces: the rows are alike.
    pub(in crate::grasp) fn engine_rows(&self, pyramidal: bool) -> ([f64; 10], usize) {
        let mut rows = [0.0; 10];
        let condim = self.parameters.condim;
        if condim == 1 || !pyramidal {
            rows[..condim].copy_from_slice(&self.force_rows[..condim]);
            return (rows, condim);
        }
        let share = self.force_rows[0] / (condim - 1) as f64;
        for (j, edges) in rows.chunks_exact_mut(2).take(condim - 1).enumerate() {
            let along = self.force_rows[j + 1] / self.parameters.friction[j];
            edges.copy_from_slice(&[0.5 * (share + along), 0.5 * (share - along)]);
        }
        (rows, 2 * (condim - 1))
    }

    /// The wrench of a unit force of row `i` on the target, `[torque about point; force]`.
    pub fn unit_wrench(&self, i: usize, point: &Vector3<f64>) -> Spatial {
        let axis = &self.axes[i % 3];
        if i < 3 { spatial(&(self.position - point).cross(axis), axis) } else { spatial(axis, &Vector3::zeros()) }
    }

    /// The wrench of this contact on the target, `[torque about point; force]`.
    pub fn wrench_about(&self, point: &Vector3<f64>) -> Spatial {
        spatial(&((self.position - point).cross(&self.force) + self.torque), &self.force)
    }

    /// The contact as the quality measures take it.
    pub fn loaded(&self) -> LoadedContact {
        LoadedContact {
            position: self.position,
            normal: self.axes[0],
            tangents: [self.axes[1], self.axes[2]],
            condim: self.parameters.condim,
            friction: self.parameters.friction,
            normal_force: self.normal_force(),
            force: self.force,
            torque: self.torque,
        }
    }

    /// A contact of the target, which is the engine's first body of it or the second.
    fn read(contact: &Contact, target_first: bool, index: usize, sim: &Simulation, topology: &Topology) -> Self {
        let [target, link_id] = if target_first { contact.bodies } else { [contact.bodies[1], contact.bodies[0]] };
        let sign = if target_first { -1.0 } else { 1.0 };
        let weight = |body: BodyId| sim.model().body_invweight0()[2 * body.index()];
        // turning all three axes when the target comes first keeps the rows of the engine
        let axis = |i: usize| contact.frame.row(i).transpose() * sign;
        GraspContact {
            link_id,
            link: link_id.index(),
            target: target.index(),
            geoms: (contact.geoms[0].index(), contact.geoms[1].index()),
            target_first,
            index,
            finger: topology.finger(link_id.index()),
            leaves: [link_id, target].map(|body| topology.leaf(body.index())),
            drift: [Vector3::zeros(); 2],
            position: contact.position,
            axes: [axis(0), axis(1), axis(2)],
            parameters: ContactParameters {
                solref: contact.solref,
                solimp: contact.solimp,
                dist: contact.dist,
                margin: contact.include_margin,
                condim: contact.condim,
                friction: contact.friction,
                inverse_weight: weight(contact.bodies[0]) + weight(contact.bodies[1]),
            },
            force_rows: [0.0; 6],
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
            active_sets: [ActiveSet::Open; 2],
            main: [0.0; 6],
            residual: [0.0; 5],
            solved: false,
            slip_velocity: Vector3::zeros(),
            warm_start: None,
            displacement: None,
            anchors: [link_id, target].map(|body| sim.point_in_body(body, &contact.position)),
            jump: None,
        }
    }

    /// Remembers the same contact in the last step, the nearest of the same two geoms in it, and where that was in the frames of
    /// link and target.
    fn remember(&mut self, before: &[SavedContact], anchors: &[[Vector3<f64>; 2]]) {
        let distance = |past: &SavedContact| (past.position - self.position).norm_squared();
        let alike = before.iter().enumerate().filter(|(_, past)| past.geoms == self.geoms);
        let nearest = alike.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        let Some((index, before)) = nearest else { return };
        self.warm_start = Some(before.warm_start(self));
        self.displacement = Some([before.normal.cross(&self.axes[0]), self.position - before.position]);
        self.jump = anchors.get(index).map(|was| {
            let [from_link, from_target] = [0, 1].map(|side| (self.anchors[side] - was[side]).norm());
            from_link.min(from_target)
        });
    }
}

/// The contacts of this step and the memory of the last one's. Buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct ContactSet {
    now: Vec<GraspContact>,
    before: Vec<SavedContact>,
    /// Of those of `before`, which a saved state has not.
    anchors: Vec<[Vector3<f64>; 2]>,
    /// `before` was given, and no step has been made since.
    restored: bool,
    /// Readings since a contact came, went or jumped.
    kept: usize,
}

impl ContactSet {
    /// Reads the contacts between hand and target: the engine's of this step, or others in its order. Those that the
    /// engine keeps out of its solve because they lie within the gap are left out.
    ///
    /// # Errors
    /// [`Error::BadContact`].
    pub fn read(
        &mut self,
        detected: impl Iterator<Item = impl Borrow<Contact>>,
        sim: &Simulation,
        topology: &Topology,
    ) -> Result<(), Error> {
        if !std::mem::take(&mut self.restored) {
            self.before.clear();
            self.before.extend(self.now.iter().map(SavedContact::of));
            self.anchors.clear();
            self.anchors.extend(self.now.iter().map(|contact| contact.anchors));
        }
        self.now.clear();
        for (index, contact) in detected.enumerate() {
            let contact = contact.borrow();
            if contact.excluded {
                continue;
            }
            let [a, b] = contact.bodies.map(|body| body.index());
            let target_first = topology.in_hand(b) && topology.in_target(a);
            if target_first || topology.in_hand(a) && topology.in_target(b) {
                check_numbers(contact, sim)?;
                // a contact is many numbers: it is made where it stays
                self.now.push(GraspContact::read(contact, target_first, index, sim, topology));
                if let Some(contact) = self.now.last_mut() {
                    contact.remember(&self.before, &self.anchors);
                }
            }
        }
        let same = self.now.len() == self.before.len() && self.now.iter().all(GraspContact::is_where_it_was);
        self.kept = if same { self.kept + 1 } else { 0 };
        Ok(())
    }

    /// What the next step remembers of the contacts, into `out`.
    pub(in crate::grasp) fn save_into(&self, out: &mut Vec<SavedContact>) {
        out.clear();
        if self.restored {
            out.extend_from_slice(&self.before);
        } else {
            out.extend(self.now.iter().map(SavedContact::of));
        }
    }

    /// No contacts now; the next step remembers `past`.
    pub(in crate::grasp) fn restore(&mut self, past: &[SavedContact]) {
        self.before.clear();
        self.before.extend_from_slice(past);
        self.anchors.clear();
        self.unread();
    }

    /// Takes back the last reading: the next step remembers what this one did.
    pub(in crate::grasp) fn unread(&mut self) {
        self.now.clear();
        self.restored = true;
        self.kept = 0;
    }

    /// Number of readings since a contact came, went or jumped.
    pub(in crate::grasp) fn kept(&self) -> usize {
        self.kept
    }

    /// Reads the forces that the engine's own solve gave these contacts.
    pub fn read_forces(&mut self, sim: &Simulation) -> Result<(), crate::mujoco::Error> {
        for contact in &mut self.now {
            let on_body2 = sim.contact_force(contact.index)?;
            let sign = if contact.target_first { -1.0 } else { 1.0 };
            contact.set_force(on_body2.force * sign, on_body2.torque * sign);
        }
        Ok(())
    }

    /// Relative velocities at the contact points, from the bodies' velocities of this step.
    pub fn read_slip(&mut self, dynamics: &Dynamics<'_>) {
        for contact in &mut self.now {
            contact.slip_velocity = contact.slip(dynamics);
        }
    }

    /// The fastest slip of the contacts whose friction is at its limit, from the bodies' present velocities \[m/s\].
    pub(in crate::grasp) fn slip_speed(&self, dynamics: &Dynamics<'_>) -> f64 {
        let sliding = self.now.iter().filter(|contact| contact.is_sliding());
        sliding.map(|contact| contact.slip(dynamics).norm()).fold(0.0, f64::max)
    }

    /// The contacts of this step.
    pub fn contacts(&self) -> &[GraspContact] {
        &self.now
    }

    /// The contacts of this step, for the solver.
    pub fn contacts_mut(&mut self) -> &mut [GraspContact] {
        &mut self.now
    }

    /// True if a link on `effectors` touches the target with a force.
    pub fn touched_by(&self, is_effector: impl Fn(usize) -> bool) -> bool {
        self.now.iter().any(|c| is_effector(c.link) && c.normal_force() > 0.0)
    }
}

/// Refuses parameters that are no numbers. The geoms' own friction is looked at too: the larger of two passes over NaN.
fn check_numbers(contact: &Contact, sim: &Simulation) -> Result<(), Error> {
    let model = sim.model();
    let own = |geom: GeomId| &model.geom_friction()[3 * geom.index()..3 * geom.index() + 3];
    let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
    let checks: [(&'static str, bool); 3] = [
        ("friction", finite(&contact.friction) && contact.geoms.into_iter().all(|geom| finite(own(geom)))),
        ("solref or solimp", finite(&contact.solref) && finite(&contact.solimp)),
        ("distance or margin", finite(&[contact.dist, contact.include_margin])),
    ];
    match checks.iter().find(|(_, finite)| !finite) {
        None => Ok(()),
        Some(&(what, _)) => {
            Err(Error::BadContact { time: sim.time(), what, geoms: contact.geoms.map(|geom| model.label(geom)) })
        }
    }
}

fn spatial(rotation: &Vector3<f64>, translation: &Vector3<f64>) -> Spatial {
    Spatial::new(rotation.x, rotation.y, rotation.z, translation.x, translation.y, translation.z)
}
