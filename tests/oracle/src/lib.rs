//! Exact oracles: the paper's equations in double precision and on dual numbers, and a ray caster.
#![allow(missing_docs, reason = "names of the paper's symbols")]

pub mod dual;
pub mod exact;
pub mod frame;
pub mod ray_caster;
