//! Recordings for the Rerun viewer (<https://rerun.io>): scenes and time series over simulated time, in one `.rrd` file.

mod layout;
mod scene;

use std::io::Write as _;
use std::path::Path;

use re_chunk::{Chunk, ChunkComponents, ChunkError, ChunkId, ChunkResult, RowId, TimeColumn, TimePoint};
use re_log_encoding::Encoder;
use re_log_types::{EntityPath, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreKind, StoreSource};
use re_sdk_types::archetypes::{RecordingInfo, Scalars, SeriesLines, SeriesPoints, TextLog};
use re_sdk_types::components::{Color, Name};
use re_sdk_types::{AsComponents, SerializationError, SerializedComponentColumn};

use super::ReportError;
use crate::whole_file::write_whole;

pub use layout::View;
pub use scene::Frame;

/// The timeline of all that has a time: simulated time, as the viewer's durations.
const TIMELINE: &str = "sim_time";

/// How a series looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// A line from value to value.
    Line,
    /// A dot for each value: for a quantity that may have several at one time.
    Dots,
}

/// One quantity over time.
#[derive(Debug, Clone)]
pub struct TimeSeries {
    /// Name in the viewer's legend, with its unit.
    pub name: String,
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// Line or dots.
    pub look: Look,
    /// Times \[s\] with the values at each, in order of time.
    pub points: Vec<(f64, Vec<f64>)>,
}

/// Recordings under construction; several in one file are listed one below the other in the viewer.
///
/// ```
/// use mujoco_grasp::report::{Look, Recording, TimeSeries, View};
/// let mut recording = Recording::new("pendulum", &[View::plot("angle", "angle_rad")])?;
/// recording.begin("swing")?;
/// let points = vec![(0.0, vec![0.1]), (0.5, vec![-0.1])];
/// recording.series("angle_rad", &TimeSeries { name: "angle [rad]".into(), rgb: [0, 114, 178], look: Look::Line, points })?;
/// # let folder = tempfile::tempdir()?;
/// recording.save(folder.path().join("swing.rrd"))?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Recording {
    application: String,
    store: StoreId,
    messages: Vec<LogMsg>,
}

impl Recording {
    /// For an application of this name; `views` are what the viewer shows of each recording at first.
    ///
    /// # Errors
    /// [`ReportError::Recording`].
    pub fn new(application: &str, views: &[View]) -> Result<Self, ReportError> {
        let store = StoreId::random(StoreKind::Blueprint, application);
        let mut recording = Self { application: application.to_owned(), store, messages: Vec::new() };
        layout::lay_out(&mut recording, views)?;
        Ok(recording)
    }

    /// Begins a recording; what follows belongs to it.
    ///
    /// # Errors
    /// [`ReportError::Recording`].
    pub fn begin(&mut self, name: &str) -> Result<(), ReportError> {
        self.open(StoreId::random(StoreKind::Recording, self.application.as_str()));
        self.log(EntityPath::properties(), &TimePoint::default(), &RecordingInfo::new().with_name(name))
    }

    /// A quantity over time, under the path `at` ("quality_n/full").
    ///
    /// # Errors
    /// [`ReportError::Recording`].
    pub fn series(&mut self, at: &str, series: &TimeSeries) -> Result<(), ReportError> {
        let path = EntityPath::from(at);
        let (name, color) = ([Name::from(series.name.as_str())], [Color::from(series.rgb)]);
        match series.look {
            Look::Line => self.log_static(path.clone(), &SeriesLines::new().with_names(name).with_colors(color))?,
            Look::Dots => self.log_static(path.clone(), &SeriesPoints::new().with_names(name).with_colors(color))?,
        }
        let lengths: Vec<usize> = series.points.iter().map(|(_, values)| values.len()).collect();
        let columns = Scalars::new(series.points.iter().flat_map(|(_, values)| values.iter().copied()));
        self.columns(path, series.points.iter().map(|(time, _)| *time), columns.columns(lengths))
    }

    /// What is said at a time \[s\], under the path `at`.
    ///
    /// # Errors
    /// [`ReportError::Recording`].
    pub fn text(&mut self, at: &str, time_s: f64, text: &str) -> Result<(), ReportError> {
        self.columns(EntityPath::from(at), [time_s], TextLog::new(text).columns_of_unit_batches())
    }

    /// Saves all recordings, and returns the size of the file in bytes.
    ///
    /// # Errors
    /// [`ReportError::Format`] for a name that does not end in `.rrd`, [`ReportError::Write`] with the system's reason,
    /// [`ReportError::Recording`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64, ReportError> {
        let path = path.as_ref();
        if super::canvas::extension(path) != "rrd" {
            return Err(ReportError::Format { path: path.to_owned(), wanted: ".rrd" });
        }
        let bytes = Encoder::encode(self.messages.iter().map(Ok)).map_err(|e| ReportError::Recording(e.to_string()))?;
        write_whole(path, |file| file.write_all(&bytes))
            .map_err(|source| ReportError::Write { path: path.to_owned(), source })?;
        Ok(bytes.len() as u64)
    }

    /// Begins a store: a recording, or the viewer's layout.
    fn open(&mut self, store: StoreId) {
        let info = StoreInfo::new(store.clone(), StoreSource::Other("mujoco-grasp".to_owned()));
        self.messages.push(LogMsg::SetStoreInfo(SetStoreInfo { row_id: *RowId::new(), info }));
        self.store = store;
    }

    fn log_static(&mut self, path: EntityPath, what: &dyn AsComponents) -> Result<(), ReportError> {
        self.log(path, &TimePoint::default(), what)
    }

    /// One row; at no time it is static.
    fn log(&mut self, path: EntityPath, at: &TimePoint, what: &dyn AsComponents) -> Result<(), ReportError> {
        self.push(Chunk::builder(path).with_archetype(RowId::new(), at.clone(), what).build())
    }

    /// A row for each time \[s\].
    fn columns(
        &mut self,
        path: EntityPath,
        times: impl IntoIterator<Item = f64>,
        columns: Result<impl Iterator<Item = SerializedComponentColumn>, SerializationError>,
    ) -> Result<(), ReportError> {
        let components: ChunkComponents = columns.map_err(failed)?.map(|c| (c.descriptor, c.list_array)).collect();
        let times = TimeColumn::new_duration_secs(TIMELINE, times);
        let timelines = std::iter::once((*times.timeline().name(), times)).collect();
        self.push(Chunk::from_auto_row_ids(ChunkId::new(), path, timelines, components))
    }

    fn push(&mut self, chunk: ChunkResult<Chunk>) -> Result<(), ReportError> {
        let message = chunk.and_then(|chunk| chunk.to_arrow_msg()).map_err(failed::<ChunkError>)?;
        self.messages.push(LogMsg::ArrowMsg(self.store.clone(), message));
        Ok(())
    }
}

fn failed<E: std::error::Error>(error: E) -> ReportError {
    ReportError::Recording(error.to_string())
}
