//! What the owner of a borrowed simulation may have changed since the last visit.

use crate::mujoco::arrays::slice;
use crate::mujoco::simulation::Simulation;
use crate::mujoco::{compat, ffi};

/// Copies of what must be as it was for the next step to go on from the last one.
///
/// A whole step computes everything from the state, as `mj_step` does, but for what this crate has derived from the model:
/// shapes of geoms and the parameters of their pairs. A step on frozen geometry also reads what the last whole step has left
/// in the data, and what that has derived from the model: inertia, moments, constraint rows, friction of contacts. All of that
/// is compared byte by byte, apart from meshes and height fields, which the engine itself does not let change in place.
#[derive(Debug, Default)]
pub(super) struct Watch {
    shapes: Copy,
    parameters: Copy,
    state: Copy,
    /// `state` is that of the end of the last visit.
    continues: bool,
    /// Steps on frozen geometry were asked for.
    frozen: bool,
}

/// Bytes of several arrays, one after the other.
#[derive(Debug, Default)]
struct Copy(Vec<u8>);

/// Memory of the engine.
type Span = (*const u8, usize);

impl Watch {
    pub fn new(sim: &Simulation) -> Self {
        let mut watch = Self::default();
        watch.shapes.take(&shapes(sim.model_fields()));
        watch
    }

    /// Tells `sim` what has been changed since the last visit. Steps on frozen geometry may follow only if `frozen`.
    pub fn look(&mut self, sim: &mut Simulation, frozen: bool) {
        let now = shapes(sim.model_fields());
        if !self.shapes.is(&now) {
            self.shapes.take(&now);
            sim.renew_model();
        }
        self.frozen |= frozen;
        if !self.frozen {
            // Nothing goes on from the last step if every step is whole.
            sim.note_change();
            return;
        }
        let now = parameters(sim.model_fields());
        if !self.parameters.is(&now) {
            self.parameters.take(&now);
            self.continues = false;
        }
        if !self.continues || !self.state.is(&state(sim, &counts(sim))) {
            sim.note_change();
        }
    }

    /// After a visit.
    pub fn remember(&mut self, sim: &Simulation) {
        self.continues = self.frozen;
        if self.continues {
            self.state.take(&state(sim, &counts(sim)));
        }
    }
}

impl Copy {
    fn is(&self, spans: &[Span]) -> bool {
        let mut rest = self.0.as_slice();
        let alike = |&(start, bytes): &Span| {
            let Some((copy, more)) = rest.split_at_checked(bytes) else { return false };
            rest = more;
            // SAFETY: the spans are arrays of the engine, which nobody writes now.
            copy == unsafe { slice(start, bytes) }
        };
        spans.iter().all(alike) && rest.is_empty()
    }

    fn take(&mut self, spans: &[Span]) {
        self.0.clear();
        for &(start, bytes) in spans {
            // SAFETY: as above.
            self.0.extend_from_slice(unsafe { slice(start, bytes) });
        }
    }
}

fn span<T>(start: *const T, count: usize) -> Span {
    (start.cast(), count * size_of::<T>())
}

/// What detectors of contacts derive from the model.
fn shapes(m: &ffi::mjModel) -> [Span; 25] {
    let (geoms, bodies, pairs) = (m.ngeom as usize, m.nbody as usize, m.npair as usize);
    [
        span(&raw const m.opt, 1),
        span(m.geom_type, geoms),
        span(m.geom_contype, geoms),
        span(m.geom_conaffinity, geoms),
        span(m.geom_condim, geoms),
        span(m.geom_priority, geoms),
        span(m.geom_dataid, geoms),
        span(m.geom_solmix, geoms),
        span(m.geom_solref, geoms * ffi::mjNREF as usize),
        span(m.geom_solimp, geoms * ffi::mjNIMP as usize),
        span(m.geom_size, 3 * geoms),
        span(m.geom_rbound, geoms),
        span(m.geom_pos, 3 * geoms),
        span(m.geom_quat, 4 * geoms),
        span(m.geom_margin, geoms),
        span(m.geom_gap, geoms),
        span(m.body_pos, 3 * bodies),
        span(m.body_quat, 4 * bodies),
        span(m.body_ipos, 3 * bodies),
        span(m.pair_dim, pairs),
        span(m.pair_solref, pairs * ffi::mjNREF as usize),
        span(m.pair_solimp, pairs * ffi::mjNIMP as usize),
        span(m.pair_margin, pairs),
        span(m.pair_gap, pairs),
        span(m.exclude_signature, m.nexclude as usize),
    ]
}

/// What else the part of a step that depends on positions takes from the model; velocities, actuators and passive forces are
/// computed anew in steps on frozen geometry, too.
fn parameters(m: &ffi::mjModel) -> [Span; 35] {
    const REF: usize = ffi::mjNREF as usize;
    const IMP: usize = ffi::mjNIMP as usize;
    let (bodies, joints, dofs, geoms) = (m.nbody as usize, m.njnt as usize, m.nv as usize, m.ngeom as usize);
    let (sites, tendons, equalities) = (m.nsite as usize, m.ntendon as usize, m.neq as usize);
    [
        span(m.qpos0, m.nq as usize),
        span(m.body_mass, bodies),
        span(m.body_subtreemass, bodies),
        span(m.body_inertia, 3 * bodies),
        span(m.body_iquat, 4 * bodies),
        span(m.body_invweight0, 2 * bodies),
        span(m.jnt_pos, 3 * joints),
        span(m.jnt_axis, 3 * joints),
        span(m.jnt_limited, joints),
        span(m.jnt_range, 2 * joints),
        span(m.jnt_margin, joints),
        span(m.jnt_solref, REF * joints),
        span(m.jnt_solimp, IMP * joints),
        span(m.dof_armature, dofs),
        span(m.dof_M0, dofs),
        span(m.dof_invweight0, dofs),
        span(m.dof_frictionloss, dofs),
        span(m.dof_solref, REF * dofs),
        span(m.dof_solimp, IMP * dofs),
        span(m.geom_friction, 3 * geoms),
        span(m.pair_friction, 5 * m.npair as usize),
        span(m.site_pos, 3 * sites),
        span(m.site_quat, 4 * sites),
        span(m.tendon_limited, tendons),
        span(m.tendon_range, 2 * tendons),
        span(m.tendon_margin, tendons),
        span(m.tendon_frictionloss, tendons),
        span(m.tendon_solref_lim, REF * tendons),
        span(m.tendon_solimp_lim, IMP * tendons),
        span(m.tendon_solref_fri, REF * tendons),
        span(m.tendon_solimp_fri, IMP * tendons),
        span(m.actuator_gear, 6 * m.nu as usize),
        span(m.eq_data, compat::EQ_DATA * equalities),
        span(m.eq_solref, REF * equalities),
        span(m.eq_solimp, IMP * equalities),
    ]
}

/// Contacts and rows, and where they are.
fn counts(sim: &Simulation) -> [usize; 6] {
    let d = sim.data();
    [d.ncon as usize, d.ne as usize, d.nf as usize, d.nefc as usize, d.contact as usize, d.efc_J as usize]
}

/// Positions and what steps on frozen geometry take from them; every function of the engine that computes something that these
/// read writes one of these arrays.
fn state(sim: &Simulation, counts: &[usize; 6]) -> [Span; 15] {
    fn of<T>(array: &[T]) -> Span {
        span(array.as_ptr(), array.len())
    }
    let (model, data) = sim.pointers();
    [
        of(counts),
        of(sim.qpos()),
        of(sim.mocap_pos()),
        of(sim.mocap_quat()),
        span(compat::eq_active(model, data), sim.model().neq()),
        of(sim.xpos()),
        of(sim.xquat()),
        of(sim.subtree_com()),
        of(sim.cdof()),
        of(sim.ten_length()),
        of(sim.actuator_length()),
        of(sim.qacc()),
        of(sim.qacc_warmstart()),
        of(sim.efc_pos()),
        of(sim.efc_force()),
    ]
}
