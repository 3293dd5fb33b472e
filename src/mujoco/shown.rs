//! Contacts that another solver has solved, shown to the engine: sensors, `cfrc_ext`, pictures and whoever reads contacts
//! see them with their forces, as if the engine had made and solved their rows.

use super::compat::{self, EXCLUDED_BY_US};
use super::contact::Contact;
use super::error::{Error, check_index, check_length, check_value};
use super::ffi;
use super::ids::{GeomId, Id};
use super::simulation::Simulation;

impl Simulation {
    /// Adds a contact to the engine's list for this step, kept out of its solve, and returns its index; `None` if the
    /// list is full. To be called between collision detection and [`make_constraint`](Self::make_constraint). Of the
    /// contact, `bodies`, `excluded` and `efc_address` are not looked at.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a geom that does not exist, [`Error::Value`] for a condim that is not 1, 3, 4 or 6.
    pub fn append_contact(&mut self, contact: &Contact) -> Result<Option<usize>, Error> {
        self.append(contact, EXCLUDED_BY_US)
    }

    /// As [`append_contact`](Self::append_contact), for the engine's own solve: as if its collision stage had found the
    /// contact. Kept out of the solve if it is `excluded`.
    ///
    /// # Errors
    /// As [`append_contact`](Self::append_contact).
    pub fn append_engine_contact(&mut self, contact: &Contact) -> Result<Option<usize>, Error> {
        self.append(contact, i32::from(contact.excluded))
    }

    fn append(&mut self, contact: &Contact, exclude: i32) -> Result<Option<usize>, Error> {
        // The engine takes all of these as addresses and counts.
        for geom in contact.geoms {
            check_index(GeomId::KIND, geom.index(), self.model().ngeom())?;
        }
        let condim = contact.condim;
        check_value("the condim of a contact", condim as f64, "1, 3, 4 or 6", |_| matches!(condim, 1 | 3 | 4 | 6))?;
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
        raw.exclude = exclude;
        raw.efc_address = -1;
        compat::complete_contact(&mut raw);
        let index = self.contact_count();
        let (m, d) = self.pointers();
        // SAFETY: model and data belong together, `&mut self` is exclusive, and the contact is complete.
        Ok(unsafe { compat::append_contact(m, d, &raw) }.then_some(index))
    }

    /// Gives contact `i`, which is kept out of the engine's solve, the force that another solver found: `rows` in the
    /// engine's layout (elliptic: normal, tangents, spin, rolling; pyramidal: the edges). They are stored behind the
    /// constraint rows, `offset` numbers after their end. False, with nothing shown, where they do not fit. To
    /// be called after the solve; it holds until contacts or rows are made again.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a contact that does not exist, [`Error::Unsupported`] for one in the engine's own solve,
    /// [`Error::Length`] for another number of rows than the contact has.
    pub fn show_contact_force(&mut self, i: usize, offset: usize, rows: &[f64]) -> Result<bool, Error> {
        check_index("contact", i, self.contact_count())?;
        // SAFETY: the contact exists.
        let (excluded, dim) = unsafe {
            let raw = self.data().contact.add(i);
            ((*raw).exclude == EXCLUDED_BY_US, (*raw).dim)
        };
        if !excluded {
            return Err(Error::Unsupported(format!("contact {i} is in the engine's own solve")));
        }
        check_length("the force of the contact, row by row,", self.rows_of(dim), rows.len())?;
        let Some(first) = self.nefc().checked_add(offset) else {
            return Ok(false);
        };
        let fits = |sim: &Self| {
            let room = compat::force_capacity(sim.model_fields(), sim.data());
            room.checked_sub(first).is_some_and(|left| rows.len() <= left)
        };
        if !fits(self) {
            compat::extend_forces(self.data_mut());
        }
        if !fits(self) {
            return Ok(false);
        }
        let data = self.data_mut();
        // SAFETY: the contact exists, and the array has room for the rows.
        unsafe {
            (*data.contact.add(i)).efc_address = first as i32;
            data.efc_force.add(first).copy_from_nonoverlapping(rows.as_ptr(), rows.len());
        }
        Ok(true)
    }
}
