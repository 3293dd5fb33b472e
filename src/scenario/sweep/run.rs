//! Runs a shard: a Parquet file for every so many grasps, each under its name only when it is whole.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use parquet::record::Field as Value;
use rayon::prelude::*;
use serde::Serialize;

use super::grid::checksum;
use super::table::{self, Column, Reader};
use super::trial::{Row, Verdict, test};
use super::{Case, Shard, Sweep};
use crate::mujoco::{CompiledModel, mujoco_version};
use crate::scenario::error::Error;
use crate::scenario::outcome::quantile;
use crate::scenario::runner::Mode;

/// What became of a shard's grasps, those of files that were there already included. The JSON object of `sweep`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The sweep's name.
    pub sweep: String,
    /// MuJoCo's version.
    pub engine: String,
    /// How contacts were simulated.
    pub mode: Mode,
    /// The folder of results.
    pub out: PathBuf,
    /// Grasps of the shard.
    pub grasps: usize,
    /// Of these, those that this call has tested; the others' files were there already.
    pub tested: usize,
    /// Files of the shard.
    pub files: usize,
    /// Grasps by verdict.
    pub verdicts: BTreeMap<&'static str, usize>,
    /// Steps under loads that were latched, of each grasp's in which a finger pressed.
    pub latched_share: Spread,
    /// Steps that were made for all of these grasps.
    pub steps: u64,
    /// Wall-clock time of this call's tests \[s\].
    pub seconds: f64,
    /// Threads that it had.
    pub threads: usize,
}

/// Median and tenth percentile over the grasps that have the number.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Spread {
    /// Half are above.
    pub median: Option<f64>,
    /// Nine tenths are above.
    pub p10: Option<f64>,
}

impl Spread {
    fn of(values: Vec<f64>) -> Self {
        Self { median: quantile(values.clone(), 0.5), p10: quantile(values, 0.1) }
    }
}

/// Tests the grasps of a shard on all threads and writes them into `out`; `told` hears of so many more grasps that are done.
///
/// # Errors
/// A scenario that cannot be set up; a file that is there and not of this sweep; what cannot be written;
/// [`Error::Interrupted`]. Files that are finished stay in any case, and the next call leaves them out.
pub fn run(sweep: &Sweep, mode: Mode, shard: Shard, out: &Path, told: &(dyn Fn(u64) + Sync)) -> Result<Report, Error> {
    std::fs::create_dir_all(out).map_err(|source| Error::Write { file: out.to_path_buf(), source })?;
    let notes = notes(sweep, mode);
    let named = |(file, cases)| (out.join(format!("part-{file:05}.parquet")), cases);
    let files: Vec<(PathBuf, &[Case])> = sweep.parts(shard).map(named).collect();
    let tested = AtomicUsize::new(0);
    let clock = Instant::now();
    files.par_iter().try_for_each(|(path, cases)| -> Result<(), Error> {
        if is_finished(path, &notes)? {
            told(cases.len() as u64);
            return Ok(());
        }
        let rows: Vec<Row> = cases
            .par_iter()
            .map(|case| {
                let row = test(sweep, case, mode)?;
                told(1);
                Ok(row)
            })
            .collect::<Result<_, Error>>()?;
        let failed = |source| Error::Write { file: path.clone(), source };
        let bytes =
            table::encode(&columns(sweep, cases, &rows, mode), &notes).map_err(|e| failed(std::io::Error::other(e)))?;
        table::write(path, &bytes).map_err(failed)?;
        tested.fetch_add(rows.len(), Ordering::Relaxed);
        Ok(())
    })?;
    let seconds = clock.elapsed().as_secs_f64();
    report(sweep, mode, out, &files, tested.into_inner(), seconds)
}

/// Whether the file is there, whole, and of this sweep.
fn is_finished(path: &Path, notes: &[(&str, String)]) -> Result<bool, Error> {
    let foreign = |problem: String| Error::Part { file: path.to_path_buf(), problem };
    let reader = match Reader::open(path) {
        Ok(reader) => reader,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(foreign(format!("is no file of a sweep: {e}"))),
    };
    for (key, own) in notes {
        match reader.note(key) {
            Some(note) if note == own => {}
            Some(note) if note.len() + own.len() < 60 => {
                return Err(foreign(format!("is of another sweep: its {key} is {note}, not {own}")));
            }
            Some(_) => return Err(foreign(format!("is of another sweep: its {key} is not this one's"))),
            None => return Err(foreign(format!("is no file of a sweep: its metadata has no {key}"))),
        }
    }
    Ok(true)
}

/// All that rows depend on, as a file's metadata.
fn notes(sweep: &Sweep, mode: Mode) -> Vec<(&'static str, String)> {
    // Numbers that are none were refused, and keys are texts: nothing can fail.
    let json = |value: &dyn Fn() -> serde_json::Result<String>| value().unwrap_or_default();
    let cases = json(&|| serde_json::to_string(&sweep.cases));
    vec![
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("engine", mujoco_version()),
        ("mode", mode.name().to_owned()),
        ("spec", json(&|| serde_json::to_string(&sweep.spec))),
        ("grasps", format!("{:016x}", checksum(cases.bytes()))),
        ("scenario", sweep.scenario.clone()),
        ("model", format!("{:016x}", model_checksum(&sweep.plan.model))),
    ]
}

/// Of what the motion of a model depends on, as far as files are edited.
fn model_checksum(m: &CompiledModel) -> u64 {
    let gravity = m.gravity();
    let options = [m.timestep(), m.impratio(), m.tolerance(), gravity.x, gravity.y, gravity.z];
    let numbers: [&[f64]; 42] = [
        &options,
        m.qpos0(),
        m.qpos_spring(),
        m.body_pos(),
        m.body_quat(),
        m.body_ipos(),
        m.body_iquat(),
        m.body_mass(),
        m.body_inertia(),
        m.jnt_pos(),
        m.jnt_axis(),
        m.jnt_stiffness(),
        m.jnt_range(),
        m.jnt_solref(),
        m.jnt_solimp(),
        m.dof_armature(),
        m.dof_damping(),
        m.dof_frictionloss(),
        m.geom_size(),
        m.geom_pos(),
        m.geom_quat(),
        m.geom_friction(),
        m.geom_solref(),
        m.geom_solimp(),
        m.geom_solmix(),
        m.geom_margin(),
        m.geom_gap(),
        m.pair_friction(),
        m.eq_data(),
        m.eq_solref(),
        m.eq_solimp(),
        m.tendon_range(),
        m.tendon_stiffness(),
        m.tendon_damping(),
        m.actuator_dynprm(),
        m.actuator_gainprm(),
        m.actuator_biasprm(),
        m.actuator_gear(),
        m.actuator_ctrlrange(),
        m.actuator_forcerange(),
        m.key_qpos(),
        m.key_ctrl(),
    ];
    let flags =
        [m.disable_flags() as i32, m.enable_flags() as i32, m.iterations() as i32, m.noslip_iterations() as i32];
    let solvers = [m.integrator().raw(), m.cone().raw(), m.solver().raw()];
    let whole: [&[i32]; 9] = [
        &flags,
        &solvers,
        m.body_parentid(),
        m.jnt_type(),
        m.geom_type(),
        m.geom_contype(),
        m.geom_conaffinity(),
        m.geom_condim(),
        m.mesh_face(),
    ];
    let numbers = numbers.into_iter().flatten().flat_map(|x| x.to_le_bytes());
    let whole = whole.into_iter().flatten().flat_map(|x| x.to_le_bytes());
    checksum(numbers.chain(whole).chain(m.mesh_vert().iter().flat_map(|x| x.to_le_bytes())))
}

/// Rows as the columns of `docs/sweep.md`.
fn columns(sweep: &Sweep, cases: &[Case], rows: &[Row], mode: Mode) -> Vec<(String, Column)> {
    let text = |of: &dyn Fn(&Row) -> Option<String>| Column::Text(rows.iter().map(of).collect());
    let number = |of: fn(&Row) -> Option<f64>| Column::Number(rows.iter().map(of).collect());
    let same = |value: &str| Column::Text(vec![Some(value.to_owned()); rows.len()]);
    let keyframes = Column::Text(cases.iter().map(|case| case.keyframe.clone()).collect());
    let mut columns = vec![("id".to_owned(), text(&|row| Some(row.id.clone()))), ("keyframe".to_owned(), keyframes)];
    for (i, (name, _)) in sweep.parameters.iter().enumerate() {
        columns.push((name.clone(), Column::Number(cases.iter().map(|case| case.values[i]).collect())));
    }
    let rest = [
        ("verdict", text(&|row| Some(row.verdict.name().to_owned()))),
        ("lost_at_s", number(|row| row.lost_at_s)),
        ("lost_in", text(&|row| row.lost_in.clone())),
        ("max_slip_m", number(|row| row.max_slip_m)),
        ("max_motion_m", number(|row| row.max_motion_m)),
        ("max_rotation_rad", number(|row| row.max_rotation_rad)),
        ("final_offset_m", number(|row| row.final_offset_m)),
        ("normal_force_n", number(|row| row.normal_force_n)),
        ("latched_at_s", number(|row| row.latched_at_s)),
        ("quality_at_latch_n", number(|row| row.quality_at_latch_n)),
        ("latched_share", number(|row| row.latched_share)),
        ("substructured_share", number(|row| row.substructured_share)),
        ("steps", Column::Count(rows.iter().map(|row| row.steps).collect())),
        ("seed", Column::Count(vec![sweep.spec.seed; rows.len()])),
        ("mode", same(mode.name())),
        ("engine", same(&mujoco_version())),
        ("error", text(&|row| row.error.clone())),
    ];
    columns.extend(rest.map(|(name, column)| (name.to_owned(), column)));
    columns
}

/// Read back from the files, so that it says the same whoever has written them.
fn report(
    sweep: &Sweep,
    mode: Mode,
    out: &Path,
    files: &[(PathBuf, &[Case])],
    tested: usize,
    seconds: f64,
) -> Result<Report, Error> {
    let mut verdicts: BTreeMap<&'static str, usize> = Verdict::ALL.iter().map(|v| (v.name(), 0)).collect();
    let (mut shares, mut steps) = (Vec::new(), 0);
    for (path, _) in files {
        let damaged = |e: std::io::Error| Error::Part { file: path.clone(), problem: format!("cannot be read: {e}") };
        let reader = Reader::open(path).map_err(damaged)?;
        for value in reader.column("verdict").map_err(damaged)? {
            let Value::Str(name) = value else { continue };
            *verdicts.iter_mut().find(|(known, _)| **known == name).map_or(&mut 0, |(_, count)| count) += 1;
        }
        let numbers = reader.column("latched_share").map_err(damaged)?.into_iter();
        shares.extend(numbers.filter_map(|value| if let Value::Double(share) = value { Some(share) } else { None }));
        let counts = reader.column("steps").map_err(damaged)?.into_iter();
        steps += counts.map(|value| if let Value::ULong(n) = value { n } else { 0 }).sum::<u64>();
    }
    Ok(Report {
        sweep: sweep.spec.name.clone(),
        engine: mujoco_version(),
        mode,
        out: out.to_path_buf(),
        grasps: files.iter().map(|(_, cases)| cases.len()).sum(),
        tested,
        files: files.len(),
        verdicts,
        latched_share: Spread::of(shares),
        steps,
        seconds,
        threads: rayon::current_num_threads(),
    })
}
