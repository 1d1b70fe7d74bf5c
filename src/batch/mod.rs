//! Many records: yield, process statistics, store.
