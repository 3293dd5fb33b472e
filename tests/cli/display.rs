//! A virtual display with a mouse and keys: Xvfb and xdotool, which `scripts/setup` installs.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long a window, or something in it, is waited for: other tests run at the same time.
const PATIENCE: Duration = Duration::from_secs(120);

/// A display of its own, gone when dropped.
pub struct Display {
    server: Child,
    pub name: String,
}

impl Display {
    pub fn start() -> Self {
        // Without -noreset the server starts over whenever its last client leaves, and a window that opens just when
        // xdotool leaves is never seen.
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|e| panic!("Xvfb does not start ({e}): scripts/setup installs it (apt install xvfb)"));
        let mut number = String::new();
        let out = server.stdout.take().expect("standard output");
        BufReader::new(out).read_line(&mut number).expect("the display's number");
        assert!(!number.trim().is_empty(), "Xvfb has no display to give");
        Self { server, name: format!(":{}", number.trim()) }
    }

    /// Calls xdotool; what it prints.
    pub fn xdotool(&self, args: &[&str]) -> String {
        let called = Command::new("xdotool").args(args).env("DISPLAY", &self.name).output();
        let output = called.unwrap_or_else(|e| {
            panic!("xdotool does not start ({e}): scripts/setup installs it (apt install xdotool)")
        });
        String::from_utf8(output.stdout).expect("text").trim().to_owned()
    }

    /// Waits for the program's window whose title is this regular expression's, gives it the keys, and returns its
    /// number.
    #[track_caller]
    pub fn window(&self, program: &mut Child, title: &str) -> String {
        let mut found = String::new();
        wait(&format!("a window {title}"), || {
            if let Some(status) = program.try_wait().expect("a program") {
                let mut said = String::new();
                program.stderr.take().expect("standard error").read_to_string(&mut said).expect("text");
                panic!("the program has ended ({status}): {said}");
            }
            found = self.xdotool(&["search", "--onlyvisible", "--name", title]);
            !found.is_empty()
        });
        let window = found.lines().last().expect("a line").to_owned();
        self.xdotool(&["windowfocus", &window]);
        window
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Until it is so.
#[track_caller]
pub fn wait(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "waited for {what}");
        sleep(Duration::from_millis(100));
    }
}
