//! What the product does and saves, at a glance: contacts, the constraint in their place, the cost of a step.

use std::ffi::OsString;
use std::path::Path;

use anyhow::Context;
use mujoco_grasp::grasp::metrics::closure::load_factor;
use mujoco_grasp::mujoco::{Arrow, Camera};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::Mode;
use nalgebra::{Vector3, Vector6};
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use serde_json::Value;

use crate::paper::{BLUE, INK, ORANGE, PALE, Paper, SKY};
use crate::stage::Stage;

const PICTURE: (u32, u32) = (500, 480);
const PANEL: i32 = 520;
const TOP: i32 = 84;
const HEIGHT: u32 = 700;
/// Held, before the push [s].
const WHEN: f64 = 4.4;
/// The constraint's axes, x, y, z: their colours, from dark to light.
const AXES: [RGBColor; 3] = [BLUE, ORANGE, SKY];
/// Half of the length of an axis in the picture [m].
const REACH: f64 = 0.085;

/// Writes the picture, with the costs of `benches`, each what `mujoco-grasp bench SCENARIO --json` printed.
pub fn save(path: &Path, benches: &[OsString]) -> anyhow::Result<()> {
    let plan = Plan::load("clutch")?;
    let camera = Camera::around(Vector3::new(0.13, 0.378, 1.36), 0.285, -40.0, -18.0);
    let mut paper = Paper::white(3 * PANEL as u32, HEIGHT);
    let mut full = Stage::new(&plan, Mode::Full, None, PICTURE, camera)?;
    full.go_to(WHEN)?;
    let contacts = full.contact_count();
    head(&mut paper, 0, "MuJoCo alone", &format!("solves {contacts} contacts in every step"));
    let arrows = full.pressing();
    paper.picture(&full.picture(arrows, false)?, 0, TOP);
    note(&mut paper, 0, ["arrows: force of each contact, 35 mm for 1 N", "clutch: a ball of 200 g, held at rest"]);

    let mut grasp = Stage::new(&plan, Mode::Grasp, None, PICTURE, camera)?;
    grasp.go_to(WHEN)?;
    anyhow::ensure!(grasp.grasped(), "the grasp is not latched at {WHEN} s");
    head(&mut paper, 1, "mujoco-grasp", "one six-axis constraint in their place");
    let arrows = axes(&grasp);
    paper.picture(&grasp.picture(arrows, true)?, PANEL, TOP);
    limits(&mut paper, &grasp)?;

    costs(&mut paper, benches)?;
    paper.image.save(path).with_context(|| format!("cannot write {}", path.display()))?;
    println!("{}: {} bytes", path.display(), std::fs::metadata(path)?.len());
    Ok(())
}

fn head(paper: &mut Paper, panel: i32, title: &str, line: &str) {
    paper.text(title, (panel * PANEL + 8, 26), 36.0, INK, HPos::Left);
    paper.text(line, (panel * PANEL + 8, 62), 24.0, INK, HPos::Left);
}

fn note(paper: &mut Paper, panel: i32, lines: [&str; 2]) {
    for (i, line) in lines.into_iter().enumerate() {
        paper.text(line, (panel * PANEL + 8, TOP + PICTURE.1 as i32 + 26 + 30 * i as i32), 21.0, INK, HPos::Left);
    }
}

/// Both ways along each axis from the target's centre of mass.
fn axes(stage: &Stage<'_>) -> Vec<Arrow> {
    let mut arrows = Vec::new();
    for (axis, RGBColor(r, g, b)) in AXES.into_iter().enumerate() {
        let rgba = [r, g, b, 255].map(|v| f32::from(v) / 255.0);
        let unit = Vector3::ith(axis, 1.0);
        arrows.extend(
            [1.0, -1.0].map(|sign| Arrow::from_point(stage.target(), sign * unit, REACH, rgba).with_width(0.003)),
        );
    }
    arrows
}

/// What friction holds on each axis with no finger pressing harder, as bars.
fn limits(paper: &mut Paper, stage: &Stage<'_>) -> anyhow::Result<()> {
    let contacts = stage.contacts();
    let largest = |axis: usize, sign: f64| {
        let factor = load_factor(&contacts, &stage.target(), &(sign * Vector6::ith(axis, 1.0)));
        factor.map(|f| if axis < 3 { f } else { 1e3 * f })
    };
    let mut bars = Vec::new();
    for axis in 0..6 {
        bars.push((largest(axis, -1.0)?, largest(axis, 1.0)?));
    }
    let (left, top) = (PANEL + 8, TOP + PICTURE.1 as i32 + 18);
    paper.text("limits: what friction holds, no finger pressing harder", (left, top), 20.0, INK, HPos::Left);
    let top = top + 18;
    for (group, (name, unit)) in [("force", "N"), ("torque", "N mm")].into_iter().enumerate() {
        let own = &bars[3 * group..3 * group + 3];
        let most = own.iter().map(|(a, b)| a.max(*b)).fold(0.0, f64::max);
        let x = left + 250 * group as i32;
        paper.text(&format!("{name} [{unit}]"), (x, top + 8), 19.0, INK, HPos::Left);
        let middle = x + 122;
        for (i, &(less, more)) in own.iter().enumerate() {
            let y = top + 32 + 21 * i as i32;
            let end = |value: f64| (value / most * 62.0) as i32;
            paper.area((middle - end(less), y - 6), (middle + end(more), y + 6), AXES[i]);
            paper.line((middle, y - 8), (middle, y + 8), 1, INK);
            paper.text(["x", "y", "z"][i], (x, y), 18.0, INK, HPos::Left);
            let digits = if group == 0 { 1 } else { 0 };
            paper.text(&format!("-{less:.digits$}"), (middle - 66, y), 17.0, INK, HPos::Right);
            paper.text(&format!("{more:.digits$}"), (middle + 66, y), 17.0, INK, HPos::Left);
        }
    }
    Ok(())
}

/// Median time of a step, for each bench.
fn costs(paper: &mut Paper, benches: &[OsString]) -> anyhow::Result<()> {
    let mut groups = Vec::new();
    let mut engine = String::new();
    for file in benches {
        let file = Path::new(file);
        let read = || -> anyhow::Result<(String, [f64; 4])> {
            let bench: Value = serde_json::from_str(&std::fs::read_to_string(file)?)?;
            engine = bench["engine"].as_str().context("no field `engine`")?.to_owned();
            let scenario = bench["scenario"].as_str().context("no field `scenario`")?.to_owned();
            let step =
                |mode: &str| bench["still"][mode]["step_us"].as_f64().with_context(|| format!("no still.{mode}"));
            Ok((scenario, [step("full_noslip")?, step("full")?, step("grasp")?, step("floor")?]))
        };
        let mut read = read;
        groups.push(read().with_context(|| format!("{} is not the JSON of `bench`", file.display()))?);
    }
    anyhow::ensure!(!groups.is_empty(), "no bench to show: name at least one file");
    head(paper, 2, "What it saves", &format!("while the hand holds; MuJoCo {engine}"));
    let (left, right) = (2 * PANEL + 190, 3 * PANEL - 110);
    let most = groups.iter().flat_map(|(_, times)| times).fold(0.0_f64, |a, b| a.max(*b));
    let decade = 10f64.powf(most.log10().floor());
    let tick = [0.2, 0.5, 1.0, 2.0].map(|part| part * decade).into_iter().find(|t| most / t <= 5.0).unwrap_or(decade);
    let x = |us: f64| left + (us / most * f64::from(right - left)) as i32;
    let foot = TOP + 240 * groups.len() as i32;
    for i in 0..=(most / tick) as usize {
        let us = tick * i as f64;
        paper.line((x(us), TOP + 26), (x(us), foot), 1, PALE);
        paper.text(&format!("{us:.0}"), (x(us), foot + 14), 19.0, INK, HPos::Center);
    }
    let axis = "time per step, median [\u{b5}s]";
    paper.text(axis, ((left + right) / 2, foot + 40), 21.0, INK, HPos::Center);
    let notes = ["grasp: ten steps a call, most on frozen geometry", "no contacts: every step whole"];
    for (i, line) in notes.into_iter().enumerate() {
        paper.text(line, (2 * PANEL + 8, foot + 74 + 26 * i as i32), 19.0, INK, HPos::Left);
    }
    for (g, (scenario, times)) in groups.iter().enumerate() {
        let top = TOP + 14 + 240 * g as i32;
        paper.text(scenario, (2 * PANEL + 8, top), 24.0, INK, HPos::Left);
        let bars = [("full, noslip 10", BLUE), ("full, creeping", SKY), ("grasp", ORANGE), ("no contacts", PALE)];
        for (i, ((label, color), us)) in bars.into_iter().zip(times).enumerate() {
            let y = top + 38 + 46 * i as i32;
            paper.text(label, (left - 10, y), 21.0, INK, HPos::Right);
            paper.area((left, y - 15), (x(*us), y + 15), color);
            let over = if i < 2 { format!("  {:.1} x", us / times[2]) } else { String::new() };
            paper.text(&format!("{us:.0}{over}"), (x(*us) + 8, y), 21.0, INK, HPos::Left);
        }
    }
    Ok(())
}
