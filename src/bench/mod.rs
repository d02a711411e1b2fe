//! Measures cost, stability and fidelity.
