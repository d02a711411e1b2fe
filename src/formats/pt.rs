//! The authors' PyTorch checkpoints and their successors' (read only).
