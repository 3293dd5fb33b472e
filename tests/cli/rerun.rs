//! `run --rerun`: what the file has, read back with the viewer's own decoder.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use mujoco_grasp::mujoco::{BodyId, Simulation};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Observer, Options, Run, run};
use mujoco_grasp::scenario::runner::Mode;
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use re_chunk::Chunk;
use re_log_encoding::DecoderApp;
use re_log_types::{LogMsg, StoreKind};

use crate::program::{call_in, data};

/// Chunks of one recording by their paths.
type Chunks = BTreeMap<String, Vec<Chunk>>;

/// The recordings of a file, in its order, and whether it has a layout.
fn read(path: &Path) -> (Vec<Chunks>, bool) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let (mut order, mut recordings, mut layout) = (Vec::new(), HashMap::<_, Chunks>::new(), false);
    for message in DecoderApp::decode_eager(file).unwrap() {
        match message.unwrap() {
            LogMsg::SetStoreInfo(set) if set.info.store_id.kind() == StoreKind::Recording => {
                order.push(set.info.store_id);
            }
            LogMsg::ArrowMsg(store, message) => {
                let chunk = Chunk::from_arrow_msg(&message).unwrap();
                let path = chunk.entity_path().to_string();
                recordings.entry(store).or_default().entry(path).or_default().push(chunk);
            }
            LogMsg::BlueprintActivationCommand(_) => layout = true,
            LogMsg::SetStoreInfo(_) => {}
        }
    }
    (order.iter().map(|store| recordings.remove(store).unwrap()).collect(), layout)
}

/// Times \[s\] of the rows of a path; empty where it is static.
fn times(chunks: &Chunks, path: &str) -> Vec<f64> {
    let columns = chunks[path].iter().flat_map(|chunk| chunk.timelines().iter());
    let times = columns.flat_map(|(name, column)| {
        assert_eq!(name.as_str(), "sim_time");
        column.times_raw().iter().map(|ns| *ns as f64 / 1e9)
    });
    times.collect()
}

/// Time and values of each row of a series.
fn series(chunks: &Chunks, path: &str) -> Vec<(f64, Vec<f64>)> {
    let values = chunks.get(path).unwrap_or_else(|| panic!("no {path} in {:?}", chunks.keys())).iter();
    let values: Vec<Vec<f64>> =
        values.flat_map(|chunk| chunk.iter_slices::<f64>("Scalars:scalars".into()).map(<[f64]>::to_vec)).collect();
    let times = times(chunks, path);
    assert_eq!(times.len(), values.len(), "{path}");
    times.into_iter().zip(values).collect()
}

/// Pose of a path on its parent in each row.
fn poses(chunks: &Chunks, path: &str) -> Vec<Isometry3<f64>> {
    let of = |chunk: &Chunk| {
        let translations = chunk.iter_slices::<[f32; 3]>("Transform3D:translation".into());
        let quaternions = chunk.iter_slices::<[f32; 4]>("Transform3D:quaternion".into());
        let pose = |(t, q): (&[[f32; 3]], &[[f32; 4]])| {
            let ([x, y, z], [i, j, k, w]) = (t[0].map(f64::from), q[0].map(f64::from));
            Isometry3::from_parts(
                Vector3::new(x, y, z).into(),
                UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)),
            )
        };
        translations.zip(quaternions).map(pose).collect::<Vec<_>>()
    };
    chunks[path].iter().flat_map(of).collect()
}

fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let head = reader.headers().unwrap().iter().map(str::to_owned).collect();
    (head, reader.records().map(|r| r.unwrap().iter().map(|v| v.parse().unwrap()).collect()).collect())
}

/// The same runs, by the library.
fn runs(plan: &Plan, push: &str) -> [Run; 2] {
    let push = plan.pushes.iter().find(|p| p.name == push);
    [Mode::Full, Mode::Grasp].map(|mode| run(plan, mode, push, Options::default(), &Observer::NOBODY).unwrap())
}

fn record(folder: &Path, scenario: &str, options: &[&str]) -> Vec<Chunks> {
    let called = call_in(folder, &[&["run", scenario, "--no-pictures", "--rerun", "new/a.rrd"], options].concat());
    assert_eq!((called.status, called.stderr.as_str()), (0, ""));
    let (recordings, layout) = read(&folder.join("new/a.rrd"));
    assert!(layout, "the viewer would guess what to show");
    recordings
}

#[test]
fn bodies_are_where_the_engine_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = record(folder.path(), &data("claw.toml"), &["--push", "along"]);
    let [chunks] = &recordings[..] else { panic!("{} recordings", recordings.len()) };
    let plan = Plan::load(&data("claw.toml")).unwrap();
    let mut sim = Simulation::new(&plan.model).unwrap();
    for run in runs(&plan, "along") {
        // 25 a second from 0 to 5 s.
        assert_eq!(run.moments.len(), 126);
        let root = format!("/scene/{}", run.mode.name());
        let mut paths = vec![root];
        for body in plan.model.bodies().skip(1) {
            let parent = &paths[plan.model.body_parentid()[body.index()] as usize];
            paths.push(format!("{parent}/{}", plan.model.body_name(body).unwrap()));
        }
        let frame_times = times(chunks, &format!("{}/f0_1", paths[1]));
        assert_eq!(frame_times, run.moments.iter().map(|m| m.time).collect::<Vec<_>>());
        let tree: Vec<Vec<Isometry3<f64>>> = paths.iter().skip(1).map(|path| poses(chunks, path)).collect();
        for (frame, moment) in run.moments.iter().enumerate() {
            sim.qpos_mut().copy_from_slice(&moment.qpos);
            sim.kinematics().unwrap();
            let mut world = vec![Isometry3::identity()];
            for body in plan.model.bodies().skip(1) {
                let own = &tree[body.index() - 1];
                // The palm never moves: one pose, for all times.
                let fixed = plan.model.body_jntnum()[body.index()] == 0;
                assert_eq!(own.len(), if fixed { 1 } else { 126 }, "{}", paths[body.index()]);
                let own = own[if fixed { 0 } else { frame }];
                world.push(world[plan.model.body_parentid()[body.index()] as usize] * own);
                let [found, wanted] = [world[body.index()], engine(&sim, body)];
                let apart = (found.translation.vector - wanted.translation.vector).norm();
                let turned = found.rotation.angle_to(&wanted.rotation);
                assert!(
                    apart < 1e-6 && turned < 1e-6,
                    "{} at {} s: {apart} m, {turned} rad",
                    paths[body.index()],
                    moment.time
                );
            }
        }
    }
}

fn engine(sim: &Simulation, body: BodyId) -> Isometry3<f64> {
    Isometry3::from_parts(sim.body_position(body).into(), sim.body_quaternion(body))
}

#[test]
fn series_are_the_columns_of_the_trajectories() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = record(folder.path(), &data("claw.toml"), &[]);
    assert_eq!(recordings.len(), 3, "one for each push");
    for (chunks, push) in recordings.iter().zip(["along", "down", "twist"]) {
        for mode in ["full", "grasp"] {
            let (head, rows) = table(&folder.path().join(format!("out/claw/{mode}-{push}.csv")));
            let column = |name: &str| head.iter().position(|h| h == name).unwrap();
            let same = |path: &str, wanted: &dyn Fn(&[f64]) -> f64, tolerance: f64| {
                let found = series(chunks, &format!("/{path}/{mode}"));
                assert_eq!(found.len(), rows.len(), "{path}");
                for ((time, values), row) in found.iter().zip(&rows) {
                    assert!((time - row[0]).abs() < 1e-9, "{path}: {time}");
                    let [value] = values[..] else { panic!("{path}: {values:?}") };
                    assert!((value - wanted(row)).abs() <= tolerance, "{path} at {time}: {value}, {}", wanted(row));
                }
            };
            same("quality_n", &|row| row[column("quality_n")], 0.0);
            same("phase", &|row| row[column("phase")], 0.0);
            let forces = |finger: &str, row: &[f64]| {
                let own = head.iter().zip(row).filter(|(h, _)| h.starts_with(&format!("normal_force_n:{finger}")));
                own.map(|(_, force)| force).sum::<f64>()
            };
            for finger in 0..5 {
                same(&format!("normal_force_n/f{finger}_1"), &|row| forces(&format!("f{finger}_"), row), 1e-12);
            }
            same("normal_force_n/all", &|row| forces("", row), 1e-12);
            let start = rows.iter().find(|row| row[0] >= 2.499).unwrap();
            for (axis, name) in ["x", "y", "z"].into_iter().zip(["px_m", "py_m", "pz_m"]) {
                let name = column(name);
                same(&format!("motion_mm/{axis}"), &|row| (row[name] - start[name]) * 1e3, 1e-9);
            }
        }
        let phases: Vec<f64> = series(chunks, "/phase/grasp").into_iter().map(|(_, values)| values[0]).collect();
        assert!([0.0, 1.0, 2.0].iter().all(|phase| phases.contains(phase)), "it never latched: the test says nothing");
        for threshold in ["Q_Th", "Q_M"] {
            let level = series(chunks, &format!("/quality_n/{threshold}"));
            assert!(level.len() == 2 && level[0].1 == level[1].1 && level[0].1[0] > 0.0, "{level:?}");
        }
        assert_eq!(times(chunks, "/events/push"), [3.0, 4.0]);
        assert_eq!(times(chunks, "/events/grasp").len(), 1, "latched once");
    }
}

#[test]
fn contact_forces_carry_the_target() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = record(folder.path(), &data("claw.toml"), &["--push", "none"]);
    let plan = Plan::load(&data("claw.toml")).unwrap();
    let object = plan.model.body("object").unwrap();
    let weight = plan.model.body_mass()[object.index()] * 9.81;
    for mode in ["full", "grasp"] {
        let path = format!("/scene/{mode}/contact_forces");
        let vectors = recordings[0][&path].iter().flat_map(|c| c.iter_slices::<[f32; 3]>("Arrows3D:vectors".into()));
        let sums = vectors.map(|v| v.iter().map(|v| Vector3::from(v.map(f64::from))).sum::<Vector3<f64>>());
        let sums: Vec<_> = times(&recordings[0], &path).into_iter().zip(sums).collect();
        assert_eq!(sums.len(), 126);
        // At rest; 1 cm stands for 1 N.
        for (time, sum) in sums.iter().filter(|(time, _)| *time > 4.5) {
            assert!((sum / 0.01 - Vector3::z() * weight).norm() < 0.02 * weight, "{mode} at {time}: {sum}, {weight} N");
        }
        let (name, limit) = (format!("/friction_over_limit/f0_1/{mode}"), 1.0 + 1e-6);
        let shares: Vec<f64> = series(&recordings[0], &name).into_iter().flat_map(|(_, values)| values).collect();
        assert!(!shares.is_empty() && shares.iter().all(|s| (0.0..=limit).contains(s)), "{shares:?}");
    }
}

#[test]
fn every_geom_of_a_picture_has_a_shape() {
    let folder = tempfile::tempdir().unwrap();
    for scenario in [data("claw.toml"), "clutch".to_owned()] {
        let recordings = record(folder.path(), &scenario, &["--push", "none", "--mode", "full"]);
        let model = &Plan::load(&scenario).unwrap().model;
        let shapes: Vec<&String> = recordings[0].keys().filter(|path| path.contains("/geoms/")).collect();
        assert_eq!(shapes.len(), model.geom_group().iter().filter(|g| **g <= 2).count());
        for path in shapes {
            let named = |c: &Chunk| c.components_identifiers().map(|i| i.to_string()).collect::<Vec<_>>();
            let parts: Vec<String> = recordings[0][path].iter().flat_map(named).collect();
            let shape = |p: &String| ["half_sizes", "radii", "vertex_positions"].iter().any(|s| p.ends_with(s));
            assert!(
                parts.iter().any(shape) && parts.iter().any(|p| p == "Transform3D:translation"),
                "{path}: {parts:?}"
            );
        }
    }
}

#[test]
fn files_that_cannot_be_written_are_said() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("file"), "").unwrap();
    std::fs::create_dir(folder.path().join("b.rrd")).unwrap();
    let claw = data("claw.toml");
    let call = |file: &str| {
        call_in(folder.path(), &["run", &claw, "--push", "none", "--mode", "full", "--no-pictures", "--rerun", file])
    };
    // Before anything is simulated:
    let called = call("a.mp4");
    assert_eq!((called.status, called.stderr.as_str()), (2, "error: --rerun is a.mp4; its name must end in .rrd\n"));
    let called = call("file/a.rrd");
    assert_eq!(called.status, 1);
    assert!(called.stderr.starts_with("error: cannot make the folder file: "), "{}", called.stderr);
    assert!(!folder.path().join("out").exists());
    // At the end, when all else is there:
    let called = call("b.rrd");
    assert_eq!(called.status, 1);
    assert!(
        called.stderr.starts_with("error: no recording: cannot write `b.rrd`: Is a directory"),
        "{}",
        called.stderr
    );
    assert!(called.stdout.contains("full") && folder.path().join("out/claw/full-none.csv").exists());
}
