//! The page, from top to bottom.

use std::path::{Path, PathBuf};

use anyhow::Context;
use mujoco_grasp::mujoco;
use mujoco_grasp::report::{Film, Page, Still, TimeChart};
use mujoco_grasp::scenario::plan::Plan;
use mujoco_grasp::scenario::run::{Pair, Run};
use mujoco_grasp::scenario::runner::{Mode, Runner};

use super::charts::{self, Facts, Told, of_grasp};
use super::cost::Cost;
use super::film::{self, Shot};
use crate::output::number;
use crate::pictures::describe;
use crate::run::Simulated;
use crate::{scatters, summary};

/// Trajectories that are longer together stay beside the page [bytes].
const MOST_NUMBERS: u64 = 6_000_000;

/// The whole page, about what is in the folder `out`.
pub fn tell(
    plan: &Plan,
    simulated: &Simulated,
    detailed: &[Pair],
    cost: &Cost,
    shot: &Result<Shot, String>,
    out: &Path,
) -> anyhow::Result<Page> {
    let runner = Runner::new(plan, Mode::Full, None)?;
    let grasps = runner.grasps().iter().enumerate();
    let facts: Vec<Facts> = grasps.map(|(index, grasp)| Facts::of(&plan.model, index, grasp)).collect();
    let mut page = Page::new(format!("{}: what the grasp did, and what it cost", plan.name), &plan.about);
    if let Ok(shot) = shot {
        page.frames(&shot.jpegs);
    }
    setting(&mut page, plan, &facts);
    results(&mut page, simulated);
    for (i, pair) in detailed.iter().enumerate() {
        let film = shot.as_ref().map(|shot| &shot.films[i]).map_err(String::as_str);
        push(&mut page, plan, &facts, pair, film, out)?;
    }
    if detailed.len() < simulated.pairs.len() {
        page.text(
            "The other pushes are in the table above, their trajectories beside this page; --push NAME tells of one.",
        );
    }
    costs(&mut page, cost);
    agreement(&mut page, plan, out)?;
    Ok(page)
}

/// What was simulated.
fn setting(page: &mut Page, plan: &Plan, facts: &[Facts]) {
    page.section("What was simulated");
    page.text(
        "The same scene twice: \"full\" is MuJoCo's own contact solve, \"grasp\" has one six-axis constraint with the friction \
         limits of the contacts in their place while the grasp is latched. Motion is that of the target in the palm, from \
         its pose when measuring starts.",
    );
    let row = |label: &str, value: String| vec![label.to_owned(), value];
    let timeline = plan.timeline;
    let mut rows = vec![
        row("quantity", "value".into()),
        row("MuJoCo", mujoco::mujoco_version()),
        row("mujoco-grasp", env!("CARGO_PKG_VERSION").into()),
        row("degrees of freedom", plan.model.nv().to_string()),
        row("time step", format!("{} ms", plan.model.timestep() * 1e3)),
        row("duration", format!("{} s", timeline.duration)),
        row("target held in place until", format!("{} s", timeline.pin_until)),
        row("measuring starts at", format!("{} s", timeline.measure_from())),
    ];
    for grasp in facts {
        let n = if facts.len() > 1 { format!("grasp {}: ", grasp.index) } else { String::new() };
        rows.push(row(&format!("{n}target"), grasp.target.clone()));
        rows.push(row(&format!("{n}palm"), grasp.palm.clone()));
        rows.push(row(&format!("{n}limits"), grasp.limits.name().into()));
        rows.push(row(&format!("{n}Q_Th, it latches at"), format!("{:.4} N", grasp.latch_quality)));
        rows.push(row(&format!("{n}Q_M, it lets go below"), format!("{:.4} N", grasp.release_quality)));
    }
    for push in &plan.pushes {
        let when = format!("{}, from {} s to {} s", describe(Some(push)), push.start, push.end);
        rows.push(row("push", when));
    }
    page.table("Scene and settings", &rows);
}

/// Every push in a few numbers.
fn results(page: &mut Page, simulated: &Simulated) {
    page.section("Results");
    let mut rows = vec![["push", "full", "grasp", "apart, RMS [mm]", "of the peak"].map(str::to_owned).to_vec()];
    let outcome = |run: &Option<Run>| summary::outcome(run.as_ref().and_then(|r| r.summary.outcome)).to_owned();
    for pair in &simulated.pairs {
        let c = pair.compare.as_ref();
        if c.is_some_and(|c| c.vacuous) {
            page.text(&format!(
                "Push {}: grasp mode was latched for none of the compared time; both were the same simulation.",
                pair.push
            ));
        }
        rows.push(vec![
            pair.push.clone(),
            outcome(&pair.full),
            outcome(&pair.grasp),
            number(c.and_then(|c| c.position_rmse_m), 1e3, 4),
            number(c.and_then(|c| c.relative_error), 100.0, 2) + " %",
        ]);
    }
    page.table("Outcome of each push in both modes, and how far the motions are apart", &rows);
    for warning in &simulated.warnings {
        page.text(&format!("Warning: {warning}"));
    }
    for failure in &simulated.failures {
        page.text(&format!("Failed: {failure}"));
    }
}

/// One push: film, stills, numbers, charts.
fn push(
    page: &mut Page,
    plan: &Plan,
    facts: &[Facts],
    pair: &Pair,
    film: Result<&(Film, Vec<Still>), &str>,
    out: &Path,
) -> anyhow::Result<()> {
    let push = plan.pushes.iter().find(|p| p.name == pair.push);
    let about = film::about(plan, pair);
    page.section(&push.map_or_else(|| "Without push".to_owned(), |p| format!("Push {}", describe(Some(p)))));
    let of =
        |grasp: &Facts| if facts.len() > 1 { format!(", {} by {}", grasp.target, grasp.palm) } else { String::new() };
    let seen = |page: &mut Page| match film {
        Ok((film, stills)) => {
            page.film(film);
            page.heading("Telling moments");
            page.stills(&about, stills);
        }
        Err(why) => page.text(why),
    };
    let counted = |page: &mut Page| {
        for grasp in facts {
            let of = of(grasp);
            page.heading(&format!("In numbers{of}"));
            in_numbers(page, pair, grasp.index, &format!("{about}{of}"));
        }
    };
    page.columns(seen, counted);
    let (mut numbers, mut costs) = (Vec::new(), Vec::new());
    for grasp in facts {
        let of = of(grasp);
        let told = Told::new(plan, grasp, pair, push);
        let n = if grasp.index > 0 { format!(".grasp{}", grasp.index) } else { String::new() };
        let (plots, contacts) = (format!("plots-{}{n}.csv", pair.push), format!("contacts-{}.csv", pair.push));
        let (motion, forces) = (told.motion(), told.forces());
        page.heading(&format!("Motion of the target{of}"));
        page.text("From shortly before the latch. Where the target is lost in the end, the axes fit what was until it was let go.");
        page.key();
        page.charts(&about, &motion, &plots)?;
        page.heading(&format!("Quality and normal forces of each finger{of}"));
        page.charts(&about, &forces, &plots)?;
        page.heading(&format!("Friction against its limit{of}"));
        page.text("Each dot is a contact: large and pale in full mode, small and dark in grasp mode. At 1 it slides.");
        page.charts(&about, &told.friction(), &contacts)?;
        let mut plotted: Vec<TimeChart> = motion.into_iter().chain(forces).collect();
        if grasp.index == 0 {
            costs.push(told.cost());
            plotted.extend(costs.iter().cloned());
        }
        numbers.push((plots, "what the charts show, in their units".to_owned(), charts::numbers(&plotted)?));
    }
    let contacts = charts::contacts(plan, pair)?;
    numbers.push((format!("contacts-{}.csv", pair.push), "every contact, 25 times a second".to_owned(), contacts));
    let files = trajectories(pair, out);
    let size: u64 = files.iter().filter_map(|f| f.metadata().ok()).map(|m| m.len()).sum();
    let too_long = size * plan.pushes.len().max(1) as u64 > MOST_NUMBERS;
    for file in files.iter().filter(|_| !too_long) {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        numbers.push((name, "trajectory, a row for each step".to_owned(), text));
    }
    let downloads = |page: &mut Page| {
        page.heading("Numbers to download");
        if too_long {
            page.text(
                "The trajectories, a row for each step, are long: they are in files of their own beside this page.",
            );
        }
        page.numbers(&numbers);
    };
    let cost = |page: &mut Page| {
        page.heading("Cost of a step");
        page.charts(&about, &costs, &numbers[0].0)
    };
    Ok(page.columns(downloads, cost)?)
}

/// What `run` has written of these runs.
fn trajectories(pair: &Pair, out: &Path) -> Vec<PathBuf> {
    let of_run = |run: &Run| {
        let others = run.others.iter().map(|other| format!("{}.grasp{}.csv", run.stem(), other.index));
        [format!("{}.csv", run.stem())].into_iter().chain(others).map(|file| out.join(file)).collect::<Vec<_>>()
    };
    pair.runs().filter(|run| run.unwritten.is_none()).flat_map(of_run).collect()
}

/// The tables of `run`, a column for each mode.
fn in_numbers(page: &mut Page, pair: &Pair, grasp: usize, about: &str) {
    let runs = pair.runs().map(|run| summary::row(String::new(), run.mode, of_grasp(run, grasp).1));
    page.table(about, &columns(&summary::HEADS[1..], runs.map(|row| row[1..].to_vec()).collect()));
    let compared = pair.compare.as_ref().map(|c| {
        let others = pair.full.iter().flat_map(|run| &run.others).position(|o| o.index == grasp);
        others.and_then(|o| c.others.get(o)).unwrap_or(c)
    });
    if let Some(c) = compared {
        let row = summary::comparison("grasp against full".to_owned(), c);
        page.table("Both modes compared, until either has lost the target", &columns(&summary::COMPARED, vec![row]));
    }
}

/// Rows as columns, after one of their heads.
fn columns(heads: &[&str], rows: Vec<Vec<String>>) -> Vec<Vec<String>> {
    let column = |(i, head): (usize, &&str)| {
        let cells = rows.iter().map(|row| row.get(i).cloned().unwrap_or_default());
        [(*head).to_owned()].into_iter().chain(cells).collect()
    };
    heads.iter().enumerate().map(column).collect()
}

/// Table 5.1 of the thesis, and ours.
fn costs(page: &mut Page, cost: &Cost) {
    page.section("Cost per step, and the thesis's Table 5.1");
    match cost {
        Ok(table) => {
            let mut cells = table.cells();
            let heads = std::mem::take(&mut cells[0]);
            let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
            page.table("Medians, in microseconds; - where there is no such number", &columns(&heads, cells));
            page.text(
                "IK: one inverse-kinematics solve. \"contact\": the part of a step that is spent because of contacts or the grasp; that of grasp with every step \
                 whole. \"noslip\": full with 10 noslip iterations. \"floor\": without contacts and grasp. Pushed: along the \
                 first push, at half the size that is not held. The thesis's times are those of its own engine, on an i7-6820HK \
                 at 2.7 GHz; it tells no whole steps.",
            );
        }
        Err(why) => page.text(why),
    }
}

/// What an earlier `agree` left here, or in its default folder.
fn agreement(page: &mut Page, plan: &Plan, out: &Path) -> anyhow::Result<()> {
    const TABLE: &str = "agree-trials.csv";
    page.section("Agreement under random pushes");
    let folders = [out.to_owned(), Path::new("out").join(&plan.name)];
    let Some(text) = folders.iter().find_map(|folder| std::fs::read_to_string(folder.join(TABLE)).ok()) else {
        page.text("Not run: mujoco-grasp agree with the same folder, and then report again.");
        return Ok(());
    };
    let (scatter, [trials, alike]) = match scatters::of_table(&plan.name, &text) {
        Ok(scatter) => scatter,
        Err(e) => {
            page.text(&format!("{TABLE} cannot be read: {e}"));
            return Ok(());
        }
    };
    match scatter.svg() {
        Ok(svg) => {
            let words = format!("{alike} of {trials} random pushes have the same outcome in both modes");
            page.plot(&svg, "Peak motion in grasp mode against full mode", &words, TABLE);
        }
        Err(e) => page.text(&e.to_string()),
    }
    page.numbers(&[(TABLE.to_owned(), "every trial".to_owned(), text)]);
    Ok(())
}
