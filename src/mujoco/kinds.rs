//! The engine's enumerations. A number that this crate does not know stays visible as `Other`.

use super::ffi;

macro_rules! kinds {
    ($($(#[$doc:meta])* $name:ident { $($(#[$vdoc:meta])* $variant:ident = $value:ident,)* })*) => { $(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[non_exhaustive]
        pub enum $name {
            $($(#[$vdoc])* $variant,)*
            /// A number that this crate does not know.
            Other(i32),
        }

        impl $name {
            /// From the engine's number.
            pub fn from_raw(raw: i32) -> Self {
                $(if raw == ffi::$value as i32 { return Self::$variant; })*
                Self::Other(raw)
            }

            /// The engine's number.
            pub fn raw(self) -> i32 {
                match self {
                    $(Self::$variant => ffi::$value as i32,)*
                    Self::Other(raw) => raw,
                }
            }
        }
    )* };
}

kinds! {
    /// How a step is integrated.
    Integrator {
        /// Semi-implicit Euler.
        Euler = mjINT_EULER,
        /// Runge-Kutta of order 4.
        Rk4 = mjINT_RK4,
        /// Implicit in velocity.
        Implicit = mjINT_IMPLICIT,
        /// Implicit in velocity, without the derivative of Coriolis forces (from MuJoCo 3 on).
        ImplicitFast = mjINT_IMPLICITFAST,
    }
    /// Shape of the friction cone.
    Cone {
        /// A pyramid with 2 (condim - 1) edges.
        Pyramidal = mjCONE_PYRAMIDAL,
        /// An elliptic cone.
        Elliptic = mjCONE_ELLIPTIC,
    }
    /// Storage of the constraint Jacobian.
    JacobianStorage {
        /// Dense.
        Dense = mjJAC_DENSE,
        /// Sparse.
        Sparse = mjJAC_SPARSE,
        /// Sparse from 60 degrees of freedom on.
        Auto = mjJAC_AUTO,
    }
    /// The constraint solver.
    Solver {
        /// Projected Gauss-Seidel.
        Pgs = mjSOL_PGS,
        /// Conjugate gradient.
        Cg = mjSOL_CG,
        /// Newton.
        Newton = mjSOL_NEWTON,
    }
    /// Type of a joint.
    JointKind {
        /// Six degrees of freedom, position and quaternion.
        Free = mjJNT_FREE,
        /// Three rotations, quaternion.
        Ball = mjJNT_BALL,
        /// One translation.
        Slide = mjJNT_SLIDE,
        /// One rotation.
        Hinge = mjJNT_HINGE,
    }
    /// Shape of a geom.
    GeomKind {
        /// Infinite plane.
        Plane = mjGEOM_PLANE,
        /// Height field.
        HeightField = mjGEOM_HFIELD,
        /// Sphere.
        Sphere = mjGEOM_SPHERE,
        /// Capsule.
        Capsule = mjGEOM_CAPSULE,
        /// Ellipsoid.
        Ellipsoid = mjGEOM_ELLIPSOID,
        /// Cylinder.
        Cylinder = mjGEOM_CYLINDER,
        /// Box.
        Box = mjGEOM_BOX,
        /// Convex hull of a mesh.
        Mesh = mjGEOM_MESH,
    }
    /// Type of an equality constraint.
    EqualityKind {
        /// A point of one body stays at a point of another.
        Connect = mjEQ_CONNECT,
        /// Two bodies keep their relative pose.
        Weld = mjEQ_WELD,
        /// Two joints are coupled.
        Joint = mjEQ_JOINT,
        /// Two tendons are coupled.
        Tendon = mjEQ_TENDON,
    }
    /// What an actuator acts on.
    TransmissionKind {
        /// A joint.
        Joint = mjTRN_JOINT,
        /// A joint, in its parent's frame.
        JointInParent = mjTRN_JOINTINPARENT,
        /// A joint through a slider-crank.
        SliderCrank = mjTRN_SLIDERCRANK,
        /// A tendon.
        Tendon = mjTRN_TENDON,
        /// A site.
        Site = mjTRN_SITE,
        /// The contacts of a body.
        Body = mjTRN_BODY,
    }
    /// What a tendon passes.
    WrapKind {
        /// A joint (fixed tendon).
        Joint = mjWRAP_JOINT,
        /// A pulley.
        Pulley = mjWRAP_PULLEY,
        /// A site.
        Site = mjWRAP_SITE,
        /// A sphere.
        Sphere = mjWRAP_SPHERE,
        /// A cylinder.
        Cylinder = mjWRAP_CYLINDER,
    }
    /// Type of a constraint row.
    RowKind {
        /// An equality constraint.
        Equality = mjCNSTR_EQUALITY,
        /// Friction of a degree of freedom.
        FrictionDof = mjCNSTR_FRICTION_DOF,
        /// Friction of a tendon.
        FrictionTendon = mjCNSTR_FRICTION_TENDON,
        /// Limit of a joint.
        LimitJoint = mjCNSTR_LIMIT_JOINT,
        /// Limit of a tendon.
        LimitTendon = mjCNSTR_LIMIT_TENDON,
        /// A contact without friction.
        ContactFrictionless = mjCNSTR_CONTACT_FRICTIONLESS,
        /// An edge of a contact's friction pyramid.
        ContactPyramidal = mjCNSTR_CONTACT_PYRAMIDAL,
        /// An axis of a contact's elliptic cone.
        ContactElliptic = mjCNSTR_CONTACT_ELLIPTIC,
    }
    /// What a constraint row does after the solve.
    RowState {
        /// No force (limit or contact).
        Satisfied = mjCNSTRSTATE_SATISFIED,
        /// Active, within its bounds.
        Quadratic = mjCNSTRSTATE_QUADRATIC,
        /// A friction row at its upper limit: the force is +frictionloss.
        AtUpperLimit = mjCNSTRSTATE_LINEARNEG,
        /// A friction row at its lower limit: the force is -frictionloss.
        AtLowerLimit = mjCNSTRSTATE_LINEARPOS,
        /// An elliptic contact that slides.
        Cone = mjCNSTRSTATE_CONE,
    }
}
