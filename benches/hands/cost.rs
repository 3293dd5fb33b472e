//! What a step of a generated hand costs: MuJoCo's own solve, the grasp, and neither.

use anyhow::{Context, ensure};
use mujoco_grasp::report::{Curve, Curves};
use mujoco_grasp::scenario::bench::{Phases, Timing, bench};

use super::hand::Hand;
use super::held;
use super::table::{markdown, ratio, us};

/// Steps in one call, as `mujoco-grasp bench` has it.
const SUBSTEPS: usize = 10;
/// A curve may be so many times as high as full and grasp before the plot cuts it.
const CUT: f64 = 1.6;

/// Medians of whole steps \[us\].
#[derive(Clone, Debug)]
pub struct Cost {
    hand: Hand,
    /// The model's own options: Newton, no noslip.
    full: f64,
    /// The cheapest of Newton, CG and PGS without noslip.
    cheapest: f64,
    /// The cheapest with 10 noslip iterations.
    noslip: f64,
    grasp: f64,
    /// No contacts.
    floor: f64,
}

impl Cost {
    /// The costs of each hand: of so many passes over all of them, the one in which the clock was fastest for that hand, as
    /// the floor tells, which neither solve has a part in.
    ///
    /// # Errors
    /// As `of`.
    pub fn of_all(hands: &[Hand], steps: usize, passes: usize) -> anyhow::Result<Vec<Self>> {
        let mut costs: Vec<Self> = Vec::new();
        for pass in 0..passes {
            for (i, hand) in hands.iter().enumerate() {
                eprintln!("pass {} of {passes}: {}", pass + 1, hand.name());
                let cost = Self::of(*hand, steps)?;
                match costs.get_mut(i) {
                    None => costs.push(cost),
                    Some(kept) if cost.floor < kept.floor => *kept = cost,
                    Some(_) => {}
                }
            }
        }
        Ok(costs)
    }

    /// Times `steps` steps of each at rest, with the interleaved turns of `mujoco-grasp bench`.
    ///
    /// # Errors
    /// A hand that does not hold as it was asked to, or does not stay latched while it is timed.
    fn of(hand: Hand, steps: usize) -> anyhow::Result<Self> {
        let plan = hand.plan()?;
        held::check(&hand, &plan)?;
        let report = bench(&plan, steps, SUBSTEPS, &|_| ())?;
        let Phases { full, full_noslip, full_default, grasp, floor, .. } = report.still;
        let unlatched = grasp.unlatched_steps.unwrap_or(0);
        ensure!(report.latched && unlatched == 0, "{}: {unlatched} timed steps were not latched", hand.name());
        let median = |timing: Timing| timing.step_us.context("nothing was timed");
        let (own, grasp, floor) = (median(full_default)?, median(grasp)?, median(floor)?);
        let cheapest = median(full)?.min(own);
        Ok(Self { hand, full: own, cheapest, noslip: median(full_noslip)?, grasp, floor })
    }

    fn cells(&self) -> Vec<String> {
        let hand = &self.hand;
        let sizes = [hand.contacts(), hand.nv()].map(|size| size.to_string());
        let times = [self.full, self.cheapest, self.noslip, self.grasp, self.floor];
        let ratios = [self.full / self.grasp, self.cheapest / self.grasp, self.noslip / self.grasp];
        let cells = [hand.name()].into_iter().chain(sizes).chain(times.map(us)).chain(ratios.map(ratio));
        cells.chain([ratio(self.grasp / self.floor)]).collect()
    }
}

/// The costs as a table, times in microseconds.
pub fn table(costs: &[Cost]) -> String {
    let head = [
        "hand",
        "contacts",
        "nv",
        "full",
        "full, cheapest",
        "noslip 10",
        "grasp",
        "floor",
        "full / grasp",
        "cheapest / grasp",
        "noslip 10 / grasp",
        "grasp / floor",
    ];
    markdown(&head, costs.iter().map(Cost::cells))
}

/// How the step grows from the first cost to the last, which differ in contacts only.
pub fn growth(costs: &[Cost]) -> String {
    let (Some(first), Some(last)) = (costs.first(), costs.last()) else { return String::new() };
    let contacts = [first, last].map(|cost| cost.hand.contacts());
    let more = (contacts[1] - contacts[0]) as f64;
    let row = |name: &str, of: &dyn Fn(&Cost) -> f64| {
        let (a, b) = (of(first), of(last));
        vec![name.to_owned(), us(a), us(b), us(b - a), format!("{:.2}", (b - a) / more)]
    };
    let head =
        ["[us]", &format!("{} contacts", contacts[0]), &format!("{} contacts", contacts[1]), "growth", "a contact"];
    let rows = [
        row("full", &|c| c.full),
        row("full, cheapest", &|c| c.cheapest),
        row("noslip 10", &|c| c.noslip),
        row("grasp", &|c| c.grasp),
        row("floor", &|c| c.floor),
    ];
    markdown(&head, rows.into_iter())
}

/// A plot over what `x` says of a hand.
pub fn plot(title: &str, x_label: &str, costs: &[Cost], x: impl Fn(&Hand) -> usize) -> Curves {
    let at = |cost: &Cost| x(&cost.hand) as f64;
    let y_limit = CUT * costs.iter().map(|c| c.full.max(c.grasp)).fold(0.0, f64::max);
    let curve = |name: &str, of: &dyn Fn(&Cost) -> f64| {
        let points: Vec<_> = costs.iter().map(|cost| (at(cost), of(cost))).collect();
        let cut = points.last().filter(|last| last.1 > y_limit);
        let more = cut.map_or_else(String::new, |(x, y)| format!("; cut off: {y:.0} \u{b5}s at {x:.0}"));
        Curve { label: format!("{name}{more}"), points }
    };
    Curves {
        title: title.to_owned(),
        x_label: x_label.to_owned(),
        y_label: "time per step, median [\u{b5}s]".to_owned(),
        curves: vec![
            curve("grasp", &|c| c.grasp),
            curve("full, the model's own options (Newton, no noslip: it creeps)", &|c| c.full),
            curve("full with 10 noslip iterations, the cheapest solver", &|c| c.noslip),
            curve("floor: no contacts", &|c| c.floor),
        ],
        y_limit: Some(y_limit),
    }
}
