//! What the tests of the package compare with: the Rust library alone, stepped with inputs from a file.
//!
//! `reference MODEL KEYFRAME TARGET PALM N INPUTS OUTPUT`, an empty KEYFRAME being the model's own start: for each call of `N`
//! steps the inputs hold the controls, a wrench on the target, and 1 while the target's free joint is held at its start; the
//! output has positions, velocities, quality, phase and time after it. All are `f64` in the machine's order. It prints the
//! median time of a call in the second half \[us\].

use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
use mujoco_grasp::mujoco::{Model, Simulation};
use std::error::Error;
use std::fs::{read, write};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [model, keyframe, target, palm, n, inputs, output] = args.as_slice() else {
        return Err("usage: reference MODEL KEYFRAME TARGET PALM N INPUTS OUTPUT".into());
    };
    let n: usize = n.parse()?;
    let inputs: Vec<f64> = read(inputs)?.as_chunks().0.iter().map(|bytes| f64::from_ne_bytes(*bytes)).collect();
    let model = Model::from_xml_file(model)?;
    let mut sim = Simulation::new(&model)?;
    let (target, palm) = (model.body(target)?, model.body(palm)?);
    let joint = model.free_joint_of(target).ok_or("the target has no free joint")?.index();
    let (q, v) = (model.jnt_qposadr()[joint] as usize, model.jnt_dofadr()[joint] as usize);
    let mut grasps = Grasps::of(&sim, &GraspSpec::new(target, palm))?;
    if !keyframe.is_empty() {
        sim.reset_to_keyframe(model.keyframe(keyframe)?)?;
    }
    let start = sim.qpos()[q..q + 7].to_vec();
    let (mut results, mut times) = (Vec::new(), Vec::new());
    for call in inputs.chunks_exact(model.nu() + 7) {
        let (controls, rest) = call.split_at(model.nu());
        if rest[6] == 1.0 {
            sim.qpos_mut()[q..q + 7].copy_from_slice(&start);
            sim.qvel_mut()[v..v + 6].fill(0.0);
        }
        sim.ctrl_mut().copy_from_slice(controls);
        sim.xfrc_applied_mut()[6 * target.index()..6 * target.index() + 6].copy_from_slice(&rest[..6]);
        let began = Instant::now();
        grasps.steps(&mut sim, n)?;
        times.push(began.elapsed().as_nanos());
        let grasp = &grasps[GraspId::FIRST];
        let phase = f64::from(u8::from(grasp.phase() == Phase::Grasped));
        results.extend(sim.qpos().iter().chain(sim.qvel()).chain(&[grasp.quality(), phase, sim.time()]).copied());
    }
    let bytes: Vec<u8> = results.into_iter().flat_map(f64::to_ne_bytes).collect();
    write(output, bytes)?;
    let mut late = times.split_off(times.len() / 2);
    late.sort_unstable();
    let median = late.get(late.len() / 2).ok_or("no calls")?;
    println!("{}", *median as f64 * 1e-3);
    Ok(())
}
