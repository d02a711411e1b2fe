//! The scalar of the loss.

use crate::math::real::Real;
use std::ops::AddAssign;

/// The number type of the loss: f32 for training, f64 for testing the gradient.
pub trait LossNumber: Real<Mask = bool> + Default + Send + Sync + PartialOrd + Into<f64> + AddAssign {}
impl LossNumber for f32 {}
impl LossNumber for f64 {}
