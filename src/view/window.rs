//! The window: events of winit to the pointer and the session, and the session to the screen.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use image::ImageFormat;
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::error::EventLoopError;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

use super::keys::{Command, command};
use super::overlay::history::History;
use super::overlay::{Shown, bars, contacts, status, tint};
use super::pace::Pace;
use super::pointer::{Button, Gaze, Modifiers, Pointer, Seen};
use super::recording::Recording;
use super::session::{Action, Session};
use crate::grasp::GraspId;
use crate::mujoco::{Camera, Drawing, Perturb, Screen, Simulation, no_window};
use crate::scenario::Error;
use crate::scenario::plan::Plan;
use crate::scenario::runner::Mode;
use crate::whole_file::write_whole;

/// Width and height at first.
const SIZE: LogicalSize<u32> = LogicalSize::new(1200, 900);
/// Nothing that is written in it covers anything else down to this size.
const LEAST: LogicalSize<u32> = LogicalSize::new(800, 600);
/// Time of a frame, at least.
const FRAME: Duration = Duration::from_micros(16_667);
/// Longest time that one frame gives to steps.
const STEPPING: Duration = Duration::from_millis(50);
/// Pixels of a wheel that has no notches.
const PIXELS_PER_NOTCH: f64 = 40.0;

/// What came of a window.
#[derive(Clone, Debug)]
pub struct Summary {
    /// What was done, also in a replay.
    pub recording: Recording,
    /// Of a replay that came to its end: whether the simulation was the recorded one, bit for bit; `None` also where the
    /// recording has no digest.
    pub same_as_replayed: Option<bool>,
    /// Frames that were drawn.
    pub frames: u64,
    /// From the first frame to the last \[s\].
    pub shown_s: f64,
    /// Time that drawing took, all frames together \[s\].
    pub drawing_s: f64,
}

/// Runs a scenario in a window until it is closed, in real time where that is possible. With a recording, what was done then is
/// done again, and the window pauses where the recording ends. To be called on the main thread, and once in a process:
/// winit allows no more.
///
/// # Errors
/// [`Error::Engine`] with [`Window`](crate::mujoco::Error::Window) where no window can be opened; what prevents the scenario from starting;
/// [`Error::Interrupted`] once the plan's stop was asked. A step that fails is told in the window. The session is in
/// `ended`, however it ended.
pub fn show(plan: &Plan, replay: Option<Recording>, ended: &mut Option<Summary>) -> Result<(), Error> {
    let mut app = App::new(plan, replay)?;
    // winit panics where an X server lacks an extension, or a library is missing
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    let ran = catch_unwind(AssertUnwindSafe(|| run(&mut app)));
    set_hook(hook);
    let ran = ran.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().map(|t| (*t).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Err(no_window(&format!("the window system failed: {text}")).into())
    });
    *ended = Some(app.summary());
    ran
}

fn run(app: &mut App) -> Result<(), Error> {
    let events = EventLoop::new().map_err(|e| no_window(&no_display(&e)))?;
    let ran = events.run_app(app);
    // before the display is closed
    app.screen = None;
    match app.failed.take() {
        Some(error) => Err(error),
        None => ran.map_err(|e| no_window(&format!("the window system failed: {e}")).into()),
    }
}

/// What is wrong with the display; of winit's text the end, which says why, without the path of its source.
fn no_display(error: &EventLoopError) -> String {
    match std::env::var("DISPLAY").ok().filter(|display| !display.is_empty()) {
        None => "DISPLAY is not set".to_owned(),
        Some(display) => {
            let text = error.to_string();
            let why =
                text.split_once(".rs:").and_then(|(_, rest)| rest.split_once(": ")).map_or(&*text, |(_, why)| why);
            format!("the X server of DISPLAY={display} cannot be used: {why}")
        }
    }
}

struct App {
    session: Session,
    /// Poses of the session, to be drawn and pulled at.
    poses: Simulation,
    screen: Option<Screen>,
    home: Camera,
    gaze: Gaze,
    pointer: Pointer,
    held: Modifiers,
    pace: Pace,
    shown: Shown,
    history: History,
    /// A step is made though the window is paused.
    single: bool,
    note: String,
    replay: Option<Recording>,
    same_as_replayed: Option<bool>,
    wants_picture: bool,
    title: String,
    failed: Option<Error>,
    frames: u64,
    first: Option<Instant>,
    last: Option<Instant>,
    drawing: Duration,
}

impl App {
    fn new(plan: &Plan, replay: Option<Recording>) -> Result<Self, Error> {
        let session = Session::new(plan)?;
        let poses = session.poses()?;
        let grasp = &session.grasps()[GraspId::FIRST];
        let home = Camera::for_grasp(&poses, grasp.palm(), grasp.target())?;
        let home = home.freed(&poses, poses.body_com(grasp.target()))?;
        Ok(Self {
            history: History::new(plan.model.timestep()),
            session,
            poses,
            screen: None,
            home,
            gaze: Gaze { camera: home, perturb: Perturb::default() },
            pointer: Pointer::default(),
            held: Modifiers::default(),
            pace: Pace::default(),
            shown: Shown::default(),
            single: false,
            note: String::new(),
            replay,
            same_as_replayed: None,
            wants_picture: false,
            title: String::new(),
            failed: None,
            frames: 0,
            first: None,
            last: None,
            drawing: Duration::ZERO,
        })
    }

    fn summary(&self) -> Summary {
        let shown = self.first.zip(self.last).map_or(Duration::ZERO, |(first, last)| last - first);
        Summary {
            recording: Recording::of(&self.session),
            same_as_replayed: self.same_as_replayed,
            frames: self.frames,
            shown_s: shown.as_secs_f64(),
            drawing_s: self.drawing.as_secs_f64(),
        }
    }

    /// Steps that are due, and a picture of what came of them.
    fn frame(&mut self) -> Result<(), Error> {
        let start = Instant::now();
        let elapsed = self.last.map_or(0.0, |last| (start - last).as_secs_f64());
        self.first.get_or_insert(start);
        self.last = Some(start);
        let due = self.pace.due(elapsed, self.session.plan().model.timestep());
        let due = due.max(u64::from(std::mem::take(&mut self.single)));
        for _ in 0..due {
            if let Err(error) = self.step() {
                if matches!(error, Error::Interrupted) {
                    return Err(error);
                }
                self.pace.paused = true;
                self.note = format!("{error}");
                break;
            }
            if start.elapsed() > STEPPING || self.replay_ends() {
                break;
            }
        }
        self.session.show(&mut self.poses)?;
        let start = Instant::now();
        self.draw()?;
        self.frames += 1;
        self.drawing += start.elapsed();
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        if let Some(recording) = &self.replay {
            recording.act(&mut self.session)?;
        } else {
            let perturb = &self.gaze.perturb;
            if perturb.is_active() {
                self.session.show(&mut self.poses)?;
            }
            let wrench = perturb.wrench(&mut self.poses)?;
            self.session.push(perturb.body().zip(wrench))?;
        }
        self.session.step()?;
        self.history.add(self.session.steps(), self.session.time(), self.session.grasps());
        Ok(())
    }

    /// Whether a replay has come to its end: the window pauses, and goes on with the mouse.
    fn replay_ends(&mut self) -> bool {
        let Some(recording) = self.replay.take_if(|r| self.session.steps() >= r.steps) else { return false };
        self.same_as_replayed = recording.digest.map(|digest| digest == self.session.digest());
        self.pace.paused = true;
        self.note = match self.same_as_replayed {
            Some(true) => "end of the recording: the same bit for bit",
            Some(false) => "end of the recording: not the same simulation",
            None => "end of the recording",
        }
        .to_owned();
        true
    }

    fn title(&self) -> String {
        let paused = if self.pace.paused { ", paused" } else { "" };
        format!("mujoco-grasp view {}{paused}", self.session.plan().name)
    }

    fn draw(&mut self) -> Result<(), Error> {
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let (session, shown) = (&self.session, self.shown);
        // also where nothing is selected: what pushes in a replay is seen
        let perturb = Some(self.gaze.perturb.clone());
        let mut drawing = Drawing { hide_sites: true, plain: !shown.shadows, perturb, ..Drawing::default() };
        for (index, grasp) in session.grasps().iter().enumerate() {
            contacts::add(session.sim(), grasp, (shown.contacts, shown.forces), &mut drawing);
            tint::add(index, grasp, shown, &mut drawing);
        }
        screen.draw(&self.poses, self.gaze.camera, &drawing)?;
        status::draw(screen, session, &self.pace, &self.gaze.perturb, &self.note)?;
        if shown.keys {
            status::draw_keys(screen)?;
        }
        if shown.bars {
            bars::draw(screen, session.sim(), session.grasps())?;
        }
        if shown.plot {
            self.history.draw(screen, session.grasps(), shown.keys)?;
        }
        if std::mem::take(&mut self.wants_picture) {
            let path = PathBuf::from(format!("{}-{}.png", session.plan().name, session.steps()));
            let picture = screen.picture()?;
            let saved =
                write_whole(&path, |file| picture.write_to(file, ImageFormat::Png).map_err(std::io::Error::other));
            self.note = match saved {
                Ok(()) => format!("saved {}", path.display()),
                Err(e) => format!("{}: cannot be written: {e}", path.display()),
            };
        }
        screen.present()?;
        let title = self.title();
        if title != self.title
            && let Some(screen) = &self.screen
        {
            screen.window().set_title(&title);
            self.title = title;
        }
        Ok(())
    }

    fn press(&mut self, key: &KeyEvent, events: &ActiveEventLoop) -> Result<(), Error> {
        if key.state != ElementState::Pressed {
            return Ok(());
        }
        let Some(command) = command(&key.logical_key).filter(|c| !key.repeat || *c == Command::Step) else {
            return Ok(());
        };
        let shown = &mut self.shown;
        let flag = match command {
            Command::Contacts => &mut shown.contacts,
            Command::Forces => &mut shown.forces,
            Command::Tint => &mut shown.tint,
            Command::Bars => &mut shown.bars,
            Command::Plot => &mut shown.plot,
            Command::Shadows => &mut shown.shadows,
            Command::Keys => &mut shown.keys,
            Command::Pause => &mut self.pace.paused,
            other => return self.obey(other, events),
        };
        *flag = !*flag;
        Ok(())
    }

    fn obey(&mut self, command: Command, events: &ActiveEventLoop) -> Result<(), Error> {
        match command {
            Command::Step => self.single = self.pace.paused,
            Command::Slower => self.pace.slower(),
            Command::Faster => self.pace.faster(),
            Command::Home => self.gaze.camera = self.home,
            Command::Picture => self.wants_picture = true,
            Command::Quit => events.exit(),
            Command::Reset | Command::Mode if self.replay.is_some() => {
                self.note = "not while a recording is replayed".to_owned();
            }
            Command::Reset => {
                self.gaze.perturb.end();
                self.session.act(Action::Reset)?;
                self.note.clear();
            }
            Command::Mode => {
                let mode = if self.session.mode() == Mode::Full { Mode::Grasp } else { Mode::Full };
                self.session.act(Action::Mode(mode))?;
            }
            // switched in `press`
            _ => {}
        }
        Ok(())
    }

    fn handle(&mut self, event: WindowEvent, events: &ActiveEventLoop) -> Result<(), Error> {
        let Some(screen) = &self.screen else { return Ok(()) };
        let seen = Seen { scene: screen.scene(), sim: &self.poses, size: screen.size() };
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(_) => screen.resize(),
            WindowEvent::RedrawRequested => self.frame()?,
            WindowEvent::KeyboardInput { event, .. } => self.press(&event, events)?,
            WindowEvent::ModifiersChanged(held) => {
                let held = held.state();
                self.held = Modifiers { ctrl: held.control_key(), shift: held.shift_key() };
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.pointer.move_to([position.x, position.y], self.held, &mut self.gaze, seen)?;
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let button = match button {
                    MouseButton::Left => Button::Left,
                    MouseButton::Middle => Button::Middle,
                    MouseButton::Right => Button::Right,
                    _ => return Ok(()),
                };
                let press = (button, state == ElementState::Pressed);
                self.pointer.press(press, self.held, Instant::now(), &mut self.gaze, seen)?;
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(y),
                    MouseScrollDelta::PixelDelta(by) => by.y / PIXELS_PER_NOTCH,
                };
                self.pointer.scroll(notches, &mut self.gaze, seen)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn fail(&mut self, error: Error, events: &ActiveEventLoop) {
        self.failed.get_or_insert(error);
        events.exit();
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.screen.is_some() {
            return;
        }
        let window =
            Window::default_attributes().with_title(self.title()).with_inner_size(SIZE).with_min_inner_size(LEAST);
        match Screen::open(self.poses.model(), events, window) {
            Ok(screen) => {
                self.shown.shadows = !screen.is_software();
                self.screen = Some(screen);
            }
            Err(error) => self.fail(error.into(), events),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if let Err(error) = self.handle(event, events) {
            self.fail(error, events);
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if let Err(error) = self.session.plan().stop.check() {
            return self.fail(error, events);
        }
        let next = self.last.map_or_else(Instant::now, |last| last + FRAME);
        if let Some(screen) = self.screen.as_ref().filter(|_| Instant::now() >= next) {
            screen.window().request_redraw();
        }
        events.set_control_flow(ControlFlow::WaitUntil(next));
    }
}
