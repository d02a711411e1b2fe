//! What several tests share.
#![allow(dead_code)]

pub(crate) mod dual;
pub(crate) mod oracle;
