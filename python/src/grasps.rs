//! The class `Grasps`.

use crate::arguments;
use crate::errors::{ModelError, of_engine, of_grasp};
use crate::grasp::Grasp;
use crate::owner::Owner;
use crate::parts::{self, Pace};
use crate::session::{Advance, Session, warn};
use crate::spec;
use crate::state::State;
use crate::turn::{Taken, Turn};
use mujoco_grasp::grasp::Phase;
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator, PyList};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

/// All grasps of one simulation, in place on its `MjModel` and `MjData`: call `step` instead of `mj_step`.
///
/// Nothing is copied: after each call the data is as after `mj_step`, with sensors, `cfrc_ext` and the contact list
/// seeing the contacts of a latched grasp with their forces. One thread at a time may step a data.
///
/// Args:
///     model: As it was loaded.
///     data: Made from it.
///     target: Body that is grasped, by its name or number: one of its own, for example with a free joint. None: no grasp
///         yet, see `add`.
///     palm: Base of the fingers, every link below may hold. None: the lowest common ancestor of the effectors, and
///         without any, the only hand that can touch the target.
///     frozen_tolerance: Angle by which anything may turn between two whole steps, rad, at most 0.1; with 0 every step is
///         whole.
///
/// Options of the grasp; None is each one's default, too:
///     effectors: Links that may hold the target, names or numbers of bodies; none: every link below the palm.
///     latch_quality: Quality at which the grasp latches, N; a tenth of the target's weight.
///     release_quality: What a latched grasp must keep not to be given up, N: with "cones" the sum of the normal forces,
///         else the quality; a quarter of `latch_quality`.
///     latch_time: Simulated time of good quality before it latches, s; 0.05.
///     release_time: Simulated time without hold before it is given up, s; 0.05.
///     limits: What stands for the contacts: "cones", their friction cones; or for comparison one bound for each axis of a
///         weld, "box", or a plain weld, "rigid": both need a weld in the model, see `weld_xml`.
///     relaxed: Axes that may slip, of x, y, z, rx, ry, rz, "box" only; all six.
///     axes: Orientation of those axes in the target's frame, a quaternion w, x, y, z, "box" only; that frame itself.
///     solref: Of the weld's axes that may not slip, "box" and "rigid": [time constant (s), damping ratio] or
///         [-stiffness, -damping]; from the contacts.
///     solimp: Likewise, five numbers.
///     relaxed_solref: Of the axes that may slip, "box" only.
///     relaxed_solimp: Likewise.
///
/// Raises:
///     ModelError: Not a model and its data, or a model with what is not served (flexes, RK4, stateful plugins).
///     UnknownNameError: A name that the model does not have.
///     SpecError: Bodies that cannot hold or be held, values that make no sense.
///     TypeError: An option that does not exist.
#[pyclass(frozen, module = "mujoco_grasp")]
pub struct Grasps {
    owner: Owner,
    turn: Turn,
    pace: Pace,
    session: Mutex<Session>,
}

impl Grasps {
    /// Runs `work` on the session, whatever other threads are doing with it: after them.
    pub fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Session) -> T + Send) -> T {
        match self.session.try_lock() {
            Ok(mut session) => work(&mut session),
            Err(TryLockError::Poisoned(poisoned)) => work(&mut poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => py.detach(|| work(&mut self.lock())),
        }
    }

    /// The session, once nobody else has it; not to be waited for with the GIL.
    pub fn lock(&self) -> MutexGuard<'_, Session> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// That a step may begin; while the result lives nobody else can.
    ///
    /// # Errors
    /// Memory that has moved; another thread that is stepping the data.
    pub fn begin(&self, py: Python<'_>) -> PyResult<Taken<'_>> {
        self.owner.check(py)?;
        self.turn.take()
    }

    fn advance(&self, py: Python<'_>, advance: Advance) -> PyResult<()> {
        let (made, warnings) = py.detach(|| {
            let mut session = self.lock();
            let made = session.advance(advance, |_| ());
            (made, session.take_warnings())
        });
        if !warnings.is_empty() {
            warn(py, warnings)?;
        }
        made
    }
}

#[pymethods]
impl Grasps {
    #[new]
    #[pyo3(signature = (model, data, target=None, palm=None, *, frozen_tolerance=2e-3, **options))]
    pub fn new(
        model: &Bound<'_, PyAny>,
        data: &Bound<'_, PyAny>,
        target: Option<&Bound<'_, PyAny>>,
        palm: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arguments::frozen_tolerance)] frozen_tolerance: f64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let (owner, borrowed) = Owner::borrow(model, data)?;
        let mut session = Session::new(borrowed);
        session.grasps.set_frozen_tolerance(frozen_tolerance);
        match target {
            Some(target) => add(&mut session, target, palm, options).map(drop)?,
            None if palm.is_some() || options.is_some() => {
                return Err(PyTypeError::new_err("options of a grasp are given without its target"));
            }
            None => {}
        }
        let turn = Turn::of(owner.data_address());
        Ok(Self { owner, turn, pace: Pace::default(), session: Mutex::new(session) })
    }

    /// Adds a grasp; options and errors as of the class. Those that move each other are solved as one problem.
    #[pyo3(signature = (target, palm=None, **options))]
    fn add(
        slf: &Bound<'_, Self>,
        target: &Bound<'_, PyAny>,
        palm: Option<&Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Grasp> {
        let grasps = slf.get();
        let _turn = grasps.begin(slf.py())?;
        let index = add(&mut grasps.lock(), target, palm, options)?;
        Ok(Grasp::new(slf.clone().unbind(), index))
    }

    /// Advances the data by `n` steps with the same controls, instead of `mj_step(model, data, n)`.
    ///
    /// Ctrl-C ends it after a whole step.
    #[pyo3(signature = (n=1))]
    fn step(&self, py: Python<'_>, #[pyo3(from_py_with = arguments::n)] n: usize) -> PyResult<()> {
        let _turn = self.begin(py)?;
        parts::make(py, n, 1, &self.pace, |part| self.advance(py, part))
    }

    /// As `step()`, for a step after which only `qpos`, `qvel`, `act`, time and the grasps' contacts are wanted.
    fn substep(&self, py: Python<'_>) -> PyResult<()> {
        let _turn = self.begin(py)?;
        self.advance(py, Advance::substeps(1))
    }

    /// After an `mj_step` of your own: reads contacts, forces and quality, and counts good time without latching.
    fn monitor(&self, py: Python<'_>) -> PyResult<()> {
        let _turn = self.begin(py)?;
        let Session { borrowed, grasps, .. } = &mut *self.lock();
        let visited = borrowed.visit(false, |sim| grasps.monitor(sim)).map_err(of_engine)?;
        visited.map_err(of_grasp)
    }

    /// Ungrasped again, with nothing counted: to be called when the data is reset.
    fn reset(&self, py: Python<'_>) {
        self.with(py, Session::reset);
    }

    /// What the grasps remember from step to step.
    fn save(&self, py: Python<'_>) -> State {
        self.with(py, |session| State { grasps: session.grasps.save(), clocks: session.clocks.clone() })
    }

    /// Goes back to a state that these grasps, or others with the same options of the same model, have saved.
    fn restore(&self, py: Python<'_>, state: &State) -> PyResult<()> {
        self.with(py, |session| {
            session.grasps.restore(&state.grasps)?;
            session.clocks.clone_from(&state.clocks);
            session.forget_time();
            Ok(())
        })
        .map_err(of_grasp)
    }

    /// Angle by which anything may turn between two whole steps, rad; with 0 every step is whole.
    #[getter]
    fn frozen_tolerance(&self, py: Python<'_>) -> f64 {
        self.with(py, |session| session.grasps.frozen_tolerance())
    }

    #[setter]
    fn set_frozen_tolerance(&self, py: Python<'_>, #[pyo3(from_py_with = arguments::frozen_tolerance)] angle: f64) {
        self.with(py, |session| session.grasps.set_frozen_tolerance(angle));
    }

    /// Steps so far that were made on frozen geometry.
    #[getter]
    fn frozen_steps(&self, py: Python<'_>) -> u64 {
        self.with(py, |session| session.grasps.frozen_steps())
    }

    /// Why others were not, and how many: "merged", "changed", "refresh", "contacts", "swings", "handover", "turned", "slid", "near".
    #[getter]
    fn whole_steps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counts: Vec<_> = self.with(py, |session| session.grasps.whole_steps().collect());
        let dict = PyDict::new(py);
        counts.into_iter().try_for_each(|(why, count)| dict.set_item(why, count))?;
        Ok(dict)
    }

    /// As it was given.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<PyAny> {
        self.owner.model.clone_ref(py)
    }

    /// As it was given.
    #[getter]
    fn data(&self, py: Python<'_>) -> Py<PyAny> {
        self.owner.data.clone_ref(py)
    }

    fn __len__(&self, py: Python<'_>) -> usize {
        self.with(py, |session| session.grasps.len())
    }

    fn __getitem__(slf: &Bound<'_, Self>, index: isize) -> PyResult<Grasp> {
        let len = slf.get().__len__(slf.py());
        let place = if index < 0 { index.checked_add_unsigned(len) } else { Some(index) };
        match place.and_then(|place| usize::try_from(place).ok()).filter(|&place| place < len) {
            Some(place) => Ok(Grasp::new(slf.clone().unbind(), place)),
            None => Err(PyIndexError::new_err(format!("grasp {index} does not exist: there are {len}"))),
        }
    }

    fn __iter__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyIterator>> {
        let handles = (0..slf.get().__len__(slf.py())).map(|index| Grasp::new(slf.clone().unbind(), index));
        PyList::new(slf.py(), handles.map(|grasp| Py::new(slf.py(), grasp)).collect::<PyResult<Vec<_>>>()?)?.try_iter()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let phases: Vec<&str> = self.with(py, |session| session.grasps.iter().map(|g| phase_name(g.phase())).collect());
        format!("<mujoco_grasp.Grasps of {}: {}>", phases.len(), phases.join(", "))
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(ModelError::new_err(
            "grasps work in place on one MjData of this process, so they are neither pickled nor copied: pickle or copy \
             save(), and restore() it in grasps that are made with the same options",
        ))
    }

    fn __traverse__(&self, visit: pyo3::PyVisit<'_>) -> Result<(), pyo3::PyTraverseError> {
        visit.call(&self.owner.model)?;
        visit.call(&self.owner.data)
    }
}

/// As in scenario files and states.
pub fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::Ungrasped => "ungrasped",
        Phase::Grasped => "grasped",
    }
}

fn add(
    session: &mut Session,
    target: &Bound<'_, PyAny>,
    palm: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<usize> {
    let spec = spec::read(session.borrowed.sim().model(), target, palm, options)?;
    let Session { borrowed, grasps, .. } = session;
    let id = borrowed.visit(false, |sim| grasps.add(sim, &spec)).map_err(of_engine)?.map_err(of_grasp)?;
    session.clocks.push(Default::default());
    Ok(id.index())
}
