//! The pictures of the README: what the grasp constraint does and saves, and a film of each experiment.
//!
//! `cargo run --release --example pictures -- DOCS BENCH.json...`, or `scripts/pictures`, which measures first.
#![forbid(unsafe_code)]

mod film;
mod overview;
mod paper;
mod stage;

use anyhow::Context;
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let docs = arguments.next().context("usage: pictures DOCS BENCH.json...")?;
    let docs = Path::new(&docs);
    let benches: Vec<_> = arguments.collect();
    overview::save(&docs.join("overview.png"), &benches)?;
    film::save(&film::CLUTCH, &docs.join("clutch.gif"))?;
    film::save(&film::PINCH, &docs.join("pinch.gif"))
}
