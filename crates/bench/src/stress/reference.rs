//! The exact oracles of the tests: the paper's equations in double precision and on dual numbers, and a ray caster.

#![allow(dead_code, unreachable_pub, reason = "the tests of the rasterisers use more of them")]

#[path = "../../../../tests/common/dual.rs"]
mod dual;
#[path = "../../../../tests/common/exact.rs"]
pub(super) mod exact;
#[path = "../../../../tests/common/oracle.rs"]
pub(super) mod oracle;
#[path = "../../../../tests/common/ray_caster.rs"]
pub(super) mod ray_caster;
