//! Both modes side by side under one push, as an animated GIF.

use std::path::Path;

use anyhow::Context;
use color_quant::NeuQuant;
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use image::RgbImage;
use mujoco_grasp::mujoco::Camera;
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::runner::Mode;
use nalgebra::Vector3;
use plotters::style::text_anchor::HPos;

use crate::paper::{BLUE, GREY, INK, ORANGE, PALE, Paper};
use crate::stage::Stage;

pub struct Film {
    scenario: &'static str,
    push: &'static str,
    title: &'static str,
    /// Point to look at [m], distance [m], azimuth and elevation [degrees].
    camera: ([f64; 3], f64, f64, f64),
    /// Where the push's arrow starts and ends, along it from the target's centre of mass [m].
    arrow: (f64, f64),
    /// From, to and between frames [s].
    takes: &'static [(f64, f64, f64)],
}

pub const CLUTCH: Film = Film {
    scenario: "clutch",
    push: "fp1",
    title: "Five fingers hold a ball of 200 g; 9.5 N push it into the palm for 1 s",
    camera: ([0.13, 0.378, 1.335], 0.31, -26.0, -15.0),
    arrow: (-0.11, -0.045),
    takes: &[(2.9, 6.3, 0.08)],
};

pub const PINCH: Film = Film {
    scenario: "pinch",
    push: "fp2",
    title: "Thumb and index hold a phone of 100 g; 0.5 N pull it down for 1 s",
    camera: ([0.115, 0.355, 1.075], 0.33, 10.0, -16.0),
    arrow: (0.045, 0.11),
    takes: &[(2.9, 4.4, 0.08), (4.42, 4.76, 0.01)],
};

const FRAME: (u32, u32) = (330, 290);
const GAP: i32 = 6;
const TOP: i32 = 54;
const FOOT: i32 = 58;
/// Between frames of the film [s].
const PACE: f64 = 0.08;

/// Writes the film.
pub fn save(film: &Film, path: &Path) -> anyhow::Result<()> {
    let plan = Plan::load(film.scenario)?;
    let push = plan.pushes.iter().find(|p| p.name == film.push).context("no such push")?;
    let (at, distance, azimuth, elevation) = film.camera;
    let camera = Camera::around(Vector3::from(at), distance, azimuth, elevation);
    let stage = |mode| Stage::new(&plan, mode, Some(push), FRAME, camera);
    let mut stages = [stage(Mode::Full)?, stage(Mode::Grasp)?];
    let mut frames = Vec::new();
    let (start, end) = (film.takes[0].0, film.takes[film.takes.len() - 1].1);
    for &(from, to, step) in film.takes {
        for i in 0..((to - from) / step).round() as usize {
            let time = from + i as f64 * step;
            let mut page = page(film);
            for (side, stage) in stages.iter_mut().enumerate() {
                stage.go_to(time)?;
                let arrows = stage.pushing(film.arrow).into_iter().collect();
                let x = side as i32 * (FRAME.0 as i32 + GAP);
                page.picture(&stage.picture(arrows, false)?, x, TOP);
                let (color, phase) = match (stage.grasped(), stage.contact_count()) {
                    (true, _) => (ORANGE, "latched: one six-axis constraint".to_owned()),
                    (false, 0) => (GREY, "no contacts".to_owned()),
                    (false, 1) => (BLUE, "1 contact in MuJoCo's solve".to_owned()),
                    (false, n) => (BLUE, format!("{n} contacts in MuJoCo's solve")),
                };
                let y = TOP + FRAME.1 as i32 + 16;
                page.area((x, y - 8), (x + 16, y + 8), color);
                page.text(&phase, (x + 24, y), 17.0, INK, HPos::Left);
            }
            foot(&mut page, time, (start, end), (push.start, push.end), PACE / step);
            frames.push(page.image);
        }
    }
    write(&frames, path)
}

fn page(film: &Film) -> Paper {
    let width = 2 * FRAME.0 as i32 + GAP;
    let mut page = Paper::white(width as u32, (TOP + FRAME.1 as i32 + FOOT) as u32);
    page.text(film.title, (4, 14), 19.0, INK, HPos::Left);
    page.text("full: MuJoCo's own contact solve", (4, 40), 17.0, INK, HPos::Left);
    page.text("grasp: ours", (FRAME.0 as i32 + GAP + 4, 40), 17.0, INK, HPos::Left);
    page
}

/// Time, and where in the film it is.
fn foot(page: &mut Paper, time: f64, (start, end): (f64, f64), push: (f64, f64), slower: f64) {
    let width = 2 * FRAME.0 as i32 + GAP;
    let (left, right, y) = (170, width - 8, TOP + FRAME.1 as i32 + 44);
    let x = |t: f64| left + ((t - start) / (end - start) * f64::from(right - left)) as i32;
    page.area((left, y - 3), (right, y + 3), PALE);
    page.area((x(push.0), y - 3), (x(push.1.min(end)), y + 3), GREY);
    page.area((x(time) - 2, y - 8), (x(time) + 2, y + 8), INK);
    let pace = if slower > 1.5 { format!(", {slower:.0} x slower") } else { String::new() };
    page.text(&format!("t = {time:.2} s{pace}"), (4, y), 17.0, INK, HPos::Left);
}

/// One palette for all frames; what has not changed since the last one is left out.
fn write(frames: &[RgbImage], path: &Path) -> anyhow::Result<()> {
    const TRANSPARENT: u8 = 255;
    let sample: Vec<u8> =
        frames.iter().step_by(6).flat_map(|f| f.pixels()).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let colors = NeuQuant::new(3, 255, &sample);
    let (width, height) = frames[0].dimensions();
    let size = [width as u16, height as u16];
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, size[0], size[1], &colors.color_map_rgb())?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut shown: Vec<u8> = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let indices: Vec<u8> = frame.pixels().map(|p| colors.index_of(&[p[0], p[1], p[2], 255]) as u8).collect();
        let changed = |(k, &index): (usize, &u8)| if shown.get(k) == Some(&index) { TRANSPARENT } else { index };
        let pixels: Vec<u8> = indices.iter().enumerate().map(changed).collect();
        let mut frame = Frame::from_indexed_pixels(size[0], size[1], pixels, Some(TRANSPARENT));
        frame.dispose = DisposalMethod::Keep;
        // The end stands for a while.
        frame.delay = (100.0 * if i + 1 == frames.len() { 1.5 } else { PACE }) as u16;
        encoder.write_frame(&frame)?;
        shown = indices;
    }
    drop(encoder);
    std::fs::write(path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
    println!("{}: {} frames, {:.2} MB", path.display(), frames.len(), bytes.len() as f64 * 1e-6);
    Ok(())
}
