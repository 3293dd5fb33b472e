//! An independent solver for the grasp laws: Clarabel's interior point method on the dual problem.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use mujoco_grasp::grasp::contact::cost::{Bound, Cost};
use nalgebra::{DMatrix, DVector};

/// `min 1/2 x'Px + q'x  s.t.  b - Ax in cones`; `None` where the method gives up.
pub fn conic(
    p: &DMatrix<f64>,
    q: &DVector<f64>,
    a: &DMatrix<f64>,
    b: &DVector<f64>,
    cones: &[SupportedConeT<f64>],
) -> Option<DVector<f64>> {
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: 1e-9,
        tol_gap_rel: 1e-9,
        tol_feas: 1e-9,
        reduced_tol_gap_abs: 1e-7,
        reduced_tol_gap_rel: 1e-7,
        reduced_tol_feas: 1e-7,
        max_iter: 200,
        ..DefaultSettings::default()
    };
    let upper = DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| if i <= j { p[(i, j)] } else { 0.0 });
    let mut solver = DefaultSolver::new(&csc(&upper), q.as_slice(), &csc(a), b.as_slice(), cones, settings)
        .expect("a well-formed problem");
    solver.solve();
    let usable = matches!(
        solver.solution.status,
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress
    );
    usable.then(|| DVector::from_vec(solver.solution.x.clone()))
}

fn csc(m: &DMatrix<f64>) -> CscMatrix<f64> {
    let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
    CscMatrix::from(&rows)
}

/// One law in the dual: `min 1/2 f'Rf + f'(jar - shift)` over a cone or set.
pub struct Dual {
    pub regularisation: Vec<f64>,
    pub shift: Vec<f64>,
    pub a: DMatrix<f64>,
    pub b: DVector<f64>,
    pub cones: Vec<SupportedConeT<f64>>,
    /// maps the dual variable to row forces (edges to rows for a pyramid)
    pub to_rows: DMatrix<f64>,
}

/// The dual of a law on `rows` rows, written from its definition.
pub fn dual(law: &Cost, rows: usize) -> Dual {
    match *law {
        Cost::Unilateral { stiffness } => Dual {
            regularisation: vec![1.0 / stiffness],
            shift: vec![0.0],
            a: -DMatrix::identity(1, 1),
            b: DVector::zeros(1),
            cones: vec![SupportedConeT::NonnegativeConeT(1)],
            to_rows: DMatrix::identity(1, 1),
        },
        Cost::Elliptic { stiffness, cone, friction } => {
            let r0 = 1.0 / stiffness;
            let mut a = -DMatrix::identity(rows, rows);
            let mut regularisation = vec![r0];
            for j in 1..rows {
                a[(j, j)] = -1.0 / friction[j - 1];
                regularisation.push(r0 * cone * cone / (friction[j - 1] * friction[j - 1]));
            }
            Dual {
                regularisation,
                shift: vec![0.0; rows],
                a,
                b: DVector::zeros(rows),
                cones: vec![SupportedConeT::SecondOrderConeT(rows)],
                to_rows: DMatrix::identity(rows, rows),
            }
        }
        Cost::Pyramidal { stiffness, friction } => {
            let edges = 2 * (rows - 1);
            let mut to_rows = DMatrix::zeros(rows, edges);
            for e in 0..edges {
                let sign = if e % 2 == 0 { 1.0 } else { -1.0 };
                to_rows[(0, e)] = 1.0;
                to_rows[(1 + e / 2, e)] = sign * friction[e / 2];
            }
            Dual {
                regularisation: vec![1.0 / stiffness; edges],
                shift: vec![0.0; edges],
                a: -DMatrix::identity(edges, edges),
                b: DVector::zeros(edges),
                cones: vec![SupportedConeT::NonnegativeConeT(edges)],
                to_rows,
            }
        }
        Cost::Bounded { centre, stiffness, limit } => Dual {
            regularisation: vec![1.0 / stiffness],
            shift: vec![centre / stiffness],
            a: DMatrix::from_row_slice(2, 1, &[1.0, -1.0]),
            b: DVector::from_element(2, limit),
            cones: vec![SupportedConeT::NonnegativeConeT(2)],
            to_rows: DMatrix::identity(1, 1),
        },
        Cost::Still => panic!("a law without forces has no dual"),
        Cost::Slip { centre, resistance, friction, bound } => {
            let r: Vec<f64> = (0..rows).map(|j| resistance * (friction[0] / friction[j]).powi(2)).collect();
            let shift = (0..rows).map(|j| r[j] * centre[j]).collect();
            let (a, b, cones) = match bound {
                Bound::Ellipsoid(normal) => {
                    let mut a = DMatrix::zeros(rows + 1, rows);
                    let mut b = DVector::zeros(rows + 1);
                    b[0] = normal;
                    for j in 0..rows {
                        a[(j + 1, j)] = -1.0 / friction[j];
                    }
                    (a, b, vec![SupportedConeT::SecondOrderConeT(rows + 1)])
                }
                Bound::Box(normals) => {
                    let mut a = DMatrix::zeros(2 * rows, rows);
                    let mut b = DVector::zeros(2 * rows);
                    for j in 0..rows {
                        (a[(2 * j, j)], a[(2 * j + 1, j)]) = (1.0, -1.0);
                        (b[2 * j], b[2 * j + 1]) = (friction[j] * normals[j], friction[j] * normals[j]);
                    }
                    (a, b, vec![SupportedConeT::NonnegativeConeT(2 * rows)])
                }
            };
            Dual { regularisation: r, shift, a, b, cones, to_rows: DMatrix::identity(rows, rows) }
        }
    }
}

/// What the dual minimises, at given row forces (laws whose dual variables are the row forces).
pub fn objective(law: &Cost, jar: &[f64], f: &DVector<f64>) -> f64 {
    let d = dual(law, jar.len());
    (0..jar.len()).map(|j| 0.5 * d.regularisation[j] * f[j] * f[j] + f[j] * (jar[j] - d.shift[j])).sum()
}

/// How far row forces lie outside their cone or bounds, relative to one newton.
pub fn violation(law: &Cost, f: &DVector<f64>) -> f64 {
    let d = dual(law, f.len());
    let slack = &d.b - &d.a * f;
    match d.cones[0] {
        SupportedConeT::SecondOrderConeT(_) => slack.rows(1, slack.len() - 1).norm() - slack[0],
        _ => -slack.min(),
    }
}

/// Row forces of one law at a fixed residual.
pub fn project(law: &Cost, jar: &[f64]) -> DVector<f64> {
    let d = dual(law, jar.len());
    let p = DMatrix::from_diagonal(&DVector::from_vec(d.regularisation.clone()));
    let q = d.to_rows.transpose() * DVector::from_column_slice(jar) - DVector::from_vec(d.shift.clone());
    &d.to_rows * conic(&p, &q, &d.a, &d.b, &d.cones).expect("a solution")
}
