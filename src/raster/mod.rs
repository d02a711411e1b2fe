//! Draws scenes: soft (the paper) and solid (what an engine does).
