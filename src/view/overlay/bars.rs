//! Wrenches against their limits, as bars.

use super::load_colour;
use crate::grasp::{Grasp, Grasps};
use crate::mujoco::{BodyId, Error, Rect, Screen, Simulation};

/// Something that has a limit.
struct Bar {
    name: String,
    /// Of the limit that is used.
    share: f64,
}

/// \[px\]
const NAME: (u32, u32) = (110, 220);
const CHARACTER: u32 = 7;
const LENGTH: u32 = 150;
const LINE: u32 = 20;
const GAP: u32 = 3;
/// Most bars of one screen.
const MOST: usize = 16;
const GROUND: [f32; 4] = [0.1, 0.1, 0.1, 0.6];

/// Draws the bars of all grasps in the lower right corner.
pub fn draw(screen: &Screen, sim: &Simulation, grasps: &Grasps) -> Result<(), Error> {
    let bars: Vec<Bar> = grasps.iter().flat_map(|grasp| of(sim, grasp)).take(MOST).collect();
    let (width, height) = screen.size();
    let longest = bars.iter().map(|bar| bar.name.len() as u32).max().unwrap_or(0);
    let name = (CHARACTER * longest).clamp(NAME.0, NAME.1);
    let (total, top) = (name + LENGTH, LINE * bars.len() as u32 + GAP);
    if width < total || height < top {
        return Ok(());
    }
    for (i, bar) in bars.iter().enumerate() {
        let bottom = GAP + LINE * (bars.len() - 1 - i) as u32;
        let row = |left: u32, width: u32| Rect { left, bottom, width, height: LINE - GAP };
        let left = width - total;
        screen.label(row(left, name), GROUND, &bar.name)?;
        screen.rectangle(row(left + name, LENGTH), GROUND)?;
        let length = (f64::from(LENGTH) * bar.share.clamp(0.0, 1.0)).round() as u32;
        let [r, g, b] = load_colour(bar.share);
        if length > 0 {
            screen.rectangle(row(left + name, length), [r, g, b, 0.9])?;
        }
    }
    Ok(())
}

/// With limits "box" the grasp's wrench over its bound on each axis; else the largest friction over its limit of each link's
/// contacts.
fn of(sim: &Simulation, grasp: &Grasp) -> Vec<Bar> {
    const AXES: [&str; 6] = ["force x", "force y", "force z", "torque x", "torque y", "torque z"];
    if let (Some(wrench), Some(bounds)) = (grasp.merged_wrench(), grasp.bounds()) {
        let share = |axis: usize| if bounds.axis(axis) > 0.0 { wrench[axis].abs() / bounds.axis(axis) } else { 0.0 };
        return (0..6).map(|axis| Bar { name: AXES[axis].to_owned(), share: share(axis) }).collect();
    }
    let (model, cone) = (sim.model(), sim.model().cone());
    let share = |link: BodyId| {
        let own = grasp.contacts().iter().filter(|c| c.link_id == link);
        own.filter_map(|c| c.friction_share(cone)).reduce(f64::max)
    };
    let mut links: Vec<BodyId> = grasp.contacts().iter().map(|c| c.link_id).collect();
    links.sort_unstable();
    links.dedup();
    links.into_iter().filter_map(|link| share(link).map(|share| Bar { name: model.body_column(link), share })).collect()
}
