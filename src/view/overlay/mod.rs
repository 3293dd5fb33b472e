//! What is drawn on top of MuJoCo's own scene.

pub(super) mod bars;
pub(super) mod contacts;
pub(super) mod history;
pub(super) mod status;
pub(super) mod tint;

/// What is on; all of it at first, but shadows where drawing is done in software.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shown {
    pub contacts: bool,
    pub forces: bool,
    pub tint: bool,
    pub bars: bool,
    pub plot: bool,
    pub shadows: bool,
    pub keys: bool,
}

impl Default for Shown {
    fn default() -> Self {
        Self { contacts: true, forces: true, tint: true, bars: true, plot: true, shadows: true, keys: true }
    }
}

/// The colour of a grasp, by its place among the grasps.
pub(super) fn colour(grasp: usize) -> [f32; 3] {
    const COLOURS: [[f32; 3]; 4] = [[0.15, 0.55, 1.0], [1.0, 0.55, 0.1], [0.6, 0.3, 0.9], [0.1, 0.7, 0.5]];
    COLOURS[grasp % COLOURS.len()]
}

/// Green for little of a limit, red at it.
pub(super) fn load_colour(share: f64) -> [f32; 3] {
    let share = share.clamp(0.0, 1.0) as f32;
    [(2.0 * share).min(1.0), (2.0 - 2.0 * share).min(1.0) * 0.85, 0.1]
}
