//! Contacts that another solver has solved, shown to the engine: sensors, `cfrc_ext`, pictures and whoever reads contacts
//! see them with their forces, as if the engine had made and solved their rows.

use super::compat::{self, EXCLUDED_BY_US};
use super::contact::Contact;
use super::error::{Error, check_index};
use super::ffi;
use super::simulation::Simulation;

impl Simulation {
    /// Adds a contact to the engine's list for this step, kept out of its solve, and returns its index; `None` if the
    /// list is full. To be called between collision detection and [`make_constraint`](Self::make_constraint).
    pub fn append_contact(&mut self, contact: &Contact) -> Option<usize> {
        let mut frame = [0.0; 9];
        for (i, row) in frame.chunks_exact_mut(3).enumerate() {
            row.copy_from_slice(&[contact.frame[(i, 0)], contact.frame[(i, 1)], contact.frame[(i, 2)]]);
        }
        // SAFETY: a structure of plain numbers.
        let mut raw: ffi::mjContact = unsafe { std::mem::zeroed() };
        raw.dist = contact.dist;
        raw.pos = contact.position.into();
        raw.frame = frame;
        raw.includemargin = contact.include_margin;
        raw.friction = contact.friction;
        raw.solref = contact.solref;
        raw.solimp = contact.solimp;
        raw.dim = contact.condim as i32;
        [raw.geom1, raw.geom2] = contact.geoms.map(|geom| geom.index() as i32);
        raw.exclude = EXCLUDED_BY_US;
        raw.efc_address = -1;
        compat::complete_contact(&mut raw);
        let index = self.contact_count();
        let (m, d) = self.pointers();
        // SAFETY: model and data belong together, `&mut self` is exclusive, and the contact is complete.
        unsafe { compat::append_contact(m, d, &raw) }.then_some(index)
    }

    /// Gives contact `i`, which is kept out of the engine's solve, the force that another solver found: `rows` in the
    /// engine's layout (elliptic: normal, tangents, spin, rolling; pyramidal: the edges). They are stored behind the
    /// constraint rows, `offset` numbers after their end. False, with nothing shown, where they do not fit. To
    /// be called after the solve; it holds until contacts or rows are made again.
    pub fn show_contact_force(&mut self, i: usize, offset: usize, rows: &[f64]) -> Result<bool, Error> {
        check_index("contact", i, self.contact_count())?;
        let end = self.nefc() + offset + rows.len();
        if end > compat::force_capacity(self.model_fields(), self.data()) {
            compat::extend_forces(self.data_mut());
        }
        if end > compat::force_capacity(self.model_fields(), self.data()) {
            return Ok(false);
        }
        let first = end - rows.len();
        let data = self.data_mut();
        // SAFETY: the contact exists.
        let raw: &mut ffi::mjContact = unsafe { &mut *data.contact.add(i) };
        if raw.exclude != EXCLUDED_BY_US {
            return Err(Error::Unsupported(format!("contact {i} is in the engine's own solve")));
        }
        raw.efc_address = first as i32;
        // SAFETY: the array has that much room.
        unsafe { data.efc_force.add(first).copy_from_nonoverlapping(rows.as_ptr(), rows.len()) };
        Ok(true)
    }
}
