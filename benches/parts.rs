//! The parts of a grasped step: contact laws, the arrow-shaped solve (with filling in its rows), the quality.
#![allow(missing_docs)] // what criterion_group makes has none

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use mujoco_grasp::grasp::cones::arrow::{Arrow, ROOT, RootVector};
use mujoco_grasp::grasp::contact::cost::{ActiveSet, Bound, Cost, MAX_ROWS};
use mujoco_grasp::grasp::monitor::gram::Gram;
use mujoco_grasp::grasp::monitor::wrench::LoadedContact;
use nalgebra::Vector3;
use std::hint::black_box;
use std::time::Duration;

const FRICTION: [f64; 5] = [0.8, 0.8, 0.01, 0.001, 0.001];
const FINGERS: usize = 5;
const JOINTS: usize = 4;

fn laws(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("law");
    let elliptic = Cost::Elliptic { stiffness: 2.0, cone: 0.8, friction: FRICTION };
    let pyramidal = Cost::Pyramidal { stiffness: 2.0, friction: FRICTION };
    let slip = Cost::Slip {
        centre: [0.1, 0.0, 0.0, 0.0, 0.0],
        resistance: 0.5,
        friction: FRICTION,
        bound: Bound::Ellipsoid(1.0),
    };
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
            let rows = if matches!(law, Cost::Slip { .. }) { condim - 1 } else { condim };
            group.bench_function(BenchmarkId::new(*name, format!("condim {condim}")), |b| {
                b.iter(|| black_box(law).respond(black_box(&jar[..rows])));
            });
        }
    }
    group.finish();
}

/// The rows of one contact on each of five fingers, of the size that a hand's have.
struct Rows {
    root: Vec<RootVector>,
    bias: Vec<f64>,
    /// How the rows see the finger's joints, row-major.
    own: Vec<f64>,
}

fn rows(condim: usize) -> Vec<Rows> {
    let mut phase = 0.0_f64;
    let mut wave = |size: f64| {
        phase += 1.7;
        size * phase.sin()
    };
    (0..FINGERS)
        .map(|_| {
            let joints: Vec<[f64; JOINTS]> = (0..condim).map(|_| std::array::from_fn(|_| wave(6.0))).collect();
            Rows {
                own: joints.into_flattened(),
                root: (0..condim).map(|_| std::array::from_fn(|_| wave(2.0))).collect(),
                bias: (0..condim).map(|i| wave(2.0) - if i == 0 { 6.0 } else { 0.0 }).collect(),
            }
        })
        .collect()
}

/// The problem, each contact starting at its force and in its zone of `from`.
fn fill(arrow: &mut Arrow, rows: &[Rows], law: Cost, from: &[(ActiveSet, [f64; MAX_ROWS])]) {
    arrow.begin(ROOT);
    for (finger, (zone, force)) in rows.iter().zip(from) {
        let m = finger.bias.len();
        arrow.begin_branch(JOINTS);
        let block = arrow.add_block(law, *zone, &finger.bias, &force[..m]);
        for (i, (y, x)) in finger.root.iter().zip(finger.own.chunks_exact(JOINTS)).enumerate() {
            let (root, own) = arrow.row(block, i);
            root.copy_from_slice(y);
            own.copy_from_slice(x);
        }
        arrow.end_branch();
    }
}

fn arrow(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("arrow");
    for condim in [3, 4] {
        let rows = rows(condim);
        for (name, law) in [
            ("elliptic", Cost::Elliptic { stiffness: 0.5, cone: 0.8, friction: FRICTION }),
            ("pyramidal", Cost::Pyramidal { stiffness: 0.5, friction: FRICTION }),
        ] {
            let parameter = format!("{name} condim {condim}");
            let mut arrow = Arrow::default();
            let cold = [(ActiveSet::Open, [0.0; MAX_ROWS]); FINGERS];
            group.bench_function(BenchmarkId::new("cold", &parameter), |b| {
                b.iter(|| {
                    let mut z = [0.0; ROOT];
                    fill(&mut arrow, &rows, law, &cold);
                    arrow.solve(black_box(&mut z))
                });
            });
            let mut solution = [0.0; ROOT];
            fill(&mut arrow, &rows, law, &cold);
            let status = arrow.solve(&mut solution);
            assert!(status.converged, "{parameter}: {status:?}");
            let warm: Vec<_> = (0..FINGERS).map(|k| (arrow.response(k).active_set, arrow.response(k).force)).collect();
            // last step's solution, moved a little, as in a simulation
            group.bench_function(BenchmarkId::new("warm", &parameter), |b| {
                b.iter(|| {
                    let mut z = solution.map(|x| 1.001 * x);
                    fill(&mut arrow, &rows, law, &warm);
                    arrow.solve(black_box(&mut z))
                });
            });
        }
    }
    group.finish();
}

fn quality(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("quality");
    for condim in [3, 4] {
        let contacts: Vec<LoadedContact> = (0..FINGERS).map(|i| contact(i, condim)).collect();
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
fn contact(i: usize, condim: usize) -> LoadedContact {
    let angle = i as f64 * 1.3;
    let outward = Vector3::new(angle.cos(), angle.sin(), 0.3 * (2.0 * angle).sin()).normalize();
    let tangent = outward.cross(&Vector3::z()).normalize();
    LoadedContact {
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
