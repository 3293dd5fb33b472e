//! What can be wrong with a grasp.

use thiserror::Error;

/// Errors of the grasp layer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The engine failed or reported a fault.
    #[error(transparent)]
    Engine(#[from] crate::mujoco::Error),
    /// An effector is the target itself.
    #[error("the effector {0} is the target (or a part of it); effectors are links of the hand that touch the target")]
    EffectorIsTarget(String),
    /// The target is a part of the hand's own kinematic tree.
    #[error(
        "the target {target} belongs to the same kinematic tree as the palm {palm}; a target must be a body of its own, for example with a free joint"
    )]
    TargetInHand {
        /// Name of the target.
        target: String,
        /// Name of the palm.
        palm: String,
    },
    /// The target cannot move.
    #[error("the target {0} is static: it has no joint, so nothing can hold or drop it; give it a free joint")]
    StaticTarget(String),
    /// An effector does not hang from the palm.
    #[error(
        "the effector {effector} does not lie below the palm {palm}; name a common ancestor of all effectors as the palm, or leave the palm out"
    )]
    EffectorOutsideHand {
        /// Name of the effector.
        effector: String,
        /// Name of the palm.
        palm: String,
    },
    /// No link could hold the target.
    #[error("no effectors: the palm {0} has no link below it with a geom; name the effectors, or another palm")]
    NoEffectors(String),
    /// The world is the palm of fingers that stand on it, and none are named.
    #[error("no effectors: with the world as the palm, name the links that may hold the target")]
    WorldWithoutEffectors,
    /// Two grasps of one target have a link in common.
    #[error(
        "{link} is in the hand of another grasp of the target {target} already (grasp {grasp}, palm {palm}); a link may belong to one grasp of a target: give each of them a hand of its own, with palms none of which is above the other, or leave one of them out"
    )]
    SharedLink {
        /// Label of the first link that both hands have.
        link: String,
        /// Label of the target.
        target: String,
        /// The other grasp's place in the order in which they were added, from 0.
        grasp: usize,
        /// Label of its palm.
        palm: String,
    },
    /// Neither palm nor effectors are given, and nothing looks like a hand.
    #[error(
        "neither a palm nor effectors are given, and no hand is found: nothing that actuators or mocap bodies drive has two fingers that can touch the target; name the palm or the effectors"
    )]
    NoHand,
    /// Neither palm nor effectors are given, and there are several hands.
    #[error("neither a palm nor effectors are given, and several hands can touch the target; name the palm, one of: {}", .0.join(", "))]
    SeveralHands(Vec<String>),
    /// A threshold that is not a positive number, or not below the other.
    #[error("{name} is {value} N; {expected}")]
    Threshold {
        /// Which threshold.
        name: &'static str,
        /// Its value \[N\].
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A time that is negative or not a number.
    #[error("{name} is {value} s; it must be a finite number, at least 0")]
    Time {
        /// Which time.
        name: &'static str,
        /// Its value \[s\].
        value: f64,
    },
    /// Spring, damper or impedance of a weld's axes that make no sense.
    #[error("{name} is {value}; {expected}")]
    Softness {
        /// The field of the spec.
        name: &'static str,
        /// Its value.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// A body that the model does not have.
    #[error(
        "the {role} is body number {index}, but the model has {count} bodies, numbered from 0; take ids from the model that is simulated"
    )]
    NoSuchBody {
        /// Target, palm or effector.
        role: &'static str,
        /// Its number.
        index: usize,
        /// How many bodies there are.
        count: usize,
    },
    /// Grasps are stepped with a simulation of another model.
    #[error(
        "these grasps are for another model than the simulation's: its {what} is {simulation}, theirs {grasps}; make grasps of its own for each model"
    )]
    OtherModel {
        /// What differs.
        what: &'static str,
        /// In the model of the grasps.
        grasps: String,
        /// In the simulation's model.
        simulation: String,
    },
    /// An integrator whose step cannot be taken apart.
    #[error(
        "a grasp needs integrator Euler or implicit; the model's is RK4, which evaluates the contacts four times within a step"
    )]
    Integrator,
    /// A form of the constraint that needs a weld, without one.
    #[error(
        "limits \"{limits}\" needs a weld between the hand and the target {target}, and the model has none; load it with Model::from_xml_file_with(path, &grasp::weld_xml(target, None)), or append that element to the model's text after all other equality constraints"
    )]
    NoWeld {
        /// Which limits were asked for.
        limits: &'static str,
        /// Label of the target.
        target: String,
    },
    /// The weld already holds the target.
    #[error(
        "the weld of the target {0} is switched on in the model: it must have active=\"false\", the grasp switches it on when it latches (see grasp::weld_xml)"
    )]
    WeldActive(String),
    /// The weld's rows are not as they must be.
    #[error(
        "the engine did not make six constraint rows, after those of all other equality constraints, for each weld of the {welds} latched grasps at t = {time:.4} s; each grasp with limits \"box\" or \"rigid\" needs a weld of its own, the last equality constraints of the model, and the flag \"equality\" enabled"
    )]
    WeldRows {
        /// Simulated time \[s\].
        time: f64,
        /// Welds switched on.
        welds: usize,
    },
    /// A saved state is not of this grasp.
    #[error(
        "the saved state is of another grasp: its {what} is {saved}, that of this one {here}; restore it into a grasp that is made with the same spec, of the same model"
    )]
    OtherState {
        /// What differs.
        what: &'static str,
        /// In the state.
        saved: String,
        /// In the grasp.
        here: String,
    },
    /// A saved state that no grasp can have been in.
    #[error("the saved state is damaged: its {0} cannot be that of any grasp (ids within the model, finite numbers)")]
    BadState(&'static str),
    /// A contact with parameters that are no numbers.
    #[error(
        "the {what} of the contact between {} and {} is not finite at t = {time:.4} s: give both geoms (or their pair) finite numbers", geoms[0], geoms[1]
    )]
    BadContact {
        /// Simulated time \[s\].
        time: f64,
        /// Which parameter.
        what: &'static str,
        /// Labels of the two geoms.
        geoms: [String; 2],
    },
    /// Something besides the contacts accelerates without bounds.
    #[error(
        "{joint} would not have a finite acceleration at t = {time:.4} s even without contacts: {cause}; the step was not made"
    )]
    BadAcceleration {
        /// Simulated time \[s\].
        time: f64,
        /// Label of the first joint.
        joint: String,
        /// The bad number, if it is in what a user sets between steps.
        cause: String,
    },
    /// The grasp solve met numbers that are not finite.
    #[error(
        "the grasp solve diverged at t = {time:.4} s: {what} is not finite; the step was not made: look for a load that is too large; a smaller time step or softer contacts may help"
    )]
    Diverged {
        /// Simulated time \[s\].
        time: f64,
        /// Which quantity.
        what: &'static str,
    },
}
