//! Plots, scatter plots and tables: what they must contain, and what they make of incomplete numbers.

use mujoco_grasp::report::{
    BenchRow, BenchTable, Curve, Curves, Mark, MotionPlot, PointSet, Push, ReportError, Scatter, Threshold, Timing,
    Trace,
};

fn trace(label: &str, n: usize) -> Trace {
    let time_s: Vec<f64> = (0..n).map(|i| i as f64 * 0.01).collect();
    Trace {
        label: label.to_owned(),
        position_mm: time_s.iter().map(|t| [t.sin(), -t, 0.5]).collect(),
        rotation_deg: time_s.iter().map(|t| 3.0 * t).collect(),
        normal_force_n: vec![2.5; n],
        quality_n: vec![0.3; n],
        time_s,
    }
}

fn plot() -> MotionPlot {
    MotionPlot {
        title: "clutch <fp1> & co".to_owned(),
        push: Some(Push { start_s: 0.4, end_s: 0.6, label: "fp1 (0, -9.5, 0) N".to_owned() }),
        marks: vec![Mark { time_s: 0.25, label: "latched".to_owned() }],
        thresholds: vec![Threshold { quality_n: 0.2, label: "Q_Th".to_owned() }],
        traces: vec![trace("full", 101), trace("grasp", 101)],
        ..MotionPlot::default()
    }
}

/// The text elements of an SVG, in order.
fn texts(svg: &str) -> Vec<String> {
    let elements = svg.split("<text").skip(1);
    let content = |e: &str| {
        let inner = &e[e.find('>').expect("an element") + 1..e.find("</text>").expect("its end")];
        inner.trim().to_owned()
    };
    elements.map(content).collect()
}

/// Curves of a colour (`#RRGGBB`), as points.
fn polylines(svg: &str, color: &str) -> Vec<Vec<(f64, f64)>> {
    let stroke = format!("stroke=\"{color}\"");
    let of_color = svg.split("<polyline").skip(1).filter(|e| e[..e.find("/>").unwrap_or(0)].contains(&stroke));
    let points = |e: &str| {
        let from = e.find("points=\"").expect("points") + 8;
        let text = &e[from..from + e[from..].find('"').expect("end of points")];
        let pair = |p: &str| p.split_once(',').map(|(x, y)| (x.parse().expect("x"), y.parse().expect("y")));
        text.split_whitespace().filter_map(pair).collect()
    };
    of_color.map(points).collect()
}

const GRASP: &str = "#CD4600";

#[test]
fn every_quantity_has_its_name_and_unit_and_the_legend_names_everything() {
    let svg = plot().svg().expect("a plot");
    let texts = texts(&svg);
    for wanted in [
        "distance moved [mm]",
        "x in palm [mm]",
        "y in palm [mm]",
        "z in palm [mm]",
        "rotation [deg]",
        "normal force [N]",
        "quality Q [N]",
        "full",
        "grasp",
        "push fp1 (0, -9.5, 0) N, 0.4 s to 0.6 s",
        "latched at 0.25 s",
        "Q_Th = 0.2 N",
    ] {
        assert!(texts.iter().any(|t| t == wanted), "no {wanted:?} among {texts:?}");
    }
    assert_eq!(texts.iter().filter(|t| *t == "time [s]").count(), 7, "one per panel");
    assert!(svg.contains("clutch &lt;fp1&gt; &amp; co"), "the title is escaped");
}

#[test]
fn nan_leaves_a_gap_in_its_own_curve_only() {
    let whole = polylines(&plot().svg().expect("a plot"), GRASP).len();
    let mut plot = plot();
    for value in &mut plot.traces[1].rotation_deg[40..45] {
        *value = f64::NAN;
    }
    plot.traces[1].rotation_deg[60] = f64::INFINITY;
    let svg = plot.svg().expect("a plot with gaps");
    assert_eq!(polylines(&svg, GRASP).len(), whole + 2, "two gaps split one curve into three");
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn a_column_that_nobody_recorded_says_so() {
    let mut plot = plot();
    for trace in &mut plot.traces {
        trace.quality_n.clear();
    }
    assert!(texts(&plot.svg().expect("a plot")).contains(&"not recorded".to_owned()));
    plot.traces[0].quality_n = vec![0.1; 101];
    assert!(!texts(&plot.svg().expect("a plot")).contains(&"not recorded".to_owned()));
}

#[test]
fn nothing_to_draw_is_an_error_and_not_an_empty_picture() {
    let empty = |plot: MotionPlot| match plot.svg() {
        Err(ReportError::Empty { missing, .. }) => missing,
        other => panic!("expected an error, got {other:?}"),
    };
    empty(MotionPlot::default());
    let one = MotionPlot { traces: vec![trace("full", 1)], ..MotionPlot::default() };
    assert!(empty(one).contains("two times"));
    let mut bad = plot();
    for trace in &mut bad.traces {
        trace.position_mm.iter_mut().for_each(|p| *p = [f64::NAN; 3]);
        trace.rotation_deg.clear();
        trace.normal_force_n.fill(f64::INFINITY);
        trace.quality_n.fill(f64::NAN);
    }
    assert!(empty(bad).contains("finite"));
    let elsewhere = MotionPlot { window_s: Some((5.0, 6.0)), ..plot() };
    empty(elsewhere);
    let backwards = MotionPlot { window_s: Some((1.0, 0.0)), ..plot() };
    empty(backwards);
}

#[test]
fn a_column_of_the_wrong_length_is_named() {
    let mut plot = plot();
    plot.traces[1].normal_force_n.pop();
    let message = plot.svg().expect_err("100 values for 101 times").to_string();
    for part in ["grasp", "normal_force_n", "100", "101"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn an_event_without_a_time_is_named() {
    let mut bad = plot();
    bad.marks[0].time_s = f64::NAN;
    let message = bad.svg().expect_err("no time").to_string();
    assert!(message.contains("latched") && message.contains("NaN"), "{message}");
    for limit in [f64::NAN, f64::INFINITY] {
        let bad = MotionPlot { motion_limit_mm: Some(limit), ..plot() };
        let message = bad.svg().expect_err("no limit").to_string();
        assert!(message.contains("motion_limit_mm"), "{message}");
    }
}

#[test]
fn a_fall_is_cut_at_the_motion_limit() {
    let mut plot = plot();
    let fallen: Vec<[f64; 3]> = (0..101).map(|i| [0.0, -f64::from(i).powi(2), 0.0]).collect();
    plot.traces[1].position_mm = fallen;
    plot.motion_limit_mm = Some(20.0);
    let svg = plot.svg().expect("a plot");
    // Ticks up to the limit, none of the 10000 mm that it falls.
    let ticks: Vec<f64> = texts(&svg).iter().filter_map(|t| t.parse().ok()).collect();
    let largest = ticks.iter().fold(0.0, |a: f64, t| a.max(t.abs()));
    assert!((10.0..=20.0).contains(&largest), "{ticks:?}");
}

#[test]
fn a_picture_shows_what_the_document_does() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("motion.PNG");
    plot().save(&path).expect("saved");
    let picture = image::open(&path).expect("a PNG").into_rgb8();
    assert_eq!(picture.dimensions(), (2 * 1180, 2 * 1080));
    let count = |color: [u8; 3]| picture.pixels().filter(|p| p.0 == color).count();
    assert!(count([205, 70, 0]) > 1000, "the grasp's curves");
    assert!(count([126, 192, 238]) > 1000, "the full solve's, not hidden under the grasp's");
    assert!(count([248, 236, 200]) > 100_000, "the push");
    let svg = folder.path().join("motion.svg");
    plot().save(&svg).expect("saved");
    assert_eq!(std::fs::read_to_string(&svg).expect("text"), plot().svg().expect("svg"));
}

#[test]
fn names_and_places_that_cannot_be_written_are_errors() {
    let message = plot().save("motion.gif").expect_err("no such format").to_string();
    assert!(message.contains("motion.gif") && message.contains(".svg"), "{message}");
    for name in ["/nonexistent-folder/a.svg", "/nonexistent-folder/a.png"] {
        let error = plot().save(name).expect_err("no such folder");
        assert!(matches!(error, ReportError::Write { .. }), "{error:?}");
        assert!(error.to_string().contains(name), "{error}");
    }
}

fn scatter(log: bool, points: Vec<(f64, f64)>) -> Scatter {
    Scatter {
        title: "peak motion".to_owned(),
        x_label: "full [mm]".to_owned(),
        y_label: "grasp [mm]".to_owned(),
        sets: vec![PointSet { label: "held".to_owned(), points, names: Vec::new() }],
        log,
    }
}

#[test]
fn equal_values_lie_on_the_diagonal_of_a_scatter_plot() {
    for log in [false, true] {
        let svg = scatter(log, vec![(0.1, 0.1), (1.0, 1.0), (30.0, 30.0), (30.0, 0.1)]).svg();
        let svg = svg.expect("a plot");
        let circles: Vec<(f64, f64)> =
            svg.split("<circle").skip(1).map(|e| (attribute(e, "cx"), attribute(e, "cy"))).collect();
        // The last circle but the legend's is off the diagonal and spans the other points' square.
        let [a, b, c, d] = circles[..4] else { panic!("{circles:?}") };
        assert_eq!((d.0, d.1), (c.0, a.1));
        let slope = (c.1 - a.1) / (c.0 - a.0);
        let on_diagonal = a.1 + slope * (b.0 - a.0);
        assert!((on_diagonal - b.1).abs() <= 1.0, "{on_diagonal} {}", b.1);
        for label in ["full [mm]", "grasp [mm]", "held (4)", "equal in both"] {
            assert!(texts(&svg).iter().any(|t| t == label), "{label}");
        }
    }
}

fn attribute(element: &str, name: &str) -> f64 {
    let from = element.find(&format!("{name}=\"")).expect("the attribute") + name.len() + 2;
    element[from..from + element[from..].find('"').expect("its end")].parse().expect("a number")
}

#[test]
fn points_that_cannot_be_shown_are_counted_and_none_is_an_error() {
    let points = vec![(1.0, 2.0), (0.0, 1.0), (f64::NAN, 1.0), (-1.0, 2.0)];
    let left_out = |log| {
        let svg = scatter(log, points.clone()).svg().expect("a plot");
        texts(&svg).into_iter().find(|t| t.starts_with("points left out"))
    };
    assert_eq!(left_out(true).as_deref(), Some("points left out: 3 (not positive or not finite)"));
    assert_eq!(left_out(false).as_deref(), Some("points left out: 1 (not finite)"));
    for log in [false, true] {
        let none = scatter(log, vec![(f64::NAN, 1.0)]).svg();
        assert!(matches!(none, Err(ReportError::Empty { .. })), "{none:?}");
    }
    // One point, and points all alike, have no range of their own.
    scatter(false, vec![(0.0, 0.0)]).svg().expect("a plot");
    scatter(true, vec![(2.0, 2.0); 3]).svg().expect("a plot");
}

fn bench() -> BenchTable {
    let timing = |step_us, contact_us| Timing { step_us, contact_us: Some(contact_us) };
    BenchTable {
        title: "cost".to_owned(),
        rows: vec![BenchRow {
            label: "clutch, pushed".to_owned(),
            ik_us: Some(812.3),
            full: timing(300.0, 160.0),
            full_noslip: timing(400.0, 240.0),
            grasp: timing(150.0, 20.0),
            exact: None,
            floor: timing(130.0, 0.0),
        }],
    }
}

#[test]
fn the_table_has_the_thesis_beside_ours_with_the_ratios() {
    let text = bench().text();
    let row = |name: &str| -> Vec<String> {
        let line = text.lines().find(|l| l.contains(name)).expect("a row");
        line.split('|').map(|c| c.trim().to_owned()).filter(|c| !c.is_empty()).collect()
    };
    assert_eq!(row("experiment 1")[1..6], ["4306", "94", "-", "12", "7.8x"]);
    assert_eq!(row("experiment 2")[1..6], ["2261", "39", "-", "5.0", "7.8x"]);
    let ours = row("clutch");
    assert_eq!(ours[1..7], ["812", "160", "240", "20", "8.0x", "12.0x"]);
    assert_eq!(ours[7..], ["300", "400", "150", "130"]);
    let widths: Vec<usize> = text.lines().map(|l| l.chars().count()).collect();
    assert!(widths.iter().all(|w| *w == widths[0]), "aligned:\n{text}");
}

#[test]
fn bars_are_as_long_as_their_times() {
    let svg = bench().svg().expect("bars");
    let widths = |color: &str| -> Vec<f64> {
        let of_color = svg.split("<rect").skip(1).filter(|e| e[..e.find("/>").unwrap_or(0)].contains(color));
        // The first is the legend's.
        of_color.skip(1).map(|e| attribute(e, "width")).collect()
    };
    let (contact, rest) = (widths("#E69F00"), widths("#7EC0EE"));
    let unit = (contact[1] + rest[1]) / 400.0;
    for (widths, times) in [(contact, [160.0, 240.0, 20.0, 0.0]), (rest, [140.0, 160.0, 130.0, 130.0])] {
        for (width, time) in widths.iter().zip(times) {
            assert!((width - unit * time).abs() <= 1.5, "{width} for {time} us");
        }
    }
    for label in ["time per step, median [\u{b5}s]", "full, noslip 10", "no contacts", "150 \u{b5}s (20)"] {
        assert!(texts(&svg).iter().any(|t| t == label), "{label}: {:?}", texts(&svg));
    }
}

#[test]
fn impossible_times_are_named() {
    assert!(matches!(BenchTable::default().svg(), Err(ReportError::Empty { .. })));
    let mut table = bench();
    table.rows[0].grasp.contact_us = Some(151.0);
    let message = table.svg().expect_err("more than the step").to_string();
    assert!(message.contains("contact_us") && message.contains("grasp"), "{message}");
    table.rows[0].grasp.contact_us = Some(f64::NAN);
    assert!(table.svg().is_err());
    let mut table = bench();
    table.rows[0].floor.step_us = 0.0;
    assert!(table.svg().expect_err("no time").to_string().contains("step_us"));
}

fn curves(points: Vec<(f64, f64)>, y_limit: Option<f64>) -> Curves {
    Curves {
        title: "cost".to_owned(),
        x_label: "contacts".to_owned(),
        y_label: "time [us]".to_owned(),
        curves: vec![Curve { label: "grasp".to_owned(), points }],
        y_limit,
    }
}

#[test]
fn curves_start_at_zero_and_end_at_the_cut() {
    let points = vec![(10.0, 20.0), (20.0, 40.0), (40.0, 80.0)];
    let whole = curves(points.clone(), None).svg().expect("curves");
    let line = &polylines(&whole, GRASP)[0];
    let [a, b, c] = line[..] else { panic!("{line:?}") };
    // all on one line through the origin: steps of x and y are in proportion
    assert!(
        ((c.1 - b.1) - 2.0 * (b.1 - a.1)).abs() <= 2.0 && ((c.0 - b.0) - 2.0 * (b.0 - a.0)).abs() <= 2.0,
        "{line:?}"
    );
    for label in ["contacts", "time [us]", "grasp", "cost"] {
        assert!(texts(&whole).iter().any(|t| t == label), "{label}");
    }
    let cut = curves(points, Some(60.0)).svg().expect("curves");
    let dots = |svg: &str| svg.split("<circle").count() - 1;
    assert_eq!((dots(&whole), dots(&cut)), (3, 2), "the point above the cut is left out");
}

#[test]
fn curves_that_cannot_be_drawn_are_refused() {
    assert!(matches!(curves(Vec::new(), None).svg(), Err(ReportError::Empty { .. })));
    for (points, limit) in [(vec![(1.0, -1.0)], None), (vec![(f64::NAN, 1.0)], None), (vec![(1.0, 1.0)], Some(0.0))] {
        assert!(matches!(curves(points, limit).svg(), Err(ReportError::BadNumber { .. })), "{limit:?}");
    }
}
