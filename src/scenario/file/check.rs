//! Everything that can be said about the values of a scenario file without its model.

use std::collections::BTreeSet;
use std::path::Path;

use super::{
    ControlEntry, GraspEntry, PushEntry, ScenarioFile, Timeline, distinct, file_name, finite, non_negative, positive,
    wrong_frozen_tolerance,
};
use crate::grasp::Limits;
use crate::grasp::spec::{wrong_solimp, wrong_solref};
use crate::scenario::error::{Error, Field};

impl ScenarioFile {
    pub(super) fn check(&self, path: &Path) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, field);
        file_name(at("name"), &self.name)?;
        if self.model.as_os_str().is_empty() {
            return Err(at("model").wrong("is empty; give the MJCF file's path, relative to this file"));
        }
        if self.grasp.is_empty() {
            return Err(at("grasp").wrong("is missing; give at least one [[grasp]] with a target"));
        }
        self.check_timeline(path)?;
        if let Some((angle, wrong)) =
            self.frozen_tolerance.and_then(|angle| Some((angle, wrong_frozen_tolerance(angle)?)))
        {
            return Err(at("frozen_tolerance").wrong(format!("is {angle:?} rad; {wrong}")));
        }
        for (i, grasp) in self.grasp.iter().enumerate() {
            grasp.check(path, i)?;
            if let Some(j) = self.grasp[..i].iter().position(|g| g.target == grasp.target && g.palm == grasp.palm) {
                return Err(at(&format!("grasp[{i}]")).wrong(format!(
                    "has the target \"{}\" and the palm of grasp[{j}]; give each target and hand one [[grasp]]",
                    grasp.target
                )));
            }
        }
        for (i, control) in self.control.iter().enumerate() {
            control.check(path, i)?;
        }
        for (i, goal) in self.goal.iter().enumerate() {
            let field = format!("goal[{i}]");
            if let Some(start) = goal.start {
                non_negative(at(&format!("{field}.start")), start)?;
            }
            if self.goal[..i].iter().any(|g| g.effector_site == goal.effector_site) {
                return Err(at(&format!("{field}.effector_site"))
                    .wrong(format!("\"{}\" has a goal already; a site can go to one place", goal.effector_site)));
            }
        }
        let mut names = BTreeSet::new();
        for (i, push) in self.push.iter().enumerate() {
            push.check(path, i, self.timeline.duration)?;
            distinct(&mut names, at(&format!("push[{i}].name")), &push.name, "push; names")?;
            if push.target.is_none() && self.grasp.len() > 1 {
                return Err(at(&format!("push[{i}].target")).wrong(format!(
                    "is missing; with {} grasps, say which target is pushed: {}",
                    self.grasp.len(),
                    self.grasp.iter().map(|g| format!("\"{}\"", g.target)).collect::<Vec<_>>().join(", ")
                )));
            }
        }
        Ok(())
    }

    fn check_timeline(&self, path: &Path) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, field);
        let Timeline { duration, pin_until, .. } = self.timeline;
        let measure_from = self.timeline.measure_from();
        positive(at("timeline.duration"), duration)?;
        non_negative(at("timeline.pin_until"), pin_until)?;
        non_negative(at("timeline.measure_from"), measure_from)?;
        if pin_until > measure_from {
            return Err(at("timeline.measure_from").wrong(format!(
                "is {measure_from:?} s, before pin_until = {pin_until:?} s; measure only once the target is free"
            )));
        }
        if measure_from >= duration {
            return Err(at("timeline.measure_from")
                .wrong(format!("is {measure_from:?} s; it must be before the end, duration = {duration:?} s")));
        }
        Ok(())
    }
}

impl GraspEntry {
    fn check(&self, path: &Path, index: usize) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, &format!("grasp[{index}].{field}"));
        let mut seen = BTreeSet::new();
        for (i, effector) in self.effectors.iter().enumerate() {
            if *effector == self.target {
                return Err(at(&format!("effectors[{i}]"))
                    .wrong(format!("\"{effector}\" is the target itself; effectors are links of the hand")));
            }
            if !seen.insert(effector.as_str()) {
                return Err(at(&format!("effectors[{i}]")).wrong(format!("\"{effector}\" is listed twice")));
            }
        }
        if self.palm.as_ref() == Some(&self.target) {
            return Err(at("palm")
                .wrong(format!("\"{}\" is the target itself; the palm is the base of the fingers", self.target)));
        }
        if let Some(q) = self.latch_quality {
            positive(at("latch_quality"), q)?;
        }
        if let Some(q) = self.release_quality {
            non_negative(at("release_quality"), q)?;
            if let Some(latch) = self.latch_quality.filter(|&latch| q >= latch) {
                return Err(at("release_quality").wrong(format!(
                    "is {q:?} N; it must be below latch_quality = {latch:?} N, or the grasp would chatter"
                )));
            }
        }
        for (field, time) in [("latch_time", self.latch_time), ("release_time", self.release_time)] {
            time.map_or(Ok(()), |time| non_negative(at(field), time))?;
        }
        let boxed = self.limits == Some(Limits::Box);
        if self.relaxed.is_some() && !boxed {
            return Err(at("relaxed").wrong("has a meaning only with limits = \"box\""));
        }
        let axes = self.relaxed.as_deref().unwrap_or_default();
        if let Some((i, axis)) = axes.iter().enumerate().find(|(i, axis)| axes[..*i].contains(axis)) {
            let name = format!("{axis:?}").to_lowercase();
            return Err(at(&format!("relaxed[{i}]")).wrong(format!("\"{name}\" is listed twice")));
        }
        if self.axes.is_some() && !boxed {
            return Err(at("axes").wrong("has a meaning only with limits = \"box\""));
        }
        self.check_softness(path, index)?;
        if let Some(q) = self.axes {
            let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            if !norm.is_finite() || norm < 1e-6 {
                return Err(at("axes").wrong(format!("is {q:?}; give a quaternion w, x, y, z that is not zero")));
            }
        }
        Ok(())
    }

    fn check_softness(&self, path: &Path, index: usize) -> Result<(), Error> {
        let solref = |given: Option<[f64; 2]>| given.map(|x| (format!("{x:?}"), wrong_solref(&x)));
        let solimp = |given: Option<[f64; 5]>| given.map(|x| (format!("{x:?}"), wrong_solimp(&x)));
        let welded: &[Limits] = &[Limits::Box, Limits::Rigid];
        for (name, given, limits, named) in [
            ("solref", solref(self.solref), welded, "\"box\" or \"rigid\""),
            ("solimp", solimp(self.solimp), welded, "\"box\" or \"rigid\""),
            ("relaxed_solref", solref(self.relaxed_solref), &welded[..1], "\"box\""),
            ("relaxed_solimp", solimp(self.relaxed_solimp), &welded[..1], "\"box\""),
        ] {
            let Some((value, wrong)) = given else { continue };
            let field = Field::new(path, &format!("grasp[{index}].{name}"));
            if !self.limits.is_some_and(|chosen| limits.contains(&chosen)) {
                return Err(field.wrong(format!("has a meaning only with limits = {named}")));
            }
            if let Some(wrong) = wrong {
                return Err(field.wrong(format!("is {value}; {wrong}")));
            }
        }
        Ok(())
    }
}

impl ControlEntry {
    fn check(&self, path: &Path, index: usize) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, &format!("control[{index}].{field}"));
        non_negative(at("time"), self.time)?;
        if let Some(all) = self.all {
            finite(at("all"), all)?;
        }
        for (name, &value) in &self.set {
            finite(at(&format!("set.{name}")), value)?;
        }
        if self.all.is_none() && self.set.is_empty() {
            return Err(at("set").wrong("is missing, and so is `all`; an entry must set something"));
        }
        Ok(())
    }
}

impl PushEntry {
    fn check(&self, path: &Path, index: usize, end: f64) -> Result<(), Error> {
        let at = |field: &str| Field::new(path, &format!("push[{index}].{field}"));
        file_name(at("name"), &self.name)?;
        if matches!(self.name.as_str(), "all" | "none") {
            return Err(
                at("name").wrong(format!("\"{}\" has a meaning of its own in --push; choose another name", self.name))
            );
        }
        non_negative(at("start"), self.start)?;
        positive(at("duration"), self.duration)?;
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            finite(at(&format!("force[{k}] ({axis})")), self.force[k])?;
            finite(at(&format!("torque[{k}] ({axis})")), self.torque[k])?;
        }
        // Sums of decimal fractions: 4.6 + 1.4 may pass 6.0 by a rounding error.
        if self.start + self.duration > end + 1e-9 {
            return Err(at("duration").wrong(format!(
                "makes the push end at {:?} s; it must end by timeline.duration = {end:?} s",
                self.start + self.duration
            )));
        }
        Ok(())
    }
}
