//! Which actuator a name means, and which moves a joint to a position.

use crate::mujoco::{ActuatorId, CompiledModel, Error, JointId, TendonId, TransmissionKind};

/// The actuator of that name; or else the one without a name that acts on the joint or tendon of that name.
///
/// # Errors
/// No such actuator, with the close names that exist.
pub fn named(model: &CompiledModel, name: &str) -> Result<ActuatorId, Error> {
    model.actuator(name).or_else(|unknown| {
        let joint = model.joint(name).ok().map(JointId::index);
        let tendon = model.tendon(name).ok().map(TendonId::index);
        let acts = |id: &ActuatorId| {
            let object = Some(model.actuator_trnid()[2 * id.index()] as usize);
            match TransmissionKind::from_raw(model.actuator_trntype()[id.index()]) {
                TransmissionKind::Joint | TransmissionKind::JointInParent => object == joint,
                TransmissionKind::Tendon => object == tendon,
                _ => false,
            }
        };
        let mut found = model.actuators().filter(|&id| model.actuator_name(id).is_none()).filter(acts);
        match (found.next(), found.next()) {
            (Some(only), None) => Ok(only),
            _ => Err(unknown),
        }
    })
}

/// The actuator that drives a joint to a position: it rests at joint value q, with torque t on the joint, for
/// `ctrl = scale q + offset + compliance t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionActuator {
    /// Index into ctrl.
    pub index: usize,
    /// ctrl per joint value.
    pub scale: f64,
    /// ctrl at joint value 0.
    pub offset: f64,
    /// ctrl per torque or force on the joint \[1/(N m) or 1/N, times the unit of ctrl\].
    pub compliance: f64,
}

impl PositionActuator {
    /// The first position actuator of a joint: joint transmission, fixed gain k, affine bias b0 + b1 length with b1 < 0, so
    /// that the force k ctrl + b0 + b1 gear q vanishes where the joint should be.
    pub fn of(model: &CompiledModel, joint: JointId) -> Option<Self> {
        const JOINT: [i32; 2] = [0, 1]; // mjTRN_JOINT, mjTRN_JOINTINPARENT
        const FIXED: i32 = 0; // mjGAIN_FIXED
        const AFFINE: i32 = 1; // mjBIAS_AFFINE
        model.actuators().map(ActuatorId::index).find_map(|a| {
            let (gain, bias) = (model.actuator_gainprm()[10 * a], &model.actuator_biasprm()[10 * a..10 * a + 2]);
            let drives = JOINT.contains(&model.actuator_trntype()[a])
                && model.actuator_trnid()[2 * a] as usize == joint.index()
                && model.actuator_gaintype()[a] == FIXED
                && model.actuator_biastype()[a] == AFFINE
                && gain != 0.0
                && bias[1] < 0.0;
            let gear = model.actuator_gear()[6 * a];
            (drives && gear != 0.0).then(|| Self {
                index: a,
                scale: -bias[1] * gear / gain,
                offset: -bias[0] / gain,
                compliance: 1.0 / (gain * gear),
            })
        })
    }
}
