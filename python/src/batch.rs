//! The class `Batch`: many simulations of one model, on all cores.

use crate::errors::SpecError;
use crate::grasps::Grasps;
use crate::session::{Advance, Session, warn};
use crate::turn::Taken;
use mujoco_grasp::grasp::{Grasp, Phase};
use mujoco_grasp::mujoco::Simulation;
use numpy::ndarray::{ArrayView, Dimension};
use numpy::{AllowTypeChange, Element, PyArray1, PyArray2, PyArrayLike2, PyArrayLike3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Simulations of one model, each with a data and grasps of its own.
#[pyclass(frozen, module = "mujoco_grasp")]
pub struct Batch {
    pool: ThreadPool,
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

type Rows<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;
type Wrenches<'py> = PyArrayLike3<'py, f64, AllowTypeChange>;

impl Batch {
    /// Runs `work` on the sessions of all simulations, on all threads of the pool. All go on to the end; then the first error
    /// is raised, with the number of its simulation.
    fn each(&self, py: Python<'_>, work: impl Fn(usize, &mut Session) -> PyResult<()> + Sync) -> PyResult<()> {
        let members: Vec<&Grasps> = self.members.iter().map(Py::get).collect();
        let _turns: Vec<Taken<'_>> = members.iter().map(|grasps| grasps.begin(py)).collect::<PyResult<_>>()?;
        let results: Vec<(PyResult<()>, Vec<String>)> = py.detach(|| {
            let of_one = |(i, grasps): (usize, &&Grasps)| {
                let mut session = grasps.lock();
                (work(i, &mut session), session.take_warnings())
            };
            self.pool.install(|| members.par_iter().enumerate().map(of_one).collect())
        });
        let mut first = Ok(());
        for (i, (result, warnings)) in results.into_iter().enumerate() {
            warn(py, warnings)?;
            if let (Ok(()), Err(error)) = (&first, result) {
                error.add_note(py, format!("in simulation {i} of the batch; the others have gone on"))?;
                first = Err(error);
            }
        }
        first
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
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// The numbers of an array that has a row of this shape for each simulation.
    fn numbers<D: Dimension>(&self, name: &str, array: ArrayView<'_, f64, D>, row: &[usize]) -> PyResult<Vec<f64>> {
        let needed = [&[self.members.len()], row].concat();
        if array.shape() == needed {
            return Ok(array.iter().copied().collect());
        }
        Err(SpecError::new_err(format!("{name} has the shape {:?}; {needed:?} is needed", array.shape())))
    }

    /// Writes a row of `columns` numbers into each simulation, where `place` is.
    fn write_rows(
        &self,
        py: Python<'_>,
        name: &str,
        rows: &Rows<'_>,
        columns: usize,
        place: impl Fn(&mut Simulation) -> &mut [f64] + Sync,
    ) -> PyResult<()> {
        let numbers = self.numbers(name, rows.as_array(), &[columns])?;
        let row = |i: usize| &numbers[i * columns..(i + 1) * columns];
        self.each(py, |i, session| session.write(|sim| place(sim).copy_from_slice(row(i))))
    }
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (model, nsim, target=None, palm=None, *, threads=None, frozen_tolerance=None, **options))]
    #[allow(clippy::too_many_arguments)] // as Python has them
    fn new(
        model: &Bound<'_, PyAny>,
        nsim: usize,
        target: Option<&Bound<'_, PyAny>>,
        palm: Option<&Bound<'_, PyAny>>,
        threads: Option<usize>,
        frozen_tolerance: Option<f64>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let py = model.py();
        if nsim == 0 || threads == Some(0) {
            return Err(SpecError::new_err("nsim and threads must be at least 1"));
        }
        let class = py.import("mujoco")?.getattr("MjData")?;
        let (mut data, mut members) = (Vec::new(), Vec::new());
        for _ in 0..nsim {
            let one = class.call1((model,))?;
            members.push(Py::new(py, Grasps::new(model, &one, target, palm, frozen_tolerance, options)?)?);
            data.push(one);
        }
        let sizes = members[0].get().with(py, |session| {
            let model = session.borrowed.sim().model();
            let (nu, nq, nv, nbody) = (model.nu(), model.nq(), model.nv(), model.nbody());
            Sizes { nu, nq, nv, nbody, nsensordata: model.nsensordata() }
        });
        let pool = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
        let pool = pool.map_err(|e| SpecError::new_err(format!("threads cannot be had: {e}")))?;
        Ok(Self { pool, members, data: PyTuple::new(py, data)?.unbind(), sizes })
    }

    /// Advances each simulation by `n` steps, as `Grasps.step`, with the GIL released.
    #[pyo3(signature = (n=1, *, ctrl=None, xfrc_applied=None))]
    fn step(
        &self,
        py: Python<'_>,
        n: usize,
        ctrl: Option<Rows<'_>>,
        xfrc_applied: Option<Wrenches<'_>>,
    ) -> PyResult<()> {
        let (nu, wrench) = (self.sizes.nu, 6 * self.sizes.nbody);
        let ctrl = ctrl.map(|rows| self.numbers("ctrl", rows.as_array(), &[nu])).transpose()?;
        let shape = [self.sizes.nbody, 6];
        let wrenches = xfrc_applied.map(|rows| self.numbers("xfrc_applied", rows.as_array(), &shape)).transpose()?;
        self.each(py, |i, session| {
            session.advance(Advance::Steps(n), |sim| {
                if let Some(ctrl) = &ctrl {
                    sim.ctrl_mut().copy_from_slice(&ctrl[i * nu..(i + 1) * nu]);
                }
                if let Some(wrenches) = &wrenches {
                    sim.xfrc_applied_mut().copy_from_slice(&wrenches[i * wrench..(i + 1) * wrench]);
                }
            })
        })
    }

    /// Resets all data to the initial configuration or a keyframe, and all grasps.
    #[pyo3(signature = (keyframe=None))]
    fn reset(&self, py: Python<'_>, keyframe: Option<&str>) -> PyResult<()> {
        self.each(py, |_, session| session.reset_data(keyframe))
    }

    /// Positions, shape (nsim, nq), a copy; may be set.
    #[getter]
    fn qpos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nq, Simulation::qpos)
    }

    #[setter]
    fn set_qpos(&self, py: Python<'_>, qpos: Rows<'_>) -> PyResult<()> {
        self.write_rows(py, "qpos", &qpos, self.sizes.nq, Simulation::qpos_mut)
    }

    /// Velocities, shape (nsim, nv), a copy; may be set.
    #[getter]
    fn qvel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nv, Simulation::qvel)
    }

    #[setter]
    fn set_qvel(&self, py: Python<'_>, qvel: Rows<'_>) -> PyResult<()> {
        self.write_rows(py, "qvel", &qvel, self.sizes.nv, Simulation::qvel_mut)
    }

    /// Shape (nsim, nsensordata), a copy.
    #[getter]
    fn sensordata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, self.sizes.nsensordata, Simulation::sensordata)
    }

    /// s, shape (nsim,)
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let time = |session: &mut Session| session.borrowed.sim().time();
        PyArray1::from_vec(py, self.members.iter().map(|grasps| grasps.get().with(py, time)).collect())
    }

    /// Shape (nsim, number of grasps).
    #[getter]
    fn is_grasped<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        self.of_grasps(py, |grasp| grasp.phase() == Phase::Grasped)
    }

    /// N, shape (nsim, number of grasps).
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.of_grasps(py, Grasp::quality)
    }

    #[getter]
    fn data(&self, py: Python<'_>) -> Py<PyTuple> {
        self.data.clone_ref(py)
    }

    #[getter]
    fn grasps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.members.iter().map(|grasps| grasps.clone_ref(py)))
    }

    fn __len__(&self) -> usize {
        self.members.len()
    }

    fn __repr__(&self) -> String {
        format!("<mujoco_grasp.Batch of {} on {} threads>", self.members.len(), self.pool.current_num_threads())
    }
}
