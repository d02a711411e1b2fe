//! COFF as the authors' exporter writes it (read only).
