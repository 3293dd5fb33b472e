//! Pictures of results: plots of the target's motion, strips of rendered frames, timing tables and scatter plots.
//!
//! Nothing here needs a display, a GPU or an installed font: text is drawn with fonts that are part of the program
//! (Ubuntu Light, from the crate `epaint_default_fonts`). Figures are saved as SVG or PNG after the file name's ending.
//!
//! | figure | what it shows |
//! |---|---|
//! | [`MotionPlot`] | the target's motion, contact forces and grasp quality over time, all modes in the same panels |
//! | [`Strip`] | rendered frames, a row for each mode, a column for each time |
//! | [`BenchTable`] | what a step costs, the thesis's Table 5.1 beside ours, as text and as bars |
//! | [`Scatter`] | a quantity in grasp mode against the same in full mode |
//! | [`Curves`] | costs against the size of a model |
//! | [`TimeChart`] | one quantity over time in both modes, small enough for a phone |
//! | [`Page`] | all of these with tables, films and numbers, in one HTML file |
//! | `Recording` (feature `rerun`) | the scene and its time series, for the Rerun viewer |

#![forbid(unsafe_code)]

mod canvas;
mod chart;
mod curves;
mod error;
mod legend;
mod page;
mod panel;
mod plot;
#[cfg(feature = "rerun")]
mod recording;
mod scatter;
mod series;
mod strip;
mod table;
mod trace;

pub use chart::{Series, Tier, TimeChart};
pub use curves::{Curve, Curves};
pub use error::ReportError;
pub use page::{Film, Page, Still};
pub use plot::MotionPlot;
#[cfg(feature = "rerun")]
pub use recording::{Frame, Look, Recording, TimeSeries, View};
pub use scatter::{PointSet, Scatter};
pub use strip::{Row, Strip};
pub use table::{BenchRow, BenchTable, Timing};
pub use trace::{Mark, Push, Threshold, Trace};
