//! The parts of a grasped step: contact laws, the arrow-shaped solve, the quality.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mujoco_grasp::grasp::arrow::Arrow;
use mujoco_grasp::grasp::cone::{Bound, Law};
use mujoco_grasp::grasp::gram::Gram;
use mujoco_grasp::grasp::wrench::ContactForce;
use nalgebra::Vector3;
use std::hint::black_box;
use std::time::Duration;

const FRICTION: [f64; 5] = [0.8, 0.8, 0.01, 0.001, 0.001];
const FINGERS: usize = 5;
const JOINTS: usize = 4;
/// The target's six and one of the wrist.
const ROOT: usize = 7;

fn laws(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("law");
    let elliptic = Law::Elliptic { stiffness: 2.0, cone: 0.8, friction: FRICTION };
    let pyramidal = Law::Pyramidal { stiffness: 2.0, friction: FRICTION };
    let slip =
        Law::Slip { centre: [0.1, 0.0, 0.0, 0.0, 0.0], resistance: 0.5, friction: FRICTION, bound: Bound::Ellipsoid(1.0) };
    let (stick, slide) = ([-1.0, 0.1, 0.05, 0.001], [0.1, 1.0, 0.5, 0.2]);
    let cases = [
        ("elliptic stick", elliptic, stick),
        ("elliptic slide", elliptic, slide),
        ("pyramidal stick", pyramidal, stick),
        ("pyramidal slide", pyramidal, slide),
        ("slip stick", slip, [0.1, 0.05, 0.001, 0.0]),
        ("slip slide", slip, [3.0, 1.0, 0.5, 0.0]),
    ];
    for condim in [3, 4] {
        for (name, law, jar) in &cases {
            let rows = if matches!(law, Law::Slip { .. }) { condim - 1 } else { condim };
            group.bench_function(BenchmarkId::new(*name, format!("condim {condim}")), |b| {
                b.iter(|| black_box(law).respond(black_box(&jar[..rows])));
            });
        }
    }
    group.finish();
}

/// A five-fingered grasp with one contact on each finger and rows of the size that a hand's have.
fn fill(arrow: &mut Arrow, condim: usize, law: Law) {
    arrow.begin(ROOT);
    let mut phase = 0.0_f64;
    let mut wave = |size: f64| {
        phase += 1.7;
        size * phase.sin()
    };
    for _ in 0..FINGERS {
        arrow.begin_branch(JOINTS);
        let rows = arrow.add_block(condim, law);
        rows.finger.iter_mut().for_each(|x| *x = wave(6.0));
        rows.root.iter_mut().for_each(|x| *x = wave(2.0));
        for (i, x) in rows.bias.iter_mut().enumerate() {
            *x = wave(2.0) - if i == 0 { 6.0 } else { 0.0 };
        }
    }
}

fn arrow(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("arrow");
    for condim in [3, 4] {
        for (name, law) in [
            ("elliptic", Law::Elliptic { stiffness: 0.5, cone: 0.8, friction: FRICTION }),
            ("pyramidal", Law::Pyramidal { stiffness: 0.5, friction: FRICTION }),
        ] {
            let mut arrow = Arrow::default();
            fill(&mut arrow, condim, law);
            let mut z = vec![0.0; arrow.size()];
            let cold = arrow.solve(None, &mut z);
            assert!(cold.converged, "{name} condim {condim}: {cold:?}");
            let parameter = format!("{name} condim {condim}");
            group.bench_function(BenchmarkId::new("fill", &parameter), |b| b.iter(|| fill(&mut arrow, condim, law)));
            group.bench_function(BenchmarkId::new("cold solve", &parameter), |b| {
                let mut start = vec![0.0; z.len()];
                b.iter(|| {
                    start.fill(0.0);
                    arrow.solve(None, black_box(&mut start))
                });
            });
            // last step's solution, moved a little, as in a simulation
            group.bench_function(BenchmarkId::new("warm solve", &parameter), |b| {
                let mut start = z.clone();
                b.iter(|| {
                    start.iter_mut().zip(&z).for_each(|(s, z)| *s = 1.001 * z);
                    arrow.solve(None, black_box(&mut start))
                });
            });
        }
    }
    group.finish();
}

fn quality(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("quality");
    for condim in [3, 4] {
        let contacts: Vec<ContactForce> = (0..FINGERS).map(|i| contact(i, condim)).collect();
        let com = Vector3::zeros();
        let name = format!("{FINGERS} contacts, condim {condim}");
        group.bench_function(BenchmarkId::new("gram", &name), |b| b.iter(|| Gram::of(black_box(&contacts), &com)));
        let gram = Gram::of(&contacts, &com);
        let threshold = 0.5 * gram.min_singular_value();
        assert!(gram.exceeds(threshold));
        group.bench_function(BenchmarkId::new("exceeds", &name), |b| b.iter(|| black_box(&gram).exceeds(threshold)));
        group.bench_function(BenchmarkId::new("smallest singular value", &name), |b| {
            b.iter(|| black_box(&gram).min_singular_value());
        });
    }
    group.finish();
}

/// Contact `i` of five around a ball of 35 mm, not all in one plane.
fn contact(i: usize, condim: usize) -> ContactForce {
    let angle = i as f64 * 1.3;
    let outward = Vector3::new(angle.cos(), angle.sin(), 0.3 * (2.0 * angle).sin()).normalize();
    let tangent = outward.cross(&Vector3::z()).normalize();
    ContactForce {
        position: 0.035 * outward,
        normal: -outward,
        tangents: [tangent, -outward.cross(&tangent)],
        condim,
        friction: FRICTION,
        normal_force: 1.0 + 0.2 * i as f64,
        force: -outward,
        torque: Vector3::zeros(),
    }
}

criterion_group! {
    name = parts;
    config = Criterion::default().warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    targets = laws, arrow, quality
}
criterion_main!(parts);
