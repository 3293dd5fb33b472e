//! Six-vectors and 6 x 6 matrices of a weld: three linear axes, three angular ones.

use crate::grasp::contact::contacts::GraspContact;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Takes `motion` from column `dof` of a 6 x `nv` Jacobian.
pub(super) fn subtract(jacobian: &mut [f64], nv: usize, dof: usize, motion: &Vector6<f64>) {
    for (row, x) in motion.iter().enumerate() {
        jacobian[row * nv + dof] -= x;
    }
}

pub(super) fn mean_distance(contacts: &[GraspContact]) -> f64 {
    let mean = 1.0 / contacts.len().max(1) as f64;
    let centroid: Vector3<f64> = contacts.iter().map(|c| c.position * mean).sum();
    contacts.iter().map(|c| (c.position - centroid).norm() * mean).sum()
}

/// Both halves of a six-vector turned.
pub(super) fn turn(rotation: &Matrix3<f64>, x: &Vector6<f64>) -> Vector6<f64> {
    let (a, b) = (rotation * x.fixed_rows::<3>(0), rotation * x.fixed_rows::<3>(3));
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

pub(super) fn turn_matrix(rotation: &Matrix3<f64>, x: &Matrix6<f64>) -> Matrix6<f64> {
    let mut six = Matrix6::zeros();
    six.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    six.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
    six * x * six.transpose()
}
