//! Contacts that another solver has solved, shown to the engine: sensors, `cfrc_ext`, pictures and whoever reads contacts
//! see them with their forces, as if the engine had made and solved their rows.

use super::contact::{Contact, EXCLUDED_BY_US};
use super::error::{Error, check_index};
use super::ffi;
use super::simulation::Simulation;

impl Simulation {
    /// Adds a contact to the engine's list for this step, kept out of its solve, and returns its index; `None` if the
    /// list is full (`nconmax`). To be called between collision detection and [`make_constraint`](Self::make_constraint).
    pub fn append_contact(&mut self, contact: &Contact) -> Option<usize> {
        let index = self.contact_count();
        if index >= self.model().nconmax() {
            return None;
        }
        let mut frame = [0.0; 9];
        for (i, row) in frame.chunks_exact_mut(3).enumerate() {
            row.copy_from_slice(&[contact.frame[(i, 0)], contact.frame[(i, 1)], contact.frame[(i, 2)]]);
        }
        let data = self.data_mut();
        // SAFETY: the list holds `nconmax` contacts, and the entry is plain numbers, each of which is set, but for two of
        // the solver's own that it sets before it reads them.
        unsafe {
            let raw = &mut *data.contact.add(index);
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
        }
        data.ncon += 1;
        Some(index)
    }

    /// Gives contact `i`, which is kept out of the engine's solve, the force that another solver found: `rows` in the
    /// engine's layout (elliptic: normal, tangents, spin, rolling; pyramidal: the edges). They are stored behind the
    /// constraint rows, `offset` numbers after their end. False, with nothing shown, where they do not fit (`njmax`). To
    /// be called after the solve; it holds until contacts or rows are made again.
    pub fn show_contact_force(&mut self, i: usize, offset: usize, rows: &[f64]) -> Result<bool, Error> {
        check_index("contact", i, self.contact_count())?;
        let first = self.nefc() + offset;
        if first + rows.len() > self.model().njmax() {
            return Ok(false);
        }
        let data = self.data_mut();
        // SAFETY: the contact exists, and `efc_force` holds `njmax` numbers.
        let raw: &mut ffi::mjContact = unsafe { &mut *data.contact.add(i) };
        if raw.exclude != EXCLUDED_BY_US {
            return Err(Error::Unsupported(format!("contact {i} is in the engine's own solve")));
        }
        raw.efc_address = first as i32;
        // SAFETY: as above.
        unsafe { data.efc_force.add(first).copy_from_nonoverlapping(rows.as_ptr(), rows.len()) };
        Ok(true)
    }
}
