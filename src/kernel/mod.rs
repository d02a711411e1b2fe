//! The paper's formulas: pure functions, no buffers, no I/O.
