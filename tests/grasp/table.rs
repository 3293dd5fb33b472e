//! A Markdown table of how closely grasp mode follows full mode, and bounds on it.

use super::hold::{Fidelity, NOSLIP, Scene, fidelity};

/// A push that moves the target less than this says nothing \[m\].
const VISIBLE: f64 = 5e-4;

/// What the normal forces of one step may differ by from those of the engine's converged solve, relative. The solve ends at
/// 1e-6 of the largest term in its gradient; largest found: 1.2e-6.
const ONE_STEP: f64 = 2e-6;

/// Of the relative error, and of that of the normal forces.
pub type Bounds = (f64, f64);

/// Rows are printed as they are measured; what is beyond its bounds is told at the end.
pub struct Table {
    faults: Vec<String>,
}

impl Table {
    pub fn new(title: &str) -> Table {
        println!("\n**{title}**\n");
        println!(
            "| variant | motion, mm | palm's, mm | contacts on a link | apart, mm | apart, deg | of the motion | normal \
             forces | in one step | iterations |"
        );
        println!("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|");
        Table { faults: Vec::new() }
    }

    /// Measures `scene` against the full solve.
    pub fn row(&mut self, name: &str, scene: &Scene, bounds: Bounds) -> Fidelity {
        self.row_against(NOSLIP, name, scene, bounds)
    }

    /// As [`row`](Self::row), with another number of iterations of the reference's friction pass.
    pub fn row_against(&mut self, noslip: usize, name: &str, scene: &Scene, bounds: Bounds) -> Fidelity {
        let found = fidelity(scene, noslip);
        self.add(name, found, bounds);
        found
    }

    /// A row that was measured elsewhere.
    pub fn add(&mut self, name: &str, found: Fidelity, (relative, forces): Bounds) {
        println!(
            "| {name} | {:.2} | {:.2} | {} | {:.4} | {:.3} | {:.4} | {:.4} | {:.0e} | {} |",
            found.peak * 1e3,
            found.palm_peak * 1e3,
            found.contacts,
            found.apart * 1e3,
            found.turned.to_degrees(),
            found.relative(),
            found.forces,
            found.one_step,
            found.iterations,
        );
        let mut check = |what: &str, value: f64, bound: f64| {
            if value.is_nan() || value > bound {
                self.faults.push(format!("{name}: {what} {value:.5}, allowed {bound}"));
            }
        };
        check("relative error", found.relative(), relative);
        check("error of the normal forces", found.forces, forces);
        check("difference of a normal force in one step", found.one_step, ONE_STEP);
        check("steps without a converged solve:", found.unsolved as f64, 0.0);
        if found.peak < VISIBLE {
            self.faults.push(format!("{name}: the push does nothing, {} m", found.peak));
        }
    }

    pub fn finish(self) {
        assert!(self.faults.is_empty(), "\n{}", self.faults.join("\n"));
    }
}
