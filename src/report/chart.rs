//! One quantity over time in both modes, small enough for a phone: the charts of a report page.

use plotters::prelude::*;

use super::ReportError;
use super::canvas::{Canvas, Figure, GREY, INK, ORANGE, SKY, VERMILION};
use super::panel::{Panel, Pen, Shade};
use super::series::{Run, clip, range, runs};

/// What one mode recorded of one quantity.
#[derive(Debug, Clone, Default)]
pub struct Series {
    /// The mode: "full", "grasp".
    pub label: String,
    /// Time \[s\] and value of each sample; NaN leaves a gap.
    pub points: Vec<(f64, f64)>,
}

/// When a grasp was latched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tier {
    /// When it begins \[s\].
    pub start_s: f64,
    /// When it ends \[s\].
    pub end_s: f64,
    /// Most of its steps were made on frozen geometry.
    pub merged: bool,
}

/// One quantity over time. The first series is a wide pale band and the second a thin dark line over it: both are seen where
/// they agree, in greyscale too. Latched times have a grey ground, darker on frozen geometry; a bar at the foot is the push.
///
/// ```
/// use mujoco_grasp::report::{Series, TimeChart};
/// let full = Series { label: "full".into(), points: vec![(0.0, 0.0), (0.5, 1.2), (1.0, 0.1)] };
/// let chart = TimeChart { y_label: "moved [mm]".into(), series: vec![full], ..TimeChart::default() };
/// assert!(chart.svg()?.contains("moved [mm]"));
/// assert_eq!(chart.in_words(), "full: from 0 at 0 s to 1.2 at 0.5 s, in the end 0.1");
/// # Ok::<(), mujoco_grasp::report::ReportError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct TimeChart {
    /// What a page names it by, with unit; without one, the axis's label.
    pub title: String,
    /// The axis's label, with unit; short, for it stands upright.
    pub y_label: String,
    /// The modes, full first.
    pub series: Vec<Series>,
    /// Drawn as dots, not as lines: samples of things that come and go.
    pub dots: bool,
    /// Grey grounds.
    pub tiers: Vec<Tier>,
    /// Start and end of the push \[s\].
    pub push_s: Option<(f64, f64)>,
    /// Dashed horizontal lines, in the unit of the quantity.
    pub levels: Vec<f64>,
    /// Times shown \[s\]; all when absent.
    pub window_s: Option<(f64, f64)>,
    /// Values beyond are cut, so that what is far away does not flatten the rest.
    pub limit: Option<f64>,
    /// The value axis fits what is within these times \[s\], and some more; what leaves it is cut. All times shown when absent.
    pub fit_s: Option<(f64, f64)>,
    /// Smallest span of the value axis, so that rounding noise is not blown up.
    pub least_span: f64,
}

const FIGURE: &str = "time chart";
const SIZE: (u32, u32) = (380, 230);
/// Pixel columns in which curves are thinned.
const COLUMNS: usize = 300;
const LATCHED: RGBColor = RGBColor(242, 242, 242);
const MERGED: RGBColor = RGBColor(224, 224, 224);
/// Height of the push's bar, as a part of the panel's.
const BAR: f64 = 0.035;
/// Room on either side for what leaves the times that an axis fits, as a part of its span.
const BEYOND: f64 = 0.25;

impl TimeChart {
    /// Where a page's script draws the time that is looked at: left, right, top and bottom of the axes in the SVG's units.
    pub const AXES: [f64; 4] = [80.0, 364.0, 8.0, 190.0];

    /// What it is called.
    pub fn name(&self) -> &str {
        if self.title.is_empty() { &self.y_label } else { &self.title }
    }

    /// The chart as an SVG document.
    ///
    /// # Errors
    /// [`ReportError::Empty`] without a time window, [`ReportError::BadNumber`] for a limit or level that is not finite.
    pub fn svg(&self) -> Result<String, ReportError> {
        self.to_svg()
    }

    /// Times shown, start and end \[s\]; `None` if there are none.
    pub fn window(&self) -> Option<(f64, f64)> {
        let times = || self.series.iter().flat_map(|s| &s.points).map(|p| p.0).filter(|t| t.is_finite());
        let all = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        let (start, end) = self.window_s.unwrap_or(all);
        (start < end && start.is_finite() && end.is_finite()).then_some((start, end))
    }

    /// The text alternative: of each series the extremes and the last value.
    pub fn in_words(&self) -> String {
        let of_series = |series: &Series| {
            let shown: Vec<_> = self.shown(series).collect();
            let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            match (shown.iter().min_by(by_value), shown.iter().max_by(by_value), shown.last()) {
                (Some(low), Some(high), Some(last)) => format!(
                    "{}: from {} at {} s to {} at {} s, in the end {}",
                    series.label,
                    short(low.1),
                    short(low.0),
                    short(high.1),
                    short(high.0),
                    short(last.1)
                ),
                _ => format!("{}: not recorded", series.label),
            }
        };
        self.series.iter().map(of_series).collect::<Vec<_>>().join("; ")
    }

    fn shown<'a>(&self, series: &'a Series) -> impl Iterator<Item = (f64, f64)> + 'a {
        let (start, end) = self.window().unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
        series.points.iter().copied().filter(move |(t, v)| (start..=end).contains(t) && v.is_finite())
    }

    fn range(&self) -> (f64, f64) {
        let limit = self.limit.unwrap_or(f64::INFINITY);
        let (start, end) = self.fit_s.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let (mut all, mut fit) = (Vec::new(), self.levels.clone());
        for (time, value) in self.series.iter().flat_map(|s| self.shown(s)) {
            let value = value.clamp(-limit, limit);
            all.push(value);
            fit.extend((start..=end).contains(&time).then_some(value));
        }
        if fit.len() == self.levels.len() {
            fit.extend(&all);
        }
        let (low, high) = range(fit.into_iter(), self.least_span).unwrap_or((0.0, 1.0));
        // Some more, but no further than there is something.
        let more = BEYOND * (high - low);
        let (low, high) =
            all.into_iter().fold((low, high), |(a, b), v| (a.min(v.max(low - more)), b.max(v.min(high + more))));
        // Room for the push's bar below the curves.
        (low - 2.0 * BAR * (high - low), high)
    }

    fn curve(&self, i: usize, window: (f64, f64), y: (f64, f64)) -> (Vec<Run>, Pen) {
        let (first, size) = (i == 0 && self.series.len() > 1, if self.dots { [3.6, 1.7] } else { [4.5, 1.5] });
        let (color, width) = if first { (SKY, size[0]) } else { (VERMILION, size[1]) };
        let pen = Pen { color, width, dashed: false };
        let points = &self.series[i].points;
        if self.dots {
            let dots: Vec<Run> = self.shown(&self.series[i]).map(|point| vec![point]).collect();
            return (clip(&dots, y), pen);
        }
        let (time, values): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        (clip(&runs(&time, &values, window, COLUMNS), y), pen)
    }
}

/// A number for reading aloud.
fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize };
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

impl Figure for TimeChart {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn check(&self) -> Result<(), ReportError> {
        let limits = self.limit.iter().map(|l| ("limit", *l)).chain(self.levels.iter().map(|l| ("a level", *l)));
        if let Some((what, value)) = limits.chain([("least_span", self.least_span)]).find(|(_, v)| !v.is_finite()) {
            let what = format!("{what} of `{}`", self.y_label);
            return Err(ReportError::BadNumber { figure: FIGURE, what, value, wanted: "finite" });
        }
        let missing = format!("`{}` needs at least two times, the first before the last", self.y_label);
        self.window().map(drop).ok_or(ReportError::Empty { figure: FIGURE, missing })
    }

    fn draw<B: DrawingBackend>(&self, canvas: &Canvas<B>) -> Result<(), ReportError> {
        let Some(window) = self.window() else { return Ok(()) };
        let y = self.range();
        let ground =
            |t: &Tier| Shade { x: (t.start_s, t.end_s), top: 1.0, color: if t.merged { MERGED } else { LATCHED } };
        let bar = |x: (f64, f64)| Shade { x, top: BAR, color: ORANGE };
        let level = |value: &f64| (*value, Pen { color: INK, width: 1.2, dashed: true });
        let has_data = self.series.iter().any(|s| self.shown(s).next().is_some());
        Panel {
            x_label: "time [s]",
            y_label: &self.y_label,
            x: window,
            y,
            shaded: self.tiers.iter().map(ground).chain(self.push_s.map(bar)).collect(),
            verticals: self.push_s.iter().flat_map(|p| [p.0, p.1]).map(|t| (t, THIN)).collect(),
            horizontals: self.levels.iter().map(level).collect(),
            curves: (0..self.series.len()).map(|i| self.curve(i, window, y)).collect(),
            note: (!has_data).then_some("not recorded"),
        }
        .draw(canvas)
    }
}

/// Where a push begins and ends.
const THIN: Pen = Pen { color: GREY, width: 1.0, dashed: true };

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_are_where_the_page_says() {
        let series = vec![Series { label: "full".into(), points: vec![(0.0, 0.0), (2.0, 1.0)] }];
        let chart = TimeChart { y_label: "q [N]".into(), series, ..TimeChart::default() };
        let svg = chart.svg().unwrap();
        let [left, right, top, bottom] = TimeChart::AXES.map(|v| v as i32);
        let lines = svg.lines().filter(|l| l.starts_with("<polyline")).map(|line| {
            let points = line.split('"').find(|p| p.contains(',')).unwrap().split_whitespace();
            points.map(|p| p.split(',').map(|x| x.parse().unwrap()).collect()).collect::<Vec<Vec<i32>>>()
        });
        let lines: Vec<_> = lines.collect();
        let near = |p: &[i32], x: i32, y: i32| (p[0] - x).abs() <= 1 && (p[1] - y).abs() <= 1;
        // The axes' lines end in their corners, to a pixel, and the curve's last point is at their right end.
        for (x, y) in [(left, bottom), (left, top), (right, bottom)] {
            assert!(lines.iter().flatten().any(|p| near(p, x, y)), "no line to {x}, {y}: {svg}");
        }
        let curve = lines.last().unwrap();
        assert!((curve.last().unwrap()[0] - right).abs() <= 1, "{curve:?}");
    }

    /// A bottle that was let go flattened all that it had done in the hand.
    #[test]
    fn an_axis_fits_the_times_that_it_is_told() {
        let points = (0..=100).map(|i| f64::from(i) * 0.1).map(|t| (t, if t < 8.0 { t.sin() } else { 60.0 })).collect();
        let series = vec![Series { label: "full".into(), points }];
        let chart = |fit_s| TimeChart { series: series.clone(), fit_s, ..TimeChart::default() };
        assert!(chart(None).range().1 > 60.0);
        let (low, high) = chart(Some((0.0, 7.9))).range();
        assert!((-1.5..-1.0).contains(&low) && (1.0..2.0).contains(&high), "{low} {high}");
        // No further than there are values, and everything where there is nothing to fit.
        assert_eq!(chart(Some((0.0, 10.0))).range(), chart(None).range());
        assert_eq!(chart(Some((20.0, 30.0))).range(), chart(None).range());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 1234.5, 0.012345, -2.5].map(short), ["0", "1234", "0.0123", "-2.5"]);
    }
}
