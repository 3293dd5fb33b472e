//! Conic programs, built row by row for clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverError, SolverStatus, SupportedConeT};

/// A conic program in clarabel's form: rows `A x + slack = b`, the slack in a product of cones.
pub(super) struct Program {
    width: usize,
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    b: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Program {
    /// An empty program in `width` variables.
    pub(super) fn new(width: usize) -> Self {
        Program { width, rows: Vec::new(), columns: Vec::new(), values: Vec::new(), b: Vec::new(), cones: Vec::new() }
    }

    /// An entry of the current row.
    pub(super) fn entry(&mut self, column: usize, value: f64) {
        if value != 0.0 {
            self.rows.push(self.b.len());
            self.columns.push(column);
            self.values.push(value);
        }
    }

    /// Ends the current row.
    pub(super) fn end_row(&mut self, right_hand_side: f64) {
        self.b.push(right_hand_side);
    }

    /// The cone of the next rows' slack.
    pub(super) fn cone(&mut self, cone: SupportedConeT<f64>) {
        self.cones.push(cone);
    }

    /// The point that maximises one variable, and how the solver stopped: whether to believe it is the caller's.
    pub(super) fn maximise(self, variable: usize) -> Result<(Vec<f64>, SolverStatus), SolverError> {
        let height = self.b.len();
        let mut q = vec![0.0; self.width];
        q[variable] = -1.0;
        let a = CscMatrix::new_from_triplets(height, self.width, self.rows, self.columns, self.values);
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            tol_gap_abs: 1e-9,
            tol_gap_rel: 1e-9,
            tol_feas: 1e-9,
            ..DefaultSettings::default()
        };
        let p = CscMatrix::zeros((self.width, self.width));
        let mut solver = DefaultSolver::new(&p, &q, &a, &self.b, &self.cones, settings)?;
        solver.solve();
        Ok((solver.solution.x, solver.solution.status))
    }
}
