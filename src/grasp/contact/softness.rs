//! MuJoCo's contact softness: from `solref` and `solimp` to reference acceleration and regularisation.
//!
//! Source: MuJoCo documentation, "Computation", section "Constraint model" (impedance, reference acceleration,
//! diagonal approximation). Kept to the engine's arithmetic, because the grasp has to follow the engine's contacts.

use super::cost::Cost;
use crate::mujoco::{self, CompiledModel, DISABLE_REFSAFE};

/// MuJoCo's smallest and largest impedance (`mjMINIMP`, `mjMAXIMP`) and smallest value (`mjMINVAL`).
const IMPEDANCE: (f64, f64) = (0.0001, 0.9999);
const MIN_VALUE: f64 = 1e-15;

/// Friction cone of the model's options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConeKind {
    /// `cone="elliptic"`
    Elliptic,
    /// `cone="pyramidal"`, MuJoCo's default
    Pyramidal,
}

/// What decides the softness of one contact.
#[derive(Clone, Copy, Debug)]
pub struct ContactParameters {
    /// `(timeconst, dampratio)` when positive, `(-stiffness, -damping)` otherwise.
    pub solref: [f64; 2],
    /// `(dmin, dmax, width, midpoint, power)`
    pub solimp: [f64; 5],
    /// Distance between the surfaces, negative when they overlap \[m\].
    pub dist: f64,
    /// Distance at which the contact starts to push \[m\].
    pub margin: f64,
    /// 1, 3, 4 or 6.
    pub condim: usize,
    /// Two tangential coefficients, spin \[m\], two rolling \[m\].
    pub friction: [f64; 5],
    /// Sum of the two bodies' translational `invweight0` \[1/kg\].
    pub inverse_weight: f64,
}

/// Options of the model that enter the softness.
#[derive(Clone, Copy, Debug)]
pub struct SolverOptions {
    /// Time step \[s\].
    pub timestep: f64,
    /// False with the disable flag `refsafe`.
    pub refsafe: bool,
    /// Ratio of frictional to normal impedance of elliptic cones.
    pub impratio: f64,
    /// Friction cone.
    pub cone: ConeKind,
}

impl SolverOptions {
    /// Those of a model, as they are now.
    pub fn of(model: &CompiledModel) -> Self {
        SolverOptions {
            timestep: model.timestep(),
            refsafe: model.disable_flags() & DISABLE_REFSAFE == 0,
            impratio: model.impratio(),
            cone: if model.cone() == mujoco::Cone::Elliptic { ConeKind::Elliptic } else { ConeKind::Pyramidal },
        }
    }
}

/// A contact's rows as a spring and damper with a regularised force cost.
#[derive(Clone, Copy, Debug)]
pub struct Softness {
    /// `aref = -damping v - spring` on the normal row, `-damping v` on the others \[1/s\].
    pub damping: f64,
    /// `K I (dist - margin)` \[m/s^2\].
    pub spring: f64,
    /// Regularisation `R` of the normal row (elliptic, condim 1) or of an edge (pyramidal) \[1/kg\].
    pub regularisation: f64,
    /// The soft cost of MuJoCo's main solve.
    pub cost: Cost,
}

/// Computes a contact's softness as `mj_makeImpedance` and `mj_referenceConstraint` do.
pub fn softness(contact: &ContactParameters, options: &SolverOptions) -> Softness {
    let mut solref = contact.solref;
    if (solref[0] > 0.0) != (solref[1] > 0.0) {
        solref = [0.02, 1.0];
    }
    if options.refsafe && solref[0] > 0.0 {
        solref[0] = solref[0].max(2.0 * options.timestep);
    }
    let solimp = sanitised(contact.solimp);
    let dmax = solimp[1];
    let stiffness = if solref[0] > 0.0 {
        1.0 / (dmax * dmax * solref[0] * solref[0] * solref[1] * solref[1]).max(MIN_VALUE)
    } else {
        -solref[0] / (dmax * dmax).max(MIN_VALUE)
    };
    let damping =
        if solref[1] > 0.0 { 2.0 / (dmax * solref[0]).max(MIN_VALUE) } else { -solref[1] / dmax.max(MIN_VALUE) };
    let depth = contact.dist - contact.margin;
    let impedance = impedance(&solimp, depth);
    let softening = (1.0 - impedance) / impedance;

    let mu = contact.friction[0];
    let pyramidal = contact.condim > 1 && options.cone == ConeKind::Pyramidal;
    let weight = contact.inverse_weight * if pyramidal { 1.0 + mu * mu } else { 1.0 };
    let normal = (softening * weight).max(MIN_VALUE);
    let ratio = 1.0 / options.impratio.max(MIN_VALUE);
    let (regularisation, cost) = if contact.condim == 1 {
        (normal, Cost::Unilateral { stiffness: 1.0 / normal })
    } else if pyramidal {
        let edge = 2.0 * mu * mu * ratio * normal;
        (edge, Cost::Pyramidal { stiffness: 1.0 / edge, friction: contact.friction })
    } else {
        (normal, Cost::Elliptic { stiffness: 1.0 / normal, cone: mu * ratio.sqrt(), friction: contact.friction })
    };
    Softness { damping, spring: stiffness * impedance * depth, regularisation, cost }
}

fn sanitised(solimp: [f64; 5]) -> [f64; 5] {
    let clamp = |x: f64| x.max(IMPEDANCE.0).min(IMPEDANCE.1);
    [clamp(solimp[0]), clamp(solimp[1]), solimp[2].max(0.0), clamp(solimp[3]), solimp[4].max(1.0)]
}

/// The impedance `d(r)` of MuJoCo's documentation at penetration `r`.
fn impedance(solimp: &[f64; 5], depth: f64) -> f64 {
    let [dmin, dmax, width, midpoint, power] = *solimp;
    if dmin == dmax || width <= MIN_VALUE {
        return 0.5 * (dmin + dmax);
    }
    let x = (depth / width).abs();
    if x >= 1.0 {
        return dmax;
    }
    if x <= 0.0 {
        return dmin;
    }
    let raised = |x: f64, power: f64| match power {
        1.0 => x,
        2.0 => x * x,
        _ => x.powf(power),
    };
    let y = if power == 1.0 {
        x
    } else if x <= midpoint {
        raised(x, power) / raised(midpoint, power - 1.0)
    } else {
        1.0 - raised(1.0 - x, power) / raised(1.0 - midpoint, power - 1.0)
    };
    dmin + y * (dmax - dmin)
}
