//! The mouse: what it does to the camera, and to what it pulls at, as in MuJoCo's `simulate`.

use std::time::{Duration, Instant};

use crate::mujoco::{Camera, Drag, Error, Perturb, Pull, Scene, Simulation};

/// Two presses within this are one double click.
const DOUBLE_CLICK: Duration = Duration::from_millis(400);
/// What a notch of the wheel zooms, in parts of the picture's height.
const NOTCH: f64 = 0.05;

/// A button of the mouse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Orbits, selects, turns.
    Left,
    /// Zooms.
    Middle,
    /// Pans, pulls.
    Right,
}

/// Keys that are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    /// The mouse acts on the selected body in the place of the camera.
    pub ctrl: bool,
    /// Horizontally in the place of vertically.
    pub shift: bool,
}

/// Where one looks from, and what is selected.
#[derive(Clone, Debug)]
pub struct Gaze {
    /// The camera.
    pub camera: Camera,
    /// The selected body, and the spring that pulls at it.
    pub perturb: Perturb,
}

/// Buttons and place of the mouse.
#[derive(Clone, Debug, Default)]
pub struct Pointer {
    /// Left, middle, right.
    down: [bool; 3],
    /// From the upper left corner \[px\].
    at: [f64; 2],
    last_press: Option<(Button, Instant)>,
}

/// What is seen where the mouse is: the scene as it was drawn last, the simulation that it shows (positions, velocities,
/// inertia), and the size of the picture.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The simulation.
    pub sim: &'a Simulation,
    /// Width and height \[px\].
    pub size: (u32, u32),
}

impl Pointer {
    /// A button goes down or up, at a time.
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::OtherModel`] for a scene of another simulation.
    pub fn press(
        &mut self,
        (button, down): (Button, bool),
        held: Modifiers,
        now: Instant,
        gaze: &mut Gaze,
        seen: Seen<'_>,
    ) -> Result<(), Error> {
        self.down[button as usize] = down;
        if down {
            let first = self.last_press.replace((button, now));
            let double = first.is_some_and(|(b, at)| b == button && now.duration_since(at) < DOUBLE_CLICK);
            if double && !held.ctrl {
                self.last_press = None;
                self.double_click(button, gaze, seen)?;
            }
        }
        let pull = match self.down {
            [_, _, true] => Some(Pull::Force),
            [true, _, _] => Some(Pull::Torque),
            _ => None,
        };
        match pull.filter(|_| held.ctrl) {
            Some(pull) => gaze.perturb.begin(pull, seen.sim, seen.scene),
            None => {
                gaze.perturb.end();
                Ok(())
            }
        }
    }

    /// The mouse moves to a place, from the upper left corner \[px\].
    ///
    /// # Errors
    /// As [`press`](Self::press).
    pub fn move_to(&mut self, to: [f64; 2], held: Modifiers, gaze: &mut Gaze, seen: Seen<'_>) -> Result<(), Error> {
        let from = std::mem::replace(&mut self.at, to);
        let drag = match (self.down, held.shift) {
            ([_, _, true], false) => Drag::MoveVertical,
            ([_, _, true], true) => Drag::MoveHorizontal,
            ([true, _, _], false) => Drag::RotateVertical,
            ([true, _, _], true) => Drag::RotateHorizontal,
            ([_, true, _], _) => Drag::Zoom,
            _ => return Ok(()),
        };
        let height = f64::from(seen.size.1.max(1));
        let [x, y] = [0, 1].map(|i| (to[i] - from[i]) / height);
        if gaze.perturb.is_active() {
            gaze.perturb.drag(drag, x, y, seen.sim, seen.scene)
        } else {
            gaze.camera = gaze.camera.moved(drag, x, y, seen.scene)?;
            Ok(())
        }
    }

    /// The wheel turns by so many notches, away from the user.
    ///
    /// # Errors
    /// As [`press`](Self::press).
    pub fn scroll(&self, notches: f64, gaze: &mut Gaze, seen: Seen<'_>) -> Result<(), Error> {
        gaze.camera = gaze.camera.moved(Drag::Zoom, 0.0, -NOTCH * notches, seen.scene)?;
        Ok(())
    }

    fn double_click(&self, button: Button, gaze: &mut Gaze, seen: Seen<'_>) -> Result<(), Error> {
        let [width, height] = [seen.size.0, seen.size.1].map(|n| f64::from(n.max(1)));
        let (x, y) = (self.at[0] / width, 1.0 - self.at[1] / height);
        let picked = seen.scene.pick(seen.sim, width / height, x, y)?;
        match (button, picked) {
            (Button::Left, Some(picked)) => gaze.perturb = Perturb::select(seen.sim, &picked)?,
            (Button::Left, None) => gaze.perturb = Perturb::default(),
            (Button::Right, Some(picked)) => {
                if let Camera::Free { lookat, .. } = &mut gaze.camera {
                    *lookat = picked.point;
                }
            }
            _ => {}
        }
        Ok(())
    }
}
