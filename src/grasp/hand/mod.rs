//! Which bodies and joints are hand, fingers and target.
pub(crate) mod search;
pub(crate) mod topology;
