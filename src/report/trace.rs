//! What a motion plot shows: the recorded columns and the events beside them.

/// What one mode recorded. The columns belong to `time_s`; a column may be empty (then its panel shows the other
/// modes only), and NaN leaves a gap in its curve.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// The mode, as the legend names it: "full", "grasp".
    pub label: String,
    /// Times of the samples \[s\], ascending.
    pub time_s: Vec<f64>,
    /// Translation of the target's frame in the palm's frame, from its pose at `measure_from` \[mm\].
    pub position_mm: Vec<[f64; 3]>,
    /// Angle of the target's rotation in the palm's frame, from its pose at `measure_from` \[degrees\].
    pub rotation_deg: Vec<f64>,
    /// Sum of the normal forces between hand and target \[N\].
    pub normal_force_n: Vec<f64>,
    /// Grasp quality Q (thesis Eq. 2.18) \[N\].
    pub quality_n: Vec<f64>,
}

/// The interval in which the target is pushed.
#[derive(Debug, Clone)]
pub struct Push {
    /// When it begins \[s\].
    pub start_s: f64,
    /// When it ends \[s\].
    pub end_s: f64,
    /// Its name and force, as the legend shows it: "fp1 (0, -9.5, 0) N".
    pub label: String,
}

/// An event at one time: the latch, the release.
#[derive(Debug, Clone)]
pub struct Mark {
    /// When \[s\].
    pub time_s: f64,
    /// What happened; the legend adds the time.
    pub label: String,
}

/// A level of the quality panel: Q_Th, Q_M.
#[derive(Debug, Clone)]
pub struct Threshold {
    /// Quality \[N\].
    pub quality_n: f64,
    /// The level's name; the legend adds the value.
    pub label: String,
}
