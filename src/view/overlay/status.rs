//! What is said at the top of the window.

use crate::grasp::Phase;
use crate::mujoco::{Corner, Error, Perturb, Screen};
use crate::view::keys::KEYS;
use crate::view::pace::Pace;
use crate::view::session::Session;

/// Characters of a line of a note.
const COLUMNS: usize = 40;

/// Scenario, mode, time and grasps, at the right; `note` is something that has just happened.
pub fn draw(screen: &Screen, session: &Session, pace: &Pace, selected: &Perturb, note: &str) -> Result<(), Error> {
    let mut rows = vec![
        (session.plan().name.clone(), format!("{} mode", session.mode().name())),
        ("time".into(), format!("{:.3} s", session.time())),
        (
            "speed".into(),
            match pace.speed() {
                _ if pace.paused => "paused".into(),
                1.0 => "real time".into(),
                speed => format!("1/{:.0}", 1.0 / speed),
            },
        ),
    ];
    for (index, grasp) in session.grasps().iter().enumerate() {
        let name = if session.grasps().len() > 1 { format!("grasp {index}") } else { "grasp".into() };
        let phase = if grasp.phase() == Phase::Grasped { "latched" } else { "not latched" };
        rows.push((name, format!("{phase}, Q {:.2} N", grasp.quality())));
    }
    if let Some(body) = selected.body() {
        rows.push(("selected".into(), session.sim().model().label(body)));
        if let Ok(wrench) = session.sim().body_wrench(body) {
            let force = wrench.fixed_rows::<3>(0).norm();
            let torque = wrench.fixed_rows::<3>(3).norm();
            rows.push(("pull".into(), format!("{force:.2} N, {torque:.3} N m")));
        }
    }
    rows.extend(lines(note).into_iter().map(|line| (String::new(), line)));
    let column = |side: fn(&(String, String)) -> &str| rows.iter().map(side).collect::<Vec<_>>().join("\n");
    screen.text(Corner::TopRight, &column(|row| &row.0), &column(|row| &row.1))
}

/// A text broken into lines between words.
fn lines(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.len() + word.len() < COLUMNS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Width and height of the list of keys, as the engine's font has it \[px\].
pub const KEYS_SIZE: (u32, u32) = (262, 540);

/// The list of keys, at the left.
pub fn draw_keys(screen: &Screen) -> Result<(), Error> {
    let column =
        |side: fn(&(&'static str, &'static str)) -> &'static str| KEYS.iter().map(side).collect::<Vec<_>>().join("\n");
    screen.text(Corner::TopLeft, &column(|row| row.0), &column(|row| row.1))
}
