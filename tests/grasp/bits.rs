//! Everything that a step computes, as bits: two runs that are the same here are the same.

use mujoco_grasp::grasp::{Grasps, Phase, Snapshot};
use mujoco_grasp::mujoco::Simulation;

/// How a saved state travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    Json,
    Cbor,
}

/// The snapshot as another process would get it.
pub fn through(format: Format, snapshot: &Snapshot) -> Snapshot {
    match format {
        Format::Json => {
            let text = serde_json::to_string(snapshot).expect("JSON");
            serde_json::from_str(&text).expect("the same from JSON")
        }
        Format::Cbor => {
            let mut bytes = Vec::new();
            ciborium::into_writer(snapshot, &mut bytes).expect("CBOR");
            ciborium::from_reader(bytes.as_slice()).expect("the same from CBOR")
        }
    }
}

/// What is seen of a simulation and its grasps after a step.
pub fn bits(sim: &Simulation, grasps: &Grasps) -> Vec<u64> {
    let time = [sim.time()];
    let arrays: [&[f64]; 9] = [
        &time,
        sim.qpos(),
        sim.qvel(),
        sim.qacc(),
        sim.act(),
        sim.qacc_warmstart(),
        sim.qfrc_constraint(),
        sim.efc_force(),
        sim.sensordata(),
    ];
    let mut all: Vec<u64> = arrays.into_iter().flatten().map(|x| x.to_bits()).collect();
    for i in 0..sim.contact_count() {
        let force = sim.contact_force(i).expect("a force");
        all.extend(force.force.iter().chain(force.torque.iter()).map(|x| x.to_bits()));
    }
    for grasp in grasps {
        all.push(u64::from(grasp.phase() == Phase::Grasped));
        all.push(grasp.quality().to_bits());
        for contact in grasp.contacts() {
            all.extend([contact.geoms.0 as u64, contact.geoms.1 as u64, u64::from(contact.is_sliding())]);
            all.extend(contact.force_rows.iter().chain(contact.position.iter()).map(|x| x.to_bits()));
        }
    }
    all
}
