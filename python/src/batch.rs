//! The class `Batch`: many simulations of one model, on all cores.

use crate::arguments;
use crate::errors::{ModelError, SpecError, of_engine};
use crate::grasps::Grasps;
use crate::parts::{self, Pace};
use crate::pool::Pool;
use crate::session::{Session, warn};
use crate::turn::Taken;
use mujoco_grasp::grasp::{Grasp, Phase};
use mujoco_grasp::mujoco::Simulation;
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;
use std::collections::HashSet;

/// Simulations of one model, stepped side by side on all cores, each with an `MjData` and `Grasps` of its own.
///
/// `data` and `grasps` are at your disposal between two calls. What a simulation does depends on nothing but its own inputs:
/// results are the same bit for bit with any number of threads, and those of its grasps stepped alone.
///
/// Args:
///     model: Shared by all and never written.
///     nsim: Simulations, all at the model's initial configuration.
///     target, palm, frozen_tolerance, options: As of `Grasps`.
///     threads: At most `nsim` are used. None: as many as there are cores.
///
/// Raises:
///     Error: As `Grasps`.
#[pyclass(frozen, module = "mujoco_grasp")]
pub struct Batch {
    pool: Pool,
    pace: Pace,
    members: Vec<Py<Grasps>>,
    data: Py<PyTuple>,
    sizes: Sizes,
}

/// Of the model.
#[derive(Clone, Copy)]
struct Sizes {
    nu: usize,
    nq: usize,
    nv: usize,
    nbody: usize,
    nsensordata: usize,
}

/// More failures of one call are counted only.
const NAMED: usize = 8;

/// What the simulations had to say in a call.
#[derive(Default)]
struct Outcome {
    failures: Vec<(usize, PyErr)>,
    warnings: Vec<String>,
}

impl Batch {
    /// That all simulations may begin a step; while the result lives nobody else can.
    fn begin(&self, py: Python<'_>) -> PyResult<Vec<Taken<'_>>> {
        let mut turns = Vec::with_capacity(self.members.len());
        for (i, grasps) in self.members.iter().enumerate() {
            match grasps.get().begin(py) {
                Ok(turn) => turns.push(turn),
                Err(error) => {
                    error.add_note(py, format!("in simulation {i} of the batch; none has gone on"))?;
                    return Err(error);
                }
            }
        }
        Ok(turns)
    }

    /// Runs `work` on the sessions of all simulations that have not failed, on all threads of the pool. All go on to the end.
    fn each(
        &self,
        py: Python<'_>,
        outcome: &mut Outcome,
        work: impl Fn(usize, &mut Session) -> PyResult<()> + Sync,
    ) -> PyResult<()> {
        let pool = self.pool.get()?;
        let failed: HashSet<usize> = outcome.failures.iter().map(|(i, _)| *i).collect();
        let of_one = |(i, grasps): (usize, &Grasps)| {
            if failed.contains(&i) {
                return (Ok(()), Vec::new());
            }
            let mut session = grasps.lock();
            (work(i, &mut session), session.take_warnings())
        };
        let members: Vec<&Grasps> = self.members.iter().map(Py::get).collect();
        let results: Vec<(PyResult<()>, Vec<String>)> =
            py.detach(|| pool.install(|| members.into_par_iter().enumerate().map(of_one).collect()));
        for (i, (result, warnings)) in results.into_iter().enumerate() {
            outcome.failures.extend(result.err().map(|error| (i, error)));
            outcome.warnings.extend(warnings);
        }
        Ok(())
    }

    /// The same once, as a whole call.
    fn once(&self, py: Python<'_>, work: impl Fn(usize, &mut Session) -> PyResult<()> + Sync) -> PyResult<()> {
        let _turns = self.begin(py)?;
        let mut outcome = Outcome::default();
        self.each(py, &mut outcome, work)?;
        self.raise(py, outcome)
    }

    /// The first simulation's error, which says of all others.
    fn raise(&self, py: Python<'_>, outcome: Outcome) -> PyResult<()> {
        let Outcome { mut failures, warnings } = outcome;
        let warned = warn(py, warnings);
        failures.sort_by_key(|(i, _)| *i);
        let failed: Vec<usize> = failures.iter().map(|(i, _)| *i).collect();
        let mut failures = failures.into_iter();
        let Some((i, first)) = failures.next() else { return warned };
        first.value(py).setattr("failed", PyTuple::new(py, &failed)?)?;
        let others = match (failed.len(), self.members.len() - failed.len()) {
            (1, 0) => String::new(),
            (count, 0) => format!("; all {count} have failed"),
            (1, _) => "; the others have gone on to the end".to_owned(),
            (count, _) => format!("; {count} have failed, see `failed`; the others have gone on to the end"),
        };
        first.add_note(py, format!("in simulation {i} of the batch{others}"))?;
        for (i, error) in failures.take(NAMED) {
            first.add_note(py, format!("simulation {i}: {error}"))?;
        }
        Err(first)
    }

    /// Rows of numbers, one for each simulation.
    fn rows<'py>(
        &self,
        py: Python<'py>,
        columns: usize,
        row: impl Fn(&Simulation) -> &[f64] + Sync,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut numbers = Vec::with_capacity(self.members.len() * columns);
        for grasps in &self.members {
            grasps.get().with(py, |session| numbers.extend_from_slice(row(session.borrowed.sim())));
        }
        PyArray1::from_vec(py, numbers).reshape([self.members.len(), columns])
    }

    /// Rows of what each grasp has, one for each simulation.
    fn of_grasps<'py, T: Element + Send>(
        &self,
        py: Python<'py>,
        value: impl Fn(&Grasp) -> T + Sync,
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let row = |session: &mut Session| session.grasps.iter().map(&value).collect();
        let rows: Vec<Vec<T>> = self.members.iter().map(|grasps| grasps.get().with(py, row)).collect();
        if let Some(i) = rows.iter().position(|row| row.len() != rows[0].len()) {
            return Err(SpecError::new_err(format!(
                "simulation {i} of the batch has {} grasps, and simulation 0 has {}: all must have as many for an array of \
                 them; read batch.grasps[{i}] itself, or add to the others, too",
                rows[i].len(),
                rows[0].len()
            )));
        }
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// Writes a row of `columns` numbers into each simulation, where `place` is.
    fn write_rows(
        &self,
        py: Python<'_>,
        name: &str,
        rows: &Bound<'_, PyAny>,
        columns: usize,
        place: impl Fn(&mut Simulation) -> &mut [f64] + Sync,
    ) -> PyResult<()> {
        let numbers = arguments::numbers(name, rows, &[self.members.len(), columns])?;
        let row = |i: usize| &numbers[i * columns..(i + 1) * columns];
        self.once(py, |i, session| session.write(|sim| place(sim).copy_from_slice(row(i))))
    }
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (model, nsim, target=None, palm=None, *, threads=None, frozen_tolerance=2e-3, **options))]
    #[allow(clippy::too_many_arguments)] // as Python has them
    fn new(
        model: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arguments::nsim)] nsim: usize,
        target: Option<&Bound<'_, PyAny>>,
        palm: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arguments::threads)] threads: Option<usize>,
        #[pyo3(from_py_with = arguments::frozen_tolerance)] frozen_tolerance: f64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let py = model.py();
        let class = py.import("mujoco")?.getattr("MjData")?;
        let (mut data, mut members) = (Vec::new(), Vec::new());
        for _ in 0..nsim {
            py.check_signals()?;
            let one = class.call1((model,))?;
            members.push(Py::new(py, Grasps::new(model, &one, target, palm, frozen_tolerance, options)?)?);
            data.push(one);
        }
        let sizes = members[0].get().with(py, |session| {
            let model = session.borrowed.sim().model();
            let (nu, nq, nv, nbody) = (model.nu(), model.nq(), model.nv(), model.nbody());
            Sizes { nu, nq, nv, nbody, nsensordata: model.nsensordata() }
        });
        // more threads than simulations would have nothing to do
        let pool = Pool::new(threads.map_or(0, |threads| threads.min(nsim)));
        pool.get()?;
        Ok(Self { pool, pace: Pace::default(), members, data: PyTuple::new(py, data)?.unbind(), sizes })
    }

    /// Advances each simulation by `n` steps, as `Grasps.step`, with the GIL released.
    ///
    /// Ctrl-C ends it, after as many steps of each simulation, of which the last is whole.
    ///
    /// Args:
    ///     n: Steps.
    ///     ctrl: Controls, shape (nsim, nu); None: as they are in each data.
    ///     xfrc_applied: Wrenches on bodies, [force; torque] at their centres of mass, world axes, N and N m, shape
    ///         (nsim, nbody, 6); None: as they are in each data.
    ///
    /// Raises:
    ///     SpecError: Arrays of other shapes.
    ///     Error: That of the first simulation that has failed. Its `failed` has the numbers of all that have, and its notes
    ///         say what the others' errors were; those that have not failed have made all their steps.
    #[pyo3(signature = (n=1, *, ctrl=None, xfrc_applied=None))]
    fn step(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = arguments::n)] n: usize,
        ctrl: Option<&Bound<'_, PyAny>>,
        xfrc_applied: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (nsim, nu, wrench) = (self.members.len(), self.sizes.nu, 6 * self.sizes.nbody);
        let mut ctrl = ctrl.map(|rows| arguments::numbers("ctrl", rows, &[nsim, nu])).transpose()?;
        let shape = [nsim, self.sizes.nbody, 6];
        let mut wrenches = xfrc_applied.map(|rows| arguments::numbers("xfrc_applied", rows, &shape)).transpose()?;
        let _turns = self.begin(py)?;
        let mut outcome = Outcome::default();
        parts::make(py, n, nsim, &self.pace, |part| {
            // written once: what is wrong with them MuJoCo puts right in the data
            let (ctrl, wrenches) = (ctrl.take(), wrenches.take());
            self.each(py, &mut outcome, |i, session| {
                session.advance(part, |sim| {
                    if let Some(ctrl) = &ctrl {
                        sim.ctrl_mut().copy_from_slice(&ctrl[i * nu..(i + 1) * nu]);
                    }
                    if let Some(wrenches) = &wrenches {
                        sim.xfrc_applied_mut().copy_from_slice(&wrenches[i * wrench..(i + 1) * wrench]);
                    }
                })
            })
        })?;
        self.raise(py, outcome)
    }

    /// Resets all data to the initial configuration or a keyframe, and all grasps.
    ///
    /// Raises:
    ///     UnknownNameError: A keyframe that the model does not have; nothing is reset.
    #[pyo3(signature = (keyframe=None))]
    fn reset(&self, py: Python<'_>, keyframe: Option<&str>) -> PyResult<()> {
        if let Some(name) = keyframe {
            let found =
                self.members[0].get().with(py, |session| session.borrowed.sim().model().keyframe(name).map(drop));
            found.map_err(of_engine)?;
        }
        self.once(py, |_, session| session.reset_data(keyframe))
    }

    /// Positions, shape (nsim, nq), a copy; may be set.
    #[getter]
    fn qpos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nq, Simulation::qpos)
    }

    #[setter]
    fn set_qpos(&self, py: Python<'_>, qpos: &Bound<'_, PyAny>) -> PyResult<()> {
        self.write_rows(py, "qpos", qpos, self.sizes.nq, Simulation::qpos_mut)
    }

    /// Velocities, shape (nsim, nv), a copy; may be set.
    #[getter]
    fn qvel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nv, Simulation::qvel)
    }

    #[setter]
    fn set_qvel(&self, py: Python<'_>, qvel: &Bound<'_, PyAny>) -> PyResult<()> {
        self.write_rows(py, "qvel", qvel, self.sizes.nv, Simulation::qvel_mut)
    }

    /// Sensors' values, shape (nsim, nsensordata), a copy.
    #[getter]
    fn sensordata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nsensordata, Simulation::sensordata)
    }

    /// Simulated time, s, shape (nsim,).
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let time = |session: &mut Session| session.borrowed.sim().time();
        PyArray1::from_vec(py, self.members.iter().map(|grasps| grasps.get().with(py, time)).collect())
    }

    /// Whether each grasp is latched, shape (nsim, number of grasps).
    #[getter]
    fn is_grasped<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        self.of_grasps(py, |grasp| grasp.phase() == Phase::Grasped)
    }

    /// Quality of each grasp, N, shape (nsim, number of grasps).
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.of_grasps(py, Grasp::quality)
    }

    /// Each simulation's `MjData`.
    #[getter]
    fn data(&self, py: Python<'_>) -> Py<PyTuple> {
        self.data.clone_ref(py)
    }

    /// Each simulation's grasps.
    #[getter]
    fn grasps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.members.iter().map(|grasps| grasps.clone_ref(py)))
    }

    fn __len__(&self) -> usize {
        self.members.len()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(ModelError::new_err(
            "a batch works in place on data of this process, so it is neither pickled nor copied: pickle or copy the save() of \
             each of its grasps and mj_getState of each of its data, and take them back in a batch that is made with the \
             same options",
        ))
    }

    fn __repr__(&self) -> PyResult<String> {
        let threads = self.pool.get()?.current_num_threads();
        Ok(format!("<mujoco_grasp.Batch of {} on {threads} threads>", self.members.len()))
    }
}
