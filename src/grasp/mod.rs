pub mod arrow;
pub mod cone;
pub mod dense;
pub mod rows;
pub mod softness;
pub mod topology;
