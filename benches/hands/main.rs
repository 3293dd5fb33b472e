//! What a grasp costs with hands of any size: against the number of contacts, against the other joints of the model, and
//! at larger time steps.
//!
//! ```sh
//! cargo bench --bench hands -- DIR                                    # hands.md and two plots, in minutes
//! cargo bench --bench hands -- --time-steps                           # prints what is said of time steps alone
//! cargo bench --bench hands -- --write DIR FINGERS CONTACTS JOINTS    # one such hand, for mujoco-grasp
//! ```
//!
//! `scripts/hands DIR` also counts where the instructions go, and adds that to the table.

mod cost;
mod hand;
mod held;
mod table;
mod time_step;

use std::path::Path;

use anyhow::Context;
use cost::Cost;
use hand::Hand;
use mujoco_grasp::mujoco::mujoco_version;
use mujoco_grasp::scenario::plan::Plan;
use nalgebra::Vector3;

/// Timed steps of each variant in each pass, unless `--steps` says otherwise.
const STEPS: usize = 1500;
const PASSES: usize = 2;
const FINGERS: usize = 5;
/// Contacts of each finger, where their number is varied: 5 to 80 in all.
const CONTACTS: [usize; 5] = [1, 2, 4, 8, 16];
/// Contacts of each finger, where it is not: 15 in all, as many as the Shadow Hand has with a block.
const FEW_CONTACTS: usize = 3;
/// Other joints, where their number is varied.
const JOINTS: [usize; 4] = [20, 80, 140, 200];
const FEW_JOINTS: usize = 20;
/// Sideways, about the can's weight \[N\].
const HAND_PUSH: [f64; 3] = [3.0, 0.0, 0.0];
/// Of the thesis's first push of the clutch, which the ball only just withstands: there every time step has another story.
const CLUTCH_PUSH: f64 = 0.5;

const USAGE: &str = "hands DIR [--steps N] | hands --time-steps | hands --write DIR FINGERS CONTACTS JOINTS";

fn main() -> anyhow::Result<()> {
    // cargo adds an argument of its own
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| arg != "--bench").collect();
    let number = |text: &str| text.parse::<usize>().with_context(|| format!("{text} is no number: {USAGE}"));
    match args.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["--write", folder, fingers, contacts, joints] => {
            let hand = Hand::new(number(fingers)?, number(contacts)?, number(joints)?)?;
            println!("{}", hand.write(Path::new(folder))?.display());
            Ok(())
        }
        ["--time-steps"] => {
            print!("{}", time_steps()?);
            Ok(())
        }
        [folder] if !folder.starts_with('-') => measure(Path::new(folder), STEPS),
        [folder, "--steps", steps] => measure(Path::new(folder), number(steps)?),
        _ => {
            println!("{USAGE}");
            Ok(())
        }
    }
}

/// Writes `hands.md`, and the plots `hands-contacts.png` and `hands-nv.png`.
fn measure(folder: &Path, steps: usize) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    let hands = |sizes: Vec<(usize, usize)>| {
        sizes.into_iter().map(|(contacts, joints)| Hand::new(FINGERS, contacts, joints)).collect::<Result<Vec<_>, _>>()
    };
    let by_contacts = hands(CONTACTS.map(|contacts| (contacts, FEW_JOINTS)).to_vec())?;
    let by_joints = hands(JOINTS.map(|joints| (FEW_CONTACTS, joints)).to_vec())?;
    let mut by_contacts_and_joints = Cost::of_all(&[by_contacts, by_joints].concat(), steps, PASSES)?;
    let by_joints = by_contacts_and_joints.split_off(CONTACTS.len());
    let by_contacts = by_contacts_and_joints;

    let engine = format!("MuJoCo {}, at rest", mujoco_version());
    let title = format!("A step of a hand that holds a can, by contacts ({FINGERS} fingers, nv 41; {engine})");
    cost::plot(&title, "contacts between hand and can", &by_contacts, Hand::contacts)
        .save(folder.join("hands-contacts.png"))?;
    let title = format!("A step of a hand that holds a can, by nv ({FINGERS} fingers, 15 contacts; {engine})");
    cost::plot(&title, "degrees of freedom of the model, nv", &by_joints, Hand::nv)
        .save(folder.join("hands-nv.png"))?;

    let text = format!(
        "MuJoCo {}, medians of {steps} steps at rest, times in microseconds.\n\n\
         ### Contacts\n\n{}\n### Other joints\n\n{}\n### Growth from 5 to 80 contacts\n\n{}\n\
         ### Larger time steps\n\n{}",
        mujoco_version(),
        cost::table(&by_contacts),
        cost::table(&by_joints),
        cost::growth(&by_contacts),
        time_steps()?,
    );
    print!("{text}");
    Ok(std::fs::write(folder.join("hands.md"), text)?)
}

fn time_steps() -> anyhow::Result<String> {
    let hand = Hand::new(FINGERS, FEW_CONTACTS, FEW_JOINTS)?.plan()?;
    let clutch = Plan::load("clutch")?;
    let clutch_push = CLUTCH_PUSH * clutch.pushes.first().context("the clutch has a push")?.force;
    let tables = [time_step::table(&hand, Vector3::from(HAND_PUSH))?, time_step::table(&clutch, clutch_push)?];
    Ok(tables.join("\n"))
}
