//! The parameters of a geom pair's contacts, mixed as the engine's collision driver does.

use super::pairs::TestedPair;
use crate::mujoco::compat;
use crate::mujoco::compiled::CompiledModel;
use crate::mujoco::ffi;

/// Parameters of a pair's contacts.
#[derive(Debug, Clone)]
pub(super) struct ContactParameters {
    /// Contacts are made at distances up to this, m.
    pub reach: f64,
    /// Contacts take part in the solve below this distance, m.
    pub include_margin: f64,
    pub condim: usize,
    pub solref: [f64; 2],
    pub solimp: [f64; 5],
    friction: FrictionOf,
}

/// Where a pair's friction is; read when it is needed, as it can be edited.
#[derive(Debug, Clone, Copy)]
enum FrictionOf {
    /// Five numbers of a `<pair>`.
    Pair(usize),
    /// The geom with the higher priority.
    Geom(usize),
    /// The larger of two geoms', number by number.
    Larger([usize; 2]),
}

impl ContactParameters {
    pub fn new(model: &CompiledModel, pair: &TestedPair) -> Self {
        let (mut parameters, mut margin, gap) = match pair.predefined {
            Some(predefined) => Self::predefined(model, predefined),
            None => Self::mixed(model, pair.geoms),
        };
        if model.overrides_contacts() {
            (margin, parameters.solref, parameters.solimp) = model.contact_override();
        }
        (parameters.reach, parameters.include_margin) = compat::reach(margin, gap);
        parameters
    }

    /// Those of a `<pair>`, its margin and its gap.
    fn predefined(model: &CompiledModel, pair: usize) -> (Self, f64, f64) {
        let parameters = Self {
            reach: 0.0,
            include_margin: 0.0,
            condim: model.pair_dim()[pair] as usize,
            solref: row(model.pair_solref(), pair),
            solimp: row(model.pair_solimp(), pair),
            friction: FrictionOf::Pair(pair),
        };
        (parameters, model.pair_margin()[pair], model.pair_gap()[pair])
    }

    /// Those of two geoms, their margin and their gap.
    fn mixed(model: &CompiledModel, geoms: [usize; 2]) -> (Self, f64, f64) {
        let of = |array: &[f64]| geoms.map(|geom| array[geom]);
        let priority = geoms.map(|geom| model.geom_priority()[geom]);
        let condim = geoms.map(|geom| model.geom_condim()[geom] as usize);
        let solref = geoms.map(|geom| row::<2>(model.geom_solref(), geom));
        let solimp = geoms.map(|geom| row::<5>(model.geom_solimp(), geom));
        let mut parameters = Self {
            reach: 0.0,
            include_margin: 0.0,
            condim: condim[0].max(condim[1]),
            solref: solref[0],
            solimp: solimp[0],
            friction: FrictionOf::Larger(geoms),
        };
        if priority[0] != priority[1] {
            let winner = usize::from(priority[1] > priority[0]);
            parameters.condim = condim[winner];
            parameters.solref = solref[winner];
            parameters.solimp = solimp[winner];
            parameters.friction = FrictionOf::Geom(geoms[winner]);
        } else {
            let mix = mix_factor(of(model.geom_solmix()));
            let blend = |[a, b]: [f64; 2]| mix * a + (1.0 - mix) * b;
            // A time constant that is not positive marks the direct format, of which the smaller is taken.
            let direct = solref.iter().any(|reference| reference[0] <= 0.0);
            parameters.solref = std::array::from_fn(|i| {
                let values = [solref[0][i], solref[1][i]];
                if direct { values[0].min(values[1]) } else { blend(values) }
            });
            parameters.solimp = std::array::from_fn(|i| blend([solimp[0][i], solimp[1][i]]));
        }
        (parameters, compat::mix_margins(of(model.geom_margin())), compat::mix_margins(of(model.geom_gap())))
    }

    /// Sliding (two), spinning and rolling (two) friction, from the model's present numbers.
    pub fn friction(&self, model: &CompiledModel) -> [f64; 5] {
        if let Some(friction) = compat::friction_override(model) {
            return friction;
        }
        let unpack = |[slide, spin, roll]: [f64; 3]| [slide, slide, spin, roll, roll];
        let friction = match self.friction {
            FrictionOf::Pair(pair) => row(model.pair_friction(), pair),
            FrictionOf::Geom(geom) => unpack(row(model.geom_friction(), geom)),
            FrictionOf::Larger(geoms) => {
                let [a, b] = geoms.map(|geom| row::<3>(model.geom_friction(), geom));
                unpack([a[0].max(b[0]), a[1].max(b[1]), a[2].max(b[2])])
            }
        };
        friction.map(|coefficient| coefficient.max(ffi::mjMINMU))
    }
}

/// Weight of the first geom.
fn mix_factor([first, second]: [f64; 2]) -> f64 {
    match (first >= ffi::mjMINVAL, second >= ffi::mjMINVAL) {
        (true, true) => first / (first + second),
        (false, false) => 0.5,
        (false, true) => 0.0,
        (true, false) => 1.0,
    }
}

/// Row `index` of an array with rows of `N` numbers.
fn row<const N: usize>(array: &[f64], index: usize) -> [f64; N] {
    std::array::from_fn(|i| array[N * index + i])
}
