//! Which actuator moves a joint to a position.

use crate::mujoco::{ActuatorId, CompiledModel, JointId};

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
