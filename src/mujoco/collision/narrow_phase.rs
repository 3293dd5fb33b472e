//! Collision detection for chosen geoms only, with the engine's own narrow phase.

// A distance that is not a number must count as too near: `!(a > b)` says that, `a <= b` does not.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::pairs::{TestedPair, detects, tested_pairs};
use super::parameters::ContactParameters;
use crate::mujoco::compat;
use crate::mujoco::contact::Contact;
use crate::mujoco::error::{Error, check_index};
use crate::mujoco::ffi;
use crate::mujoco::ids::{BodyId, GeomId, Id};
use crate::mujoco::simulation::Simulation;
use nalgebra::{Matrix3, Vector3};

const NAME: &str = "mjCOLLISIONFUNC";

/// Finds the contacts between two sets of geoms as [`Simulation::collision`] would, at a fraction of its cost: no other
/// pair is looked at, and there is no broad phase.
///
/// The contacts are those of the engine bit for bit, in its order, except that (engine_collision_driver.c)
/// - the engine's broad phase works in single precision and with the geoms' own margins, so it may lose contacts of bodies
///   that barely touch, or that only a larger override margin reaches;
/// - MuJoCo 2.2.2 tests a plane of a static body other than the world twice, if something passes close to its origin;
/// - the engine stops when the list (`nconmax`) or, in MuJoCo 3, the arena is full.
///
/// [`is_certain`](Self::is_certain) says of contacts that were found whether all of this can be ruled out.
#[derive(Clone)]
pub struct PairCollider {
    pub(super) pairs: Vec<TestedPair>,
    probes: Vec<Probe>,
    parameters: Vec<ContactParameters>,
    /// What the engine writes a pair's contacts to.
    buffer: Buffer,
    /// Of the model, see [`CompiledModel::origin`](crate::mujoco::CompiledModel::origin).
    pub(super) origin: u64,
    /// The engine may test a pair twice.
    twice: bool,
}

/// What the bounding spheres of a pair are tested with.
#[derive(Debug, Clone, Copy)]
struct Probe {
    geoms: [u32; 2],
    test: Bound,
    /// Both geoms are boxes.
    boxes: bool,
    /// No contact beyond this distance, m.
    reach: f64,
    /// A box in the pair: a long one's bounding sphere says little.
    slab: Option<Slab>,
}

/// A box, and how far from it the centre of the other geom's bounding sphere may be.
#[derive(Debug, Clone, Copy)]
struct Slab {
    geom: u32,
    other: u32,
    half: [f64; 3],
    reach: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Bound {
    /// Distance of the centres.
    Spheres,
    /// Height of the second centre above the first geom, a plane.
    Plane,
    /// A geom has no bounding sphere.
    Nothing,
}

impl std::fmt::Debug for PairCollider {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PairCollider").field("pairs", &self.pairs.len()).finish_non_exhaustive()
    }
}

impl PairCollider {
    /// For all pairs of a geom of `first` and a geom of `second` that collision detection tests. Geoms that the engine
    /// does not collide (contype and conaffinity, welded bodies, parent and child, `<exclude>`) give no pair.
    ///
    /// Fails as [`of_sets`](Self::of_sets).
    pub fn new(sim: &Simulation, first: &[GeomId], second: &[GeomId]) -> Result<Self, Error> {
        Self::of_sets(sim, &[[first, second]])
    }

    /// As [`new`](Self::new), for the pairs of several sets at once.
    ///
    /// Fails if a geom does not exist, and with [`Error::Unsupported`] where [`supported`](Self::supported) says no or a
    /// pair has what a [`Contact`] does not say (signed distance fields, adhesion, `solreffriction`).
    pub fn of_sets(sim: &Simulation, sets: &[[&[GeomId]; 2]]) -> Result<Self, Error> {
        if !Self::supported() {
            let version = compat::header_version();
            return Err(Error::Unsupported(format!("the narrow phase of MuJoCo {version} cannot be called alone")));
        }
        let model = sim.model();
        let members = |geoms: &[GeomId]| {
            let mut inside = vec![false; model.ngeom()];
            for geom in geoms {
                check_index(GeomId::KIND, geom.index(), model.ngeom())?;
                inside[geom.index()] = true;
            }
            Ok(inside)
        };
        let sets = sets.iter().map(|[first, second]| Ok((members(first)?, members(second)?)));
        let sets = sets.collect::<Result<Vec<_>, Error>>()?;
        let mut pairs = tested_pairs(sim);
        pairs.retain(|pair| {
            let [a, b] = pair.geoms;
            sets.iter().any(|(first, second)| (first[a] && second[b]) || (first[b] && second[a]))
        });
        if let Some(pair) = pairs.iter().find(|pair| !compat::is_plain(sim.model_fields(), pair.geoms, pair.predefined))
        {
            let [a, b] = pair.geoms.map(|geom| model.label(GeomId::from_index(geom)));
            return Err(Error::Unsupported(format!(
                "contacts of {a} and {b} have adhesion, a friction reference or a signed distance field, which the narrow \
                 phase alone does not give"
            )));
        }
        let parameters: Vec<_> = pairs.iter().map(|pair| ContactParameters::new(model, pair)).collect();
        let probes =
            pairs.iter().zip(&parameters).map(|(pair, parameters)| Probe::new(sim, pair, parameters.reach)).collect();
        let twice = compat::REPEATS_PLANES && any_plane(sim, &pairs);
        Ok(Self { pairs, probes, parameters, buffer: Buffer::new(), origin: model.origin(), twice })
    }

    /// Whether this version of the engine lets its narrow phase be called alone (2.2.2 does, and 3.9 and later do).
    pub fn supported() -> bool {
        compat::NARROW_PHASE
    }

    /// Number of geom pairs.
    pub fn pair_count(&self) -> usize {
        self.pairs.len()
    }

    /// Whether a contact of these two geoms is one that this collider finds. The order does not matter.
    pub fn covers(&self, geoms: [GeomId; 2]) -> bool {
        let [a, b] = geoms.map(GeomId::index);
        self.pairs.iter().any(|pair| pair.geoms == [a, b] || pair.geoms == [b, a])
    }

    /// Replaces `out` by the contacts of the present poses (see [`Simulation::kinematics`]); allocates nothing once
    /// `out` is large enough. Poses and friction are those of `sim`, the other parameters are those of [`new`](Self::new).
    ///
    /// Fails, with an empty `out`, for a simulation of another model or on an engine fault.
    pub fn collide(&mut self, sim: &Simulation, out: &mut Vec<Contact>) -> Result<(), Error> {
        out.clear();
        self.check_model(sim)?;
        if !detects(sim) {
            return Ok(());
        }
        let buffer = &mut self.buffer;
        let result = sim.query(NAME, |m, d| {
            for (i, probe) in self.probes.iter().enumerate() {
                // SAFETY: the data is of the model that the probe was made for.
                if unsafe { probe.may_touch(d) } {
                    let (pair, parameters) = (&self.pairs[i], &self.parameters[i]);
                    // SAFETY: model and data belong together, and have the pair's geoms.
                    let found = unsafe { buffer.collide(m, d, pair.geoms, parameters.reach) };
                    let found = if compat::REPEATS_POINTS && probe.boxes { without_repeats(found) } else { found };
                    let friction = parameters.friction(sim.model());
                    for raw in found {
                        out.push(contact(raw, pair, parameters, friction)?);
                    }
                }
            }
            Ok(())
        });
        let result = result.flatten();
        if result.is_err() {
            out.clear();
        }
        result
    }

    /// That `sim` is of the model that this was made for.
    pub(super) fn check_model(&self, sim: &Simulation) -> Result<(), Error> {
        sim.model().check_origin(self.origin, "a pair collider")
    }

    /// Whether it is certain that the engine's collision stage would put exactly these contacts of this collider into its
    /// list: `found` at the present poses, and nothing else being near. Allocates nothing.
    pub fn is_certain(&self, sim: &Simulation, found: &[Contact]) -> bool {
        !self.twice
            && found.len() <= compat::contact_room(sim.model_fields(), sim.data())
            && found.chunk_by(|a, b| a.geoms == b.geoms).all(|of_one_pair| broad_phase_keeps(sim, of_one_pair))
    }
}

/// More than what single precision takes from the overlap of two boxes, relative to the coordinates of their faces: 2^-24
/// for each of two faces, and some for the axes.
const PRECISION: f64 = 1.0 / (1 << 22) as f64;

/// More than what the narrow phase errs, relative to the geoms' sizes.
const ACCURACY: f64 = 1e-6;

/// Whether two geoms with these contacts are so close that the boxes around them, widened by their margins, overlap along
/// any axis by more than rounding.
fn broad_phase_keeps(sim: &Simulation, of_one_pair: &[Contact]) -> bool {
    let model = sim.model();
    let [a, b] = of_one_pair[0].geoms.map(|geom| geom.index());
    let position = |geom: usize| Vector3::from_column_slice(&sim.geom_xpos()[3 * geom..3 * geom + 3]);
    let mut margin = model.geom_margin()[a] + model.geom_margin()[b];
    if model.overrides_contacts() {
        margin = margin.min(model.contact_override().0);
    }
    let size = model.geom_rbound()[a] + model.geom_rbound()[b];
    let rounding = PRECISION * (position(a).norm() + position(b).norm() + size) + ACCURACY * size;
    // Written so that a distance that is not a number is not certain.
    of_one_pair.iter().any(|contact| contact.dist < margin - rounding)
}

/// Whether a body of a pair is static, but not the world, and has a plane or height field.
fn any_plane(sim: &Simulation, pairs: &[TestedPair]) -> bool {
    let model = sim.model();
    let open = |geom: usize| matches!(model.geom_type()[geom] as u32, ffi::mjGEOM_PLANE | ffi::mjGEOM_HFIELD);
    let has = |body: usize| {
        let geoms = 0..model.ngeom();
        body != 0
            && model.body_weldid()[body] == 0
            && geoms.filter(|&geom| model.geom_bodyid()[geom] as usize == body).any(open)
    };
    pairs.iter().flat_map(|pair| pair.bodies).any(has)
}

impl Probe {
    fn new(sim: &Simulation, pair: &TestedPair, margin: f64) -> Self {
        let [radius1, radius2] = pair.geoms.map(|geom| sim.model().geom_rbound()[geom]);
        let kinds = pair.geoms.map(|geom| sim.model().geom_type()[geom]);
        let plane = kinds[0] == ffi::mjGEOM_PLANE as i32;
        let (test, reach) = if radius1 > 0.0 && radius2 > 0.0 {
            (Bound::Spheres, radius1 + radius2 + margin)
        } else if plane && radius2 > 0.0 {
            (Bound::Plane, margin + radius2)
        } else {
            (Bound::Nothing, f64::INFINITY)
        };
        let is_box = kinds.map(|kind| kind == ffi::mjGEOM_BOX as i32);
        let slab = (test == Bound::Spheres).then(|| is_box.iter().position(|&is| is)).flatten().map(|first| {
            let [geom, other] = [pair.geoms[first], pair.geoms[1 - first]];
            let size = &sim.model().geom_size()[3 * geom..3 * geom + 3];
            let reach = (sim.model().geom_rbound()[other] + margin) * (1.0 + ROUNDING);
            Slab { geom: geom as u32, other: other as u32, half: [size[0], size[1], size[2]], reach }
        });
        Self { geoms: pair.geoms.map(|geom| geom as u32), test, boxes: is_box == [true; 2], reach, slab }
    }

    /// # Safety
    /// `d` is valid and has this probe's geoms.
    #[inline]
    unsafe fn may_touch(&self, d: *const ffi::mjData) -> bool {
        let [geom1, geom2] = self.geoms.map(|geom| geom as usize);
        // SAFETY: three numbers per geom.
        let position = |geom: usize| unsafe { *(*d).geom_xpos.add(3 * geom).cast::<[f64; 3]>() };
        let ([x1, y1, z1], [x2, y2, z2]) = (position(geom1), position(geom2));
        let (x, y, z) = (x2 - x1, y2 - y1, z2 - z1);
        let distance = match self.test {
            Bound::Spheres => (x * x + y * y + z * z).sqrt(),
            Bound::Plane => {
                // SAFETY: nine numbers per geom.
                let axes = unsafe { *(*d).geom_xmat.add(9 * geom1).cast::<[f64; 9]>() };
                x * axes[2] + y * axes[5] + z * axes[8]
            }
            Bound::Nothing => return true,
        };
        // Like the engine, a pose that is not a number goes on.
        // SAFETY: the box and its partner are this probe's geoms.
        !(distance > self.reach) && self.slab.is_none_or(|slab| unsafe { slab.may_touch(d) })
    }
}

/// More than rounding can add to a distance, relative.
const ROUNDING: f64 = 1e-9;

impl Slab {
    /// Whether the other geom's bounding sphere comes near the box.
    ///
    /// # Safety
    /// `d` is valid and has both geoms.
    #[inline]
    unsafe fn may_touch(&self, d: *const ffi::mjData) -> bool {
        // SAFETY: three and nine numbers per geom.
        let (centre, other, axes) = unsafe {
            (
                *(*d).geom_xpos.add(3 * self.geom as usize).cast::<[f64; 3]>(),
                *(*d).geom_xpos.add(3 * self.other as usize).cast::<[f64; 3]>(),
                *(*d).geom_xmat.add(9 * self.geom as usize).cast::<[f64; 9]>(),
            )
        };
        let away: [f64; 3] = std::array::from_fn(|i| other[i] - centre[i]);
        let outside = |i: usize| {
            let along = away[0] * axes[i] + away[1] * axes[3 + i] + away[2] * axes[6 + i];
            (along.abs() - self.half[i]).max(0.0)
        };
        let square: f64 = (0..3).map(|i| outside(i) * outside(i)).sum();
        // The same for a pose that is not a number (whose outside `max` turns into zero).
        !(square > self.reach * self.reach)
    }
}

/// Room for what the engine finds for one pair.
#[derive(Clone)]
pub(super) struct Buffer(Box<[compat::Raw]>);

impl Buffer {
    pub fn new() -> Self {
        // SAFETY: a structure of plain numbers.
        let empty: compat::Raw = unsafe { std::mem::zeroed() };
        Self(vec![empty; ffi::mjMAXCONPAIR as usize].into_boxed_slice())
    }

    /// Runs the engine's collision function of two geoms. Of a contact it sets distance, position and the first two axes
    /// of the frame.
    ///
    /// # Safety
    /// `m` and `d` are valid, belong together and have these geoms, and nothing holds a reference to the poses: the
    /// engine changes them for a while.
    unsafe fn collide(
        &mut self,
        m: *const ffi::mjModel,
        d: *mut ffi::mjData,
        geoms: [usize; 2],
        margin: f64,
    ) -> &mut [compat::Raw] {
        // SAFETY: every geom has a type.
        let kinds = geoms.map(|geom| unsafe { *(*m).geom_type.add(geom) });
        let [geom1, geom2] = geoms.map(|geom| geom as i32);
        let Some(function) = compat::narrow_phase(kinds) else {
            return &mut [];
        };
        // SAFETY: the function is that of the geoms' types, and writes no more than mjMAXCONPAIR contacts.
        let found = unsafe { function(m, d, self.0.as_mut_ptr(), geom1, geom2, margin) };
        let found = (found.max(0) as usize).min(self.0.len());
        &mut self.0[..found]
    }
}

/// Two boxes may give a point several times; the engine keeps the last.
fn without_repeats(found: &mut [compat::Raw]) -> &mut [compat::Raw] {
    let mut kept = 0;
    for i in 0..found.len() {
        let repeated = found[i + 1..].iter().any(|later| later.pos == found[i].pos);
        if !repeated {
            found[kept] = found[i];
            kept += 1;
        }
    }
    &mut found[..kept]
}

fn contact(
    raw: &compat::Raw,
    pair: &TestedPair,
    parameters: &ContactParameters,
    friction: [f64; 5],
) -> Result<Contact, Error> {
    Ok(Contact {
        geoms: pair.geoms.map(GeomId::from_index),
        bodies: pair.bodies.map(BodyId::from_index),
        position: raw.pos.into(),
        frame: complete_frame(&compat::axes(raw))?,
        dist: raw.dist,
        include_margin: parameters.include_margin,
        condim: parameters.condim,
        friction,
        solref: parameters.solref,
        solimp: parameters.solimp,
        // Written so that a distance that is not a number is excluded, as by the engine.
        excluded: !(raw.dist < parameters.include_margin),
        efc_address: None,
    })
}

/// mju_makeFrame: the normal, the tangent hint made orthogonal to it (or y, or z), and their cross product, as rows.
/// The order of operations is the engine's.
fn complete_frame(raw: &[f64; 6]) -> Result<Matrix3<f64>, Error> {
    let [x0, x1, x2, y0, y1, y2] = *raw;
    let (normal, length) = normalized([x0, x1, x2]);
    if length < 0.5 {
        return Err(Error::Engine { call: NAME, message: "xaxis of contact frame undefined".into() });
    }
    let mut hint = [y0, y1, y2];
    if dot(&hint, &hint).sqrt() < 0.5 {
        hint = if normal[1] < 0.5 && normal[1] > -0.5 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    }
    let along = dot(&normal, &hint);
    let (tangent, _) = normalized(std::array::from_fn(|i| hint[i] - normal[i] * along));
    let (n, t) = (Vector3::from(normal), Vector3::from(tangent));
    let b = n.cross(&t);
    Ok(Matrix3::new(n.x, n.y, n.z, t.x, t.y, t.z, b.x, b.y, b.z))
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// mju_normalize3: the unit vector (x if there is none) and the length.
fn normalized(v: [f64; 3]) -> ([f64; 3], f64) {
    let length = dot(&v, &v).sqrt();
    if length < ffi::mjMINVAL {
        return ([1.0, 0.0, 0.0], length);
    }
    let inverse = 1.0 / length;
    (v.map(|x| x * inverse), length)
}
