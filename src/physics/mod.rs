//! Effects, one file each, and the pipeline that simulates a valve.
