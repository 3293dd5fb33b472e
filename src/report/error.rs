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
    Empty { figure: &'static str, missing: String },
    /// Two columns that belong together differ in length.
    #[error(
        "{figure}: `{series}` has {found} values of {field}, but {expected} are needed; give one for each point, or none at all"
    )]
    Length { figure: &'static str, series: String, field: &'static str, found: usize, expected: usize },
    /// A number that must be finite (or positive) is not.
    #[error("{figure}: {what} is {value}; it must be {wanted}")]
    BadNumber { figure: &'static str, what: String, value: f64, wanted: &'static str },
    /// The frames of a strip have different sizes.
    #[error(
        "strip of frames: frame {index} of row `{row}` is {found_width} x {found_height} pixels, the first frame is \
         {width} x {height}; render all frames at one size"
    )]
    FrameSize { row: String, index: usize, found_width: u32, found_height: u32, width: u32, height: u32 },
    /// The picture would be larger than a PNG viewer can be expected to open.
    #[error(
        "strip of frames: {width} x {height} pixels are too many (at most {limit} each way); use fewer or smaller frames"
    )]
    TooLarge { width: u64, height: u64, limit: u32 },
    /// The file name does not say which format is wanted.
    #[error("cannot save a figure as `{}`: the name must end in {wanted}", path.display())]
    Format { path: PathBuf, wanted: &'static str },
    /// The file could not be written.
    #[error("cannot write `{}`: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    /// The picture could not be encoded as PNG.
    #[error("cannot encode `{}` as PNG: {source}", path.display())]
    Encode { path: PathBuf, source: image::ImageError },
    /// The drawing library failed.
    #[error("drawing failed: {0}")]
    Draw(String),
}

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for ReportError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self::Draw(error.to_string())
    }
}
