//! The scalar of the loss.

use crate::math::real::Real;
use std::ops::AddAssign;

/// What the loss needs of a number; f32 trains, f64 proves the gradient.
pub trait LossNumber: Real<Mask = bool> + Default + Send + Sync + PartialOrd + Into<f64> + AddAssign {}
impl LossNumber for f32 {}
impl LossNumber for f64 {}
