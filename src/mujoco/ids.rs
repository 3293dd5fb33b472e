//! Typed indices of model elements: a body cannot be mistaken for a geom.

use super::ffi;

/// An index of one kind of model element.
pub trait Id: Copy {
    /// "body", "joint", ...
    const KIND: &'static str;
    /// The engine's object type (mjtObj).
    #[doc(hidden)]
    const OBJECT: u32;
    /// Wraps a plain index; nothing is checked until it is used.
    fn from_index(index: usize) -> Self;
    /// The plain index.
    fn index(self) -> usize;
}

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident, $kind:literal, $object:ident;)*) => { $(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(usize);

        impl $name {
            /// Wraps a plain index; nothing is checked until it is used.
            pub const fn from_index(index: usize) -> Self { Self(index) }
            /// The plain index, as in the engine's arrays.
            pub const fn index(self) -> usize { self.0 }
        }

        impl Id for $name {
            const KIND: &'static str = $kind;
            const OBJECT: u32 = ffi::$object as u32;
            fn from_index(index: usize) -> Self { Self(index) }
            fn index(self) -> usize { self.0 }
        }
    )* };
}

ids! {
    /// A body; 0 is the world.
    BodyId, "body", mjOBJ_BODY;
    /// A joint.
    JointId, "joint", mjOBJ_JOINT;
    /// A geom (shape).
    GeomId, "geom", mjOBJ_GEOM;
    /// A site (massless marker frame).
    SiteId, "site", mjOBJ_SITE;
    /// A camera.
    CameraId, "camera", mjOBJ_CAMERA;
    /// A mesh.
    MeshId, "mesh", mjOBJ_MESH;
    /// An equality constraint.
    EqualityId, "equality constraint", mjOBJ_EQUALITY;
    /// A tendon.
    TendonId, "tendon", mjOBJ_TENDON;
    /// An actuator.
    ActuatorId, "actuator", mjOBJ_ACTUATOR;
    /// A sensor.
    SensorId, "sensor", mjOBJ_SENSOR;
    /// A keyframe.
    KeyframeId, "keyframe", mjOBJ_KEY;
}

impl BodyId {
    /// The world body, which never moves.
    pub const WORLD: BodyId = BodyId(0);
}
