//! The six-dimensional hull against closed forms, Qhull, and a conic oracle.

use crate::support::{Random, contact, equator, faces, on_sphere};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, ZeroConeT};
use mujoco_grasp::grasp::metrics::hull::{ConvexHull, HullError};
use mujoco_grasp::grasp::metrics::quality::{ferrari_canny, hull_volume, primitive_wrenches, wrench_hull};
use nalgebra::{Matrix6, Vector3, Vector6};

fn close(value: f64, expected: f64, tolerance: f64) {
    assert!((value - expected).abs() <= tolerance * expected.abs().max(1e-9), "{value} is not {expected}");
}

fn hull(points: &[Vector6<f64>]) -> ConvexHull {
    ConvexHull::new(points).expect("the hull closes")
}

fn unit(k: usize) -> Vector6<f64> {
    let mut e = Vector6::zeros();
    e[k] = 1.0;
    e
}

fn cross_polytope() -> Vec<Vector6<f64>> {
    (0..6).flat_map(|k| [unit(k), -unit(k)]).collect()
}

fn hypercube() -> Vec<Vector6<f64>> {
    (0..64u32).map(|bits| Vector6::from_fn(|k, _| if bits >> k & 1 == 1 { 1.0 } else { -1.0 })).collect()
}

/// The largest s with `s u` in the hull of `points`, by linear programming: no facet is ever formed.
fn reach(points: &[Vector6<f64>], u: &Vector6<f64>) -> f64 {
    let n = points.len();
    // sum a_i p_i = s u, sum a_i = 1, a >= 0.
    let mut rows = vec![vec![0.0; n + 1]; 7 + n];
    for (j, p) in points.iter().enumerate() {
        for k in 0..6 {
            rows[k][j] = p[k];
        }
        rows[6][j] = 1.0;
        rows[7 + j][j] = -1.0;
    }
    for k in 0..6 {
        rows[k][n] = -u[k];
    }
    let mut b = vec![0.0; 7 + n];
    b[6] = 1.0;
    let mut q = vec![0.0; n + 1];
    q[n] = -1.0;
    let a = CscMatrix::from(&rows);
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let p = CscMatrix::zeros((n + 1, n + 1));
    let cones = [ZeroConeT(7), NonnegativeConeT(n)];
    let mut solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings).expect("a valid program");
    solver.solve();
    solver.solution.x[n]
}

fn support(points: &[Vector6<f64>], u: &Vector6<f64>) -> f64 {
    points.iter().map(|p| p.dot(u)).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn cross_polytope_has_64_facets_at_one_over_root_six() {
    let hull = hull(&cross_polytope());
    assert_eq!(hull.facets().len(), 64);
    close(hull.inner_radius(), 1.0 / 6f64.sqrt(), 1e-12);
    close(hull.volume(), 64.0 / 720.0, 1e-12);
}

#[test]
fn hypercube_with_its_32_cohedral_corners_a_facet() {
    let hull = hull(&hypercube());
    close(hull.inner_radius(), 1.0, 1e-9);
    close(hull.volume(), 64.0, 1e-9);
}

#[test]
fn points_within_and_on_the_hull_change_nothing() {
    let mut random = Random::new(5);
    let mut points = hypercube();
    for _ in 0..60 {
        let mut inside = Vector6::from_fn(|_, _| 2.0 * random.uniform() - 1.0);
        points.push(inside);
        inside[2] = 1.0;
        points.push(inside);
        // Midpoints of edges, and the corners again.
        points.push((points[7] + points[15]) / 2.0);
        points.push(points[33]);
    }
    let hull = hull(&points);
    close(hull.inner_radius(), 1.0, 1e-5);
    close(hull.volume(), 64.0, 1e-5);
}

#[test]
fn affine_maps_scale_the_volume_and_thin_hulls_stay_exact() {
    let mut random = Random::new(9);
    let thin = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 1e-2, 1e-3, 1e-4));
    let points: Vec<_> = cross_polytope().iter().map(|p| thin * p).collect();
    let expected = (0..6).map(|k| thin[(k, k)].powi(-2)).sum::<f64>().powf(-0.5);
    close(hull(&points).inner_radius(), expected, 1e-9);
    close(hull(&points).volume(), 64.0 / 720.0 * 1e-9, 1e-9);
    let shear = Matrix6::from_fn(|_, _| random.normal());
    let points: Vec<_> = hypercube().iter().map(|p| shear * p).collect();
    close(hull(&points).volume(), 64.0 * shear.determinant().abs(), 1e-6);
}

#[test]
fn flat_and_empty_sets_have_neither_ball_nor_volume() {
    let flat: Vec<_> = hypercube().iter().map(|p| Vector6::new(p[0], p[1], p[2], p[3], p[4], p[0] + p[1])).collect();
    for points in [vec![], vec![unit(0)], cross_polytope()[..6].to_vec(), flat, vec![unit(3); 40]] {
        let hull = hull(&points);
        assert_eq!((hull.inner_radius(), hull.volume()), (0.0, 0.0));
        assert!(hull.facets().is_empty());
    }
}

#[test]
fn an_origin_outside_has_no_ball_but_a_volume() {
    let away: Vec<_> = cross_polytope().iter().map(|p| p + unit(2) * 1.5).collect();
    assert_eq!(hull(&away).inner_radius(), 0.0);
    close(hull(&away).volume(), 64.0 / 720.0, 1e-9);
}

#[test]
fn a_point_that_is_not_finite_is_named() {
    let mut points = cross_polytope();
    points[4][1] = f64::NAN;
    assert_eq!(ConvexHull::new(&points), Err(HullError::NotFinite { point: 4 }));
}

/// Every point of the hull is below every facet, so no facet is too low; and by linear programming each facet's nearest
/// point belongs to the hull, so none is too high. Together: the facets are the hull's own, whatever built them.
#[test]
fn facets_of_random_grasps_agree_with_linear_programming() {
    let mut random = Random::new(11);
    for round in 0..12 {
        let condim = [3, 4, 6][round % 3];
        let contacts = random.grasp(3 + round % 4, condim);
        let points = primitive_wrenches(&contacts, &Vector3::zeros()).expect("a valid grasp");
        let hull = hull(&points);
        let size = points.iter().map(|p| p.norm()).fold(0.0, f64::max);
        for facet in hull.facets() {
            assert!((support(&points, &facet.normal) - facet.offset).abs() < 1e-6 * size);
        }
        let epsilon = hull.inner_radius();
        if epsilon > 0.0 {
            let nearest = hull.facets().iter().min_by(|a, b| a.offset.total_cmp(&b.offset));
            let u = nearest.expect("it has facets").normal;
            close(reach(&points, &u), epsilon, 1e-5);
        }
        for _ in 0..40 {
            let u = Vector6::from_fn(|_, _| random.normal()).normalize();
            if epsilon > 0.0 {
                // No direction's support or reach is below epsilon.
                assert!(support(&points, &u) >= epsilon - 1e-9 * size);
                let through = hull
                    .facets()
                    .iter()
                    .map(|f| (f.offset, f.normal.dot(&u)))
                    .filter(|(_, along)| *along > 0.0)
                    .map(|(offset, along)| offset / along)
                    .fold(f64::INFINITY, f64::min);
                close(reach(&points, &u), through, 1e-5);
            }
        }
    }
}

#[test]
fn epsilon_of_a_soft_pinch_is_below_its_weakest_axis_and_every_support() {
    let (a, mu, spin, f) = (0.03, 0.7, 0.004, 2.0);
    let pinch = on_sphere(&equator(2), a, 4, [mu, mu, spin, 0.0, 0.0], f);
    let epsilon = ferrari_canny(&pinch, &Vector3::zeros()).expect("a valid grasp");
    assert!(epsilon > 0.0);
    let h = |u: &Vector6<f64>| support(&primitive_wrenches(&pinch, &Vector3::zeros()).expect("valid"), u);
    close(h(&unit(3)), spin / a * f, 1e-12);
    assert!(epsilon <= spin / a * f + 1e-12);
    let mut random = Random::new(4);
    let least =
        (0..20000).map(|_| h(&Vector6::from_fn(|_, _| random.normal()).normalize())).fold(f64::INFINITY, f64::min);
    assert!(epsilon <= least);
}

#[test]
fn epsilon_of_six_contacts_on_a_cube_is_below_every_axis() {
    let (a, mu, f) = (0.05, 0.5, 3.0);
    let cube = on_sphere(&faces(), a, 3, [mu, mu, 0.0, 0.0, 0.0], f);
    let epsilon = ferrari_canny(&cube, &Vector3::zeros()).expect("a valid grasp");
    let points = primitive_wrenches(&cube, &Vector3::zeros()).expect("a valid grasp");
    for k in 0..3 {
        close(support(&points, &unit(k)), f, 1e-12);
        close(support(&points, &unit(3 + k)), mu * f, 1e-12);
    }
    assert!(epsilon > 0.1 * mu * f && epsilon <= mu * f);
    assert!(hull_volume(&cube, &Vector3::zeros()).expect("a valid grasp") > 0.0);
}

#[test]
fn hard_pinches_and_open_palms_have_no_epsilon() {
    let pinch = on_sphere(&equator(2), 0.03, 3, [1.0, 1.0, 0.0, 0.0, 0.0], 2.0);
    assert_eq!(ferrari_canny(&pinch, &Vector3::zeros()).expect("a valid grasp"), 0.0);
    // Contacts that all press the same way lie in one hyperplane if they press alike, else they have a volume.
    let palm = |uneven: f64| -> Vec<_> {
        [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
            .iter()
            .enumerate()
            .map(|(k, (x, y))| {
                let at = Vector3::new(0.02 * x, 0.02 * y, -0.03);
                let force = 1.0 + uneven * k as f64;
                contact(at, Vector3::z(), 4, [1.0, 1.0, 0.005, 0.0, 0.0], force)
            })
            .collect()
    };
    for uneven in [0.0, 0.3] {
        let epsilon = ferrari_canny(&palm(uneven), &Vector3::zeros());
        assert_eq!(epsilon.expect("a valid grasp"), 0.0);
        let volume = hull_volume(&palm(uneven), &Vector3::zeros()).expect("a valid grasp");
        assert_eq!(volume > 0.0, uneven > 0.0);
    }
}

#[test]
fn unloaded_contacts_are_not_in_the_hull() {
    let mut contacts = Random::new(2).grasp(5, 4);
    let before = wrench_hull(&contacts, &Vector3::zeros()).expect("a valid grasp");
    contacts.push(contact(Vector3::x() * 0.1, -Vector3::x(), 4, [1.0; 5], 0.0));
    let after = wrench_hull(&contacts, &Vector3::zeros()).expect("a valid grasp");
    assert_eq!(before, after);
}

#[test]
fn two_hundred_wrenches_take_less_than_a_second() {
    let contacts = Random::new(6).grasp(20, 4);
    let points = primitive_wrenches(&contacts, &Vector3::zeros()).expect("a valid grasp");
    assert_eq!(points.len(), 200);
    let start = std::time::Instant::now();
    let hull = hull(&points);
    let took = start.elapsed();
    println!("{} facets in {took:?}", hull.facets().len());
    // On a machine shared with other work; alone it is far below.
    assert!(took.as_secs_f64() < 1.0, "{took:?}");
}

/// scipy 1.15 (Qhull) on the same 60 points.
#[test]
fn qhull_finds_the_same_hull() {
    let points: Vec<Vector6<f64>> = (0..60)
        .map(|i| {
            let i = i as f64;
            Vector6::from_fn(|j, _| {
                let j = j as f64;
                (7.0 * i + 3.0 * j + i * j).sin() + 0.3 * (2.0 * i * j + i).cos()
            })
        })
        .collect();
    let hull = hull(&points);
    assert_eq!(hull.facets().len(), 2351);
    close(hull.inner_radius(), 0.917_020_324_395_264_6, 1e-10);
    close(hull.volume(), 19.444_140_373_882_924, 1e-10);
}

/// Contacts as engines give them: cohedral up to noise of any size, where a hull's rounding is worst.
#[test]
fn nearly_symmetric_contacts_close_whatever_the_noise() {
    let mut random = Random::new(77);
    let friction = [1.0, 1.0, 0.005, 0.0001, 0.0001];
    for exponent in 0..16 {
        let noise = if exponent == 0 { 0.0 } else { 10f64.powi(-exponent) };
        for condim in [3, 4, 6] {
            let mut contacts = on_sphere(&faces(), 0.04, condim, friction, 1.0);
            for side in [-1.0, 1.0] {
                for (y, z) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                    let at = Vector3::new(0.03 * side, 0.02 * y, 0.02 * z);
                    contacts.push(contact(at, -Vector3::x() * side, condim, friction, 0.5));
                }
            }
            let exact = ferrari_canny(&contacts, &Vector3::zeros()).expect("the hull closes");
            for c in &mut contacts {
                c.position += random.direction() * (0.01 * noise);
                c.normal_force *= 1.0 + noise * random.normal() * 0.1;
            }
            let jittered = ferrari_canny(&contacts, &Vector3::zeros()).expect("the hull closes");
            assert!((exact - jittered).abs() <= 2.0 * noise + 1e-5 * exact, "{exact} {jittered}");
        }
    }
}
