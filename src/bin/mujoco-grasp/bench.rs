use std::process::ExitCode;
#[derive(Debug, clap::Args)]
pub struct Args { scenario: String }
pub fn bench(_: &Args, _: crate::output::Output) -> anyhow::Result<ExitCode> { Ok(ExitCode::SUCCESS) }
