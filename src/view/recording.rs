//! A session in a file.

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::digest::Digest;
use super::session::{Event, Session};
use crate::mujoco::mujoco_version;
use crate::scenario::Error;
use crate::scenario::plan::Plan;
use crate::whole_file::write_whole;

/// What was done in a session, and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Name of the scenario.
    pub scenario: String,
    /// Version of MuJoCo.
    pub engine: String,
    /// What was done, in order.
    pub events: Vec<Event>,
    /// Steps in all.
    pub steps: u64,
    /// See [`Session::digest`]; a recording that was written by hand needs none.
    #[serde(default)]
    pub digest: Option<Digest>,
}

impl Recording {
    /// Of a session until now.
    pub fn of(session: &Session) -> Self {
        Self {
            scenario: session.plan().name.clone(),
            engine: mujoco_version(),
            events: session.events().to_vec(),
            steps: session.steps(),
            digest: Some(session.digest()),
        }
    }

    /// Reads a file that [`write`](Self::write) has written, or that looks like one.
    ///
    /// # Errors
    /// [`Error::Recording`].
    pub fn read(path: &Path, plan: &Plan) -> Result<Self, Error> {
        let wrong = |problem: String| Error::Recording { file: path.to_owned(), problem };
        let text = std::fs::read_to_string(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
        let recording: Self =
            serde_json::from_str(&text).map_err(|e| wrong(format!("is no recording of `view --record`: {e}")))?;
        if recording.scenario != plan.name {
            let (its, ours) = (&recording.scenario, &plan.name);
            return Err(wrong(format!("is of the scenario \"{its}\", not of \"{ours}\"")));
        }
        if let Some(pair) = recording.events.windows(2).find(|pair| pair[0].step > pair[1].step) {
            let (first, second) = (pair[0].step, pair[1].step);
            return Err(wrong(format!(
                "has an event of step {first} before one of step {second}; they must be in order"
            )));
        }
        Ok(recording)
    }

    /// Writes it as JSON.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let written = write_whole(path, |file| {
            serde_json::to_writer(&mut *file, self)?;
            file.write_all(b"\n")
        });
        written.map_err(|source| Error::Write { file: path.to_owned(), source })
    }

    /// Does what was done before step `session.steps()`.
    ///
    /// # Errors
    /// As [`Session::act`].
    pub fn act(&self, session: &mut Session) -> Result<(), Error> {
        let step = session.steps();
        let from = self.events.partition_point(|e| e.step < step);
        let due = self.events[from..].iter().take_while(|e| e.step == step);
        due.into_iter().try_for_each(|event| session.act(event.action.clone()))
    }

    /// Replays it at once.
    ///
    /// # Errors
    /// As [`Session::act`] and [`Session::step`].
    pub fn replay(&self, plan: &Plan) -> Result<Session, Error> {
        let mut session = Session::new(plan)?;
        while session.steps() < self.steps {
            self.act(&mut session)?;
            session.step()?;
        }
        self.act(&mut session)?;
        Ok(session)
    }
}
