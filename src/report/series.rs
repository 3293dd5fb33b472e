//! Sampled curves made ready for drawing: cut to a window, split at gaps, thinned, clipped.

/// A piece of a curve without gaps.
pub(crate) type Run = Vec<(f64, f64)>;

/// The finite samples of a curve in a time window, split where samples are missing (NaN or infinite), and thinned: of
/// the samples of one of `columns` (pixel columns) only the first, the extremes and the last stay, which draws the same.
pub(crate) fn runs(time: &[f64], values: &[f64], window: (f64, f64), columns: usize) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let mut open = false;
    for (&t, &v) in time.iter().zip(values) {
        let shown = t.is_finite() && v.is_finite() && t >= window.0 && t <= window.1;
        if shown && !open {
            runs.push(Run::new());
        }
        open = shown;
        if let (true, Some(run)) = (shown, runs.last_mut()) {
            run.push((t, v));
        }
    }
    let width = (window.1 - window.0) / columns.max(1) as f64;
    runs.iter().map(|run| thin(run, window.0, width)).collect()
}

fn thin(run: &[(f64, f64)], start: f64, width: f64) -> Run {
    let column = |t: f64| ((t - start) / width).floor() as i64;
    let mut thinned = Run::new();
    for samples in run.chunk_by(|a, b| column(a.0) == column(b.0)) {
        let last = samples.len() - 1;
        let by_value = |&a: &usize, &b: &usize| samples[a].1.total_cmp(&samples[b].1);
        let low = (0..=last).min_by(by_value).unwrap_or(0);
        let high = (0..=last).max_by(by_value).unwrap_or(0);
        let mut keep = [0, low.min(high), low.max(high), last].to_vec();
        keep.dedup();
        thinned.extend(keep.into_iter().map(|i| samples[i]));
    }
    thinned
}

/// Cuts curves at the lower and upper edge of a panel, at the exact crossing.
pub(crate) fn clip(runs: &[Run], (low, high): (f64, f64)) -> Vec<Run> {
    let mut clipped: Vec<Run> = Vec::new();
    for run in runs {
        if let [only] = run.as_slice() {
            clipped.extend((only.1 >= low && only.1 <= high).then(|| vec![*only]));
        }
        for pair in run.windows(2) {
            let Some((from, to)) = clip_segment(pair[0], pair[1], low, high) else {
                continue;
            };
            match clipped.last_mut() {
                Some(last) if last.last() == Some(&from) => last.push(to),
                _ => clipped.push(vec![from, to]),
            }
        }
    }
    clipped
}

fn clip_segment(a: (f64, f64), b: (f64, f64), low: f64, high: f64) -> Option<((f64, f64), (f64, f64))> {
    if a.1.max(b.1) < low || a.1.min(b.1) > high {
        return None;
    }
    let at = |v: f64| (a.0 + (b.0 - a.0) * (v - a.1) / (b.1 - a.1), v);
    let inside = |p: (f64, f64)| {
        if p.1 < low {
            at(low)
        } else if p.1 > high {
            at(high)
        } else {
            p
        }
    };
    Some((inside(a), inside(b)))
}

/// The range of finite values with a margin, at least `minimum_span` wide so that rounding noise is not blown up.
pub(crate) fn range(values: impl Iterator<Item = f64>, minimum_span: f64) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return None;
    }
    let middle = 0.5 * (low + high);
    let half = 0.5 * (high - low).max(minimum_span) * 1.12;
    Some((middle - half, middle + half))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_samples_split_a_curve() {
        let time = [0.0, 1.0, 2.0, 3.0, 4.0];
        let values = [1.0, 2.0, f64::NAN, 4.0, f64::INFINITY];
        assert_eq!(runs(&time, &values, (0.0, 4.0), 100), vec![vec![(0.0, 1.0), (1.0, 2.0)], vec![(3.0, 4.0)]]);
    }

    #[test]
    fn thinning_keeps_the_extremes_of_each_column_in_order() {
        let time: Vec<f64> = (0..1000).map(|i| f64::from(i) * 1e-3).collect();
        let mut values: Vec<f64> = time.iter().map(|t| (40.0 * t).sin()).collect();
        values[333] = 7.0;
        values[334] = -7.0;
        let thinned = runs(&time, &values, (0.0, 1.0), 10).concat();
        assert!(thinned.len() <= 40 && thinned.len() >= 20, "{}", thinned.len());
        assert!(thinned.contains(&(0.333, 7.0)) && thinned.contains(&(0.334, -7.0)));
        assert!(thinned.windows(2).all(|p| p[0].0 < p[1].0));
    }

    #[test]
    fn clipping_cuts_at_the_crossing() {
        let zigzag = vec![vec![(0.0, 0.0), (1.0, 2.0), (2.0, 0.0)]];
        let clipped = clip(&zigzag, (-1.0, 1.0));
        assert_eq!(clipped, vec![vec![(0.0, 0.0), (0.5, 1.0)], vec![(1.5, 1.0), (2.0, 0.0)]]);
        assert!(clip(&zigzag, (3.0, 4.0)).is_empty());
    }

    #[test]
    fn range_of_noise_is_not_blown_up_and_nothing_has_no_range() {
        let (low, high) = range([1.0, 1.0 + 1e-12, f64::NAN].into_iter(), 0.1).expect("two finite values");
        assert!((high - low - 0.112).abs() < 1e-9);
        assert_eq!(range([f64::NAN].into_iter(), 0.1), None);
    }
}
