//! A body pulled at with the mouse: the engine's spring between a point of it and where that point is dragged (mjvPerturb).

use super::error::{Error, check_index, check_value};
use super::ffi;
use super::guard;
use super::ids::{BodyId, Id};
use super::scene::{Picked, Scene};
use super::simulation::Simulation;
use nalgebra::{Vector3, Vector6};

/// A selected body, and the spring that pulls at it or turns it. Its stiffness is the model's (`visual/map/stiffness` and
/// `stiffnessrot`, scaled by the engine with the body's inertia), critically damped.
#[derive(Clone)]
pub struct Perturb {
    raw: ffi::mjvPerturb,
}

impl std::fmt::Debug for Perturb {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Perturb {{ body: {:?}, active: {} }}", self.body(), self.raw.active)
    }
}

/// What the spring does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pull {
    /// Pulls at the selected point.
    Force,
    /// Turns the body.
    Torque,
}

/// How the mouse drags: the camera, or what is pulled at (mjtMouse).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drag {
    /// About a horizontal and the vertical axis.
    RotateVertical,
    /// About the axis towards the camera, horizontally.
    RotateHorizontal,
    /// In the plane of the picture.
    MoveVertical,
    /// In the horizontal plane.
    MoveHorizontal,
    /// Nearer or farther.
    Zoom,
}

impl Drag {
    pub(super) fn action(self) -> i32 {
        let action = match self {
            Self::RotateVertical => ffi::mjMOUSE_ROTATE_V,
            Self::RotateHorizontal => ffi::mjMOUSE_ROTATE_H,
            Self::MoveVertical => ffi::mjMOUSE_MOVE_V,
            Self::MoveHorizontal => ffi::mjMOUSE_MOVE_H,
            Self::Zoom => ffi::mjMOUSE_ZOOM,
        };
        action as i32
    }
}

impl Default for Perturb {
    /// Nothing is selected.
    fn default() -> Self {
        // SAFETY: a plain C structure of numbers; the call writes its defaults and cannot fault.
        let raw = unsafe {
            let mut raw: ffi::mjvPerturb = std::mem::zeroed();
            ffi::mjv_defaultPerturb(&mut raw);
            raw
        };
        Self { raw }
    }
}

impl Perturb {
    /// The body at a point of its surface, not pulled at yet. Needs `sim`'s positions.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a body that does not exist, [`Error::Value`] for a point that is not finite.
    pub fn select(sim: &Simulation, picked: &Picked) -> Result<Self, Error> {
        check_index(BodyId::KIND, picked.body.index(), sim.model().nbody())?;
        for value in picked.point.iter() {
            check_value("a coordinate of the selected point", *value, "finite", |_| true)?;
        }
        let mut perturb = Self::default();
        perturb.raw.select = picked.body.index() as i32;
        perturb.raw.localpos = sim.point_in_body(picked.body, &picked.point).into();
        Ok(perturb)
    }

    /// The selected body.
    pub fn body(&self) -> Option<BodyId> {
        usize::try_from(self.raw.select).ok().filter(|b| *b > 0).map(BodyId::from_index)
    }

    /// The selected point in the body's frame \[m\].
    pub fn local_point(&self) -> Vector3<f64> {
        self.raw.localpos.into()
    }

    /// Whether the spring is there.
    pub fn is_active(&self) -> bool {
        self.raw.active != 0
    }

    /// The spring begins, without tension. Needs `sim`'s positions and factored inertia
    /// ([`inertia`](Simulation::inertia)), and a scene that has been [updated](Scene::update). Nothing happens where no body
    /// is selected.
    ///
    /// # Errors
    /// [`Error::OtherModel`], [`Error::OutOfRange`], [`Error::Engine`].
    pub fn begin(&mut self, pull: Pull, sim: &Simulation, scene: &Scene) -> Result<(), Error> {
        if !self.is_usable(sim, scene)? {
            return Ok(());
        }
        let raw = &mut self.raw;
        sim.query("mjv_initPerturb", |m, d| {
            // SAFETY: model and data belong together, the scene is one of the model, and the body exists.
            unsafe { ffi::mjv_initPerturb(m, d, scene.raw(), raw) }
        })?;
        self.raw.active = match pull {
            Pull::Force => ffi::mjPERT_TRANSLATE,
            Pull::Torque => ffi::mjPERT_ROTATE,
        } as i32;
        Ok(())
    }

    /// The mouse has moved, by parts of the picture's height, `y` downward: where the spring pulls to moves, too.
    ///
    /// # Errors
    /// As [`begin`](Self::begin), and [`Error::Value`] for numbers that are not finite.
    pub fn drag(&mut self, drag: Drag, x: f64, y: f64, sim: &Simulation, scene: &Scene) -> Result<(), Error> {
        for value in [x, y] {
            check_value("a movement of the mouse", value, "finite", |_| true)?;
        }
        if !self.is_active() || !self.is_usable(sim, scene)? {
            return Ok(());
        }
        let raw = &mut self.raw;
        sim.query("mjv_movePerturb", |m, d| {
            // SAFETY: model and data belong together, the scene is one of the model, and the body exists.
            unsafe { ffi::mjv_movePerturb(m, d, drag.action(), x, y, scene.raw(), raw) }
        })
    }

    /// The spring is let go; the body stays selected.
    pub fn end(&mut self) {
        self.raw.active = 0;
        self.raw.active2 = 0;
    }

    /// What the spring exerts on the body at its centre of mass, world axes, `[force; torque]` \[N, N m\]; `None` where
    /// there is no spring. Needs the positions and velocities of `sim`, whose applied wrench on the body is overwritten.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a body that does not exist, [`Error::Engine`].
    pub fn wrench(&self, sim: &mut Simulation) -> Result<Option<Vector6<f64>>, Error> {
        let Some(body) = self.body().filter(|_| self.is_active()) else { return Ok(None) };
        sim.set_body_wrench(body, &Vector3::zeros(), &Vector3::zeros())?;
        let (m, d) = sim.pointers();
        guard::call("mjv_applyPerturbForce", || {
            // SAFETY: model and data belong together, `sim` is exclusive, and the body exists.
            unsafe { ffi::mjv_applyPerturbForce(m, d, &self.raw) }
        })?;
        sim.body_wrench(body).map(Some)
    }

    pub(super) fn as_ptr(&self) -> *const ffi::mjvPerturb {
        &self.raw
    }

    /// Whether a body is selected, which the model has.
    fn is_usable(&self, sim: &Simulation, scene: &Scene) -> Result<bool, Error> {
        scene.check_simulation(sim)?;
        let Some(body) = self.body() else { return Ok(false) };
        check_index(BodyId::KIND, body.index(), sim.model().nbody())?;
        Ok(true)
    }
}
