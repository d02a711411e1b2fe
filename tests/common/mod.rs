//! What several tests share.
#![allow(dead_code)]

pub mod dual;
pub mod oracle;
