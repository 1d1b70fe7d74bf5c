//! Plan x rig -> record.
