//! The costs that turn a contact's acceleration residual into its force: projections onto friction cones.
//!
//! A cost is the gradient of a convex function `s`: `force = -ds/djar`, with `jar = J a - aref` the residual of
//! the contact's rows (MuJoCo's notation). Two costs act one after the other, as in MuJoCo with its noslip pass:
//!
//! 1. [`Cost::Elliptic`], [`Cost::Pyramidal`], [`Cost::Unilateral`]: the trial force `-jar / R` is projected onto the
//!    friction cone in the metric of MuJoCo's contact softness `R`. Since `R_j mu_j^2` is the same for all friction
//!    rows, the projection is radial and has a closed form.
//! 2. [`Cost::Slip`]: with the normal force now fixed, friction without softness: a proximal step around the force
//!    `centre` (its value one step ago), projected onto what the normal force allows. When the force stops changing
//!    the residual is zero: nothing creeps.

mod slip;

use slip::{slip_box, slip_ellipsoid};

/// Largest number of rows of one contact (condim 6).
pub const MAX_ROWS: usize = 6;

/// Where a contact stands on its cone; the force is affine in the residual in the first two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActiveSet {
    /// No force.
    Open,
    /// Inside the cone: the force is the trial force.
    Stick,
    /// On the cone's surface.
    Slide,
    /// Pyramids, boxes, bounded rows: the rows that push (pyramid, bit per edge) or saturate (two bits per axis: at the
    /// lower, at the upper limit).
    Facet(u32),
}

impl ActiveSet {
    /// True where the force is an affine function of the residual as long as the active set stays the same.
    pub fn is_affine(self) -> bool {
        self != ActiveSet::Slide
    }
}

/// What a contact does with the residual of its rows. Row order is MuJoCo's: normal, two tangents, spin, two
/// rolling axes (condim 1, 3, 4, 6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cost {
    /// One row that only pushes: condim 1, or a joint limit. `stiffness` is `1 / R`.
    Unilateral {
        /// `1 / R` of the row.
        stiffness: f64,
    },
    /// Elliptic cone `f_n >= |f_j / mu_j|`, softness `R_0` on the normal and `R_j = R_0 mu_0^2 / (impratio mu_j^2)`.
    Elliptic {
        /// `1 / R_0` of the normal row.
        stiffness: f64,
        /// MuJoCo's regularised coefficient `mu_1 sqrt(R_1 / R_0)`.
        cone: f64,
        /// Friction coefficients of the rows after the normal.
        friction: [f64; 5],
    },
    /// Pyramid with edges `n +- mu_j t_j`, each of the same softness.
    Pyramidal {
        /// `1 / R` of an edge.
        stiffness: f64,
        /// Friction coefficients of the rows after the normal.
        friction: [f64; 5],
    },
    /// Friction under a known normal force. The rows are those after the normal.
    Slip {
        /// Force at which the proximal step starts \[N, N m\].
        centre: [f64; 5],
        /// Proximal resistance of the first friction row; `r_j = resistance mu_0^2 / mu_j^2`.
        resistance: f64,
        /// Friction coefficients.
        friction: [f64; 5],
        /// What the normal force allows.
        bound: Bound,
    },
    /// One row of either sign up to a limit: an equality (no limit), friction of a joint or tendon.
    Bounded {
        /// Force without residual.
        centre: f64,
        /// `1 / R` of the row.
        stiffness: f64,
        /// Largest force; infinite for an equality.
        limit: f64,
    },
    /// Rows whose force is known already and does not answer.
    Still,
}

/// The set in which a friction force lies once the normal force is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// `sqrt(sum (f_j / mu_j)^2) <= N`.
    Ellipsoid(f64),
    /// `|f_j| <= mu_j N_j`, `N_j` the normal force that the pair of edges `j` of a pyramid carries.
    Box([f64; 5]),
}

impl Bound {
    /// The normal force of an elliptic cone, the largest of a pyramid's pairs.
    fn normal(&self) -> f64 {
        match self {
            Bound::Ellipsoid(normal) => *normal,
            Bound::Box(normals) => normals.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Value of a cost at one residual. `hessian` is row-major with stride [`MAX_ROWS`].
#[derive(Clone, Copy, Debug)]
pub struct Response {
    /// `s(jar)`.
    pub cost: f64,
    /// `-ds/djar`.
    pub force: [f64; MAX_ROWS],
    /// `d2s/djar2`, symmetric, positive semidefinite.
    pub hessian: [f64; MAX_ROWS * MAX_ROWS],
    /// Where on the cone.
    pub active_set: ActiveSet,
}

impl Response {
    /// No force.
    pub fn open() -> Self {
        Response { cost: 0.0, force: [0.0; MAX_ROWS], hessian: [0.0; MAX_ROWS * MAX_ROWS], active_set: ActiveSet::Open }
    }
}

impl Cost {
    /// Friction within the elliptic cone of a normal force; see [`Cost::Slip`].
    pub fn slip_ellipsoid(centre: [f64; 5], resistance: f64, friction: [f64; 5], normal: f64) -> Self {
        Cost::Slip { centre, resistance, friction, bound: Bound::Ellipsoid(normal) }
    }

    /// Friction within the box that the pairs of a pyramid's edges span; see [`Cost::Slip`].
    pub fn slip_box(centre: [f64; 5], resistance: f64, friction: [f64; 5], normals: [f64; 5]) -> Self {
        Cost::Slip { centre, resistance, friction, bound: Bound::Box(normals) }
    }

    /// First row that a cost of the friction pass governs; the rows before it, or all (`None`), keep the force of the first
    /// pass.
    pub(in crate::grasp) fn first_friction_row(&self) -> Option<usize> {
        match self {
            Cost::Slip { .. } => Some(1),
            Cost::Bounded { .. } => Some(0),
            _ => None,
        }
    }

    /// How far `force` is from the centre of a friction cost, as a share of the friction limit; 0 for the other costs.
    pub(in crate::grasp) fn change(&self, force: &[f64]) -> f64 {
        let share = |change: f64, limit: f64| if limit > 0.0 { change.abs() / limit } else { 0.0 };
        match self {
            Cost::Slip { centre, friction, bound, .. } => {
                let normal = |j: usize| if let Bound::Box(normals) = bound { normals[j] } else { bound.normal() };
                let of = |j: usize| share(force[j] - centre[j], friction[j] * normal(j));
                (0..force.len()).map(of).fold(0.0, f64::max)
            }
            Cost::Bounded { centre, limit, .. } if limit.is_finite() => share(force[0] - centre, *limit),
            _ => 0.0,
        }
    }

    /// The same friction cost, centred at `force`; other costs as they are.
    pub(in crate::grasp) fn centred(&self, force: &[f64; MAX_ROWS]) -> Cost {
        let mut cost = *self;
        match &mut cost {
            Cost::Slip { centre, .. } => centre.copy_from_slice(&force[..5]),
            Cost::Bounded { centre, limit, .. } if limit.is_finite() => *centre = force[0],
            _ => {}
        }
        cost
    }

    /// Evaluates the cost at the residual `jar` (one entry for each row that the cost governs).
    pub fn respond(&self, jar: &[f64]) -> Response {
        let mut out = Response::open();
        self.respond_into(jar, &mut out);
        out
    }

    /// As [`respond`](Self::respond), into `out`.
    pub fn respond_into(&self, jar: &[f64], out: &mut Response) {
        *out = Response::open();
        match self {
            Cost::Unilateral { stiffness } => unilateral(out, jar[0], *stiffness),
            Cost::Elliptic { stiffness, cone, friction } => elliptic(out, jar, *stiffness, *cone, friction),
            Cost::Pyramidal { stiffness, friction } => pyramidal(out, jar, *stiffness, friction),
            Cost::Slip { centre, resistance, friction, bound } => {
                let kappa = resistance * friction[0] * friction[0];
                match bound {
                    Bound::Ellipsoid(normal) => slip_ellipsoid(out, jar, centre, kappa, friction, *normal),
                    Bound::Box(normals) => slip_box(out, jar, centre, kappa, friction, normals),
                }
            }
            Cost::Bounded { centre, stiffness, limit } => bounded(out, jar[0], *centre, *stiffness, *limit),
            Cost::Still => {}
        }
    }
}

impl Cost {
    /// As [`respond_into`](Self::respond_into), by the tangent at another residual: close where the cost is not affine but the
    /// residual will turn out to be about `expected`. `cost` is not set.
    pub fn respond_near(&self, jar: &[f64], expected: &[f64], out: &mut Response) {
        self.respond_into(expected, out);
        for (force, row) in out.force.iter_mut().zip(out.hessian.chunks_exact(MAX_ROWS)).take(jar.len()) {
            let change = jar.iter().zip(expected).zip(row).map(|((jar, expected), h)| h * (jar - expected));
            *force -= change.sum::<f64>();
        }
    }

    /// The force if the contact stays in `active_set`: on an affine active set the cost's affine piece, continued beyond the active set;
    /// elsewhere the cost itself. A guess to start from: `cost` is not set.
    pub fn respond_in(&self, jar: &[f64], active_set: ActiveSet, out: &mut Response) {
        *out = Response { active_set, ..Response::open() };
        match (self, active_set) {
            (Cost::Unilateral { .. } | Cost::Elliptic { .. } | Cost::Pyramidal { .. }, ActiveSet::Open) => {}
            (Cost::Unilateral { stiffness }, ActiveSet::Stick) => {
                out.force[0] = -stiffness * jar[0];
                out.hessian[0] = *stiffness;
            }
            (Cost::Elliptic { stiffness, cone, friction }, ActiveSet::Stick) => {
                stick(out, jar, *stiffness, *cone, friction);
            }
            (Cost::Pyramidal { stiffness, friction }, ActiveSet::Facet(edges)) => {
                push_edges(out, jar, *stiffness, friction, |bit, _| edges & (1 << bit) != 0);
            }
            (Cost::Slip { centre, resistance, friction, bound: Bound::Ellipsoid(_) }, ActiveSet::Stick) => {
                let kappa = resistance * friction[0] * friction[0];
                for j in 0..jar.len() {
                    let r = kappa / (friction[j] * friction[j]);
                    out.force[j] = centre[j] - jar[j] / r;
                    out.hessian[j * MAX_ROWS + j] = 1.0 / r;
                }
            }
            (Cost::Slip { centre, resistance, friction, bound: Bound::Box(normals) }, ActiveSet::Facet(saturated)) => {
                let kappa = resistance * friction[0] * friction[0];
                for j in 0..jar.len() {
                    let r = kappa / (friction[j] * friction[j]);
                    let limit = friction[j] * normals[j];
                    match (saturated >> (2 * j)) & 0b11 {
                        0b00 => {
                            out.force[j] = centre[j] - jar[j] / r;
                            out.hessian[j * MAX_ROWS + j] = 1.0 / r;
                        }
                        0b01 => out.force[j] = -limit,
                        _ => out.force[j] = limit,
                    }
                }
            }
            (Cost::Bounded { centre, stiffness, limit }, ActiveSet::Facet(saturated)) => {
                bounded_in(out, jar[0], *centre, *stiffness, *limit, saturated);
            }
            _ => self.respond_into(jar, out),
        }
    }
}

/// The inside of the elliptic cone: each row a spring of its own, `R_j mu_j^2 = R_0 mu^2` (see [`Cost::Elliptic`]).
fn stick(out: &mut Response, jar: &[f64], stiffness: f64, mu: f64, friction: &[f64; 5]) {
    out.active_set = ActiveSet::Stick;
    for j in 0..jar.len() {
        let d = if j == 0 { stiffness } else { stiffness * friction[j - 1] * friction[j - 1] / (mu * mu) };
        out.force[j] = -d * jar[j];
        out.hessian[j * MAX_ROWS + j] = d;
    }
}

fn unilateral(out: &mut Response, jar: f64, stiffness: f64) {
    if jar < 0.0 {
        out.cost = 0.5 * stiffness * jar * jar;
        out.force[0] = -stiffness * jar;
        out.hessian[0] = stiffness;
        out.active_set = ActiveSet::Stick;
    }
}

/// `s(jar) = max_f { -f jar - (f - c)^2 / (2 stiffness) }` over `|f| <= limit`.
fn bounded(out: &mut Response, jar: f64, centre: f64, stiffness: f64, limit: f64) {
    let trial = centre - stiffness * jar;
    let saturated = u32::from(trial < -limit) | u32::from(trial > limit) << 1;
    bounded_in(out, jar, centre, stiffness, limit, saturated);
    let off = out.force[0] - centre;
    out.cost = -out.force[0] * jar - 0.5 * off * off / stiffness;
}

fn bounded_in(out: &mut Response, jar: f64, centre: f64, stiffness: f64, limit: f64, saturated: u32) {
    out.active_set = ActiveSet::Facet(saturated);
    match saturated {
        0b00 => {
            out.force[0] = centre - stiffness * jar;
            out.hessian[0] = stiffness;
        }
        0b01 => out.force[0] = -limit,
        _ => out.force[0] = limit,
    }
}

/// MuJoCo's elliptic cone ("Computation" chapter, "Reduced cost for friction cones"): in the coordinates
/// `U = (mu jar_n, mu_j jar_j)` the dual cone is circular and the projection radial.
fn elliptic(out: &mut Response, jar: &[f64], stiffness: f64, mu: f64, friction: &[f64; 5]) {
    let dim = jar.len();
    let mut u = [0.0; MAX_ROWS];
    let mut tangential = 0.0;
    for j in 1..dim {
        u[j] = jar[j] * friction[j - 1];
        tangential += u[j] * u[j];
    }
    let normal = jar[0] * mu;
    let tangential = tangential.sqrt();

    if normal >= mu * tangential {
        return;
    }
    if mu * normal + tangential <= 0.0 {
        stick(out, jar, stiffness, mu, friction);
        out.cost = -0.5 * (0..dim).map(|j| out.force[j] * jar[j]).sum::<f64>();
        return;
    }

    out.active_set = ActiveSet::Slide;
    let dm = stiffness / (mu * mu * (1.0 + mu * mu));
    let depth = normal - mu * tangential;
    out.cost = 0.5 * dm * depth * depth;
    out.force[0] = -dm * depth * mu;
    let along = out.force[0] / tangential;
    for j in 1..dim {
        out.force[j] = -along * u[j] * friction[j - 1];
    }
    // second derivative of dm/2 (U_0 - mu |U_t|)^2, chained with diag(mu, friction)
    let scale = |j: usize| if j == 0 { mu } else { friction[j - 1] };
    let diagonal = mu * mu - mu * normal / tangential;
    let outer = mu * normal / (tangential * tangential * tangential);
    for i in 0..dim {
        for j in 0..=i {
            let mut h = match (i, j) {
                (0, 0) => 1.0,
                (_, 0) => -mu * u[i] / tangential,
                _ => outer * u[i] * u[j],
            };
            if i == j && i > 0 {
                h += diagonal;
            }
            h *= dm * scale(i) * scale(j);
            out.hessian[i * MAX_ROWS + j] = h;
            out.hessian[j * MAX_ROWS + i] = h;
        }
    }
}

fn pyramidal(out: &mut Response, jar: &[f64], stiffness: f64, friction: &[f64; 5]) {
    let edges = push_edges(out, jar, stiffness, friction, |_, residual| residual < 0.0);
    if edges != 0 {
        out.active_set = ActiveSet::Facet(edges);
    }
}

/// Lets the edges of a pyramid that `pushes` (by number and residual) chooses act; returns them as bits.
fn push_edges(
    out: &mut Response,
    jar: &[f64],
    stiffness: f64,
    friction: &[f64; 5],
    pushes: impl Fn(usize, f64) -> bool,
) -> u32 {
    let mut edges = 0;
    for j in 1..jar.len() {
        let mu = friction[j - 1];
        for (side, sign) in [mu, -mu].into_iter().enumerate() {
            let bit = 2 * (j - 1) + side;
            let residual = jar[0] + sign * jar[j];
            if !pushes(bit, residual) {
                continue;
            }
            edges |= 1 << bit;
            let push = -stiffness * residual;
            out.cost -= 0.5 * push * residual;
            out.force[0] += push;
            out.force[j] += sign * push;
            out.hessian[0] += stiffness;
            out.hessian[j] += stiffness * sign;
            out.hessian[j * MAX_ROWS] += stiffness * sign;
            out.hessian[j * MAX_ROWS + j] += stiffness * sign * sign;
        }
    }
    edges
}

/// The normal force that each pair of opposing pyramid edges carries: what MuJoCo's noslip pass keeps fixed.
pub fn pyramid_pairs(jar: &[f64], stiffness: f64, friction: &[f64; 5]) -> [f64; 5] {
    let mut pairs = [0.0; 5];
    for j in 1..jar.len() {
        let mu = friction[j - 1];
        let push = |sign: f64| stiffness * (-(jar[0] + sign * jar[j])).max(0.0);
        pairs[j - 1] = push(mu) + push(-mu);
    }
    pairs
}
