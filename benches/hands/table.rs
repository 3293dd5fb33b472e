//! Tables in Markdown, and how their numbers are written.

/// A table: the first column to the left, numbers to the right.
pub fn markdown(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let head: Vec<String> = head.iter().map(|&name| name.to_owned()).collect();
    let rule = format!("|---|{}\n", "---:|".repeat(head.len().saturating_sub(1)));
    line(&head) + &rule + &rows.map(|row| line(&row)).collect::<String>()
}

/// Microseconds.
pub fn us(value: f64) -> String {
    if value < 99.95 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// A ratio of times.
pub fn ratio(value: f64) -> String {
    format!("{value:.2}")
}
