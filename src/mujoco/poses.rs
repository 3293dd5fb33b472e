//! Poses and velocities of model elements, as nalgebra types, world frame.
//!
//! Of an element that does not exist (an id of another model, too large for this one) all numbers are NaN, where no error
//! can be returned.

use super::error::Error;
use super::ffi;
use super::ids::{BodyId, GeomId, SiteId};
use super::simulation::Simulation;
use nalgebra::{Isometry3, Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

/// Row `index` of an array with rows of `N` numbers.
fn row<const N: usize>(array: &[f64], index: usize) -> [f64; N] {
    array.as_chunks().0.get(index).copied().unwrap_or([f64::NAN; N])
}

fn vector(array: &[f64], index: usize) -> Vector3<f64> {
    row(array, index).into()
}

fn matrix(array: &[f64], index: usize) -> Matrix3<f64> {
    Matrix3::from_row_slice(&row::<9>(array, index))
}

impl Simulation {
    /// Origin of a body's frame, m.
    pub fn body_position(&self, id: BodyId) -> Vector3<f64> {
        vector(self.xpos(), id.index())
    }

    /// Orientation of a body's frame: body axes to world axes.
    pub fn body_rotation(&self, id: BodyId) -> Matrix3<f64> {
        matrix(self.xmat(), id.index())
    }

    /// Orientation of a body's frame as a quaternion.
    pub fn body_quaternion(&self, id: BodyId) -> UnitQuaternion<f64> {
        let [w, x, y, z] = row(self.xquat(), id.index());
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    /// A body's frame in the world, m.
    pub fn body_pose(&self, id: BodyId) -> Isometry3<f64> {
        Isometry3::from_parts(self.body_position(id).into(), self.body_quaternion(id))
    }

    /// A point of the world in a body's frame, m.
    pub fn point_in_body(&self, id: BodyId, point: &Vector3<f64>) -> Vector3<f64> {
        self.body_rotation(id).tr_mul(&(point - self.body_position(id)))
    }

    /// A body's own centre of mass, m.
    pub fn body_com(&self, id: BodyId) -> Vector3<f64> {
        vector(self.xipos(), id.index())
    }

    /// Inertia of a body about its own centre of mass, world axes, kg m^2.
    pub fn body_inertia_world(&self, id: BodyId) -> Matrix3<f64> {
        let axes = matrix(self.ximat(), id.index());
        axes * Matrix3::from_diagonal(&vector(self.model().body_inertia(), id.index())) * axes.transpose()
    }

    /// Twist of a body, [linear; angular]: the velocity of its frame's origin (m/s) and its angular velocity (rad/s),
    /// world axes. Valid after [`velocity`](Self::velocity).
    pub fn body_twist(&self, id: BodyId) -> Result<Vector6<f64>, Error> {
        self.object_velocity(ffi::mjOBJ_XBODY, id)
    }

    /// As [`body_twist`](Self::body_twist), of the body's centre of mass.
    pub fn body_com_twist(&self, id: BodyId) -> Result<Vector6<f64>, Error> {
        self.object_velocity(ffi::mjOBJ_BODY, id)
    }

    fn object_velocity(&self, object: u32, id: BodyId) -> Result<Vector6<f64>, Error> {
        super::error::check_index("body", id.index(), self.model().nbody())?;
        let mut out = [0.0; 6];
        // SAFETY: the body exists; the engine writes six numbers, [angular; linear], world axes.
        self.query("mj_objectVelocity", |m, d| unsafe {
            ffi::mj_objectVelocity(m, d, object as i32, id.index() as i32, out.as_mut_ptr(), 0)
        })?;
        let [wx, wy, wz, vx, vy, vz] = out;
        Ok(Vector6::new(vx, vy, vz, wx, wy, wz))
    }

    /// Centre of a geom, m.
    pub fn geom_position(&self, id: GeomId) -> Vector3<f64> {
        vector(self.geom_xpos(), id.index())
    }

    /// Orientation of a geom: geom axes to world axes.
    pub fn geom_rotation(&self, id: GeomId) -> Matrix3<f64> {
        matrix(self.geom_xmat(), id.index())
    }

    /// Position of a site, m.
    pub fn site_position(&self, id: SiteId) -> Vector3<f64> {
        vector(self.site_xpos(), id.index())
    }

    /// Orientation of a site: site axes to world axes.
    pub fn site_rotation(&self, id: SiteId) -> Matrix3<f64> {
        matrix(self.site_xmat(), id.index())
    }

    /// Centre of mass of the tree below a body, with it, m.
    pub fn subtree_com_of(&self, id: BodyId) -> Vector3<f64> {
        vector(self.subtree_com(), id.index())
    }
}
