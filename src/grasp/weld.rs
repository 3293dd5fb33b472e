//! The weld equality that carries a merged grasp: finding it, lending its rows, and the settings that the rows need.
//!
//! The weld is in the model for its six constraint rows only. It is switched on while the rows are made and off right
//! after, so that nothing else ever sees it active; Jacobian, reference and regularisation are overwritten.

use super::controller::Grasp;
use super::error::Error;
use super::spec::Limits;
use super::topology::Topology;
use crate::mujoco::{EqualityId, EqualityKind, JacobianStorage, Simulation};
use nalgebra::{Matrix6, Vector6};

/// Rows of a weld.
pub const WELD_ROWS: usize = 6;

/// The elements that a model needs, besides its own, for a grasp of body `target` with [`Limits::Box`] or
/// [`Limits::Rigid`]: a weld, switched off and without a name. To be added after all other equality constraints, as
/// `Model::from_xml_file_with` does with its second argument.
///
/// `hand` is any body of the hand that has a name; without, the weld's other side is the world. Either serves; two hands
/// that grasp the same target need a weld each, told apart by `hand`.
pub fn weld_xml(target: &str, hand: Option<&str>) -> String {
    let target = escape(target);
    let bodies = match hand {
        Some(hand) => format!("body1=\"{}\" body2=\"{target}\"", escape(hand)),
        None => format!("body1=\"{target}\""),
    };
    format!("<equality><weld {bodies} active=\"false\"/></equality>")
}

fn escape(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// The last weld between the target and the hand, or else between the target and the world.
pub(super) fn find(sim: &Simulation, topology: &Topology, limits: Limits, target: &str) -> Result<EqualityId, Error> {
    let model = sim.model();
    let welds = |other: &dyn Fn(usize) -> bool| {
        model
            .equalities()
            .filter(|&id| model.equality_kind(id) == Some(EqualityKind::Weld))
            .filter(|&id| {
                let bodies = model.equality_bodies(id).map(|bodies| bodies.map(|body| body.index()));
                bodies.is_some_and(|[a, b]| (topology.in_target(a) && other(b)) || (topology.in_target(b) && other(a)))
            })
            .last()
    };
    let weld = welds(&|body| topology.in_hand(body))
        .or_else(|| welds(&|body| body == 0))
        .ok_or_else(|| Error::NoWeld { limits: limits.name(), target: target.to_string() })?;
    if sim.is_equality_active(weld)? {
        return Err(Error::WeldActive(target.to_string()));
    }
    Ok(weld)
}

/// Makes the engine's constraint rows, with the weld rows of each latched merged grasp that has contacts.
pub(super) fn make_constraint(sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<(), Error> {
    let mut count = 0;
    let mut relaxed = 0;
    for grasp in grasps.iter().filter(|g| g.wants_weld()) {
        switch(sim, grasp, true)?;
        count += 1;
        relaxed += grasp.relaxed_count();
    }
    let made = sim.make_constraint();
    if count == 0 {
        return Ok(made?);
    }
    for grasp in grasps.iter().filter(|g| g.wants_weld()) {
        switch(sim, grasp, false)?;
    }
    made?;
    let rows = lend(sim, grasps, count)?;
    // All rows of all welds are alike until they are overwritten: the rigid ones come first, then those with bounds.
    let mut rigid = rows.start;
    let mut bounded = rows.end - relaxed;
    sim.make_friction_rows(relaxed)?;
    for grasp in grasps.iter_mut().filter(|g| g.wants_weld()) {
        grasp.write_weld_rows(sim, &mut rigid, &mut bounded)?;
    }
    Ok(())
}

/// The welds' rows of this step, once [`make_constraint`] has made them: the last equalities and the first friction rows.
pub(super) fn rows(sim: &Simulation, grasps: &[Grasp]) -> std::ops::Range<usize> {
    let welds = || grasps.iter().filter(|g| g.wants_weld());
    let end = sim.ne() + welds().map(Grasp::relaxed_count).sum::<usize>();
    end.saturating_sub(WELD_ROWS * welds().count())..end
}

fn switch(sim: &mut Simulation, grasp: &Grasp, on: bool) -> Result<(), Error> {
    match grasp.weld() {
        Some(weld) => Ok(sim.set_equality_active(weld, on)?),
        None => Ok(()),
    }
}

/// The rows of `count` welds, checked to be the last of the equality rows.
fn lend(sim: &Simulation, grasps: &[Grasp], count: usize) -> Result<std::ops::Range<usize>, Error> {
    let missing = || Error::WeldRows { time: sim.time(), welds: count };
    let end = sim.ne();
    let start = end.checked_sub(WELD_ROWS * count).ok_or_else(missing)?;
    for (i, grasp) in grasps.iter().enumerate().filter(|(_, g)| g.wants_weld()) {
        let rows = grasp.weld().and_then(|weld| sim.equality_rows(weld));
        let complete = rows.is_some_and(|r| r.len() == WELD_ROWS && r.start >= start);
        let shared = grasps[..i].iter().any(|g| g.wants_weld() && g.weld() == grasp.weld());
        if !complete || shared {
            return Err(missing());
        }
    }
    Ok(start..end)
}

/// The user's settings that weld rows cannot live with.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Settings {
    noslip_iterations: usize,
    jacobian: JacobianStorage,
}

/// Before a step: while a merged grasp is latched the Jacobian is dense (a sparse weld row has no finger columns), and
/// with bounded rows there is no noslip pass (it would solve them without their regularisation, which is part of their
/// reference). The user's settings come back in the first step without such a grasp.
pub(super) fn adapt_settings(sim: &mut Simulation, grasps: &mut [Grasp]) -> Result<(), Error> {
    let merged = grasps.iter().any(|g| g.is_merged());
    let bounded = grasps.iter().any(|g| g.is_merged() && g.limits() == Limits::Box);
    let holder = grasps.iter().position(|g| g.settings().is_some());
    let (Some(holder), true) = (holder.or(merged.then_some(0)), merged) else {
        for grasp in grasps {
            grasp.restore_settings(sim)?;
        }
        return Ok(());
    };
    let model = sim.model();
    let user = *grasps[holder]
        .settings_mut()
        .get_or_insert(Settings { noslip_iterations: model.noslip_iterations(), jacobian: model.jacobian_storage() });
    user.put(sim, if bounded { 0 } else { user.noslip_iterations })?;
    if sim.model().is_sparse() {
        sim.set_jacobian_storage(JacobianStorage::Dense)?;
    }
    Ok(())
}

impl Settings {
    /// Whether the engine knows such settings.
    pub(super) fn are_known(&self) -> bool {
        !matches!(self.jacobian, JacobianStorage::Other(_)) && i32::try_from(self.noslip_iterations).is_ok()
    }

    fn put(&self, sim: &mut Simulation, noslip_iterations: usize) -> Result<(), Error> {
        if sim.model().noslip_iterations() != noslip_iterations {
            sim.set_noslip_iterations(noslip_iterations)?;
        }
        Ok(())
    }

    /// Gives the settings back.
    pub(super) fn restore(&self, sim: &mut Simulation) -> Result<(), Error> {
        self.put(sim, self.noslip_iterations)?;
        if sim.model().jacobian_storage() != self.jacobian {
            sim.set_jacobian_storage(self.jacobian)?;
        }
        Ok(())
    }
}

/// Splits the merged softness `N` into a diagonal `D >= N`, which the rows' regularisation can be, and the excess
/// `D - N`, which multiplies the last step's wrench in the reference: `J a + D l = aref + (D - N) l_last` has the solution
/// of `J a + N l = aref` as its fixed point and comes nearer to it in every step, since `0 <= D - N < D + J M^-1 J^T`.
pub(super) fn regularise(softness: &Matrix6<f64>) -> ([f64; WELD_ROWS], Matrix6<f64>) {
    let diagonal: [f64; WELD_ROWS] = std::array::from_fn(|i| {
        (0..WELD_ROWS).map(|j| softness[(i, j)].abs() * (softness[(i, i)] / softness[(j, j)]).sqrt()).sum()
    });
    (diagonal, Matrix6::from_diagonal(&Vector6::from(diagonal)) - softness)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn softness_matrix(seed: f64) -> Matrix6<f64> {
        let b = Matrix6::from_fn(|i, j| (seed + 2.3 * i as f64 + 1.1 * (i * j) as f64).sin());
        let scale = Matrix6::from_diagonal(&Vector6::new(1.0, 2.0, 1.0, 300.0, 500.0, 200.0));
        scale * (b * b.transpose() + Matrix6::identity() * 1e-3) * scale
    }

    #[test]
    fn regularisation_bounds_the_softness_and_its_lag_settles_on_the_solution() {
        for seed in [0.1, 1.3, 2.9, 4.2] {
            let n = softness_matrix(seed);
            let (d, excess) = regularise(&n);
            let diagonal = Matrix6::from_diagonal(&Vector6::from(d));
            let scaled = |m: &Matrix6<f64>| {
                let s = Matrix6::from_diagonal(&Vector6::from_fn(|i, _| d[i].sqrt().recip()));
                s * m * s
            };
            let least = scaled(&excess).symmetric_eigenvalues().min();
            assert!(least > -1e-12, "D - N must not be negative: {least}");
            assert!((diagonal - excess - n).amax() < 1e-12 * n.amax());
            // a light target: little inverse inertia beside the softness, the slowest case
            let a = scaled(&n).map(|x| 0.01 * x) + Matrix6::identity() * 0.01;
            let (n, excess) = (scaled(&n), scaled(&excess));
            let b = Vector6::new(1.0, -2.0, 0.5, 0.3, 0.8, -1.0);
            let solution = (a + n).lu().solve(&b).unwrap();
            let mut x = Vector6::zeros();
            let mut error = solution.norm();
            for _ in 0..3000 {
                x = (a + Matrix6::identity()).lu().solve(&(b + excess * x)).unwrap();
                let now = (x - solution).norm();
                assert!(now <= error * (1.0 + 1e-9) + 1e-12);
                error = now;
            }
            assert!(error < 1e-6 * solution.norm(), "{error}");
        }
    }
}
