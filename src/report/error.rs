//! What can go wrong when a figure is made.

use std::path::PathBuf;

use plotters::drawing::DrawingAreaErrorKind;
use thiserror::Error;

/// Why a figure could not be made. Each message says which figure and what would be right.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// There is nothing to show.
    #[error("{figure}: nothing to draw: {missing}")]
    Empty {
        /// Which figure.
        figure: &'static str,
        /// What is missing.
        missing: String,
    },
    /// Two columns that belong together differ in length.
    #[error(
        "{figure}: `{series}` has {found} values of {field}, but {expected} are needed; give one for each point, or none at all"
    )]
    Length {
        /// Which figure.
        figure: &'static str,
        /// Which column of the figure.
        series: String,
        /// Which field.
        field: &'static str,
        /// How many there are.
        found: usize,
        /// How many it takes.
        expected: usize,
    },
    /// A number that must be finite (or positive) is not.
    #[error("{figure}: {what} is {value}; it must be {wanted}")]
    BadNumber {
        /// Which figure.
        figure: &'static str,
        /// Which number.
        what: String,
        /// Its value.
        value: f64,
        /// What would be right.
        wanted: &'static str,
    },
    /// The frames of a strip have different sizes.
    #[error(
        "strip of frames: frame {index} of row `{row}` is {found_width} x {found_height} pixels, the first frame is \
         {width} x {height}; render all frames at one size"
    )]
    FrameSize {
        /// Label of the row.
        row: String,
        /// Its place, from 0.
        index: usize,
        /// Its width \[px\].
        found_width: u32,
        /// Its height \[px\].
        found_height: u32,
        /// Width \[px\].
        width: u32,
        /// Height \[px\].
        height: u32,
    },
    /// The picture would be larger than a PNG viewer can be expected to open.
    #[error(
        "strip of frames: {width} x {height} pixels are too many (at most {limit} each way); use fewer or smaller frames"
    )]
    TooLarge {
        /// Width \[px\].
        width: u64,
        /// Height \[px\].
        height: u64,
        /// The most there may be.
        limit: u32,
    },
    /// The file name does not say which format is wanted.
    #[error("cannot save a figure as `{}`: the name must end in {wanted}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What would be right.
        wanted: &'static str,
    },
    /// The file could not be written.
    #[error("cannot write `{}`: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The picture could not be encoded as PNG.
    #[error("cannot encode `{}` as PNG: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: image::ImageError,
    },
    /// The recording library failed, or the engine while its poses were recorded.
    #[cfg(feature = "rerun")]
    #[error("recording failed: {0}")]
    Recording(String),
    /// The drawing library failed.
    #[error("drawing failed: {0}")]
    Draw(String),
}

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for ReportError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self::Draw(error.to_string())
    }
}
