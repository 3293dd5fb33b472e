//! Two hands, two grasps of one baton: the left hand takes it and hands it to the right one.
//!
//! `cargo run --release --example handover`
#![forbid(unsafe_code)]

use mujoco_grasp::grasp::{GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{BodyId, Model, Simulation};
use std::error::Error;

/// A change of phase.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// \[s\]
    pub time: f64,
    /// "left" or "right".
    pub hand: &'static str,
    /// What the grasp became.
    pub phase: Phase,
}

/// From when to when a part of an actuator's way is made \[s\], the actuators by the beginning of their names, and where they go.
type Move = ((f64, f64), &'static str, f64);

const MOVES: &[Move] = &[
    ((0.0, 0.7), "left_x", 0.118),
    ((0.7, 1.4), "left_thumb", 1.0),
    ((0.7, 1.4), "left_index", 0.9),
    ((0.7, 1.4), "left_middle", 0.9),
    ((1.9, 2.7), "left_x", 0.31),
    ((1.9, 2.7), "left_z", -0.04),
    ((1.9, 2.7), "right_z", 0.04),
    ((2.7, 3.3), "right_x", -0.334),
    ((3.3, 3.9), "right_thumb", 1.0),
    ((3.3, 3.9), "right_index", 0.9),
    ((3.3, 3.9), "right_middle", 0.9),
    ((4.3, 4.8), "left_thumb", 0.0),
    ((4.3, 4.8), "left_index", 0.0),
    ((4.3, 4.8), "left_middle", 0.0),
    ((4.8, 5.3), "left_x", 0.15),
    ((5.3, 6.1), "right_x", -0.12),
];

/// The changes of phase, and how far the baton is from the right palm at the end \[m\].
pub fn run() -> Result<(Vec<Event>, f64), Box<dyn Error>> {
    let model = Model::from_xml_file(concat!(env!("CARGO_MANIFEST_DIR"), "/models/handover.xml"))?;
    let mut sim = Simulation::new(&model)?;
    let baton = sim.model().body("baton")?;
    let palms = [sim.model().body("left_palm")?, sim.model().body("right_palm")?];
    // one grasp for each pair of hand and target
    let mut grasps = Grasps::new();
    let left = grasps.add(&sim, &GraspSpec::new(baton, palms[0]))?;
    let right = grasps.add(&sim, &GraspSpec::new(baton, palms[1]))?;
    let names: Vec<String> = sim.model().actuators().map(|a| sim.model().label(a)).collect();
    let start = sim.qpos()[..7].to_vec();

    let mut events = Vec::new();
    while sim.time() < 6.5 {
        if sim.time() < 1.5 {
            // the baton waits until the left hand has closed
            sim.qpos_mut()[..7].copy_from_slice(&start);
            sim.qvel_mut()[..6].fill(0.0);
        }
        grasps.iter_mut().for_each(|g| g.allow_latch(sim.time() >= 1.5));
        let time = sim.time();
        for (name, ctrl) in names.iter().zip(sim.ctrl_mut()) {
            *ctrl = target(name, time);
        }
        let before = [left, right].map(|hand| grasps[hand].phase());
        grasps.step(&mut sim)?;
        for ((hand, id), before) in [("left", left), ("right", right)].into_iter().zip(before) {
            let phase = grasps[id].phase();
            if phase != before {
                println!("{:.3} s: the {hand} hand is {phase:?}, Q = {:.3} N", sim.time(), grasps[id].quality());
                events.push(Event { time: sim.time(), hand, phase });
            }
        }
    }
    let away = distance(&sim, baton, palms[1]);
    println!("the baton is {:.1} mm from the right palm", 1e3 * away);
    Ok((events, away))
}

/// Where the actuator of this name is sent at `time`.
fn target(name: &str, time: f64) -> f64 {
    let mut at = 0.0;
    for ((from, to), actuators, goal) in MOVES {
        if name.contains(actuators) && time > *from {
            at += (goal - at) * ((time - from) / (to - from)).min(1.0);
        }
    }
    at
}

fn distance(sim: &Simulation, a: BodyId, b: BodyId) -> f64 {
    (sim.body_position(a) - sim.body_position(b)).norm()
}

#[allow(dead_code)] // not where a test includes this file
fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
