//! Contacts of the current step, copied out of the engine.

use super::arrays::slice;
use super::compat::{self, EXCLUDED_BY_US};
use super::error::{Error, check_index};
use super::ffi;
use super::ids::{BodyId, GeomId};
use super::kinds::Cone;
use super::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};

/// One contact point between two geoms, world frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// The geoms; the normal points from the first to the second.
    pub geoms: [GeomId; 2],
    /// Their bodies.
    pub bodies: [BodyId; 2],
    /// The point, midway between the surfaces, m.
    pub position: Vector3<f64>,
    /// Rows: unit normal from body 1 into body 2, and two unit tangents (normal x tangent 1 = tangent 2).
    /// `frame * v` takes world axes to contact axes.
    pub frame: Matrix3<f64>,
    /// Distance of the surfaces, m; negative in penetration.
    pub dist: f64,
    /// The contact takes part in the solve if `dist < include_margin` (margin - gap), m.
    pub include_margin: f64,
    /// 1 frictionless, 3 sliding, 4 and spinning, 6 and rolling.
    pub condim: usize,
    /// Sliding along tangents 1 and 2 (-), spinning about the normal (m), rolling about tangents 1 and 2 (m).
    pub friction: [f64; 5],
    /// Solver reference.
    pub solref: [f64; 2],
    /// Solver impedance.
    pub solimp: [f64; 5],
    /// Kept out of the solve: in the gap, by [`Simulation::exclude_contact`], or because no degree of freedom can move
    /// it.
    pub excluded: bool,
    /// Its first constraint row, if it has any; beyond all rows if its force is a
    /// [shown](Simulation::show_contact_force) one.
    pub efc_address: Option<usize>,
}

impl Contact {
    /// Unit normal from body 1 into body 2.
    pub fn normal(&self) -> Vector3<f64> {
        self.frame.row(0).transpose()
    }

    /// The body that touches `body`, if this is a contact of `body`.
    pub fn other_body(&self, body: BodyId) -> Option<BodyId> {
        match self.bodies {
            [first, second] if first == body => Some(second),
            [first, second] if second == body => Some(first),
            _ => None,
        }
    }
}

/// What a contact exerts, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactForce {
    /// Force on body 2, N (on body 1: the opposite).
    pub force: Vector3<f64>,
    /// Torque on body 2 about the contact point, N m (on body 1: the opposite).
    pub torque: Vector3<f64>,
}

impl Simulation {
    fn raw_contacts(&self) -> &[ffi::mjContact] {
        // SAFETY: the first `ncon` contacts are initialised.
        unsafe { slice(self.data().contact, self.data().ncon as usize) }
    }

    /// Number of contacts found in the current step, excluded ones too.
    pub fn contact_count(&self) -> usize {
        self.raw_contacts().len()
    }

    /// Contact `i` of the current step.
    pub fn contact(&self, i: usize) -> Result<Contact, Error> {
        let raw = self.raw_contacts();
        check_index("contact", i, raw.len())?;
        Ok(self.copy_contact(&raw[i]))
    }

    /// All contacts of the current step. Allocates nothing.
    pub fn contacts(&self) -> impl ExactSizeIterator<Item = Contact> + '_ {
        self.raw_contacts().iter().map(|raw| self.copy_contact(raw))
    }

    /// Bodies of contact `i`, cheaper than the whole contact; `None` if there is no such contact.
    pub fn contact_bodies(&self, i: usize) -> Option<[BodyId; 2]> {
        self.raw_contacts().get(i).map(|raw| self.bodies_of(raw))
    }

    /// The force of contact `i`, on body 2 (see [`ContactForce`]); zero if the contact is not in the solve. Valid after
    /// [`constraint`](Self::constraint) (or [`forward`](Self::forward), [`step`](Self::step)).
    pub fn contact_force(&self, i: usize) -> Result<ContactForce, Error> {
        let raw = self.raw_contacts();
        check_index("contact", i, raw.len())?;
        let mut local = [0.0; 6];
        if self.has_rows(&raw[i]) {
            // SAFETY: the contact exists and all of its rows do.
            self.query("mj_contactForce", |m, d| unsafe { ffi::mj_contactForce(m, d, i as i32, local.as_mut_ptr()) })?;
        }
        let to_world = frame_of(&raw[i]).transpose();
        Ok(ContactForce {
            force: to_world * Vector3::new(local[0], local[1], local[2]),
            torque: to_world * Vector3::new(local[3], local[4], local[5]),
        })
    }

    /// Keeps contact `i` out of the solve of this step. To be called between [`collision`](Self::collision) and
    /// [`make_constraint`](Self::make_constraint); the next collision detection forgets it.
    pub fn exclude_contact(&mut self, i: usize) -> Result<(), Error> {
        check_index("contact", i, self.contact_count())?;
        // SAFETY: the contact exists, and `&mut self` makes the write exclusive.
        unsafe { (*self.data_mut().contact.add(i)).exclude = EXCLUDED_BY_US };
        Ok(())
    }

    fn copy_contact(&self, raw: &ffi::mjContact) -> Contact {
        Contact {
            geoms: [raw.geom1, raw.geom2].map(|geom| GeomId::from_index(geom as usize)),
            bodies: self.bodies_of(raw),
            position: raw.pos.into(),
            frame: frame_of(raw),
            dist: raw.dist,
            include_margin: raw.includemargin,
            condim: raw.dim as usize,
            friction: raw.friction,
            solref: raw.solref,
            solimp: raw.solimp,
            excluded: raw.exclude != 0,
            efc_address: self.has_rows(raw).then_some(raw.efc_address as usize),
        }
    }

    fn bodies_of(&self, raw: &ffi::mjContact) -> [BodyId; 2] {
        let body_of = self.model().geom_bodyid();
        [raw.geom1, raw.geom2].map(|geom| BodyId::from_index(body_of[geom as usize] as usize))
    }

    /// Rows that a contact of this condim has.
    pub(super) fn rows_of(&self, condim: i32) -> usize {
        let dim = condim.max(0) as usize;
        if dim > 1 && self.model().cone() == Cone::Pyramidal { 2 * (dim - 1) } else { dim }
    }

    /// Whether the contact's rows are among the current ones, or those of a contact with a
    /// [shown force](Self::show_contact_force) behind them.
    fn has_rows(&self, raw: &ffi::mjContact) -> bool {
        let rows = self.rows_of(raw.dim);
        let end = if raw.exclude == EXCLUDED_BY_US {
            compat::force_capacity(self.model_fields(), self.data())
        } else {
            self.nefc()
        };
        usize::try_from(raw.efc_address).is_ok_and(|first| first + rows <= end)
    }
}

fn frame_of(raw: &ffi::mjContact) -> Matrix3<f64> {
    Matrix3::from_row_slice(&raw.frame)
}
