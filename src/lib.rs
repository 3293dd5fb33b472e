//! Grasps on MuJoCo at a fraction of the cost.
//!
//! A hand that holds something costs a physics engine many contacts in every step, for as long as it holds. Here a grasp
//! is watched until it is good enough; then its contacts leave MuJoCo's solve, and one six-axis constraint with the
//! friction limits of those same contacts takes their place. The object still gives, slides and drops as it would, and
//! when the grasp gets poor the contacts come back. The idea is that of Guerroudj (2022); the constraint is not (below).
//!
//! ```text
//!  MuJoCo                        grasp                                          MuJoCo
//!  ┌──────────────────────┐      ┌─────────────────────────────────────────┐    ┌────────────────────────┐
//!  │ kinematics, inertia, │      │ ungrasped: watch contacts and quality;  │    │ solve of all that is   │
//!  │ collision            ├─────►│   Q >= Q_Th for a while ──► grasped     ├───►│ left (floor, limits,   ├──► integrate
//!  │ (contacts, smooth    │      │ grasped: take the contacts out, solve   │    │ other objects), with   │
//!  │  accelerations)      │      │   them as one, put the forces on hand   │    │ the grasp's forces     │
//!  └──────────────────────┘      │   and target; no hold ──► ungrasped     │    └────────────────────────┘
//!                                └─────────────────────────────────────────┘
//! ```
//!
//! # The constraint
//!
//! Once latched, the contacts between hand and target are *one* problem in the target's six accelerations and the palm's
//! few: MuJoCo's own convex contact problem, with the same softness `R`, the same reference accelerations and the same
//! friction cones ([`grasp::contact::softness`], [`grasp::contact::cost`]). Each finger touches nothing but its own joints and the root,
//! so its joints are eliminated exactly by a Cholesky factor of their own few rows, and what Newton's method factors does
//! not grow with the number of contacts ([`grasp::cones::arrow`]). A second, converged pass then holds what friction can hold
//! without MuJoCo's creep, as its noslip pass does by sweeps: a proximal step around the friction of the last step
//! (`grasp/cones/solve.rs`). Contacts are found anew in every step, so they roll, appear and open while grasped.
//!
//! That is [`grasp::Limits::Cones`], the default. [`grasp::Limits::Box`] is the thesis's Eqs. 4.1 to 4.3, one bound per
//! axis of a weld with the merged fingertips, and [`grasp::Limits::Rigid`] a plain weld: both for comparison.
//!
//! The [`guide`] takes those who know MuJoCo from an MJCF to a grasp, step by step, and `examples/` has whole programs.
//!
//! # Modules
//!
//! | module | what |
//! |---|---|
//! | [`mujoco`] | safe binding to MuJoCo 2.2.2 and 3: models, simulations, stages, contacts, rows, pictures |
//! | [`grasp`] | contacts, quality, phases and the constraint; [`grasp::Grasps::step`] in place of [`mujoco::Simulation::step`] |
//! | [`kinematics`] | fingertips to goals, by damped least squares |
//! | [`scenario`] | scenario files, runs in both modes, what became of the object, benches |
//! | [`report`] | plots, strips of frames, tables |
//! | [`view`] | an interactive window, and what was done in it, recorded and replayed |
//!
//! # Example
//!
//! Two soft fingertips hold a ball, and let it go.
//!
//! ```
//! use mujoco_grasp::grasp::{GraspId, GraspSpec, Grasps, Phase};
//! use mujoco_grasp::mujoco::{Model, Simulation};
//!
//! let model = Model::from_xml_string(
//!     r#"<mujoco>
//!       <option cone="elliptic"/>
//!       <default><geom condim="4" friction="1 0.01 0.001"/></default>
//!       <worldbody>
//!         <body name="palm" pos="0 0 0.3">
//!           <geom type="box" size="0.06 0.02 0.01"/>
//!           <body pos="-0.0415 0 -0.06">
//!             <joint name="left" type="slide" axis="1 0 0" damping="5"/>
//!             <geom size="0.012" mass="0.05"/>
//!           </body>
//!           <body pos="0.0415 0 -0.06">
//!             <joint name="right" type="slide" axis="-1 0 0" damping="5"/>
//!             <geom size="0.012" mass="0.05"/>
//!           </body>
//!         </body>
//!         <body name="ball" pos="0 0 0.24"><freejoint/><geom size="0.03" mass="0.1"/></body>
//!       </worldbody>
//!       <actuator><position joint="left" kp="300"/><position joint="right" kp="300"/></actuator>
//!     </mujoco>"#,
//! )?;
//! let mut sim = Simulation::new(&model)?;
//! let (ball, palm) = (sim.model().body("ball")?, sim.model().body("palm")?);
//! let mut grasps = Grasps::of(&sim, &GraspSpec::new(ball, palm))?;
//!
//! sim.ctrl_mut().fill(0.01);
//! while sim.time() < 1.0 {
//!     grasps.step(&mut sim)?;
//! }
//! assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Grasped);
//! assert!(sim.body_com(ball).z > 0.235);
//! println!("Q = {:.3} N on {} contacts", grasps[GraspId::FIRST].quality(), grasps[GraspId::FIRST].contacts().len());
//!
//! sim.ctrl_mut().fill(-0.02);
//! while sim.time() < 1.5 {
//!     grasps.step(&mut sim)?;
//! }
//! assert_eq!(grasps[GraspId::FIRST].phase(), Phase::Ungrasped);
//! assert!(sim.body_com(ball).z < 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! World frame, SI, angles in radians. Twists and wrenches are 6-vectors `[linear; angular]` (force; torque). A contact's
//! normal points into the target, and forces are those on the target. Nothing panics on what a caller can pass,
//! but for indexing with a handle of other grasps, as with a slice; every error says what, where, and what would be right.
#![deny(unsafe_code)]

pub mod grasp;
#[doc = include_str!("guide.md")]
pub mod guide {}
pub mod kinematics;
#[allow(unsafe_code)]
pub mod mujoco;
#[cfg(feature = "report")]
pub mod report;
#[cfg(feature = "scenario")]
pub mod scenario;
#[cfg(feature = "view")]
pub mod view;
#[cfg(any(feature = "report", feature = "scenario"))]
mod whole_file;

/// The README's Rust runs as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
