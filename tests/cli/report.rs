//! `report`: one page with everything in it, that a reader without network, mouse or eyes can use.

use crate::page::{collect, named, section};
use crate::program::{Called, call_in, changed_claw};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// What a page may have at most [bytes].
const LARGEST: usize = 15_000_000;

/// Between each `from` and the `to` after it.
fn between<'a>(text: &'a str, from: &'a str, to: &'a str) -> Vec<&'a str> {
    text.split(from).skip(1).map(|rest| rest.split(to).next().unwrap()).collect()
}

/// What `%XX` stands for.
fn decoded(url: &str) -> String {
    let mut parts = url.split('%');
    let mut bytes = parts.next().unwrap().as_bytes().to_vec();
    for part in parts {
        bytes.push(u8::from_str_radix(&part[..2], 16).unwrap());
        bytes.extend(part[2..].bytes());
    }
    String::from_utf8(bytes).unwrap()
}

/// The file of this name that the page holds.
#[track_caller]
fn held(html: &str, file: &str) -> String {
    let start = format!("<a download=\"{file}\" href=\"data:text/csv;charset=utf-8,");
    let files = between(html, &start, "\"");
    assert_eq!(files.len(), 1, "{file}");
    decoded(files[0])
}

fn column(csv: &str, name: &str) -> Vec<Option<f64>> {
    let mut rows = csv::Reader::from_reader(csv.as_bytes());
    let i = rows
        .headers()
        .unwrap()
        .iter()
        .position(|head| head == name)
        .unwrap_or_else(|| panic!("no {name} in {csv:.300}"));
    rows.records().map(|row| row.unwrap()[i].parse().ok()).collect()
}

/// A page about the claw under one push, whose name is no HTML; beside a table that `agree` has left.
#[test]
fn a_page_of_the_claw() {
    let (folder, path) =
        changed_claw(&[], &[("name = \"along\"", "name = \"<b>&'x\""), ("duration = 5.0", "duration = 4.2")]);
    let out = folder.path().join("out/claw");
    std::fs::create_dir_all(&out).unwrap();
    let trials = "trial,full,same_outcome,full_peak_motion_m,grasp_peak_motion_m\n0,held,true,0.001,0.00101\n7,slid,false,0.02,0.03\n";
    std::fs::write(out.join("agree-trials.csv"), trials).unwrap();
    let called = call_in(folder.path(), &["report", path.to_str().unwrap(), "--push", "<b>&'x", "--json"]);
    assert_eq!((called.status, called.stderr.as_str()), (0, ""));
    let json = called.json();
    let html = std::fs::read_to_string(folder.path().join(json["page"].as_str().unwrap())).unwrap();
    assert_eq!(json["page_bytes"].as_u64(), Some(html.len() as u64));
    assert!(html.len() < LARGEST, "{}", html.len());
    keys_are_on_the_reference_page(&json);
    it_needs_nothing_else(&html);
    it_has_all_parts(&html);
    pictures_and_plots_have_words(&html);
    the_film_is_of_both_modes(&html);
    the_numbers_are_those_of_the_runs(&html, &out, &json["runs"][0]);
    assert_eq!(held(&html, "agree-trials.csv"), trials);
    assert!(html.contains("1 of 2 random pushes have the same outcome"));
}

fn keys_are_on_the_reference_page(json: &Value) {
    let mut keys = BTreeSet::new();
    collect(json, &mut keys);
    named(&(section("### report") + &section("### run")), keys);
}

fn it_needs_nothing_else(html: &str) {
    for attribute in ["src=\"", "href=\""] {
        for place in between(html, attribute, "\"") {
            assert!(place.starts_with("data:") || place.starts_with('#'), "{attribute}{place:.60}");
        }
    }
    for loads in ["@import", "url(", "fetch(", "<iframe", "<object", "<link rel=\"stylesheet\""] {
        assert!(!html.contains(loads), "{loads}");
    }
    // What is linked to is there.
    for anchor in between(html, "href=\"#", "\"") {
        assert_eq!(html.matches(&format!(" id=\"{anchor}\"")).count(), 1, "{anchor}");
    }
    // The push's name is text wherever it stands.
    assert!(!html.contains("<b>") && html.contains("Push &lt;b&gt;&amp;&#39;x: (3.000, 0.000, 0.000) N"));
}

fn it_has_all_parts(html: &str) {
    let sections = [
        "What was simulated",
        "Results",
        "Cost per step, and the thesis&#39;s Table 5.1",
        "Agreement under random pushes",
    ];
    for title in sections {
        assert_eq!(
            html.matches(&format!("\">{title}</h2>")).count() + html.matches(&format!("<h2>{title}</h2>")).count(),
            1
        );
    }
    let parts = ["Telling moments", "In numbers", "Motion of the target", "Quality and normal forces of each finger"];
    for title in parts.into_iter().chain(["Friction against its limit", "Cost of a step", "Numbers to download"]) {
        assert_eq!(html.matches(&format!("<h3>{title}</h3>")).count(), 1, "{title}");
    }
    for moment in ["latched", "before", "push", "peak", "end"] {
        assert!(between(html, "<figcaption>", "</figcaption>").iter().any(|c| c.contains(moment)), "{moment}");
    }
    // The thesis's times, and ours in a column beside them.
    let table = between(html, "thesis, experiment 1", "</table>")[0];
    assert!(table.contains("<td>4306</td><td>2261</td>") && table.contains("here, pushed"), "{table}");
}

fn pictures_and_plots_have_words(html: &str) {
    assert!(between(html, "<img ", ">").iter().all(|img| !between(img, "alt=\"", "\"")[0].is_empty()));
    let charts = between(html, "role=\"img\"", "</svg>");
    // Seven of motion, two of forces and one of cost; of five fingers force and friction; the scatter plot.
    assert_eq!(charts.len(), 7 + 2 + 1 + 2 * 5 + 1);
    for chart in charts {
        let (title, words) =
            (between(chart, "<title id=\"", "</title>")[0], between(chart, "<desc id=\"", "</desc>")[0]);
        assert!(
            title.split('>').nth(1).unwrap().len() > 10 && words.split('>').nth(1).unwrap().len() > 20,
            "{title} {words}"
        );
        assert!(!words.contains("not recorded"), "{title}");
        let labelled = between(chart, "aria-labelledby=\"", "\"")[0];
        assert!(labelled.split(' ').all(|id| chart.contains(&format!("id=\"{id}\""))), "{labelled}");
    }
    // All other drawings are samples of lines, beside their words.
    assert_eq!(
        html.matches("<svg ").count(),
        html.matches("role=\"img\"").count() + html.matches("aria-hidden").count()
    );
}

fn the_film_is_of_both_modes(html: &str) {
    let frames: Vec<String> = serde_json::from_str(between(html, "id=\"frames\">", "</script>")[0]).unwrap();
    let film: Value =
        serde_json::from_str(between(html, "<script type=\"application/json\">", "</script>")[0]).unwrap();
    let row =
        |r: usize| film["rows"][r].as_array().unwrap().iter().map(|f| f.as_u64().unwrap() as usize).collect::<Vec<_>>();
    let (full, grasp) = (row(0), row(1));
    let times: Vec<f64> = film["times"].as_array().unwrap().iter().map(|t| t.as_f64().unwrap()).collect();
    assert!(times.len() > 30 && full.len() == times.len() && grasp.len() == times.len());
    assert!(times.windows(2).all(|t| t[0] < t[1]) && *times.last().unwrap() > 4.0);
    // Until the pin lets go both modes are the same simulation, and share their frames; once pushed they do not.
    for (i, time) in times.iter().enumerate() {
        assert!(full[i] < frames.len() && grasp[i] < frames.len());
        assert!(if *time < 2.0 { full[i] == grasp[i] } else { *time < 3.1 || full[i] != grasp[i] }, "{time}");
    }
    // JPEG begins with ff d8 ff.
    assert!(frames.iter().all(|jpeg| jpeg.starts_with("/9j/")));
    assert!(frames.iter().collect::<BTreeSet<_>>().len() > 30, "it moves");
}

fn the_numbers_are_those_of_the_runs(html: &str, out: &Path, pair: &Value) {
    for mode in ["full", "grasp"] {
        let file = format!("{mode}-<b>&'x.csv");
        let page = held(html, &format!("{mode}-&lt;b&gt;&amp;&#39;x.csv"));
        assert!(page == std::fs::read_to_string(out.join(&file)).unwrap(), "{file}");
    }
    let plots = held(html, "plots-&lt;b&gt;&amp;&#39;x.csv");
    for mode in ["full", "grasp"] {
        let moved = column(&plots, &format!("{mode}: distance moved [mm]"));
        let times = column(&plots, "time_s");
        let measured = times.iter().zip(moved).filter(|(t, _)| t.unwrap() >= 2.5).filter_map(|(_, v)| v);
        let peak = pair[mode]["peak_motion_m"].as_f64().unwrap() * 1e3;
        assert!((measured.fold(0.0, f64::max) - peak).abs() < 1e-3 * peak, "{mode}");
    }
    // They begin shortly before the latch, not with the way of the hand.
    let (first, latched) = (column(&plots, "time_s")[0].unwrap(), pair["grasp"]["latched_at_s"].as_f64().unwrap());
    assert!(first < latched && first > latched - 0.2, "{first} {latched}");
    let apart: Vec<f64> = column(&plots, "grasp against full: positions apart [um]").into_iter().flatten().collect();
    let rms = (apart.iter().map(|v| v * v).sum::<f64>() / apart.len() as f64).sqrt();
    let told = pair["compare"]["position_rmse_m"].as_f64().unwrap() * 1e6;
    assert!((rms - told).abs() < 1e-2 * told, "{rms} {told}");
    // condim 3 with friction 1: the share is friction over normal force, and never above 1.
    let contacts = held(html, "contacts-&lt;b&gt;&amp;&#39;x.csv");
    let [normal, friction, share] =
        ["normal_force_n", "friction_n", "friction_over_limit"].map(|name| column(&contacts, name));
    assert!(normal.len() > 300);
    for ((normal, friction), share) in normal.into_iter().zip(friction).zip(share) {
        let (normal, friction, share) = (normal.unwrap(), friction.unwrap(), share.unwrap());
        assert!((share - friction / normal).abs() < 1e-3 && share < 1.0 + 1e-6, "{normal} {friction} {share}");
    }
}

/// Bad input and folders that cannot be: said, and nothing that was computed is lost.
#[test]
fn what_is_in_the_way_is_said() {
    let (folder, path) = changed_claw(&[], &[("duration = 5.0", "duration = 4.2")]);
    let report = |options: &[&str]| -> Called {
        call_in(folder.path(), &[&["report", path.to_str().unwrap(), "--push", "down", "--json"], options].concat())
    };
    std::fs::write(folder.path().join("file"), "").unwrap();
    let called = report(&["--out", "file"]);
    assert_eq!(called.status, 1);
    assert!(called.json()["error"].as_str().unwrap().contains("cannot make the folder file"), "{}", called.stderr);

    std::fs::create_dir_all(folder.path().join("taken/report.html")).unwrap();
    let called = report(&["--out", "taken"]);
    assert_eq!(called.status, 1);
    let json = called.json();
    assert!(json["page"].is_null() && json["runs"][0]["full"]["outcome"] == "held");
    let error = json["error"].as_str().unwrap();
    assert!(error.contains("no page taken/report.html") && error.contains("the trajectories are in taken"), "{error}");
    assert!(folder.path().join("taken/grasp-down.csv").is_file());

    let called = report(&["--push", "up"]);
    assert_eq!(called.status, 2);
}
